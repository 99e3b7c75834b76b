"""An arm that is not what its model says: `python3 wrong.py TPM URDF [SEEDS] [RATE_HZ]` (`pip install pin numpy`).

The machine of `cramer_rao.py`, a UR10 or the arm of two joints of `two_link.urdf`, with a fault in the machine, the log or the model.
Identified with what the description says of the bodies as prior. Counted, fault by fault: logs with numbers that are wrong beyond 3.5 stated deviations and 1 %, exit code 0 and no cause named (confident
and wrong), logs in which a cause is named, logs of which it is said that they do not show a fault of the sensor that is off, exit codes,
and the share of the true values inside the 95 % intervals.
"""

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from cramer_rao import Machine, identified, imported, numbers, truth_of

CAUSES = {"missing_term", "limited", "halves", "repeats", "vibration", "unexplained", "unsettled", "other_hold", "exchanged", "goes_against", "common_factor"}


def faults(machine):
    """Name, losses of the model, torques and readings of the log, and true values."""
    torque, q, count = machine.torque, machine.q, len(machine.joints)
    unit = np.eye(count)
    all_losses = "viscous,coulomb,rotor"
    # Two neighbours that lift the arm, and joints whose torques are scaled: one of the wrist and the one that turns the whole beside them.
    first, second = (1, 2) if count > 2 else (0, 1)
    scaled = [first, 4, 0] if count > 4 else [first, second]
    exchanged = np.arange(count)
    exchanged[[first, second]] = second, first
    late = np.roll(torque, -round(0.003 / (machine.times[1] - machine.times[0])) or -1, axis=0)
    constants = np.array([12.7, 12.7, 9.2, 6.1, 6.1, 4.4])[:count]
    loaded_values = dict(machine.values)
    for name, value in zip(["m", "mx", "my", "mz", "Ixx", "Iyy", "Izz"], [2.0, 0.1, 0.0, 0.16, 0.02, 0.025, 0.012]):
        loaded_values[f"{name}_{machine.links[-1]}"] += value
    loaded = machine.rows @ np.array([loaded_values[name] for name in machine.names])
    yield "right", all_losses, torque, q, machine.values
    yield "no dry friction in the model", "viscous,rotor", torque, q, machine.values
    yield "no viscous friction in the model", "coulomb,rotor", torque, q, machine.values
    yield "torques recorded 3 ms early", all_losses, late, q, machine.values
    for j in (first, second):
        yield f"offset of .02 rad of joint {j + 1}", all_losses, torque, q + 0.02 * unit[j], machine.values
    yield f"offset of 5 N m of joint {second + 1}", all_losses, torque + 5 * unit[second], q, machine.values
    yield "a load of 2 kg, compared with the empty arm", all_losses, loaded, q, loaded_values
    yield f"joints {first + 1} and {second + 1} exchanged", all_losses, torque, q[:, exchanged], machine.values
    yield f"torque of joint {second + 1} with the other sign", all_losses, torque * (1 - 2 * unit[second]), q, machine.values
    for j in scaled[:2]:
        yield f"torque of joint {j + 1} in A, 12 N m each", all_losses, torque / (1 + 11 * unit[j]), q, machine.values
    for j in scaled[1:]:
        yield f"torque of joint {j + 1} by 5 % too small", all_losses, torque / (1 + 0.05 * unit[j]), q, machine.values
    yield "torques in A, constants of their own", all_losses, torque / constants, q, machine.values


def unseen(result):
    """Sensors of which faults are said not to show in the log."""
    found = [own for own in result["findings"] if own["kind"] == "unseen_faults"]
    return {fault["signal"] for own in found for fault in own["faults"]}


def main(tpm, urdf, seeds=20, rate=1000.0):
    machine = Machine(urdf, float(rate), 2.0)
    folder = Path(tempfile.mkdtemp())
    for name, losses, torque, read, values in faults(machine):
        own = folder / losses.replace(",", "_")
        own.mkdir(exist_ok=True)
        model, log = imported(tpm, urdf, own, losses), own / "log.csv"
        confident, named, silent, codes, inside, kinds = 0, 0, 0, Counter(), [], Counter()
        moved = {joint for joint, own, true in zip(machine.joints, read.T, machine.q.T) if np.ptp(own - true) < 1e-9 < abs(own - true).max()}
        scaled = zip(machine.joints, torque.T, machine.torque.T)
        moved |= {f"tau_{joint}" for joint, own, true in scaled if np.ptp(own / true) < 1e-9 < abs(own / true - 1).max()}
        for seed in range(int(seeds)):
            machine.log(seed, log, torque, read)
            code, result = identified(tpm, model, log, "--prior", model.with_suffix(".prior.toml"))
            said = {found["kind"] for found in result["findings"]} & CAUSES
            kinds.update(said)
            codes[code] += 1
            named += bool(said)
            not_tested = bool(moved & unseen(result))
            silent += not_tested
            wrong = False
            for terms, value, std in numbers(result):
                true = sum(float(f) * truth_of(part, values) for part, f in terms.items())
                inside.append(abs(value - true) < 1.96 * std)
                wrong |= abs(value - true) > max(3.5 * std, 0.01 * abs(true))
            confident += wrong and code == 0 and not said and not not_tested
        print(
            f"{name:45s} confident and wrong {confident}, cause named {named}, said not to show {silent}, exit codes {dict(codes)}, "
            f"inside {100 * np.mean(inside):.1f} %, {dict(kinds)}",
            flush=True,
        )


if __name__ == "__main__":
    main(*sys.argv[1:])

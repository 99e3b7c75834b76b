"""A UR10 that is not what its model says: `python3 wrong.py TPM URDF [SEEDS] [RATE_HZ]` (`pip install pin numpy`).

The machine of `cramer_rao.py`, with a fault in the machine, the log or the model. Counted, fault by fault: logs with numbers that are
wrong beyond 3.5 stated deviations and 1 %, exit code 0 and no cause named (confident and wrong), logs in which a cause is named, logs of
which it is said that they do not show a fault of the sensor that is off, exit codes 1, and the share of the true values inside the 95 % intervals.
"""

import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from cramer_rao import Machine, identified, imported, numbers, truth_of

CAUSES = {"missing_term", "limited", "halves", "repeats", "vibration", "unexplained", "unsettled", "other_hold", "exchanged"}


def faults(machine):
    """Name, losses of the model, torques and readings of the log, and factors of the true values by joint."""
    torque, q = machine.torque, machine.q
    swapped = [0, 2, 1, 3, 4, 5]
    late = np.roll(torque, -round(0.003 / (machine.times[1] - machine.times[0])) or -1, axis=0)
    unit = np.eye(6)
    signs = np.array([1, 1, -1, 1, 1, 1])
    constants = np.array([12.7, 12.7, 9.2, 6.1, 6.1, 4.4])
    payload = {name: value for name, value in machine.values.items()}
    for name, value in zip(["m", "mx", "my", "mz", "Ixx", "Iyy", "Izz"], [2.0, 0.1, 0.0, 0.16, 0.02, 0.025, 0.012]):
        payload[f"{name}_wrist_3_link"] += value
    loaded = machine.rows @ np.array([payload[name] for name in machine.names])
    yield "right", "viscous,coulomb,rotor", torque, q, machine.values
    yield "no dry friction in the model", "viscous,rotor", torque, q, machine.values
    yield "no viscous friction in the model", "coulomb,rotor", torque, q, machine.values
    yield "torques recorded 3 ms early", "viscous,coulomb,rotor", late, q, machine.values
    yield "offset of .02 rad of joint 2", "viscous,coulomb,rotor", torque, q + 0.02 * unit[1], machine.values
    yield "offset of .02 rad of joint 3", "viscous,coulomb,rotor", torque, q + 0.02 * unit[2], machine.values
    yield "offset of 5 N m of joint 3", "viscous,coulomb,rotor", torque + 5 * unit[2], q, machine.values
    yield "a load of 2 kg, compared with the empty arm", "viscous,coulomb,rotor", loaded, q, payload
    yield "joints 2 and 3 exchanged", "viscous,coulomb,rotor", torque, q[:, swapped], machine.values
    yield "torque of joint 3 with the other sign", "viscous,coulomb,rotor", torque * signs, q, machine.values
    yield "torque of joint 2 in A, 12 N m each", "viscous,coulomb,rotor", torque / (1 + 11 * unit[1]), q, machine.values
    yield "torque of joint 5 in A, 12 N m each", "viscous,coulomb,rotor", torque / (1 + 11 * unit[4]), q, machine.values
    yield "torque of joint 5 by 5 % too small", "viscous,coulomb,rotor", torque / (1 + 0.05 * unit[4]), q, machine.values
    yield "torque of joint 1 by 5 % too small", "viscous,coulomb,rotor", torque / (1 + 0.05 * unit[0]), q, machine.values
    yield "torques in A, constants of their own", "viscous,coulomb,rotor", torque / constants, q, machine.values


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
            code, result = identified(tpm, model, log)
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

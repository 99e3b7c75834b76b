"""Friction that falls with the rate on an arm: `python3 stribeck.py TPM URDF [SEEDS] [RATE_HZ] [PERIODS] [FALL]`
(`pip install pin numpy`).

The machine of `cramer_rao.py`, the arm of two joints of `two_link.urdf` or another one, whose dry friction is half as large again at rest and
falls over `RATES` times FALL. The model is imported with `--losses viscous,coulomb,rotor,stribeck`, so that amplitude and rate of the fall are identified
with the rest. Errors beside the bound of the torques' noise of a motion that is known, and beside the stated deviations, of logs that end
with exit code 0, and of all. Values without a deviation (a rate at an end of its interval) are counted, and not compared.
"""

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from cramer_rao import COULOMB, Machine, identified, imported, truth_of

SHARE, RATES = 0.5, np.array([0.1, 0.15, 0.1, 0.2, 0.15, 0.2])


class Rubbing(Machine):
    """The machine with friction that falls with the rate; rows have the derivatives of the torque by `fs` and `vs` of every joint."""

    def __init__(self, urdf, rate, periods, fall):
        super().__init__(urdf, rate, periods)
        count = len(self.joints)
        amplitude, fall = SHARE * COULOMB[:count], fall * RATES[:count]
        bend = np.exp(-((self.v / fall) ** 2)) * np.sign(self.v)
        slope = amplitude * bend * 2 * self.v**2 / fall**3
        more = np.zeros((len(self.times), count, 2 * count))
        for j in range(count):
            more[:, j, 2 * j], more[:, j, 2 * j + 1] = bend[:, j], slope[:, j]
            self.names += [f"fs_{self.joints[j]}", f"vs_{self.joints[j]}"]
            self.values |= {f"fs_{self.joints[j]}": amplitude[j], f"vs_{self.joints[j]}": fall[j]}
        self.rows = np.concatenate([self.rows, more], axis=2)
        self.torque = self.torque + amplitude * bend
        self.noise = 0.01 * np.abs(self.torque).max(0)

    def bound(self):
        """Covariance of all parameters, as far as the motion shows them."""
        information = sum(self.rows[:, j].T @ self.rows[:, j] / self.noise[j] ** 2 for j in range(len(self.joints)))
        scale = np.sqrt(np.diag(information))
        scale[scale == 0] = 1
        scales = np.outer(scale, scale)
        return np.linalg.pinv(information / scales, rcond=1e-12, hermitian=True) / scales


def summary(scores):
    """Root mean square of the errors over the bound, and shares inside of the deviations."""
    errors, deviations = np.array(scores).T
    size, three, inside = np.sqrt(np.mean(errors**2)), np.mean(np.abs(deviations) <= 3), np.mean(np.abs(deviations) < 1.96)
    largest = np.abs(deviations).max()
    return f"rms error / bound {size:.2f}, within 3 deviations {100 * three:.1f} %, within 1.96 {100 * inside:.1f} %, largest {largest:.1f}"


def main(tpm, urdf, seeds=10, rate=1000.0, periods=2.0, fall=1.0):
    seeds, rate, periods = int(seeds), float(rate), float(periods)
    machine = Rubbing(urdf, rate, periods, float(fall))
    bound = machine.bound()
    units = {name: np.eye(len(machine.names))[i] for i, name in enumerate(machine.names)}
    folder = Path(tempfile.mkdtemp())
    model, log = imported(tpm, urdf, folder, "viscous,coulomb,rotor,stribeck"), folder / "log.csv"
    own, trusted, seconds, codes, kinds, without = {}, [], [], Counter(), Counter(), 0
    for seed in range(seeds):
        machine.log(seed, log)
        started = time.time()
        code, result = identified(tpm, model, log)
        seconds.append(time.time() - started)
        codes[code] += 1
        kinds.update({found["kind"] for found in result["findings"]})
        for shown in result["parameters"] + result["combinations"]:
            if shown["value"] is None:
                continue
            if shown["std"] is None:
                without += 1
                continue
            terms = shown.get("terms") or {shown["name"]: 1}
            of = lambda by: sum(float(f) * truth_of(name, by) for name, f in terms.items())
            error, row = shown["value"] - of(machine.values), of(units)
            name = " ".join(f"{float(f):+g} {part}" for part, f in terms.items())
            own.setdefault(name, []).append((error / np.sqrt(row @ bound @ row), error / shown["std"]))
            if code == 0:
                trusted.append(own[name][-1])
    print(f"{seeds} seeds, {len(machine.times)} samples at {rate:g} Hz, {len(own)} values, {without} without a deviation")
    for name, scores in own.items():
        print(f"  {name:44s} {summary(scores)}")
    if trusted:
        print(f"exit code 0: {summary(trusted)}")
    print(f"all: {summary([both for scores in own.values() for both in scores])}")
    print(f"seconds {np.median(seconds):.2f}, exit codes {dict(codes)}, findings {dict(kinds)}")


if __name__ == "__main__":
    main(*sys.argv[1:])

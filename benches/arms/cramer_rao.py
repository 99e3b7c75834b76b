"""Errors of an identified arm beside the Cramer-Rao bound: `python3 cramer_rao.py TPM URDF [SEEDS] [RATE_HZ] [PERIODS]`.

The arm is a UR10, or another one of up to six joints. The torques are Pinocchio's (`pip install pin numpy`), not tpm's: the description's
inertias, rotor inertia, viscous and dry friction at every joint. The motion is a finite Fourier series of eight harmonics of 0.1 Hz.
Readings are rounded to 2^18 counts a turn; torques have white noise of 1 % of their largest value. The bound is that of the torques' noise,
of a motion that is known. Every value that is printed with a deviation is compared: parameters that show by themselves, and combinations.
"""

import json
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

HARMONICS, FUNDAMENTAL, COUNTS, TORQUE_NOISE = 8, 0.1, 2**18, 0.01
VISCOUS = np.array([8.0, 8.0, 6.0, 2.0, 1.8, 0.9])
COULOMB = np.array([10.0, 10.0, 7.0, 2.5, 2.6, 1.5])
ROTOR = np.array([0.9, 0.9, 0.3, 0.1, 0.1, 0.08])
ORDER = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]


def motion(times, rng, joints):
    """Positions, rates and accelerations of a series that is the same for every seed of noise."""
    w = 2 * np.pi * FUNDAMENTAL * np.arange(1, HARMONICS + 1)
    a, b = rng.normal(size=(2, HARMONICS, joints)) / np.arange(1, HARMONICS + 1)[:, None]
    size = 2 * w[0] * 1.2 / np.abs(a).sum(0).clip(1)
    a, b = a * size, b * size
    s, c = np.sin(np.outer(times, w)), np.cos(np.outer(times, w))
    return (s / w) @ a + (c / w) @ b, c @ a - s @ b, -(s * w) @ a - (c * w) @ b


def truth_of(name, values):
    """Value of a parameter of the model, lumped ones by the names of their parts."""
    total, sign = 0.0, 1.0
    for part in re.split(r"_(plus|minus)_", name):
        if part in ("plus", "minus"):
            sign = 1.0 if part == "plus" else -1.0
            continue
        factor, own, over = re.fullmatch(r"(?:(\d+)_)?(.+?)(?:_per_(\d+))?", part).groups()
        total = total + sign * values[own] * float(factor or 1) / float(over or 1)
    return total


class Machine:
    """An arm of up to six joints with friction along a motion: regressors of Pinocchio, true parameters, torques, and their noise."""

    def __init__(self, urdf, rate, periods):
        model = pin.buildModelFromUrdf(urdf)
        data, self.joints = model.createData(), list(model.names[1:])
        count = len(self.joints)
        bodies = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
        # The link that a joint moves; those behind fixed joints follow it.
        self.links = [next(body.name for body in bodies if body.parentJoint == 1 + j) for j in range(count)]
        self.times = np.arange(int(periods / FUNDAMENTAL * rate)) / rate
        self.q, self.v, a = motion(self.times, np.random.default_rng(1), count)
        self.names = [f"{p}_{link}" for link in self.links for p in ORDER]
        self.names += [f"{k}_{j}" for j in self.joints for k in ("fv", "fc", "Ia")]
        theta = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]])
        theta = np.concatenate([theta, np.ravel(np.column_stack([VISCOUS, COULOMB, ROTOR])[:count])])
        self.rows = np.zeros((len(self.times), count, len(self.names)))
        for k in range(len(self.times)):
            self.rows[k, :, : 10 * count] = pin.computeJointTorqueRegressor(model, data, self.q[k], self.v[k], a[k])
            for j in range(count):
                self.rows[k, j, 10 * count + 3 * j : 10 * count + 3 * j + 3] = self.v[k, j], np.sign(self.v[k, j]), a[k, j]
        self.torque = self.rows @ theta
        self.noise = TORQUE_NOISE * np.abs(self.torque).max(0)
        self.values = dict(zip(self.names, theta))

    def log(self, seed, file, torque=None, read=None):
        """Writes readings and torques with noise."""
        rng = np.random.default_rng(1000 + seed)
        count = 2 * np.pi / COUNTS
        read = np.round((self.q if read is None else read) / count) * count
        force = (self.torque if torque is None else torque) + rng.normal(size=self.torque.shape) * self.noise
        header = ",".join(["t_s", *self.joints, *(f"tau_{j}" for j in self.joints)])
        np.savetxt(file, np.column_stack([self.times, read, force]), delimiter=",", header=header, comments="", fmt="%.10g")


def imported(tpm, urdf, folder, losses="viscous,coulomb,rotor"):
    """The description as a model."""
    file = folder / "arm.tpm"
    text = subprocess.run([tpm, "import", urdf, "--output", file, "--losses", losses], capture_output=True, text=True)
    if not file.exists():
        sys.exit(text.stderr)
    return file


def identified(tpm, model, log, *more):
    """Exit code and result; `more` are further options."""
    command = [tpm, "identify", model, "--log", log, "--hold", "none", "--json", *more]
    run = subprocess.run(command, capture_output=True, text=True)
    return run.returncode, json.loads(run.stdout)


def numbers(result):
    """Values with a deviation, as parameters and as combinations: the terms of each, value and deviation."""
    for own in result["parameters"] + result["combinations"]:
        if own["value"] is not None:
            yield own.get("terms") or {own["name"]: 1}, own["value"], own["std"]


def main(tpm, urdf, seeds=50, rate=1000.0, periods=2.0):
    seeds, rate, periods = int(seeds), float(rate), float(periods)
    machine = Machine(urdf, rate, periods)
    information = sum(machine.rows[:, j].T @ machine.rows[:, j] / machine.noise[j] ** 2 for j in range(len(machine.joints)))
    scale = np.sqrt(np.diag(information))
    scale[scale == 0] = 1
    bound = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    units = {name: np.eye(len(machine.names))[i] for i, name in enumerate(machine.names)}
    folder = Path(tempfile.mkdtemp())
    model, log = imported(tpm, urdf, folder), folder / "log.csv"
    errors, scores, seconds, codes, said = [], [], [], [], 0
    for seed in range(seeds):
        machine.log(seed, log)
        started = time.time()
        code, result = identified(tpm, model, log)
        seconds.append(time.time() - started)
        codes.append(code)
        said += sum(own["kind"] == "missing_term" for own in result["findings"])
        for terms, value, std in numbers(result):
            of = lambda by: sum(float(f) * truth_of(name, by) for name, f in terms.items())
            true, row = of(machine.values), of(units)
            errors.append((value - true) / np.sqrt(row @ bound @ row))
            scores.append((value - true) / std)
    errors, scores = np.array(errors), np.array(scores)
    per = errors.reshape(seeds, -1)
    print(f"{seeds} seeds, {len(machine.times)} samples at {rate:g} Hz, {per.shape[1]} values each")
    print(f"rms error / bound {np.sqrt(np.mean(errors**2)):.3f}, worst value {np.sqrt((per**2).mean(0)).max():.2f}")
    print(f"coverage of 95 % {100 * np.mean(np.abs(scores) < 1.96):.1f} %, largest {np.abs(scores).max():.1f} deviations")
    print(f"seconds {np.median(seconds):.2f}, exit codes {sorted(set(codes))}, terms said to be missing {said}")


if __name__ == "__main__":
    main(*sys.argv[1:])

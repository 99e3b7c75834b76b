"""Excitation of arms beside random motions: `python3 excitation.py TPM URDF [--lock JOINT=VALUE ...] [-- OPTIONS OF tpm design ...]`.

`tpm import` and `tpm design` find a motion under the limits of the description; Pinocchio (`pip install pin numpy`) judges it and 1000
random series of the same harmonics and period: dense samples of positions, velocities and torques against the limits, and the condition
number of the stacked regressor in base parameters (columns of the inertias of links chosen by a pivoted decomposition, in SI units).
A random series has normal coefficients, its centre anywhere within the positions, and is scaled into the limits of positions and
velocities; series whose torques pass their limits are drawn again.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pinocchio as pin

RANDOM = 1000
SAMPLES = 250
DENSE = 5000
SHARE = 0.7  # of the torques, as the experiment of an import says


def series(mean, lines, w, phases):
    """Position, velocity and acceleration of every joint at phases: arrays phases by joints."""
    out = np.zeros((3, len(phases), len(mean)))
    for j in range(len(mean)):
        out[0, :, j] = mean[j]
        for k, a, b in lines[j]:
            c, s = np.cos(k * phases), np.sin(k * phases)
            out[0, :, j] += a * c + b * s
            out[1, :, j] += k * w * (b * c - a * s)
            out[2, :, j] -= (k * w) ** 2 * (a * c + b * s)
    return out


class Arm:
    def __init__(self, urdf, locks):
        whole = pin.buildModelFromUrdf(urdf)
        rest = pin.neutral(whole)
        held = []
        for name, value in locks.items():
            joint = whole.getJointId(name)
            rest[whole.joints[joint].idx_q] = value
            held.append(joint)
        self.model = pin.buildReducedModel(whole, held, rest) if held else whole
        self.data = self.model.createData()
        random = np.random.default_rng(1)
        rows = [self.regressor(*random.normal(size=(3, self.model.nv))) for _ in range(60)]
        from scipy.linalg import qr
        _, r, pivots = qr(np.vstack(rows), mode="economic", pivoting=True)
        rank = int((np.abs(np.diag(r)) > 1e-9 * abs(r[0, 0])).sum())
        self.base = np.sort(pivots[:rank])

    def regressor(self, q, v, a):
        return pin.computeJointTorqueRegressor(self.model, self.data, q, v, a)

    def torques(self, motion):
        return np.array([pin.rnea(self.model, self.data, *state) for state in motion.transpose(1, 0, 2)])

    def condition(self, motion):
        stacked = np.vstack([self.regressor(*state)[:, self.base] for state in motion.transpose(1, 0, 2)])
        values = np.linalg.svd(stacked, compute_uv=False)
        return values[0] / values[-1]

    def shares(self, motion):
        """Largest shares of positions' range, velocities and torques."""
        model = self.model
        middle = (model.upperPositionLimit + model.lowerPositionLimit) / 2
        reach = (model.upperPositionLimit - model.lowerPositionLimit) / 2
        return (
            (np.abs(motion[0] - middle) / reach).max(),
            (np.abs(motion[1]) / model.velocityLimit).max(),
            (np.abs(self.torques(motion)) / (SHARE * model.effortLimit)).max(),
        )

    def random(self, generator, harmonics, w):
        """A random series from rest to rest within the limits of positions and velocities."""
        model, phases = self.model, np.linspace(0, 2 * np.pi, SAMPLES, endpoint=False)
        mean, lines = [], []
        for j in range(model.nv):
            low, high = model.lowerPositionLimit[j], model.upperPositionLimit[j]
            centre = generator.uniform(0.85 * low + 0.15 * high, 0.15 * low + 0.85 * high)
            k = np.arange(2, harmonics + 1)
            a, b = generator.normal(size=len(k)) / k**2, generator.normal(size=len(k)) / k
            first = (1, -(k**2 * a).sum(), -(k * b).sum())
            own = [first, *zip(k, a, b)]
            moved = series([0.0], [own], w, phases)
            room = min(centre - low, high - centre)
            scale = min(room / np.abs(moved[0]).max(), model.velocityLimit[j] / np.abs(moved[1]).max())
            scale *= generator.uniform(0.3, 0.95)
            mean.append(centre)
            lines.append([(k, a * scale, b * scale) for k, a, b in own])
        return series(mean, lines, w, phases)


def main(tpm, urdf, *options):
    options = list(options)
    split = options.index("--") if "--" in options else len(options)
    imported, design = options[:split], options[split + 1 :]
    locks = {name: float(value) for name, value in (one.split("=") for one in imported[1::2])}
    folder = Path(tempfile.mkdtemp())
    model, found = folder / "arm.tpm", folder / "found.json"
    subprocess.run([tpm, "import", urdf, "-o", model, "--losses", "none", *imported], check=True, capture_output=True)
    began = time.time()
    command = [tpm, "design", model, "--experiment", folder / "arm.experiment.toml", "--json", "-o", found, *design]
    subprocess.run(command, check=True)
    seconds = time.time() - began
    found = json.loads(found.read_text())
    arm = Arm(urdf, locks)
    if len(arm.base) != len(found["base"]):
        sys.exit(f"{len(arm.base)} base parameters there, {len(found['base'])} here")
    best = found["motions"][0]["trajectory"]
    # The description's order of joints is that of the model here.
    names = [name for name in arm.model.names[1:]]
    order = [found["coordinates"].index(name) for name in names]
    mean, lines = [best[c]["mean"] for c in order], [best[c]["lines"] for c in order]
    w = found["frequency"]
    dense = series(mean, lines, w, np.linspace(0, 2 * np.pi, DENSE, endpoint=False))
    judged = series(mean, lines, w, np.linspace(0, 2 * np.pi, SAMPLES, endpoint=False))
    generator = np.random.default_rng(0)
    conditions, drawn = [], 0
    while len(conditions) < RANDOM and drawn < 100 * RANDOM:
        drawn += 1
        motion = arm.random(generator, found["harmonics"], w)
        if np.abs(arm.torques(motion[:, ::5]) / (SHARE * arm.model.effortLimit)).max() <= 1:
            conditions.append(arm.condition(motion[:, ::5]))
    designed = arm.condition(judged)
    print(f"{Path(urdf).name}: {found['feasible']} of {found['starts']} starts feasible, {seconds:.1f} s")
    print("shares of position, velocity, torque at 5000 instants: " + " ".join(f"{s:.4f}" for s in arm.shares(dense)))
    print(f"start at rest: {np.abs(dense[1:, 0]).max():.1e}")
    print(f"condition {designed:.2f} (the program says {found['motions'][0]['condition']:.2f})")
    print(f"best of {len(conditions)} random feasible series of {drawn} drawn: {min(conditions):.2f}, median {np.median(conditions):.1f}")
    print(f"ratio {min(conditions) / designed:.2f}")


if __name__ == "__main__":
    main(*sys.argv[1:])

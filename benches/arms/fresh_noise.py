"""A quiet log of a UR5 under fresh noise: `python3 fresh_noise.py TPM URDF LOG TRUTH [SEEDS]` (`pip install pin numpy`).

LOG has the columns `t_s`, `q1`.., `dq1`.. and `tau1`.. without noise, TRUTH (JSON) the viscous friction `params.d`, the rotor inertias
`params.arm`, the step of the encoders `encoder_step` and the noise of the torques `tau_noise_frac`, a share of the largest torque. Every
value that is printed with a deviation is compared with the bound of the torques' noise, of a motion that is known.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
from cramer_rao import ORDER, truth_of

LINKS = ["shoulder_link", "upper_arm_link", "forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link"]


class Recorded:
    """A log without noise, the parameters behind it and the rows of its equations: inertias, then friction and rotor of every joint."""

    def __init__(self, urdf, log, truth):
        self.model = pin.buildModelFromUrdf(urdf)
        self.data, self.joints = self.model.createData(), list(self.model.names[1:])
        self.settings = json.loads(Path(truth).read_text())
        table = np.genfromtxt(log, delimiter=",", names=True)
        self.times = table["t_s"]
        self.q, self.v, self.torque = (np.column_stack([table[f"{name}{j}"] for j in range(1, 7)]) for name in ("q", "dq", "tau"))
        self.a = np.gradient(self.v, self.times, axis=0)
        self.names = [f"{p}_{link}" for link in LINKS for p in ORDER] + [f"{k}_{j}" for j in self.joints for k in ("fv", "Ia")]
        losses = np.ravel(np.column_stack([self.settings["params"]["d"], self.settings["params"]["arm"]]))
        self.theta = np.concatenate([inertia.toDynamicParameters() for inertia in list(self.model.inertias)[1:]] + [losses])
        self.noise = self.settings["tau_noise_frac"] * np.abs(self.torque).max(0)
        # What the tool uses are the periods in which the motion has settled: all but the first.
        self.used = self.times >= self.settings["period_s"]

    def rows(self, q, v, a):
        found = np.zeros((len(q), 6, len(self.names)))
        for k in range(len(q)):
            found[k, :, :60] = pin.computeJointTorqueRegressor(self.model, self.data, q[k], v[k], a[k])
            for j in range(6):
                found[k, j, 60 + 2 * j : 62 + 2 * j] = v[k, j], a[k, j]
        return found

    def bound(self):
        """Covariance of the parameters by the noise of the torques, of a motion that is known."""
        rows = self.rows(self.q[self.used], self.v[self.used], self.a[self.used])
        information = sum(rows[:, j].T @ rows[:, j] / self.noise[j] ** 2 for j in range(6))
        scale = np.sqrt(np.diag(information))
        scale[scale == 0] = 1
        scales = np.outer(scale, scale)
        return np.linalg.pinv(information / scales, rcond=1e-12, hermitian=True) / scales


def imported(tpm, urdf):
    """The model of a description with viscous friction and rotors, in a folder of its own."""
    file = Path(tempfile.mkdtemp()) / "ur5.tpm"
    subprocess.run([tpm, "import", urdf, "--output", file, "--losses", "viscous,rotor"], capture_output=True, check=False)
    return file


def main(tpm, urdf, log, truth, seeds=20):
    own = Recorded(urdf, log, truth)
    bound = own.bound()
    values, units = dict(zip(own.names, own.theta)), {name: np.eye(len(own.names))[i] for i, name in enumerate(own.names)}
    model = imported(tpm, urdf)
    file = model.parent / "log.csv"
    errors, scores, codes = [], [], []
    for seed in range(int(seeds)):
        rng = np.random.default_rng(1000 + seed)
        step = np.array(own.settings["encoder_step"])
        read, force = np.round(own.q / step) * step, own.torque + rng.normal(size=own.torque.shape) * own.noise
        header = ",".join(["t_s", *own.joints, *(f"tau_{j}" for j in own.joints)])
        np.savetxt(file, np.column_stack([own.times, read, force]), delimiter=",", header=header, comments="", fmt="%.10g")
        run = subprocess.run([tpm, "identify", model, "--log", file, "--hold", "zoh", "--json"], capture_output=True, text=True)
        codes.append(run.returncode)
        result = json.loads(run.stdout)
        own_errors = {}
        for shown in result["parameters"] + result["combinations"]:
            if shown["value"] is None:
                continue
            terms = shown.get("terms") or {shown["name"]: 1}
            of = lambda by: sum(float(f) * truth_of(name, by) for name, f in terms.items())
            true, row = of(values), of(units)
            own_errors[shown.get("name") or str(sorted(terms))] = (shown["value"] - true) / np.sqrt(row @ bound @ row)
            scores.append((shown["value"] - true) / shown["std"])
        errors.append(own_errors)
    per = {name: np.sqrt(np.mean([e[name] ** 2 for e in errors if name in e])) for name in errors[0]}
    scores = np.array(scores)
    print(f"{seeds} noises: rms error / bound {np.sqrt(np.mean(np.square(list(per.values())))):.3f}, worst value {max(per.values()):.2f}")
    print(f"coverage of 95 % {100 * np.mean(np.abs(scores) < 1.96):.1f} %, largest {np.abs(scores).max():.1f} deviations, exit codes {sorted(set(codes))}")


if __name__ == "__main__":
    main(*sys.argv[1:])

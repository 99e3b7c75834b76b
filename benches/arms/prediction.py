"""Torques that are predicted from a log of a UR5: `python3 prediction.py TPM URDF LOG TRUTH QUIET [STATES]` (`pip install pin numpy`).

LOG has the columns `t_s`, `q1`.., `dq1`.. and `tau1`.., TRUTH (JSON) the viscous friction `params.d`, the rotor inertias `params.arm` and the
noise of the torques `tau_noise_frac`, a share of the largest torque; QUIET is a log of this motion without noise. What is identified predicts
the torques at random states: positions anywhere, rates and accelerations within the ranges of the motion. Printed are root mean squares of
the errors over those of the torques, joint by joint, beside the Cramer-Rao bound: what the torques' noise makes of these predictions, of a
motion that is known.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
from cramer_rao import ORDER, truth_of
from fresh_noise import LINKS


def main(tpm, urdf, log, truth, quiet, states=300):
    model = pin.buildModelFromUrdf(urdf)
    data, joints = model.createData(), list(model.names[1:])
    settings = json.loads(Path(truth).read_text())
    table = np.genfromtxt(quiet, delimiter=",", names=True)
    times = table["t_s"]
    q, v, torque = (np.column_stack([table[f"{name}{j}"] for j in range(1, 7)]) for name in ("q", "dq", "tau"))
    a = np.gradient(v, times, axis=0)
    names = [f"{p}_{link}" for link in LINKS for p in ORDER] + [f"{k}_{j}" for j in joints for k in ("fv", "Ia")]
    losses = np.ravel(np.column_stack([settings["params"]["d"], settings["params"]["arm"]]))
    theta = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]] + [losses])

    def regressor(q, v, a):
        rows = np.zeros((len(q), 6, len(names)))
        for k in range(len(q)):
            rows[k, :, :60] = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])
            for j in range(6):
                rows[k, j, 60 + 2 * j : 62 + 2 * j] = v[k, j], a[k, j]
        return rows

    folder = Path(tempfile.mkdtemp())
    imported = folder / "ur5.tpm"
    subprocess.run([tpm, "import", urdf, "--output", imported, "--losses", "viscous,rotor"], capture_output=True, check=False)
    maps = [word for i, joint in enumerate(joints, 1) for word in ("--map", f"{joint}=q{i}", "--map", f"tau_{joint}=tau{i}")]
    run = subprocess.run([tpm, "identify", imported, "--log", log, *maps, "--hold", "zoh", "--json"], capture_output=True, text=True)
    if not run.stdout:
        sys.exit(run.stderr)
    result = json.loads(run.stdout)
    shown = [own for own in result["parameters"] + result["combinations"] if own["value"] is not None]
    units = {name: np.eye(len(names))[i] for i, name in enumerate(names)}
    of = lambda own: sum(float(f) * truth_of(name, units) for name, f in (own.get("terms") or {own["name"]: 1}).items())
    found = np.linalg.lstsq(np.array([of(own) for own in shown]), np.array([own["value"] for own in shown]), rcond=1e-12)[0]

    used = times >= settings["period_s"]
    rng = np.random.default_rng(3)
    within = lambda x: rng.uniform(x[used].min(0), x[used].max(0), (int(states), 6))
    at = regressor(rng.uniform(-np.pi, np.pi, (int(states), 6)), within(v), within(a))
    true = at @ theta
    rms = lambda x: np.sqrt(np.mean(x**2, axis=0))
    errors = rms(at @ found - true) / rms(true)
    text = lambda values: " ".join(f"{100 * value:.3g}" for value in values)
    print(f"exit code {run.returncode}, rank {result['rank']}, {states} states")
    print(f"errors of the prediction, joint by joint: {text(errors)} %")
    noise = settings["tau_noise_frac"] * np.abs(torque).max(0)
    if noise.all():
        rows = regressor(q[used], v[used], a[used])
        information = sum(rows[:, j].T @ rows[:, j] / noise[j] ** 2 for j in range(6))
        scale = np.sqrt(np.diag(information))
        scale[scale == 0] = 1
        bound = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
        least = np.sqrt(np.mean(np.einsum("kji,il,kjl->kj", at, bound, at), axis=0)) / rms(true)
        print(f"Cramer-Rao bound:                        {text(least)} %, ratios {' '.join(f'{r:.2f}' for r in errors / least)}")


if __name__ == "__main__":
    main(*sys.argv[1:])

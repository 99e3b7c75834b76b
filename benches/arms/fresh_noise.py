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


def main(tpm, urdf, log, truth, seeds=20):
    model = pin.buildModelFromUrdf(urdf)
    data, joints = model.createData(), list(model.names[1:])
    settings = json.loads(Path(truth).read_text())
    table = np.genfromtxt(log, delimiter=",", names=True)
    times = table["t_s"]
    q, v, torque = (np.column_stack([table[f"{name}{j}"] for j in range(1, 7)]) for name in ("q", "dq", "tau"))
    a = np.gradient(v, times, axis=0)
    links = dict(zip(joints, LINKS))
    names = [f"{p}_{links[j]}" for j in joints for p in ORDER] + [f"{k}_{j}" for j in joints for k in ("fv", "Ia")]
    losses = np.ravel(np.column_stack([settings["params"]["d"], settings["params"]["arm"]]))
    theta = np.concatenate([inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]] + [losses])
    rows = np.zeros((len(times), 6, len(names)))
    for k in range(len(times)):
        rows[k, :, :60] = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])
        for j in range(6):
            rows[k, j, 60 + 2 * j : 62 + 2 * j] = v[k, j], a[k, j]
    noise = settings["tau_noise_frac"] * np.abs(torque).max(0)
    # What the tool uses are the periods in which the motion has settled: all but the first.
    used = times >= settings["period_s"]
    information = sum(rows[used, j].T @ rows[used, j] / noise[j] ** 2 for j in range(6))
    scale = np.sqrt(np.diag(information))
    scale[scale == 0] = 1
    bound = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    values, units = dict(zip(names, theta)), {name: np.eye(len(names))[i] for i, name in enumerate(names)}
    folder = Path(tempfile.mkdtemp())
    imported = folder / "ur5.tpm"
    subprocess.run([tpm, "import", urdf, "--output", imported, "--losses", "viscous,rotor"], capture_output=True, check=False)
    errors, scores, codes = [], [], []
    for seed in range(int(seeds)):
        rng = np.random.default_rng(1000 + seed)
        step = np.array(settings["encoder_step"])
        read, force = np.round(q / step) * step, torque + rng.normal(size=torque.shape) * noise
        file = folder / "log.csv"
        header = ",".join(["t_s", *joints, *(f"tau_{j}" for j in joints)])
        np.savetxt(file, np.column_stack([times, read, force]), delimiter=",", header=header, comments="", fmt="%.10g")
        run = subprocess.run([tpm, "identify", imported, "--log", file, "--hold", "zoh", "--json"], capture_output=True, text=True)
        codes.append(run.returncode)
        result = json.loads(run.stdout)
        own_errors = {}
        for own in result["parameters"] + result["combinations"]:
            if own["value"] is None:
                continue
            terms = own.get("terms") or {own["name"]: 1}
            of = lambda by: sum(float(f) * truth_of(name, by) for name, f in terms.items())
            true, row = of(values), of(units)
            own_errors[own.get("name") or str(sorted(terms))] = (own["value"] - true) / np.sqrt(row @ bound @ row)
            scores.append((own["value"] - true) / own["std"])
        errors.append(own_errors)
    per = {name: np.sqrt(np.mean([e[name] ** 2 for e in errors if name in e])) for name in errors[0]}
    scores = np.array(scores)
    print(f"{seeds} noises: rms error / bound {np.sqrt(np.mean(np.square(list(per.values())))):.3f}, worst value {max(per.values()):.2f}")
    print(f"coverage of 95 % {100 * np.mean(np.abs(scores) < 1.96):.1f} %, largest {np.abs(scores).max():.1f} deviations, exit codes {sorted(set(codes))}")


if __name__ == "__main__":
    main(*sys.argv[1:])

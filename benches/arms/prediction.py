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

import numpy as np
from cramer_rao import truth_of
from fresh_noise import Recorded, imported


def main(tpm, urdf, log, truth, quiet, states=300):
    recorded = Recorded(urdf, quiet, truth)
    joints, used = recorded.joints, recorded.used
    maps = [word for i, joint in enumerate(joints, 1) for word in ("--map", f"{joint}=q{i}", "--map", f"tau_{joint}=tau{i}")]
    run = subprocess.run([tpm, "identify", imported(tpm, urdf), "--log", log, *maps, "--hold", "zoh", "--json"], capture_output=True, text=True)
    if not run.stdout:
        sys.exit(run.stderr)
    result = json.loads(run.stdout)
    shown = [own for own in result["parameters"] + result["combinations"] if own["value"] is not None]
    units = {name: np.eye(len(recorded.names))[i] for i, name in enumerate(recorded.names)}
    of = lambda own: sum(float(f) * truth_of(name, units) for name, f in (own.get("terms") or {own["name"]: 1}).items())
    found = np.linalg.lstsq(np.array([of(own) for own in shown]), np.array([own["value"] for own in shown]), rcond=1e-12)[0]

    rng = np.random.default_rng(3)
    within = lambda x: rng.uniform(x[used].min(0), x[used].max(0), (int(states), 6))
    at = recorded.rows(rng.uniform(-np.pi, np.pi, (int(states), 6)), within(recorded.v), within(recorded.a))
    true = at @ recorded.theta
    rms = lambda x: np.sqrt(np.mean(x**2, axis=0))
    errors = rms(at @ found - true) / rms(true)
    text = lambda values: " ".join(f"{100 * value:.3g}" for value in values)
    print(f"exit code {run.returncode}, rank {result['rank']}, {states} states")
    print(f"errors of the prediction, joint by joint: {text(errors)} %")
    if recorded.noise.all():
        least = np.sqrt(np.mean(np.einsum("kji,il,kjl->kj", at, recorded.bound(), at), axis=0)) / rms(true)
        print(f"Cramer-Rao bound:                        {text(least)} %, ratios {' '.join(f'{r:.2f}' for r in errors / least)}")


if __name__ == "__main__":
    main(*sys.argv[1:])

"""The measured log of a Staubli TX40: `python3 tx40.py TPM MODEL LOG URDF` (`pip install pin numpy scipy`).

MODEL is `models/robots/tx40.tpm`; LOG has the angles and torques of the motors at 1 kHz, of which joints are linear maps (the wrist is
coupled), URDF the geometry. What is identified is judged as the data set's own page says: positions behind a low pass of 100 Hz, differences,
torques and every column of the regressor decimated to 50 Hz without a phase, samples in which a joint rests left out, root mean square
of the error over that of the torque, joint by joint. Beside it weighted regression on these very rows, which minimises this figure.
"""

import json
import subprocess
import sys
import time

import numpy as np
import pinocchio as pin
from cramer_rao import ORDER, truth_of
from scipy.signal import butter, decimate, filtfilt

MAPS = {
    "q1": "q_motor1_rad/32", "q2": "q_motor2_rad/32 - pi/2", "q3": "q_motor3_rad/45 + pi/2", "q4": "-q_motor4_rad/48",
    "q5": "q_motor5_rad/45", "q6": "q_motor6_rad/32 - q_motor5_rad/45",
    "tau1": "32*tau_motor1_Nm", "tau2": "32*tau_motor2_Nm", "tau3": "45*tau_motor3_Nm", "tau4": "-48*tau_motor4_Nm",
    "tau5": "45*tau_motor5_Nm", "tau6": "32*tau_motor6_Nm",
}
# A joint rests below this share of its largest rate.
REST = 0.01
# Friction and rotors of the drives that others have published for this log (figaroh-plus, weighted least squares).
PUBLISHED = {
    "fv_q1": 8.087, "fc_q1": 7.014, "fv_q2": 5.594, "fc_q2": 8.134, "Ia_q3": 0.0971, "fv_q3": 1.983, "fc_q3": 6.283, "Ia_q4": 0.0297,
    "fv_q4": 1.112, "fc_q4": 2.49, "Ia_q5": 0.048, "fv_q5": 1.854, "fc_q5": 3.041, "fv_q6": 0.648, "Ia_wrist": 0.0077, "fv_wrist": 0.616,
}


def joints(log):
    """Times, joint angles, and torques on the joints."""
    table = np.genfromtxt(log, delimiter=",", names=True)
    motor = np.column_stack([table[f"q_motor{j}_rad"] for j in range(1, 7)])
    torque = np.column_stack([table[f"tau_motor{j}_Nm"] for j in range(1, 7)])
    q = motor / [32, 32, 45, -48, 45, 32]
    q[:, 5] -= q[:, 4]
    q[:, 1] -= np.pi / 2
    q[:, 2] += np.pi / 2
    force = torque * [32, 32, 45, -48, 45, 32]
    force[:, 4] += force[:, 5]
    return table["t_s"], q, force


def rows(urdf, q, v, a):
    """Regressor of inertias and drives, and the names of its columns."""
    model = pin.buildModelFromUrdf(urdf)
    data = model.createData()
    names = [f"{p}_link{j}" for j in range(1, 7) for p in ORDER]
    drives = {f"q{j + 1}": np.eye(6)[j] for j in range(6)} | {"wrist": np.eye(6)[4] + np.eye(6)[5]}
    names += [f"{k}_{drive}" for drive in drives for k in ("fv", "fc", "f0", "Ia")]
    found = np.zeros((len(q), 6, len(names)))
    for k in range(len(q)):
        found[k, :, :60] = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k])
    at = 60
    for way in drives.values():
        rate, bend = v @ way, a @ way
        for own in (rate, np.sign(rate), np.ones(len(q)), bend):
            found[:, :, at] = np.outer(own, way)
            at += 1
    return found, names


def slow(x):
    """To 50 Hz without a phase, in two steps."""
    return decimate(decimate(x, 10, axis=0, zero_phase=True), 2, axis=0, zero_phase=True)


def main(tpm, model, log, urdf):
    maps = [word for name, text in MAPS.items() for word in ("--map", f"{name}={text}")]
    command = [tpm, "identify", model, "--log", log, *maps, "--hold", "none", "--json"]
    started = time.time()
    run = subprocess.run(command, capture_output=True, text=True)
    seconds = time.time() - started
    if not run.stdout:
        sys.exit(run.stderr)
    result = json.loads(run.stdout)

    times, q, force = joints(log)
    cut = 100.0 * 2 * (times[1] - times[0])
    q = filtfilt(*butter(4, cut), q, axis=0)
    v = np.gradient(q, times, axis=0)
    a = np.gradient(v, times, axis=0)
    matrix, names = rows(urdf, q, v, a)
    moving = np.abs(slow(v)) > REST * np.abs(v).max(0)
    matrix, force = slow(matrix), slow(force)

    # Any parameters with the values that are stated have the same torques: combinations cover what moves the arm.
    shown = [own for own in result["parameters"] + result["combinations"] if own["value"] is not None]
    units = {name: np.eye(len(names))[i] for i, name in enumerate(names)}
    of = lambda own: sum(float(f) * truth_of(name, units) for name, f in (own.get("terms") or {own["name"]: 1}).items())
    theta = np.linalg.lstsq(np.array([of(own) for own in shown]), np.array([own["value"] for own in shown]), rcond=1e-12)[0]

    def shares(theta):
        left = force - matrix @ theta
        of_joint = lambda x, j: np.sqrt(np.mean(x[moving[:, j], j] ** 2))
        return np.array([of_joint(left, j) / of_joint(force, j) for j in range(6)])

    weights = np.ones(6)
    for _ in range(5):
        whole = np.concatenate([matrix[moving[:, j], j] / weights[j] for j in range(6)])
        right = np.concatenate([force[moving[:, j], j] / weights[j] for j in range(6)])
        scale = np.linalg.norm(whole, axis=0)
        scale[scale == 0] = 1
        own = np.linalg.lstsq(whole / scale, right, rcond=1e-7)[0] / scale
        weights = np.array([np.std((force - matrix @ own)[moving[:, j], j]) for j in range(6)])
    text = lambda values: " ".join(f"{100 * value:.2f}" for value in values)
    mine, theirs = shares(theta), shares(own)
    print(f"exit code {run.returncode}, {seconds:.2f} s, rank {result['rank']}, {[found['kind'] for found in result['findings']]}")
    print(f"unexplained, joint by joint: {text(mine)} %")
    print(f"regression on these rows:    {text(theirs)} %, ratios {' '.join(f'{r:.3f}' for r in mine / theirs)}")
    alone = {own["name"]: own for own in result["parameters"] if own["value"] is not None}
    for name, value in PUBLISHED.items():
        if name in alone:
            found = alone[name]
            print(f"{name:9s} {found['value']:8.4f} +- {found['std']:.4f}, published {value:7.4f}: "
                  f"{100 * (found['value'] / value - 1):+6.1f} %, {(found['value'] - value) / found['std']:+6.1f} deviations")


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Torques of written inertias by other programs: `python3 read_back.py TPM URDF RESULT.json MODEL.tpm [--tip LINK ...]`.

`tpm inertias` writes a description and a model for MuJoCo; Pinocchio and MuJoCo read them back (`pip install pin mujoco numpy`) and must
give, at random states, the torques of the parameters that tpm states: Pinocchio's regressor of the geometry times these. Options behind
the model are those of the import.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

STATES = 100


def main(tpm, urdf, result, model, *options):
    folder = Path(tempfile.mkdtemp())
    written, mjcf, stated = folder / "new.urdf", folder / "new.xml", folder / "new.json"
    command = [tpm, "inertias", model, result, "--description", urdf, "--urdf", written, "--mjcf", mjcf, "--json", "-o", stated]
    run = subprocess.run([*command, *options], capture_output=True, text=True)
    if run.returncode:
        sys.exit(run.stderr)
    values = {own["name"]: own["value"] for own in json.loads(stated.read_text())["parameters"]}
    arm = pin.buildModelFromUrdf(str(written))
    data = arm.createData()
    joints = list(arm.names[1:])
    machine = mujoco.MjModel.from_xml_path(str(mjcf))
    # Dry friction and limits of joints are constraints there, and no part of the equations of motion.
    machine.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    state = mujoco.MjData(machine)
    place = [mujoco.mj_name2id(machine, mujoco.mjtObj.mjOBJ_JOINT, name) for name in joints]
    links = {frame.name for frame in arm.frames}
    bodies = [next(name[2:] for name in values if name.startswith("m_") and name[2:] in links and body_of(arm, name[2:]) == j)
              for j in range(1, arm.njoints)]
    order = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]
    theta = np.array([values[f"{symbol}_{body}"] for body in bodies for symbol in order])
    rng = np.random.default_rng(1)
    errors, most = np.zeros(2), 0.0
    for _ in range(STATES):
        q, v, a = rng.uniform(-2, 2, (3, arm.nv))
        wanted = pin.computeJointTorqueRegressor(arm, data, q, v, a) @ theta
        read = pin.rnea(arm, data, q, v, a)
        losses = np.zeros(arm.nv)
        for j, name in enumerate(joints):
            losses[j] = values.get(f"fv_{name}", 0) * v[j] + values.get(f"Ia_{name}", 0) * a[j]
        state.qpos[place], state.qvel[place], state.qacc[place] = q, v, a
        mujoco.mj_inverse(machine, state)
        turned = state.qfrc_inverse[place]
        errors = np.maximum(errors, [np.abs(read - wanted).max(), np.abs(turned - wanted - losses).max()])
        most = max(most, np.abs(wanted).max())
    print(f"{STATES} states, largest torque {most:.1f}: Pinocchio {errors[0] / most:.1e}, MuJoCo {errors[1] / most:.1e} of it")
    sys.exit(int(errors.max() > 1e-9 * most))


def body_of(arm, link):
    """Index of the joint that carries a link as its own frame."""
    frame = arm.frames[arm.getFrameId(link)]
    return frame.parentJoint if frame.placement.isIdentity() else -1


if __name__ == "__main__":
    main(*sys.argv[1:])

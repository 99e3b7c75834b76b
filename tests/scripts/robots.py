"""Torques, mass matrices and regressors of robot descriptions by Pinocchio, as fixtures for tests/tests/whole/robots.rs.

usage: robots.py DESCRIPTIONS OUT [STATES [REGRESSORS]]

Needs the package `pin` (4.1). DESCRIPTIONS is the folder of the URDF files, OUT the folder of the fixtures; STATES is the number of
random states of each robot (5), REGRESSORS the number of those whose regressor is written too (1).

Angles are read as `tpm import` reads them: within 1e-4 of a multiple of pi/2 they are that multiple. The fixture `so101_written` has
the angles as they are written. Parameters of a body are in the order m, mx, my, mz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz, about its frame.

Joints that follow others (`gripper`, in OUT) are joints of their own here, and are moved and asked through the matrix G from the joints that
lead to all of them: torques G' tau(G q, G v, G a), and the mass matrix G' M G.
"""

import json
import math
import re
import sys
import xml.etree.ElementTree as xml
from pathlib import Path

import numpy as np
import pinocchio as pin

ROBOTS = {
    "ur5": ("ur5_robot.urdf", []),
    "ur10": ("ur10_robot.urdf", []),
    "so101": ("so101.urdf", []),
    "xarm7": ("xarm7.urdf", []),
    "panda": ("panda.urdf", ["panda_finger_joint1", "panda_finger_joint2"]),
    "z1": ("z1.urdf", []),
}
# Pinocchio orders the moments of inertia xx, xy, yy, xz, yz, zz.
ORDER = [0, 1, 2, 3, 4, 5, 7, 6, 8, 9]


def recognised(text):
    def angle(word):
        value = float(word)
        quarters = round(value / (math.pi / 2))
        return repr(quarters * math.pi / 2) if abs(value - quarters * math.pi / 2) <= 1e-4 else word

    def angles(match):
        return 'rpy="' + " ".join(angle(word) for word in match.group(1).split()) + '"'

    return re.sub(r'rpy="([^"]*)"', angles, text)


def model_of(text, locked):
    model = pin.buildModelFromXML(text)
    held = [model.getJointId(name) for name in locked]
    return pin.buildReducedModel(model, held, pin.neutral(model)) if held else model


def digits(array):
    return json.loads(json.dumps(np.asarray(array).tolist()), parse_float=lambda text: float(f"{float(text):.13g}"))


def fixture(model, states, regressors, rng):
    data = model.createData()
    joints = list(model.names)[1:]
    assert model.nq == model.nv == len(joints)
    written = []
    for index in range(states):
        q, v, a = (np.round(rng.uniform(-limit, limit, model.nv), 3) for limit in (2, 2, 6))
        torque = pin.rnea(model, data, q, v, a)
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        state = {"q": q.tolist(), "v": v.tolist(), "a": a.tolist(), "torque": digits(torque), "mass": digits(mass)}
        if index < regressors:
            regressor = pin.computeJointTorqueRegressor(model, data, q, v, a)
            columns = [10 * joint + k for joint in range(model.nv) for k in ORDER]
            state["regressor"] = digits(regressor[:, columns])
        written.append(state)
    return {"joints": joints, "states": written}


def followed(text):
    """A description without `mimic`, by which Pinocchio might reduce the model itself, and what it says: factor and leader by follower."""
    mimics = {}
    for joint in xml.fromstring(text).iter("joint"):
        for mimic in joint.iter("mimic"):
            mimics[joint.get("name")] = (float(mimic.get("multiplier", "1")), mimic.get("joint"))
    return re.sub(r"<mimic[^>]*/>", "", text), mimics


def coupled(text, states, rng):
    text, mimics = followed(text)
    model = model_of(text, [])
    data = model.createData()
    joints = list(model.names)[1:]
    # A joint without limits has two positions, cosine and sine, in Pinocchio.
    leading = [joint for joint in joints if joint not in mimics]
    G = np.zeros((len(joints), len(leading)))
    for row, joint in enumerate(joints):
        factor, leader = mimics.get(joint, (1.0, joint))
        G[row, leading.index(leader)] = factor
    written = []
    for _ in range(states):
        q, v, a = (np.round(rng.uniform(-limit, limit, len(leading)), 3) for limit in (2, 2, 6))
        configuration = pin.integrate(model, pin.neutral(model), G @ q)
        torque = G.T @ pin.rnea(model, data, configuration, G @ v, G @ a)
        mass = pin.crba(model, data, configuration)
        mass = G.T @ (np.triu(mass) + np.triu(mass, 1).T) @ G
        state = {"q": q.tolist(), "v": v.tolist(), "a": a.tolist(), "torque": digits(torque), "mass": digits(mass)}
        written.append(state)
    return {"joints": leading, "states": written}


def main():
    folder, out = Path(sys.argv[1]), Path(sys.argv[2])
    states = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    regressors = int(sys.argv[4]) if len(sys.argv) > 4 else 1
    rng = np.random.default_rng(1)
    texts = {name: (recognised((folder / file).read_text()), locked) for name, (file, locked) in ROBOTS.items()}
    texts["so101_written"] = ((folder / "so101.urdf").read_text(), [])
    for name, (text, locked) in texts.items():
        text = text.replace('<?xml version="1.0" encoding="utf-8"?>', "")
        found = fixture(model_of(text, locked), states, regressors, rng)
        (out / f"{name}.json").write_text(json.dumps(found, separators=(",", ":")) + "\n")
    found = coupled(recognised((out / "gripper.urdf").read_text()).split("?>", 1)[1], states, rng)
    (out / "gripper.json").write_text(json.dumps(found, separators=(",", ":")) + "\n")


main()

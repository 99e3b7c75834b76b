"""Robot descriptions read, counted and compiled: `python3 descriptions.py TPM FILE[:OPTION ...] ...`, options of `tpm import` behind colons.

Every file is imported; the base parameters are counted by `tpm identifiability --any-motion` and by singular values of Pinocchio's regressor
of the description (URDF), and the torques of the generated C, with the parameters of the written prior, are compared at 100 random states
with Pinocchio (URDF) or MuJoCo (MJCF: the inverse dynamics with its constraints left out, dry friction added), moved and asked through
the matrix from the joints that lead to those that follow them. Ranks are those of right
angles as they are recognised, beside singular values above 1e-5 of the largest; torques are those of the angles as they are written.
Needs gcc and the packages pin, mujoco and numpy. One line for each file, and what failed.
"""

import ctypes
import json
import re
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as xml
from pathlib import Path

import numpy as np

STATES = 100
LONGEST = 300


class Generated:
    """The inverse dynamics of an imported model, compiled."""

    def __init__(self, tpm, model, prior, folder):
        call(tpm, "generate", model, "--lang", "c", "--prefix", "robot", "-o", folder)
        subprocess.run(["gcc", "-O1", "-shared", "-fPIC", "-o", folder / "robot.so", folder / "robot.c", "-lm"], check=True)
        self.code = ctypes.CDLL(str(folder / "robot.so"))
        header = (folder / "robot.h").read_text()
        names = fields(header, "robot_physical") or fields(header, "robot_parameters")
        self.values = (ctypes.c_double * len(names))(*(prior.get(name, 0.0) for name in names))
        if "robot_lump(" in header:
            lumped = (ctypes.c_double * len(fields(header, "robot_parameters")))()
            self.code.robot_lump(self.values, lumped)
            self.values = lumped

    def torques(self, q, v, a):
        motion = (ctypes.c_double * (3 * len(q)))(*np.stack([q, v, a], axis=1).ravel())
        forces = (ctypes.c_double * len(q))()
        self.code.robot_inverse_dynamics(motion, self.values, forces)
        return np.array(forces)


def fields(header, struct):
    found = re.search(r"typedef struct %s \{(.*?)\} %s;" % (struct, struct), header, re.S)
    return re.findall(r"double (\w+);", found.group(1)) if found else []


def call(*command):
    run = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=LONGEST)
    if run.returncode > 1 and "--allow-large" in run.stderr:
        command = [*command, "--allow-large"]
        run = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=LONGEST)
    if run.returncode > 1:
        raise RuntimeError(run.stderr.strip())
    return run.stdout


def numbers(path):
    lines = [line.split("#")[0] for line in path.read_text().splitlines()]
    return {name.strip(): float(value) for name, value in (line.split("=") for line in lines if "=" in line)}


def joints_of(model):
    """The coordinates of a model in order."""
    return re.findall(r"(\w+) \[", re.search(r"coordinate ([^;]*);", model.read_text()).group(1))


class OfPinocchio:
    def __init__(self, path, options):
        import pinocchio as pin

        self.pin = pin
        whole = pin.buildModelFromUrdf(str(path))
        held = dict(one.split("=") for name, one in zip(options, options[1:]) if name == "--lock")
        rest = pin.neutral(whole)
        for name, value in held.items():
            joint = whole.joints[whole.getJointId(name)]
            rest[joint.idx_q:joint.idx_q + joint.nq] = float(value) if joint.nq == 1 else [np.cos(float(value)), np.sin(float(value))]
        ids = [whole.getJointId(name) for name in held]
        self.model = pin.buildReducedModel(whole, ids, rest) if ids else whole
        self.data = self.model.createData()
        self.names = list(self.model.names[1:])
        joints = xml.parse(path).getroot().iter("joint")
        self.follows = {
            joint.get("name"): (float(mimic.get("multiplier", "1")), mimic.get("joint"))
            for joint in joints for mimic in joint.iter("mimic") if joint.get("name") in self.names
        }

    def configuration(self, q):
        out = self.pin.neutral(self.model)
        for joint, value in zip(self.model.joints[1:], q):
            # A joint without limits counts by cosine and sine there.
            out[joint.idx_q:joint.idx_q + joint.nq] = value if joint.nq == 1 else [np.cos(value), np.sin(value)]
        return out

    def torques(self, q, v, a):
        return self.pin.rnea(self.model, self.data, self.configuration(q), v, a)

    def losses(self, v):
        # Pinocchio reads friction of a URDF into fields that its recursion leaves out.
        return np.zeros(self.model.nv)

    def rank(self, coupling):
        random = np.random.default_rng(1)
        rows = []
        for _ in range(max(300, 40 * self.model.nv) // 3):
            q, v, a = random.normal(size=(3, coupling.shape[1])) @ coupling.T
            regressor = self.pin.computeJointTorqueRegressor(self.model, self.data, self.configuration(q), v, a)
            rows.append(coupling.T @ regressor)
        stacked = np.vstack(rows)
        values = np.linalg.svd(stacked, compute_uv=False)
        return int((values > 1e-5 * values[0]).sum())


class OfMuJoCo:
    def __init__(self, path, options):
        import mujoco

        self.mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_path(str(path))
        # Dry friction, limits and contacts are constraints there, and no part of the equations of motion.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self.data = mujoco.MjData(self.model)
        joint = mujoco.mjtObj.mjOBJ_JOINT
        self.names = [mujoco.mj_id2name(self.model, joint, at) or f"#{at}" for at in range(self.model.njnt)]
        if self.model.nv != self.model.njnt:
            raise RuntimeError("free or ball joints: compare such a model with its base held")
        self.follows = {
            self.names[own]: (data[1], self.names[other])
            for kind, own, other, data in zip(self.model.eq_type, self.model.eq_obj1id, self.model.eq_obj2id, self.model.eq_data)
            if kind == mujoco.mjtEq.mjEQ_JOINT
        }

    def torques(self, q, v, a):
        self.data.qpos, self.data.qvel, self.data.qacc = q, v, a
        self.mujoco.mj_inverse(self.model, self.data)
        return self.data.qfrc_inverse.copy()

    def losses(self, v):
        return self.model.dof_frictionloss * np.sign(v)

    def rank(self, coupling):
        return None


def coupling_of(peer):
    """The joints that lead, and the matrix from their positions to those of all joints: others follow by a factor."""
    leading = [name for name in peer.names if name not in peer.follows]
    matrix = np.zeros((len(peer.names), len(leading)))
    for row, name in enumerate(peer.names):
        factor, leader = peer.follows.get(name, (1.0, name))
        matrix[row, leading.index(leader)] = factor
    return leading, matrix


def judge(tpm, path, options):
    folder = Path(tempfile.mkdtemp())
    model = folder / "robot.tpm"
    began = time.time()
    call(tpm, "import", path, "-o", model, *options, "--angles", "written")
    of_urdf = path.suffix == ".urdf"
    peer = (OfPinocchio if of_urdf else OfMuJoCo)(path, options)
    own = joints_of(model)
    leading, coupling = coupling_of(peer)
    plain = [re.sub(r"\W", "_", name) for name in leading]
    # A name that means something else here has `_` behind it.
    order = [plain.index(name if name in plain else name.rstrip("_")) if name.rstrip("_") in plain or name in plain else at
             for at, name in enumerate(own)]
    bare = folder / "bare.tpm"
    call(tpm, "import", path, "-o", bare, *options, "--losses", "none")
    counted = json.loads(call(tpm, "identifiability", bare, "--any-motion", "--json"))["rank"]
    expected = peer.rank(coupling)
    prior = numbers(folder / "robot.prior.toml")
    if of_urdf:
        prior = {name: value for name, value in prior.items() if not name.startswith(("fv_", "fc_"))}
    code = Generated(tpm, model, prior, folder)
    random = np.random.default_rng(0)
    worst = 0.0
    for _ in range(STATES):
        q, v, a = random.normal(size=(3, len(own)))
        there = np.empty((3, len(own)))
        there[:, order] = np.stack([q, v, a])
        there = there @ coupling.T
        wanted = (coupling.T @ (peer.torques(*there) + peer.losses(there[1])))[order]
        worst = max(worst, np.abs(code.torques(q, v, a) - wanted).max() / max(1.0, np.abs(wanted).max()))
    ranks = f"{counted}" if expected is None else f"{counted} beside {expected}"
    right = worst < 1e-8 and expected in (None, counted)
    print(f"{'right' if right else 'WRONG':6} {path.name:34} {len(own):3} joints  rank {ranks:14} torques {worst:.1e}  {time.time() - began:.1f} s", flush=True)
    return right


def one(tpm, file):
    name, *options = file.split(":")
    try:
        return judge(tpm, Path(name), options)
    except Exception as fault:  # one file must not end the others
        lines = str(fault).strip().splitlines()
        first = next((line for line in lines if "rror" in line), lines[0] if lines else repr(fault))
        print(f"FAULT  {Path(name).name:34} {type(fault).__name__}: {first[:200]}", flush=True)
        return False


def main(tpm, *files):
    # A process for every file, since libraries may crash.
    right = sum(subprocess.run([sys.executable, __file__, "--one", tpm, file]).returncode == 0 for file in files)
    print(f"{right} of {len(files)} right")


if __name__ == "__main__":
    if sys.argv[1] == "--one":
        sys.exit(0 if one(*sys.argv[2:]) else 1)
    main(*sys.argv[1:])

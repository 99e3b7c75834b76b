"""What `tpm export` writes, executed: CasADi and structured text beside the generated C, a model for MuJoCo loaded by MuJoCo.

usage: check.py TPM MODELS

TPM is the program `tpm` (cargo build --release -p tpm-cli), MODELS the folder `models`. Needs cc and the packages casadi and blark; with the
package mujoco the file for MuJoCo is loaded, too. Every number may differ from that of C by 1e-9 of its size; the program ends with 1 where
one does. Structured text is parsed by blark, and executed after a translation of its statements into Python, line by line.
"""

import ctypes
import importlib.util
import math
import random
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import blark

MODELS = [
    "mass_spring_drag", "cart_pendulum", "three_carts", "two_carts", "closed_loop_arm", "rotary_pendulum", "rotary_pendulum_dry",
    "stribeck_pendulum", "brushless_motor", "emps", "silverbox", "robots/planar_arm", "robots/tx40",
]
TOLERANCE = 1e-9
POINTS = 20


def run(*command):
    return subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True)


def module(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    own = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(own)
    return own


def compiled(folder, prefix):
    run("cc", "-O2", "-std=c99", "-shared", "-fPIC", "-o", folder / "own.so", folder / f"{prefix}.c", "-lm")
    return ctypes.CDLL(str(folder / "own.so"))


def called(library, name, arguments, count):
    """What a function of C writes into its last argument; the structures hold numbers and nothing else."""
    result = (ctypes.c_double * max(count, 1))()
    vectors = [(ctypes.c_double * max(len(own), 1))(*own) for own in arguments]
    getattr(library, name)(*[ctypes.byref(own) for own in vectors], ctypes.byref(result))
    return list(result)[:count]


def executed(text):
    """The functions and blocks of structured text, as functions of Python that take and return values by name."""
    words = {"SIN": "math.sin", "COS": "math.cos", "TAN": "math.tan", "ASIN": "math.asin", "ACOS": "math.acos", "ATAN": "math.atan",
             "SQRT": "math.sqrt", "EXP": "math.exp", "LN": "math.log", "ABS": "abs", "AND": "and", "TRUE": "True"}
    text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.S)
    lines, section, inputs, outputs, name = [], None, [], [], None
    for line in (line.strip() for line in text.splitlines()):
        head = re.match(r"FUNCTION(_BLOCK)? (\w+)", line)
        if head:
            name, inputs, outputs, section = head[2], [], [] if head[1] else [head[2]], None
        elif line in ("VAR_INPUT", "VAR_OUTPUT", "VAR_TEMP"):
            section = line
        elif line == "END_VAR":
            section = None
        elif section:
            own, default = re.match(r"(\w+) : LREAL(?: := ([^;]+))?;", line).groups()
            {"VAR_INPUT": inputs, "VAR_OUTPUT": outputs}.get(section, []).append(f"{own}={default or 0.0}" if section == "VAR_INPUT" else own)
        elif line.startswith("END_FUNCTION"):
            result = "{" + ", ".join(f"'{own}': r_{own}" for own in outputs) + "}" if line == "END_FUNCTION_BLOCK" else f"r_{name}"
            lines += [f"    return {result}", ""]
        elif line:
            if not lines or lines[-1] == "":
                lines.append(f"def {name}({', '.join(inputs)}):")
                depth = 1
            for own, other in words.items():
                line = re.sub(rf"\b{own}\b", other, line)
            for own in outputs:
                line = re.sub(rf"\b{own}\b(?= :=)", f"r_{own}", line)
            line = line.replace(":=", "=")
            if line.startswith(("ELSIF", "ELSE", "END_IF")):
                depth -= 1
            line = re.sub(r"^IF (.*) THEN$", r"if \1:", re.sub(r"^ELSIF (.*) THEN$", r"elif \1:", line))
            line = "else:" if line == "ELSE" else line.rstrip(";")
            if not line.startswith("END_IF"):
                lines.append("    " * depth + line)
            depth += line.endswith(":")
    space = {"math": math}
    exec("\n".join(lines), space)
    return space


def worst(found, expected):
    """The largest difference, as a share of the sizes."""
    if len(found) != len(expected):
        sys.exit(f"{len(found)} numbers in place of {len(expected)}")
    size = max([1e-300, *map(abs, expected)])
    return max([0.0, *[abs(a - b) / size for a, b in zip(found, expected)]])


def check(tpm, model, folder):
    random.seed(str(model.name))
    values = folder / "values.toml"
    # Values of all parameters: a refusal names those that are missing.
    table = {}
    while True:
        values.write_text("".join(f"{name} = {value}\n" for name, value in table.items()))
        tried = subprocess.run([str(tpm), "export", str(model), "--params", str(values), "--to", "casadi", "-o", str(folder / "own.py")],
                               capture_output=True, text=True)
        if tried.returncode == 0:
            break
        missing = re.search(r"add lines for (.*)", tried.stderr)
        if not missing:
            sys.exit(f"{model}: {tried.stderr}")
        table.update({name: round(random.uniform(0.5, 2.0), 6) for name in missing[1].strip().split(", ")})
    own = module(folder / "own.py")
    run(tpm, "export", model, "--params", values, "--to", "st", "-o", folder / "own.st")
    text = (folder / "own.st").read_text()
    blark.parse_source_code(text)
    blocks = executed(text)
    forward = hasattr(own, "forward_dynamics")
    made = [tpm, "generate", model, "--lang", "c", "--prefix", "own", "-o", folder]
    run(*made, *(["--with", "forward_dynamics"] if forward else []))
    library = compiled(folder, "own")
    orders = [len(re.findall(r"double (?:value|dot|ddot|der\d+);", body)) - 1
              for body in re.findall(r"typedef struct own_\w+_motion \{(.*?)\}", (folder / "own.h").read_text(), re.S)]
    highest = max(orders)
    differences = {}

    def note(what, found, expected):
        differences[what] = max(differences.get(what, 0.0), worst(found, expected))

    for _ in range(POINTS):
        motion = [[random.uniform(-2, 2) for _ in orders] for _ in range(highest + 1)]
        constants = [random.uniform(0.5, 2) for _ in own.CONSTANTS]
        flat = [motion[order][place] for place, most in enumerate(orders) for order in range(most + 1)]
        theta = own.IDENTIFIED
        more = [constants] if constants else []
        known = {name: value for name, value in zip(own.CONSTANTS, constants)}
        forces = called(library, "own_inverse_dynamics", [flat, theta, *more], len(own.EQUATIONS))
        note("inverse dynamics", own.inverse_dynamics(*motion, *more).full().ravel().tolist(), forces)
        by_name = dict(known)
        for place, (name, most) in enumerate(zip(own.COORDINATES, orders)):
            spelled = [name, f"dot({name})", f"ddot({name})", *(f"der({name}, {order})" for order in range(3, most + 1))]
            by_name.update({spelled[order]: motion[order][place] for order in range(most + 1)})
        has_inputs = hasattr(own, "feed_forward")
        expected = called(library, "own_feed_forward", [flat, theta, *more], len(own.INPUTS)) if has_inputs else forces
        if has_inputs:
            note("feed-forward", own.feed_forward(*motion, *more).full().ravel().tolist(), expected)
        for name, block in blocks.items():
            if name.endswith(("_FeedForward", "_InverseDynamics")):
                # Identifiers of the language may differ from the model's names, which stand in the comments.
                declared = re.search(rf"FUNCTION_BLOCK {name}\n(.*?)END_VAR", text, re.S)[1]
                inputs = re.findall(r"(\w+) : LREAL[^;]*; \(\* `([^`]+)`", declared)
                given = {identifier: by_name[told] for identifier, told in inputs if told in by_name}
                note("structured text", list(block(**given).values()), expected)
        if forward:
            inputs = [random.uniform(-2, 2) for _ in own.INPUTS]
            expected = called(library, "own_forward_dynamics", [flat, inputs, theta, *more], len(orders))
            note("forward dynamics", own.forward_dynamics(*motion[:-1], inputs, *more).full().ravel().tolist(), expected)
    return differences


def mujoco(tpm, models, folder):
    """Armature, damping and friction of the joints of a shipped arm, as MuJoCo reads them."""
    try:
        import mujoco
    except ImportError:
        return print("MuJoCo is not here; the file for it is not loaded")
    values = {"Ia_q1": 0.03, "fv_q1": 0.4, "fc_q1": 0.9, "fv_q2": 0.2, "fc_q2": 0.5, "Ia_q2": 0.01}
    (folder / "losses.toml").write_text("".join(f"{name} = {value}\n" for name, value in values.items()))
    joint = '<body name="{0}" pos="0 0 .3"><joint name="{0}" axis="0 1 0"/><geom size=".05" mass="1"/>{1}</body>'
    text = f'<mujoco><default><joint damping="9"/></default><worldbody>{joint.format("q1", joint.format("q2", ""))}</worldbody></mujoco>'
    (folder / "robot.xml").write_text(text)
    model = models / "robots/planar_arm.tpm"
    run(tpm, "export", model, "--params", folder / "losses.toml", "--to", "mjcf", "--into", folder / "robot.xml", "-o", folder / "new.xml")
    own = mujoco.MjModel.from_xml_path(str(folder / "new.xml"))
    found = [*own.dof_armature, *own.dof_damping, *own.dof_frictionloss]
    expected = [values[f"{name}_{joint}"] for name in ("Ia", "fv", "fc") for joint in ("q1", "q2")]
    print(f"MuJoCo {mujoco.__version__}: largest difference {worst(found, expected):.1e}")
    return worst(found, expected)


def main():
    tpm, models = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    largest = 0.0
    print("| model | " + " | ".join(kinds := ["inverse dynamics", "feed-forward", "forward dynamics", "structured text"]) + " |")
    print("|---|---|---|---|---|")
    for name in MODELS:
        with tempfile.TemporaryDirectory() as folder:
            found = check(tpm, models / f"{name}.tpm", Path(folder))
        largest = max(largest, *found.values())
        print(f"| {name} | " + " | ".join(f"{found[kind]:.1e}" if kind in found else "-" for kind in kinds) + " |", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        largest = max(largest, mujoco(tpm, models, Path(folder)) or 0.0)
    sys.exit(largest > TOLERANCE)


if __name__ == "__main__":
    main()

"""Inverse and forward dynamics and regressors of arms beside CasADi and Pinocchio: operations, instructions and times of one run, as one table.

usage: beside_casadi.py TPM ARMS DESCRIPTIONS FIXTURES

TPM is the program `tpm`, ARMS the program `arms` (cargo build --release -p tpm-cli -p tpm-benches), DESCRIPTIONS the folder of the URDF
files, FIXTURES tests/fixtures/robots: the torques are compared with Pinocchio's first. Needs the package casadi, gcc and valgrind; with the
package pin, Pinocchio is timed too (through its Python interface).

The models are what `tpm import --losses none` reads: inertias at run time, no friction, the panda's fingers locked. CasADi is given the
recursion written by hand (SX, cse), with angles as `tpm import` reads them, so that it has the same exact zeros and ones, and it makes the
columns of tpm's base parameters and no others. Instructions are those of one call by callgrind, sines and cosines included; both C files
are compiled by `gcc -O2`. Times are the shortest of a hundred means over 4000 calls.
"""

import json
import math
import re
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as xml
from pathlib import Path

import casadi as ca
import numpy as np

ROBOTS = {"ur10": ("ur10_robot", []), "xarm7": ("xarm7", []), "panda": ("panda", ["panda_finger_joint1", "panda_finger_joint2"])}
NAMES = ["m", "mx", "my", "mz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz"]


def exact(value):
    """Numbers within rounding of an integer are that integer, so that CasADi leaves out what is zero or one."""
    return round(value) if abs(value - round(value)) < 1e-12 else value


def rotation(rpy):
    def quarter(angle):
        turns = round(angle / (math.pi / 2))
        return turns * math.pi / 2 if abs(angle - turns * math.pi / 2) <= 1e-4 else angle

    (cr, sr), (cp, sp), (cy, sy) = ((exact(math.cos(quarter(a))), exact(math.sin(quarter(a)))) for a in rpy)
    return [[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr]]


def chain(path, locked):
    """The joints from the base outward, fixed ones put into the next: name of the link, parent, rotation, origin, axis."""
    root = xml.parse(path).getroot()
    joints = root.findall("joint")
    children = {joint.find("child").get("link") for joint in joints}
    base = next(link.get("name") for link in root.findall("link") if link.get("name") not in children)
    links, place = [], {base: (None, np.eye(3), np.zeros(3))}
    pending = [base]
    while pending:
        link = pending.pop(0)
        for joint in joints:
            if joint.find("parent").get("link") != link:
                continue
            origin = joint.find("origin")
            numbers = lambda key: [float(w) for w in (origin.get(key, "0 0 0") if origin is not None else "0 0 0").split()]
            parent, turn, at = place[link]
            at = at + turn @ np.array(numbers("xyz"))
            turn = turn @ np.array(rotation(numbers("rpy")), float)
            child = joint.find("child").get("link")
            moves = joint.get("type") in ("revolute", "continuous") and joint.get("name") not in locked
            if moves:
                axis = [float(w) for w in joint.find("axis").get("xyz").split()]
                clean = lambda rows: [[exact(x) for x in row] for row in rows]
                links.append((child, parent, clean(turn), [exact(x) for x in at], axis))
                place[child] = (len(links) - 1, np.eye(3), np.zeros(3))
            else:
                place[child] = (parent, turn, at)
            pending.append(child)
    return links


# Vectors are lists of SX or numbers: CasADi folds numbers that are exactly zero or one.
def dot(a, b):
    total = 0
    for x, y in zip(a, b):
        if not (is_zero(x) or is_zero(y)):
            product = y if is_one(x) else x if is_one(y) else x * y
            total = product if is_zero(total) else total + product
    return total


def is_zero(x):
    return (isinstance(x, (int, float)) and x == 0) or (isinstance(x, ca.SX) and x.is_zero())


def is_one(x):
    return (isinstance(x, (int, float)) and x == 1) or (isinstance(x, ca.SX) and x.is_one())


def add(*vectors):
    return [dot([1] * len(vectors), parts) for parts in zip(*vectors)]


def cross(a, b):
    return [dot([a[1], neg(a[2])], [b[2], b[1]]), dot([a[2], neg(a[0])], [b[0], b[2]]), dot([a[0], neg(a[1])], [b[1], b[0]])]


def neg(x):
    return 0 if is_zero(x) else -x


def times(rows, vector):
    return [dot(row, vector) for row in rows]


def transposed(rows):
    return [list(column) for column in zip(*rows)]


def turned(axis, q):
    """The rotation by q about an axis x, y or z (or its negative)."""
    k = max(range(3), key=lambda i: abs(axis[i]))
    assert abs(axis[k]) == 1 and sum(abs(a) for a in axis) == 1, "an axis of the frame"
    c, s = ca.cos(q), ca.sin(q)
    s = s if axis[k] > 0 else -s
    i, j = (k + 1) % 3, (k + 2) % 3
    rows = [[0] * 3 for _ in range(3)]
    rows[k][k], rows[i][i], rows[j][j], rows[i][j], rows[j][i] = 1, c, c, -s, s
    return rows


def motions(links, q, v, a):
    """w, e, linear acceleration with gravity, and U = [e]x + [w]x[w]x of every link, in its frame, with its rotation."""
    found = []
    for i, (_, parent, turn, origin, axis) in enumerate(links):
        if parent is None:
            w, e, acc, field = [0] * 3, [0] * 3, [0, 0, 9.81], [[0] * 3 for _ in range(3)]
        else:
            w, e, acc, field = found[parent][:4]
        joint = turned(axis, q[i])
        inward = lambda x, joint=joint, turn=turn: times(transposed(joint), times(transposed(turn), x))
        outward = lambda x, joint=joint, turn=turn: times(turn, times(joint, x))
        acc = inward(add(acc, times(field, origin)))
        rate = [x * v[i] if x not in (0, 1) else (v[i] if x else 0) for x in axis]
        second = [x * a[i] if x not in (0, 1) else (a[i] if x else 0) for x in axis]
        w, e = inward(w), inward(e)
        e = add(e, second, cross(w, rate))
        w = add(w, rate)
        (x, y, z), (ex, ey, ez) = w, e
        xx, yy, zz, xy, yz, zx = dot([x], [x]), dot([y], [y]), dot([z], [z]), dot([x], [y]), dot([y], [z]), dot([z], [x])
        minus = lambda s, t: add([s], [neg(t)])[0]
        field = [[neg(add([yy], [zz])[0]), minus(xy, ez), add([zx], [ey])[0]],
                 [add([xy], [ez])[0], neg(add([zz], [xx])[0]), minus(yz, ex)],
                 [minus(zx, ey), add([yz], [ex])[0], neg(add([xx], [yy])[0])]]
        moments = [[ex, zx, neg(xy)], [neg(field[2][0]), field[2][1], minus(xx, yy)], [field[1][0], minus(zz, xx), neg(field[1][2])],
                   [neg(yz), ey, xy], [minus(yy, zz), neg(field[0][1]), field[0][2]], [yz, neg(zx), ez]]
        found.append((w, e, acc, field, moments, outward))
    return found


def torques(links, q, v, a, parameters):
    moving = motions(links, q, v, a)
    wrenches = [([0] * 3, [0] * 3) for _ in links]
    result = [None] * len(links)
    for i in reversed(range(len(links))):
        _, parent, _, origin, axis = links[i]
        _, _, acc, field, moments, outward = moving[i]
        p = parameters[i]
        first = p[1:4]
        force = add(wrenches[i][0], [dot([p[0]], [x]) for x in acc], times(field, first))
        turning = [dot([column[k] for column in moments], p[4:]) for k in range(3)]
        moment = add(wrenches[i][1], turning, cross(first, acc))
        result[i] = dot(axis, moment)
        if parent is not None:
            force, moment = outward(force), outward(moment)
            moment = add(moment, cross(origin, force))
            wrenches[parent] = (add(wrenches[parent][0], force), add(wrenches[parent][1], moment))
    return result


def regressor(links, q, v, a, kept):
    """The wrench of one unit of every kept parameter, sent inward; row of joint j sees the links outward of j."""
    moving = motions(links, q, v, a)
    entries = []
    for i in range(len(links)):
        _, _, acc, field, moments, _ = moving[i]
        for k in range(10):
            if (i, k) not in kept:
                continue
            if k == 0:
                force, moment = acc, [0] * 3
            elif k < 4:
                unit = [int(k - 1 == j) for j in range(3)]
                force, moment = [row[k - 1] for row in field], cross(unit, acc)
            else:
                force, moment = [0] * 3, moments[k - 4]
            link = i
            while link is not None:
                _, parent, _, origin, axis = links[link]
                entries.append(dot(axis, moment))
                if parent is not None:
                    outward = moving[link][5]
                    force, moment = outward(force), outward(moment)
                    moment = add(moment, cross(origin, force))
                link = parent
    return [entry for entry in entries if not is_zero(entry)]


def skew(p):
    return ca.vertcat(ca.horzcat(0, -p[2], p[1]), ca.horzcat(p[2], 0, -p[0]), ca.horzcat(-p[1], p[0], 0))


def symmetric(matrix):
    """The upper half for both, since nothing else says that they are equal."""
    return ca.vertcat(*(ca.horzcat(*(matrix[min(i, j), max(i, j)] for j in range(3))) for i in range(3)))


def accelerations(links, q, v, forces, parameters):
    """The articulated-body algorithm (Featherstone), moments about the origins of the links' frames: forces are (n, f), motions (w, v)."""
    column = lambda x: ca.vertcat(*x)
    moving, bodies = [], []
    for i, (_, parent, turn, origin, axis) in enumerate(links):
        rotation = ca.mtimes(ca.SX(turn), column([ca.horzcat(*row) for row in turned(axis, q[i])]))
        s, p = column(axis), column(origin)
        w, u = moving[parent][:2] if parent is not None else (ca.SX.zeros(3), ca.SX.zeros(3))
        w, u = ca.mtimes(rotation.T, w), ca.mtimes(rotation.T, u + ca.cross(w, p))
        rate = s * v[i]
        bend, slip = ca.cross(w, rate), ca.cross(u, rate)
        w = w + rate
        moving.append((w, u, rotation, p, s, bend, slip))
        m, x, y, z, ixx, ixy, ixz, iyy, iyz, izz = parameters[i]
        first = column([x, y, z])
        inertia = column([ca.horzcat(ixx, ixy, ixz), ca.horzcat(ixy, iyy, iyz), ca.horzcat(ixz, iyz, izz)])
        momentum, turning = m * u + ca.cross(w, first), ca.mtimes(inertia, w) + ca.cross(first, u)
        bias = [ca.cross(w, turning) + ca.cross(u, momentum), ca.cross(w, momentum)]
        bodies.append([inertia, skew(first), m * ca.SX.eye(3), *bias])
    pivots = [None] * len(links)
    for i in reversed(range(len(links))):
        _, parent, _, _, _ = links[i]
        _, _, rotation, p, s, bend, slip = moving[i]
        inertia, coupling, mass, moment, force = bodies[i]
        a, b = ca.mtimes(inertia, s), ca.mtimes(coupling.T, s)
        d = 1 / ca.dot(s, a)
        left = forces[i] - ca.dot(s, moment)
        pivots[i] = (a, b, d, left)
        if parent is None:
            continue
        inertia = symmetric(inertia - d * ca.mtimes(a, a.T))
        coupling = coupling - d * ca.mtimes(a, b.T)
        mass = symmetric(mass - d * ca.mtimes(b, b.T))
        moment = moment + ca.mtimes(inertia, bend) + ca.mtimes(coupling, slip) + a * (left * d)
        force = force + ca.mtimes(coupling.T, bend) + ca.mtimes(mass, slip) + b * (left * d)
        out = lambda x: ca.mtimes(ca.mtimes(rotation, x), rotation.T)
        inertia, coupling, mass = symmetric(out(inertia)), out(coupling), symmetric(out(mass))
        moment, force = ca.mtimes(rotation, moment), ca.mtimes(rotation, force)
        cross = skew(p)
        carried = coupling + ca.mtimes(cross, mass)
        inertia = symmetric(inertia - ca.mtimes(coupling, cross) + ca.mtimes(cross, carried.T))
        for place, part in enumerate([inertia, carried, mass, moment + ca.cross(p, force), force]):
            bodies[parent][place] = bodies[parent][place] + part
    result, found = [], []
    for i, (_, parent, _, _, _) in enumerate(links):
        _, _, rotation, p, s, bend, slip = moving[i]
        e, acc = found[parent] if parent is not None else (ca.SX.zeros(3), ca.SX([0, 0, 9.81]))
        e, acc = ca.mtimes(rotation.T, e) + bend, ca.mtimes(rotation.T, acc + ca.cross(e, p)) + slip
        a, b, d, left = pivots[i]
        own = (left - ca.dot(a, e) - ca.dot(b, acc)) * d
        result.append(own)
        found.append((e + s * own, acc))
    return result


OPS = {"mul": {ca.OP_MUL, ca.OP_DIV, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV}, "add": {ca.OP_ADD, ca.OP_SUB, ca.OP_NEG}, "call": {ca.OP_SIN, ca.OP_COS}}


def counts(name, inputs, outputs):
    function = ca.Function(name, inputs, [ca.densify(ca.vertcat(*outputs))], {"cse": True})
    kinds = [function.instruction_id(i) for i in range(function.n_instructions())]
    return [sum(kind in OPS[key] for kind in kinds) for key in ("mul", "add", "call")], function


def check(links, fixture, prior, description):
    """The torques at Pinocchio's states, with the description's inertias."""
    values = dict(line.split(" = ") for line in prior.read_text().splitlines() if " = " in line and not line.startswith("#"))
    joints = {joint.find("child").get("link"): joint.get("name") for joint in xml.parse(description).getroot().findall("joint")}
    known = json.loads(fixture.read_text())
    order = [known["joints"].index(joints[link]) for link, *_ in links]
    parameters = [[float(values.get(f"{name}_{link}", 0)) for name in NAMES] for link, *_ in links]
    for state in known["states"]:
        q, v, a, wanted = ([state[key][i] for i in order] for key in ("q", "v", "a", "torque"))
        numbers = lambda x: [ca.SX(value) for value in x]
        found = [float(ca.evalf(ca.SX(x))) for x in torques(links, numbers(q), numbers(v), numbers(a), parameters)]
        scale = max(abs(x) for x in wanted)
        worst = max(abs(x - y) for x, y in zip(found, wanted)) / scale
        assert worst < 1e-9, f"{fixture.stem}: {found} beside {wanted}"
        back = [float(ca.evalf(ca.SX(x))) for x in accelerations(links, numbers(q), numbers(v), numbers(found), parameters)]
        worst = max(abs(x - y) for x, y in zip(back, a)) / max(abs(x) for x in a)
        assert worst < 1e-8, f"{fixture.stem}: accelerations {back} beside {a}"


HARNESS = """
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
@HEAD@
static double in[512], out[4096];
__attribute__((noinline)) static void once(void) { @CALL@; }
int main(int count, char **words) {
    int calls = atoi(words[1]), parts = atoi(words[2]);
    for (int i = 0; i < 512; i++) in[i] = 0.1 + 0.7 * ((i * 7919) % 101) / 101.0;
    @VALUES@
    double best = 1e9, sum = 0;
    for (int part = 0; part < parts; part++) {
        struct timespec a, b;
        clock_gettime(CLOCK_MONOTONIC, &a);
        for (int i = 0; i < calls; i++) { in[i % 18] += 1e-6; once(); sum += out[0]; }
        clock_gettime(CLOCK_MONOTONIC, &b);
        double each = ((b.tv_sec - a.tv_sec) * 1e9 + (b.tv_nsec - a.tv_nsec)) / calls;
        if (each < best) best = each;
    }
    printf("%.1f %g\\n", best, sum);
    return count < 3;
}
"""


# Inertias of bodies that are possible, by the parameter: forward dynamics of others are those of no machine.
VALUES = {"m": 3, "mx": 0.1, "my": 0.1, "mz": 0.1, "Ixx": 1, "Ixy": 0.02, "Ixz": 0.02, "Iyy": 1, "Iyz": 0.02, "Izz": 1}


def measured(folder, name, head, call, sources, values=()):
    """Instructions of one call, and its time in ns; `values` are those of some places of the arguments."""
    source, program = folder / f"{name}_main.c", folder / f"{name}_main"
    text = " ".join(f"in[{place}] = {value};" for place, value in values)
    source.write_text(HARNESS.replace("@HEAD@", head).replace("@CALL@", call).replace("@VALUES@", text))
    subprocess.run(["gcc", "-O2", "-I", folder, "-o", program, source, *sources, "-lm"], check=True)

    def instructions(calls):
        command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder / 'callgrind'}", program, str(calls), "1"]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stderr
        return int(re.search(r"Collected : (\d+)", said).group(1))

    each = (instructions(1100) - instructions(100)) / 1000
    times = subprocess.run([program, "4000", "100"], check=True, capture_output=True, text=True).stdout
    return round(each), float(times.split()[0])


def by_casadi(folder, name, function):
    generated = function.generate(f"{name}.c", {"with_header": True})
    for kind in (".c", ".h"):
        Path(generated).with_suffix(kind).replace(folder / f"{name}{kind}")
    places = [0]
    for i in range(function.n_in()):
        places.append(places[-1] + function.nnz_in(i))
    arguments = ", ".join(f"in + {place}" for place in places[:-1])
    call = f"const double *arg[] = {{{arguments}}}; double *res[] = {{out}}; {function.name()}(arg, res, iw, w, 0)"
    head = f'#include "{name}.h"\nstatic casadi_int iw[{max(function.sz_iw(), 1)}]; static double w[{max(function.sz_w(), 1)}];'
    last = function.n_in() - 1
    links = function.size1_in(last)
    values = [(places[last] + k * links + i, VALUES[own]) for k, own in enumerate(NAMES) for i in range(links)]
    return measured(folder, name, head, call, [folder / f"{name}.c"], values if function.size2_in(last) == 10 else ())


def by_tpm(folder, tpm, name, model, function):
    parts = "base_regressor,forward_dynamics"
    subprocess.run([tpm, "generate", model, "--lang", "c", "--prefix", name, "--with", parts, "-o", folder],
                   check=True, capture_output=True)
    header = (folder / f"{name}.h").read_text()
    fields = re.search(rf"typedef struct (?:\w+ )?{{([^}}]*)}} {name}_parameters;", header).group(1)
    fields = re.findall(r"double (\w+);", re.sub(r"/\*.*?\*/", "", fields, flags=re.S))
    values = [(40 + k, VALUES[field.split("_")[0]]) for k, field in enumerate(fields)]
    call = {
        "inverse_dynamics": f"{name}_inverse_dynamics((const {name}_motion *)in, (const {name}_parameters *)(in + 40), ({name}_forces *)out)",
        "base_regressor": f"{name}_base_regressor((const {name}_motion *)in, (void *)out)",
        "forward_dynamics": f"{name}_forward_dynamics((const {name}_motion *)in, (const {name}_inputs *)(in + 30), "
                            f"(const {name}_parameters *)(in + 40), ({name}_accelerations *)out)",
    }[function]
    return measured(folder, f"{name}_{function}", f'#include "{name}.h"', call, [folder / f"{name}.c"], values)


def by_pinocchio(path, locked):
    """Times of inverse dynamics and of the full regressor through Python, in ns; nothing without the package."""
    try:
        import pinocchio
    except ImportError:
        return None
    model = pinocchio.buildModelFromUrdf(str(path))
    if locked:
        model = pinocchio.buildReducedModel(model, [model.getJointId(joint) for joint in locked], pinocchio.neutral(model))
    data = model.createData()
    q, v, a = pinocchio.randomConfiguration(model), np.random.rand(model.nv), np.random.rand(model.nv)

    def each(call):
        best = math.inf
        for _ in range(5):
            start = time.perf_counter()
            for _ in range(2000):
                call(model, data, q, v, a)
            best = min(best, (time.perf_counter() - start) / 2000)
        return 1e9 * best

    return each(pinocchio.rnea), each(pinocchio.computeJointTorqueRegressor)


def main():
    tpm, arms, descriptions, fixtures = (Path(word).resolve() for word in sys.argv[1:5])
    work = ["inverse dynamics, all parameters", "inverse dynamics, base parameters", "regressor, base columns", "forward dynamics"]
    print("| arm | base | work | operations: CasADi | tpm | ratio | instructions: CasADi | tpm | ratio | ns: CasADi | tpm | Pinocchio |")
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name, (file, locked) in ROBOTS.items():
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            model, description = folder / f"{name}.tpm", descriptions / f"{file}.urdf"
            locks = [word for joint in locked for word in ("--lock", f"{joint}=0")]
            subprocess.run([tpm, "import", description, "--losses", "none", *locks, "-o", model], check=True, capture_output=True)
            leading = set(subprocess.run([arms, "--columns", model], check=True, capture_output=True, text=True).stdout.split())
            own = subprocess.run([arms, model], check=True, capture_output=True, text=True).stdout.split()
            links = chain(description, locked)
            n = len(links)
            q, v, a = (ca.SX.sym(letter, n) for letter in "qva")
            split = lambda x: [x[i] for i in range(n)]
            theta = ca.SX.sym("theta", n, 10)
            kept = {(i, k) for i in range(n) for k in range(10) if f"{NAMES[k]}_{links[i][0]}" in leading}
            everything = [[theta[i, k] for k in range(10)] for i in range(n)]
            alone = [[theta[i, k] if (i, k) in kept else 0 for k in range(10)] for i in range(n)]
            state = [split(x) for x in (q, v, a)]
            check(links, fixtures / f"{name}.json", folder / f"{name}.prior.toml", description)
            functions = [torques(links, *state, everything), torques(links, *state, alone), regressor(links, *state, kept),
                         accelerations(links, *state, everything)]
            assert len(kept) == int(own[1]), (name, len(kept), own[1])
            pinocchio = by_pinocchio(description, locked)
            for what, outputs, ours in zip(work, functions, [*own[2:5], None]):
                inputs = [q, v, a] + ([theta] if outputs is not functions[2] else [])
                theirs, function = counts(f"{name}_{work.index(what)}", inputs, outputs)
                beside = "- | -"
                if ours:
                    ratio = sum(int(x) for x in ours.split("/")[:2]) / sum(theirs[:2])
                    beside = f"{ours} | {ratio:.2f}"
                line = f"| {name} | {own[1]} | {what} | {'/'.join(map(str, theirs))} | {beside} |"
                casadi = by_casadi(folder, f"casadi_{work.index(what)}", function)
                made = {0: "inverse_dynamics", 2: "base_regressor", 3: "forward_dynamics"}.get(work.index(what))
                if made:
                    here = by_tpm(folder, tpm, name, model, made)
                    beside = f"{pinocchio[work.index(what) // 2]:.0f}" if pinocchio and made != "forward_dynamics" else "-"
                    line += f" {casadi[0]} | {here[0]} | {here[0] / casadi[0]:.2f} | {casadi[1]:.0f} | {here[1]:.0f} | {beside} |"
                else:
                    line += f" {casadi[0]} | - | - | {casadi[1]:.0f} | - | - |"
                print(line, flush=True)


if __name__ == "__main__":
    main()

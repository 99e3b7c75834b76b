#!/usr/bin/env python3
"""How the work of a verb grows with what it reads: processor time over size, and the exponent of the last two sizes that were answered.

    benches/growth.py TPM [SECONDS]

TPM is the program, SECONDS the longest time of one run (10 where nothing is said). It prints a table in Markdown: for every verb and size the
seconds of the processor with the exit code where it is not 0, and the exponent. A refusal (2) ends a row: what is refused costs no more.
"""
import math
import os
import resource
import signal
import subprocess
import sys
import tempfile

# Time below which the start of the program, and not its work, is measured.
START = 0.05


def ring(n):
    """n masses in a ring, each with an input of its own."""
    names = lambda letter: ", ".join(f"{letter}{i}" for i in range(n))
    rows = "".join(f"  m*ddot(x{i}) + m*x{(i + 1) % n} = u{i};\n" for i in range(n))
    moves = " ".join(f"x{i} = A*cos(w*t);" for i in range(n))
    return (f"model Ring {{\n  coordinate {names('x')};\n  input {names('u')};\n  parameter m;\n{rows}"
            f"  pattern {{ amplitude A; frequency w; {moves} }}\n}}\n")


def robot(attributes, links):
    """A chain of links, with attributes on its root that mean nothing."""
    extra = "".join(f' a{i}="1"' for i in range(attributes))
    inertial = ('<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>')
    bodies = "".join(f'<link name="b{i}">{inertial}</link>' for i in range(links + 1))
    joints = "".join(
        f'<joint name="j{i}" type="{"revolute" if i == 0 else "fixed"}"><parent link="b{i}"/><child link="b{i + 1}"/>'
        '<origin xyz="0.1 0 0"/><axis xyz="0 0 1"/><limit effort="1" velocity="1" lower="-1" upper="1"/></joint>'
        for i in range(links))
    return f'<robot name="r"{extra}>{bodies}{joints}</robot>'


def log(lines, columns):
    """A sine and its force, with further columns."""
    head = "t_s,x,u" + "".join(f",c{i}" for i in range(columns))
    rest = ",0" * columns
    rows = (f"{i / 100:.2f},{math.sin(i / 20):.6f},{math.cos(i / 20):.6f}{rest}" for i in range(lines))
    return head + "\n" + "\n".join(rows) + "\n"


SIGN = ("model S {{\n  coordinate x; input u; parameter m, c;\n  m*ddot(x) + c*sign(dot(x)) = u;\n"
        "  pattern {{ amplitude A; frequency w; harmonics {}; x = A*cos(w*t); }}\n}}\n")

VALUES = ["--value", "m=1"]
MOTION = [*VALUES, "--value", "A=1", "--value", "w=1"]
COORDINATES = [10, 20, 40, 80]
# Name of the row, sizes, name of the file, its text by size, arguments.
ROWS = [
    ("check, coordinates", COORDINATES, "m.tpm", ring, ["check", "m.tpm"]),
    ("expand, coordinates", COORDINATES, "m.tpm", ring, ["expand", "m.tpm"]),
    ("identifiability, coordinates", COORDINATES, "m.tpm", ring, ["identifiability", "m.tpm"]),
    ("split, coordinates", COORDINATES, "m.tpm", ring, ["split", "m.tpm"]),
    ("generate, coordinates", COORDINATES, "m.tpm", ring, ["generate", "m.tpm", "--lang", "rust"]),
    ("linearize, coordinates", COORDINATES, "m.tpm", ring, ["linearize", "m.tpm", *VALUES]),
    ("regulate, coordinates", COORDINATES, "m.tpm", ring,
     ["regulate", "m.tpm", *VALUES, "--sample-time", "1e-3", "--derivative-filter", "0.02"]),
    ("trajectories, coordinates", COORDINATES, "m.tpm", ring, ["trajectories", "m.tpm", *MOTION]),
    ("expand, harmonics", [10**k for k in range(1, 7)], "m.tpm", SIGN.format, ["expand", "m.tpm"]),
    ("identifiability, harmonics", [10**k for k in range(1, 7)], "m.tpm", SIGN.format, ["identifiability", "m.tpm"]),
    ("import, attributes", [50, 1000, 10000, 100000], "r.urdf", lambda n: robot(n, 1), ["import", "r.urdf", "-o", "-"]),
    ("import, links", [10, 100, 1000, 10000], "r.urdf", lambda n: robot(0, n), ["import", "r.urdf", "-o", "-"]),
    ("inspect, lines", [1000, 10000, 100000], "l.csv", lambda n: log(n, 0), ["inspect", "l.csv"]),
    ("inspect, columns", [10, 100, 1000], "l.csv", lambda n: log(200, n), ["inspect", "l.csv"]),
]


def run(arguments, folder, longest):
    """Processor seconds and exit code; the code is None where the time was not enough."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    child = subprocess.Popen(arguments, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                             preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(longest),) * 2))
    code = child.wait()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    taken = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return taken, None if code in (-signal.SIGXCPU, -signal.SIGKILL) else code


def exponent(points):
    """The slope between the last two answered sizes, once both take longer than the start of the program."""
    seen = [(size, time) for size, time, code in points if code in (0, 1) and time > START]
    if len(seen) < 2:
        return "-"
    (small, before), (large, after) = seen[-2:]
    return f"{math.log(after / before) / math.log(large / small):.1f}"


def main():
    tpm, longest = os.path.abspath(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    print("| verb, what grows | processor seconds by size | exponent |\n|---|---|---|")
    for name, sizes, file, text, arguments in ROWS:
        points = []
        for size in sizes:
            with tempfile.TemporaryDirectory() as folder:
                with open(os.path.join(folder, file), "w") as out:
                    out.write(text(size))
                time, code = run([tpm, *arguments], folder, longest)
            points.append((size, time, code))
            if code not in (0, 1):
                break
        said = {0: "", 1: " (1)", 2: " refused", None: " not ended"}
        cells = ", ".join(f"{size}: {time:.2f}{said.get(code, f' code {code}')}" for size, time, code in points)
        print(f"| {name} | {cells} | {exponent(points)} |", flush=True)


if __name__ == "__main__":
    main()

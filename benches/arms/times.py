"""Times and memory of identified arms: `python3 times.py TPM UR10 ARM7 [TX40_MODEL TX40_LOG]` (`pip install pin numpy`).

Logs of the machine of `cramer_rao.py`, its dry and viscous friction and rotors: the UR10, its first three joints, and an arm of seven joints
(`xarm7.urdf`), ten parameters of inertia and three of every drive; the TX40's log as it was measured (`tx40.py`). Of three runs of the whole
process the least time, wall clock and processors together, and the largest memory.
"""

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as xml
from pathlib import Path

import cramer_rao
import numpy as np
from cramer_rao import Machine, imported
from tx40 import MAPS

# A seventh joint like the sixth.
for name in ("VISCOUS", "COULOMB", "ROTOR"):
    values = getattr(cramer_rao, name)
    setattr(cramer_rao, name, np.append(values, values[-1]))


def shortened(urdf, count, folder):
    """The description with the first joints that move only, a chain."""
    tree = xml.parse(urdf)
    root = tree.getroot()
    parents = {joint.find("child").get("link"): joint for joint in root.findall("joint")}

    def moving(link):
        joint = parents.get(link)
        return 0 if joint is None else moving(joint.find("parent").get("link")) + (joint.get("type") != "fixed")

    for link in list(root.findall("link")):
        if moving(link.get("name")) > count:
            root.remove(parents[link.get("name")])
            root.remove(link)
    for other in list(root.findall("transmission")) + list(root.findall("gazebo")):
        root.remove(other)
    file = folder / f"first_{count}.urdf"
    tree.write(file)
    return str(file)


# A process of its own, since the largest memory of a child begins with that of the process from which it is forked.
HELPER = """
import os, sys, time
started = time.time()
pid = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=[(os.POSIX_SPAWN_OPEN, n, "/dev/null", os.O_WRONLY, 0) for n in (1, 2)])
_, status, usage = os.wait4(pid, 0)
print(os.waitstatus_to_exitcode(status), time.time() - started, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)
"""


def measured(command):
    """Exit code, least wall-clock time, least time of processors, largest memory in MB."""
    runs = []
    for _ in range(3):
        words = [sys.executable, "-S", "-c", HELPER, *map(str, command)]
        runs.append([float(word) for word in subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()])
    codes, walls, busy, memory = zip(*runs)
    return int(max(codes)), min(walls), min(busy), max(memory)


def main(tpm, ur10, arm7, *tx40):
    folder = Path(tempfile.mkdtemp())
    cases = [
        ("6 joints, 10,000 samples", ur10, 500.0, 2.0),
        ("7 joints, 10,000 samples", arm7, 500.0, 2.0),
        ("6 joints, 100,000 samples", ur10, 5000.0, 2.0),
        ("3 joints, 20,000 samples", shortened(ur10, 3, folder), 1000.0, 2.0),
    ]
    print("| log | exit code | s | s of processors | MB |\n|---|---|---|---|---|")
    for name, urdf, rate, periods in cases:
        machine = Machine(urdf, rate, periods)
        own = folder / name.replace(" ", "_").replace(",", "")
        own.mkdir()
        model, log = imported(tpm, urdf, own), own / "log.csv"
        machine.log(0, log)
        code, wall, busy, memory = measured([tpm, "identify", model, "--log", log, "--hold", "none", "--json"])
        print(f"| {name} | {code} | {wall:.2f} | {busy:.2f} | {memory:.0f} |", flush=True)
    if tx40:
        maps = [word for signal, text in MAPS.items() for word in ("--map", f"{signal}={text}")]
        code, wall, busy, memory = measured([tpm, "identify", tx40[0], "--log", tx40[1], *maps, "--hold", "none", "--json"])
        print(f"| TX40, 9000 samples | {code} | {wall:.2f} | {busy:.2f} | {memory:.0f} |")


if __name__ == "__main__":
    main(*sys.argv[1:])

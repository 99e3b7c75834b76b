"""Growth of the times of check, base parameters and generate with the joints of a tree (two arms on a torso).

usage: growth.py TPM [JOINTS ...]

TPM is the program (cargo build --release -p tpm-cli). Every time is the least of three runs of the whole process; the exponent is that of
the time between one row and the one before.
"""

import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tree import tree

WORK = {
    "check": ["check", "{model}"],
    "base parameters": ["identifiability", "--any-motion", "{model}"],
    "generate": ["generate", "{model}", "--lang", "c", "-o", "{folder}/code"],
}


def least(command):
    times = []
    for _ in range(3):
        start = time.perf_counter()
        code = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
        times.append(time.perf_counter() - start)
        # 1: not every parameter shows alone, which is no fault of an arm.
        if code not in (0, 1):
            raise SystemExit(f"{' '.join(map(str, command))} ends with {code}")
    return min(times)


def main():
    tpm, joints = sys.argv[1], [int(word) for word in sys.argv[2:]] or [2, 4, 7, 15, 30]
    print("| joints | " + " | ".join(f"{name}, s | exponent" for name in WORK) + " |")
    print("|---" * (1 + 2 * len(WORK)) + "|")
    before = None
    with tempfile.TemporaryDirectory() as folder:
        for count in joints:
            model = Path(folder) / f"tree{count}.tpm"
            model.write_text(tree(count))
            found = [least([tpm, *(word.format(model=model, folder=folder) for word in words)]) for words in WORK.values()]
            cells = []
            for index, seconds in enumerate(found):
                cells.append(f"{seconds:.3f}")
                exponent = math.log(seconds / before[1][index]) / math.log(count / before[0]) if before else math.nan
                cells.append(f"{exponent:.1f}" if before else "")
            print(f"| {count} | " + " | ".join(cells) + " |", flush=True)
            before = (count, found)


if __name__ == "__main__":
    main()

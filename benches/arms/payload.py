"""Random loads on an arm: `python3 payload.py TPM URDF [LOADS] [RATE_HZ] [PERIODS]` (`pip install pin numpy`).

The machine of `cramer_rao.py` along its motion, one period of ten seconds unless more are asked for, is logged without a load and with
one, fresh noise in every log. Loads are boxes of one density, .2 to 3 kg, sides of 4 to 20 cm, turned at random, their centres up to 10 cm
beside the axis of the last link and 3 to 20 cm before it. What `tpm payload` says is compared with the truth: error of the mass, share of
the ten parameters inside their 95 % intervals, scores beyond 3.5 deviations, and whether the load that it calls possible is one.
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pinocchio as pin
from cramer_rao import Machine, identified, imported

MOMENTS = ["Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"]
KEYS = ["m", "cx", "cy", "cz", *MOMENTS]


def box(rng):
    """A box on the last link, in its frame."""
    mass, sides = rng.uniform(0.2, 3.0), rng.uniform(0.04, 0.2, 3)
    turned = pin.Quaternion(*(lambda q: q / np.linalg.norm(q))(rng.normal(size=4))).matrix()
    moments = turned @ np.diag(mass / 12 * (np.sum(sides**2) - sides**2)) @ turned.T
    centre = np.append(rng.uniform(-0.1, 0.1, 2), rng.uniform(0.03, 0.2))
    return pin.Inertia(mass, centre, moments)


def is_possible(values):
    """Whether mass and moments are those of a body: no density is negative."""
    moments = np.zeros((3, 3))
    for (i, j), key in zip([(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)], MOMENTS):
        moments[i, j] = moments[j, i] = values[key]
    principal = np.linalg.eigvalsh(moments)
    return values["m"] > 0 and principal[0] > 0 and principal[0] + principal[1] > principal[2] * (1 - 1e-9)


def main(tpm, urdf, loads=100, rate=100.0, periods=1.0):
    machine = Machine(urdf, float(rate), float(periods))
    folder = Path(tempfile.mkdtemp())
    model, log = imported(tpm, urdf, folder), folder / "log.csv"
    columns = [machine.names.index(f"{name}_{machine.links[-1]}") for name in ("m", "mx", "my", "mz", *MOMENTS)]
    errors, scores, codes, impossible, shown = [], [], Counter(), 0, Counter()
    for load in range(int(loads)):
        body = box(np.random.default_rng(load))
        loaded = machine.torque + machine.rows[:, :, columns] @ body.toDynamicParameters()
        files = []
        for seed, torque in ((2 * load, machine.torque), (2 * load + 1, loaded)):
            machine.log(seed, log, torque)
            files.append(folder / f"{len(files)}.json")
            files[-1].write_text(json.dumps(identified(tpm, model, log)[1]))
        run = subprocess.run([tpm, "payload", model, *files, "--json"], capture_output=True, text=True)
        codes[run.returncode] += 1
        if run.returncode == 2:
            print(run.stderr)
            continue
        found = {own["name"]: own for own in json.loads(run.stdout)["parameters"]}
        about = np.array([body.inertia[i, j] for i, j in [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)]])
        truth = dict(zip(KEYS, [body.mass, *body.lever, *about]))
        for key, true in truth.items():
            if found[key]["value"] is not None:
                shown[key] += 1
                scores.append((found[key]["value"] - true) / found[key]["std"])
        if found["m"]["value"] is not None:
            errors.append(found["m"]["value"] / body.mass - 1)
        impossible += not is_possible({key: found[key]["possible"] for key in KEYS})
    errors, scores = np.abs(errors), np.abs(scores)
    print(f"{loads} loads, {len(machine.times)} samples at {float(rate):g} Hz a log, exit codes {dict(codes)}, shown {dict(shown)}")
    print(f"error of the mass: median {100 * np.median(errors):.2f} %, largest {100 * errors.max():.2f} %, within 1 %: {np.sum(errors < 0.01)}")
    print(f"inside 95 %: {100 * np.mean(scores < 1.96):.1f} % of {len(scores)}, largest {scores.max():.1f} deviations, impossible {impossible}")


if __name__ == "__main__":
    main(*sys.argv[1:])

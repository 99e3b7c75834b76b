"""Possible inertias from impossible estimates: `python3 possible.py TPM URDF [COUNT]` (`pip install pin numpy`).

The machine of `cramer_rao.py` is logged under so much noise on the torques that estimates come out of which no body is made: the last link
would have a negative moment about its axis, or moments that no density has, whatever its mass is. Of so many of these estimates `tpm
inertias` is asked for possible ones. Every link is proven here once more, with the rationals of its decimals: the pseudo-inertia has four
positive leading minors. Then a log without noise, with a description whose masses and moments are 20 % wrong, up or down, link by link: base
parameters against the truth.
"""

import json
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as xml
from collections import Counter
from fractions import Fraction
from pathlib import Path

import numpy as np
from cramer_rao import ORDER, Machine, imported, truth_of

NOISE = 30.0


def identified(tpm, model, log):
    """Exit code and result, without a simulation, which such noise is not worth."""
    command = [tpm, "identify", model, "--log", log, "--hold", "none", "--refine", "none", "--json"]
    run = subprocess.run(command, capture_output=True, text=True)
    return run.returncode, json.loads(run.stdout)


def shown_alone(result):
    return {own["name"]: own["value"] for own in result["parameters"] if own["value"] is not None}


def is_impossible(result, link):
    """Whether no mass and no further moment make a body of what is shown of the last link: with the moment I about its axis and those about
    the two others, I > 0 and |difference of these| < I; nothing where its moment is not shown alone."""
    alone = shown_alone(result)
    for axis, others in (("xx", ("yy", "zz")), ("yy", ("xx", "zz")), ("zz", ("xx", "yy"))):
        moment = alone.get(f"I{axis}_{link}")
        if moment is None:
            continue
        names = {f"I{other}_{link}" for other in others}
        differences = [own["value"] for own in result["combinations"] if set(own["terms"]) == names]
        return moment <= 0 or any(abs(value) > moment for value in differences)
    return False


def pseudo_inertia(values, link):
    exact = {symbol: Fraction(repr(values[f"{symbol}_{link}"])) for symbol in ORDER}
    half = (exact["Ixx"] + exact["Iyy"] + exact["Izz"]) / 2
    m, x, y, z = (exact[symbol] for symbol in ("m", "mx", "my", "mz"))
    return [
        [half - exact["Ixx"], -exact["Ixy"], -exact["Ixz"], x],
        [-exact["Ixy"], half - exact["Iyy"], -exact["Iyz"], y],
        [-exact["Ixz"], -exact["Iyz"], half - exact["Izz"], z],
        [x, y, z, m],
    ]


def is_proven(rows):
    """Whether a symmetric matrix of rationals is positive definite: all pivots are positive."""
    rows = [list(row) for row in rows]
    for k in range(4):
        if rows[k][k] <= 0:
            return False
        for i in range(k + 1, 4):
            factor = rows[i][k] / rows[k][k]
            rows[i] = [a - factor * b for a, b in zip(rows[i], rows[k])]
    return True


def possible(tpm, model, result, urdf, folder):
    file = folder / "result.json"
    file.write_text(json.dumps(result))
    started = time.time()
    run = subprocess.run([tpm, "inertias", model, file, "--description", urdf, "--json"], capture_output=True, text=True)
    return run, time.time() - started


def main(tpm, urdf, count=50):
    machine = Machine(urdf, 100.0, 1.0)
    folder = Path(tempfile.mkdtemp())
    model, log = imported(tpm, urdf, folder), folder / "log.csv"
    exact_noise, last = machine.noise, machine.links[-1]
    machine.noise = NOISE * exact_noise
    seconds, proven, codes, distances, seed, drawn = [], 0, Counter(), [], 0, 0
    while drawn < int(count) and seed < 20 * int(count):
        machine.log(seed, log)
        seed += 1
        _, result = identified(tpm, model, log)
        if not is_impossible(result, last):
            continue
        drawn += 1
        run, took = possible(tpm, model, result, urdf, folder)
        codes[run.returncode] += 1
        seconds.append(took)
        if run.returncode:
            print(run.stderr)
            continue
        found = json.loads(run.stdout)
        values = {own["name"]: own["value"] for own in found["parameters"]}
        distances.append(found["distance"])
        proven += all(is_proven(pseudo_inertia(values, link)) for link in machine.links)
    print(f"{drawn} impossible estimates of {seed} logs, exit codes {dict(codes)}, every link proven in {proven}")
    print(f"seconds: median {np.median(seconds):.3f}, largest {max(seconds):.3f}; moved by {min(distances):.2f} to {max(distances):.2f} deviations")

    machine.noise = 0 * exact_noise
    rng = np.random.default_rng(5)
    tree = xml.parse(urdf)
    for inertial in tree.getroot().iter("inertial"):
        for part, keys in (("mass", ["value"]), ("inertia", ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"])):
            own, factor = inertial.find(part), rng.choice([0.8, 1.2])
            for key in keys:
                own.set(key, repr(float(own.get(key)) * factor))
    wrong = folder / "wrong.urdf"
    tree.write(wrong)
    log.unlink()
    header = ",".join(["t_s", *machine.joints, *(f"tau_{j}" for j in machine.joints)])
    table = np.column_stack([machine.times, machine.q, machine.torque])
    np.savetxt(log, table, delimiter=",", header=header, comments="", fmt="%.17g")
    code, result = identified(tpm, model, log)
    run, took = possible(tpm, model, result, wrong, folder)
    if run.returncode:
        sys.exit(run.stderr)
    found = json.loads(run.stdout)
    errors = []
    largest = max(abs(own["possible"]) for own in found["combinations"])
    for own in found["combinations"]:
        true = sum(float(f) * truth_of(name, machine.values) for name, f in own["terms"].items())
        errors.append([abs(value - true) / largest for value in (own["estimate"], own["possible"])])
    estimate, moved = np.array(errors).max(0)
    print(f"exact log, wrong description: {took:.3f} s, largest error over the largest base parameter: estimate {estimate:.1e}, possible {moved:.1e}")


if __name__ == "__main__":
    main(*sys.argv[1:])

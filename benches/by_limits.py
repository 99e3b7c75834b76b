"""Campaigns that are given limits and nothing else: `python3 by_limits.py TPM [MACHINES [SEED [SECONDS]]]` (numpy).

Machines are drawn at random: a cart, a mass on a spring with drag, a hanging pendulum, an arm of two links; limits of position, speed and
drive as a machine of that size has them; sensors with noise or an encoder. Every second one has something that its model lacks. No value
of any parameter is told. Counted: limits that were passed by what was recorded, right models with a value beyond 3.5 stated deviations and
exit code 0 (confident and wrong), the share of the truth inside the 95 % intervals, missing terms that were named, and the largest stated
deviation of right models as a share of the value.
"""

import csv
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

PATTERN = {
    1: "pattern {{ amplitude a [{unit}]; frequency w [rad/s]; {q} = rest_to_rest(a, w, 3); }}",
    2: "pattern {{ amplitude a1 [rad], a2 [rad]; frequency w [rad/s]; q1 = rest_to_rest(a1, w, 3); q2 = rest_to_rest(a2, w, 3); }}",
}
# Rows by machine: terms by parameter with its unit, row by row.
CART = dict(q=["x"], u=["u"], unit="m", rows=[{"m [kg]": "ddot(x)", "d [N*s/m]": "dot(x)", "fc [N]": "sign(dot(x))"}])
SPRING = dict(q=["x"], u=["u"], unit="m", rows=[{"m [kg]": "ddot(x)", "k1 [N/m]": "x", "k2 [N*s^2/m^2]": "dot(x)^2"}])
PENDULUM = dict(q=["q"], u=["u"], unit="rad", rows=[{"J [kg*m^2]": "ddot(q)", "g [N*m]": "sin(q)", "d [N*m*s/rad]": "dot(q)"}])
ARM = dict(q=["q1", "q2"], u=["t1", "t2"], unit="rad", rows=[
    {"p1 [kg*m^2]": "ddot(q1)", "p2 [kg*m^2]": "(ddot(q1) + ddot(q2))",
     "p3 [kg*m^2]": "(cos(q2)*(2*ddot(q1) + ddot(q2)) - sin(q2)*(2*dot(q1)*dot(q2) + dot(q2)^2))", "g1 [N*m]": "cos(q1)",
     "d1 [N*m*s/rad]": "dot(q1)", "f1 [N*m]": "sign(dot(q1))"},
    {"p2 [kg*m^2]": "(ddot(q1) + ddot(q2))", "p3 [kg*m^2]": "(cos(q2)*ddot(q1) + sin(q2)*dot(q1)^2)", "d2 [N*m*s/rad]": "dot(q2)",
     "f2 [N*m]": "sign(dot(q2))"},
])
# What the machine has beside its model: the row and the term.
LACKS = {
    "cart": [(0, "dot(x)*abs(dot(x))"), (0, "1")],
    "spring": [(0, "sign(dot(x))"), (0, "x^3"), (0, "dot(x)")],
    "pendulum": [(0, "sign(dot(q))"), (0, "dot(q)*abs(dot(q))")],
    "arm": [(0, "dot(q1)*abs(dot(q1))"), (1, "sin(q2)")],
}


def machine(rng):
    """Kind, text, true values, limits, sensors."""
    kind = rng.choice(["cart", "spring", "pendulum", "arm"])
    size = lambda low, high: float(np.exp(rng.uniform(np.log(low), np.log(high))))
    if kind in ("cart", "spring"):
        own = CART if kind == "cart" else SPRING
        m, room, speed = size(0.5, 50), size(0.1, 0.8), size(0.3, 2.0)
        inertial = m * speed**2 / room
        force = inertial * size(3, 12)
        if kind == "cart":
            truth = {"m": m, "d": force / speed * rng.uniform(0.02, 0.2), "fc": force * rng.uniform(0.02, 0.15)}
        else:
            truth = {"m": m, "k1": force / room * rng.uniform(0.1, 0.5), "k2": force / speed**2 * rng.uniform(0.02, 0.2)}
        limits = {"x": room, "dot(x)": speed, "u": force}
    elif kind == "pendulum":
        own = PENDULUM
        room, speed, inertia = size(0.5, 2.5), size(2, 10), size(0.002, 0.5)
        force = inertia * speed**2 / room * size(3, 12)
        truth = {"J": inertia, "g": force * rng.uniform(0.05, 0.4), "d": force / speed * rng.uniform(0.02, 0.2)}
        limits = {"q": room, "dot(q)": speed, "u": force}
    else:
        own = ARM
        p = size(0.05, 2)
        truth = {"p1": p, "p2": p * rng.uniform(0.15, 0.4), "p3": p * rng.uniform(0.1, 0.3)}
        room, speed = size(0.8, 2.0), size(1.5, 5)
        forces = [(truth["p1"] + 2 * truth["p2"]) * speed**2 / room * size(4, 12), truth["p2"] * speed**2 / room * size(5, 15)]
        truth |= {"g1": forces[0] * rng.uniform(0.05, 0.3), "d1": forces[0] / speed * rng.uniform(0.02, 0.1),
                  "f1": forces[0] * rng.uniform(0.02, 0.1), "d2": forces[1] / speed * rng.uniform(0.02, 0.1),
                  "f2": forces[1] * rng.uniform(0.02, 0.1)}
        forces[1] += 2 * truth["p3"] * speed**2 / room
        limits = {"q1": room, "q2": room, "dot(q1)": speed, "dot(q2)": speed, "t1": forces[0], "t2": forces[1]}
    noise = room * size(10**-5, 10**-4)
    sensor = {"noise": noise} if rng.random() < 0.5 else {"noise": noise, "step": 2 * noise}
    return kind, own, truth, limits, sensor


def text(own, name, extra=None):
    rows = []
    names = dict.fromkeys(declared for row in own["rows"] for declared in row)
    for r, row in enumerate(own["rows"]):
        terms = [f"{declared.split()[0]}*{term}" for declared, term in row.items()]
        if extra and extra[0] == r:
            terms.append(f"lacked*{extra[1]}")
        rows.append(" + ".join(terms) + f" = {own['u'][r]};")
    force = "N" if own["unit"] == "m" else "N*m"
    declare = ", ".join(names) + (", lacked" if extra else "")
    unit = own["unit"]
    coordinates, inputs = ", ".join(f"{q} [{unit}]" for q in own["q"]), ", ".join(f"{u} [{force}]" for u in own["u"])
    return (f"model {name} {{ coordinate {coordinates}; input {inputs}; parameter {declare}; {' '.join(rows)} "
            + PATTERN[len(own["q"])].format(unit=own["unit"], q=own["q"][0]) + " }")


def experiment(folder, own, truth, limits, sensor, extra, seconds, seed):
    of = lambda names, limit: ", ".join(f"{name} = {limits[limit.format(name)]}" for name in names)
    lines = [f"seed = {seed}", "[plant]", "sub_steps = 8"]
    values = dict(truth)
    if extra:
        row, term, value = extra
        values["lacked"] = value
        (folder / "other.tpm").write_text(text(own, "Other", (row, term)))
        lines.append('model = "other.tpm"')
    lines.append("parameters = { " + ", ".join(f"{name} = {value}" for name, value in values.items()) + " }")
    for q in own["q"]:
        lines += [f"[plant.sensors.{q}]"] + [f"{name} = {value}" for name, value in sensor.items()]
    feedback = [f'{{ input = "{u}", coordinate = "{q}", kp = {limits[u] / limits[q]}, kd = {limits[u] / limits[f"dot({q})"]} }}'
                for u, q in zip(own["u"], own["q"])]
    lines += ["[control]", "sample_time = 1e-3", "derivative_filter = 2e-3", f"feedback = [{', '.join(feedback)}]"]
    lines += ["[limits]", f"inputs = {{ {of(own['u'], '{}')} }}",
              f"velocities = {{ {of(own['q'], 'dot({})')} }}",
              "positions = { " + ", ".join(f"{q} = [{-limits[q]}, {limits[q]}]" for q in own["q"]) + " }",
              "tracking = { " + ", ".join(f"{q} = {limits[q] / 2}" for q in own["q"]) + " }"]
    lines += ["[schedule]", "settle_periods = 2", f"measure_time = {min(20, seconds / 10)}", "max_runs = 400",
              "[plan]", f"time = {seconds}"]
    (folder / "machine.toml").write_text("\n".join(lines) + "\n")
    (folder / "machine.tpm").write_text(text(own, "Machine"))


def passed(folder, own, limits, sensor):
    """Limits that the records pass, beyond what the sensor's noise explains."""
    slack = 6 * sensor["noise"] + sensor.get("step", 0)
    found = set()
    for path in folder.glob("runs/run-*.csv"):
        with open(path) as file:
            rows = csv.reader(file)
            head = next(rows)
            table = np.array([[float(cell) for cell in row] for row in rows])
        for q in own["q"]:
            x = table[:, head.index(q)]
            if np.abs(x).max() > limits[q] + slack:
                found.add(q)
            # The speed over twenty samples.
            if len(x) > 20 and (np.abs(x[20:] - x[:-20]) / 0.02).max() > limits[f"dot({q})"] + slack / 0.01:
                found.add(f"dot({q})")
        for u in own["u"]:
            if np.abs(table[:, head.index(u)]).max() > limits[u] * (1 + 1e-9):
                found.add(u)
    return found


def main(tpm, machines=50, seed=1, seconds=180.0):
    inside, wrong, violated, named, lacking, widths, times = [], [], [], 0, 0, [], []
    for number in range(int(machines)):
        rng = np.random.default_rng([int(seed), number])
        kind, own, truth, limits, sensor = machine(rng)
        extra = None
        if number % 2:
            row, term = LACKS[kind][rng.integers(len(LACKS[kind]))]
            # A force of some percent of the drive's at the largest reach or speed of its row.
            q, u = own["q"][row], own["u"][row]
            at = {"x": limits[q], "q": limits[q]}[q[0]], limits[f"dot({q})"]
            full = {"sign": 1, "dot": at[1] ** 2 if "abs" in term else at[1], "x^3": at[0] ** 3, "1": 1, "sin": 1}
            scale = next(value for start, value in full.items() if term.startswith(start))
            extra = (row, term, limits[u] * rng.uniform(0.04, 0.12) / scale)
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            experiment(folder, own, truth, limits, sensor, extra, float(seconds), number + 1)
            began = time.time()
            run = subprocess.run([tpm, "identify", "machine.tpm", "--runs", "runs", "--json"], cwd=folder, capture_output=True, text=True)
            times.append(time.time() - began)
            try:
                result = json.loads(run.stdout)
            except json.JSONDecodeError:
                print(f"{number:3d} {kind:9s} no result: {run.stderr.strip()[-300:]}", flush=True)
                wrong.append(number) if run.returncode == 0 else None
                lacking += extra is not None
                continue
            beyond = passed(folder, own, limits, sensor)
        errors, share = {}, {}
        for parameter in result["parameters"]:
            if parameter["value"] is not None and parameter["std"]:
                errors[parameter["name"]] = (parameter["value"] - truth[parameter["name"]]) / parameter["std"]
                share[parameter["name"]] = parameter["std"] / abs(truth[parameter["name"]])
        worst = max(map(abs, errors.values()), default=0.0)
        kinds = [finding["kind"] for finding in result["findings"]]
        if beyond:
            violated.append(number)
        if run.returncode == 0 and worst > 3.5 and not (extra and "missing_term" in kinds):
            wrong.append(number)
        if extra:
            lacking += 1
            named += "missing_term" in kinds
        else:
            inside += [abs(error) < 1.96 for error in errors.values()] + [False] * (len(truth) - len(errors))
            widths.append(max(share.values(), default=np.inf))
        what = f"lacks {extra[1]}" if extra else "right"
        print(f"{number:3d} {kind:9s} {what:28s} exit {run.returncode} runs {len(result['runs']):3d} worst {worst:6.1f} deviations, "
              f"widest {100 * max(share.values(), default=np.inf):8.4f} %, {'named' if 'missing_term' in kinds else '     '} "
              f"{result['outcome']} {times[-1]:5.1f} s {'PASSED ' + ' '.join(sorted(beyond)) if beyond else ''}", flush=True)
    print(f"\n{machines} machines: limits passed on {len(violated)} {violated}, confident and wrong {len(wrong)} {wrong}, right models: "
          f"{100 * np.mean(inside):.1f} % of {len(inside)} inside, widest deviation {100 * np.median(widths):.3f} % (median); missing terms "
          f"named {named} of {lacking}; {np.median(times):.1f} s (median), {max(times):.1f} s at most")


if __name__ == "__main__":
    main(*sys.argv[1:])

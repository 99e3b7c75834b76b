"""States that nobody measured, beside scipy: `python3 unmeasured.py TPM [LOGS] [MACHINE ...]` (numpy, scipy).

Four machines of which the log has one sensor: two masses with a spring between them and an encoder at the motor, a pendulum whose
propeller's thrust lags, two tanks one above the other with the level of the lower one, and a mass on a spring with LuGre friction that is
reversed slowly. A fifth has two: a pendulum with a coarse encoder and, on a lever, an accelerometer that feels gravity and has an offset.
Every log has noise and a command of its own; inputs are held between stamps.

tpm gets the model and the log. scipy (`least_squares`, which minimises the differences between readings and a simulation) gets the
equations as a vectorised simulation, the true state at the beginning, and a start within 30 % of the true parameters: more than a user
would have. Printed: the largest error in stated deviations, how many of the 95 % intervals hold the truth, the root mean square of the
relative errors, the logs without a result, and the median time of a log.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares


def steps(rng, t, every, low, high):
    """A command that jumps to new values at times of its own."""
    values = rng.uniform(low, high, int(t[-1] / every) + 2)
    return values[(t / every).astype(int)]


class Masses:
    text = """model Masses { coordinate x1 [m]; unmeasured x2 [m]; input u [N];
    parameter m1 [kg], m2 [kg], d1 [N*s/m], d2 [N*s/m], k [N/m], c [N*s/m];
    m1*ddot(x1) + d1*dot(x1) + k*(x1 - x2) + c*(dot(x1) - dot(x2)) = u;
    m2*ddot(x2) + d2*dot(x2) + k*(x2 - x1) + c*(dot(x2) - dot(x1)) = 0; }"""
    sensors, samples, step, substeps = {"x1": 1e-4}, 2000, 0.005, 4
    truth, first = [0.8, 0.5, 1.2, 0.4, 300.0, 0.6], [0.0, 0.0, 0.0, 0.0]

    def command(self, rng, t):
        return steps(rng, t, 0.37, -1.5, 1.5)

    def rate(self, p, s, u):
        m1, m2, d1, d2, k, c = p
        pull = k * (s[0] - s[1]) + c * (s[2] - s[3])
        return [s[2], s[3], (u - d1 * s[2] - pull) / m1, (pull - d2 * s[3]) / m2]

    def readings(self, p, s, u):
        return {"x1": s[0]}


class Propeller:
    text = """model Propeller { coordinate phi [rad]; unmeasured thrust [N]; input u [N];
    parameter J [kg*m^2], d [N*m*s/rad], l [m], tau [s];
    constant mgl = 0.6 [N*m];
    J*ddot(phi) + d*dot(phi) + mgl*sin(phi) - l*thrust = 0;
    tau*dot(thrust) + thrust = u; }"""
    sensors, samples, step, substeps = {"phi": 2e-3}, 1500, 0.01, 4
    truth, first = [0.03, 0.02, 0.2, 0.15], [0.1, 0.0, 0.0]

    def command(self, rng, t):
        return steps(rng, t, 0.37, -1.5, 1.5)

    def rate(self, p, s, u):
        inertia, d, l, tau = p
        return [s[1], (l * s[2] - d * s[1] - 0.6 * np.sin(s[0])) / inertia, (u - s[2]) / tau]

    def readings(self, p, s, u):
        return {"phi": s[0]}


class Tanks:
    text = """model Tanks { coordinate h2 [1]; unmeasured h1 [1]; input u [1/s]; parameter a1 [1/s], a2 [1/s];
    dot(h1) + a1*sqrt(h1) = u;
    dot(h2) - a1*sqrt(h1) + a2*sqrt(h2) = 0; }"""
    sensors, samples, step, substeps = {"h2": 5e-3}, 600, 1.0, 4
    truth, first = [0.05, 0.04], [3.0, 2.0]

    def command(self, rng, t):
        return steps(rng, t, 15.0, 0.045, 0.1)

    def rate(self, p, s, u):
        a1, a2 = p
        upper, lower = np.sqrt(np.maximum(s[0], 0)), np.sqrt(np.maximum(s[1], 0))
        return [u - a1 * upper, a1 * upper - a2 * lower]

    def readings(self, p, s, u):
        return {"h2": s[1]}


class LuGre:
    """The bristle z of LuGre's friction; its Stribeck curve is known from a test at steady speeds but for its level."""

    text = """model LuGre { coordinate x [m]; unmeasured z [m]; input u [N];
    parameter m [kg], k [N/m], d [N*s/m], s0 [N/m], s1 [N*s/m], r [1/m];
    constant vs = 0.01 [m/s];
    m*ddot(x) + k*x + d*dot(x) + s0*z + s1*dot(z) = u;
    dot(z) - dot(x) + r*abs(dot(x))*z/(1 + 0.4*exp(-(dot(x)/vs)^2)) = 0; }"""
    sensors, samples, step, substeps = {"x": 2e-6}, 4000, 0.002, 8
    truth, first = [1.0, 400.0, 4.0, 2e4, 60.0, 1e4], [0.0, 0.0, 0.0]

    def command(self, rng, t):
        a, w = rng.uniform(0.8, 1.2, 3), 2 * np.pi * np.array([0.25, 0.4, 0.9])
        return 3.0 * a[0] * np.sin(w[0] * t) + 3.0 * a[1] * np.sin(w[1] * t) + 0.8 * a[2] * np.sin(w[2] * t)

    def rate(self, p, s, u):
        m, k, d, s0, s1, r = p
        z = s[1] - r * np.abs(s[1]) * s[2] / (1 + 0.4 * np.exp(-((s[1] / 0.01) ** 2)))
        return [s[1], (u - k * s[0] - d * s[1] - s0 * s[2] - s1 * z) / m, z]

    def readings(self, p, s, u):
        return {"x": s[0]}


class Accelerometer:
    text = """model Accelerometer { coordinate phi [rad], acc [m/s^2]; input u [N*m];
    parameter J [kg*m^2], d [N*m*s/rad], mgl [N*m], zero [m/s^2];
    constant r = 0.3 [m], g = 9.81 [m/s^2];
    J*ddot(phi) + d*dot(phi) + mgl*sin(phi) = u;
    acc - r*ddot(phi) - g*sin(phi) - zero = 0; }"""
    sensors, samples, step, substeps = {"phi": 2e-2, "acc": 5e-2}, 1500, 0.01, 4
    truth, first = [0.03, 0.02, 0.6, 0.25], [0.1, 0.0]

    def command(self, rng, t):
        return steps(rng, t, 0.37, -0.4, 0.4)

    def rate(self, p, s, u):
        return [s[1], (u - p[1] * s[1] - p[2] * np.sin(s[0])) / p[0]]

    def readings(self, p, s, u):
        return {"phi": s[0], "acc": 0.3 * np.array(self.rate(p, s, u)[1]) + 9.81 * np.sin(s[0]) + p[3]}


MACHINES = {"masses": Masses(), "propeller": Propeller(), "tanks": Tanks(), "lugre": LuGre(), "accelerometer": Accelerometer()}


def simulate(machine, p, u, refine=1):
    """Readings at the stamps by the classical rule of Runge and Kutta, one column per sensor; `p` may hold many sets of parameters."""
    p = np.asarray(p, float)
    s = np.array([np.full(p.shape[1:], x) for x in machine.first], float)
    n = machine.substeps * refine
    h = machine.step / n
    out = np.empty((len(u), len(machine.sensors), *p.shape[1:]))
    rate = lambda s, u: np.array(machine.rate(p, s, u))
    for k, now in enumerate(u):
        read = machine.readings(p, s, now)
        out[k] = [read[name] for name in machine.sensors]
        for _ in range(n):
            a = rate(s, now)
            b = rate(s + h / 2 * a, now)
            c = rate(s + h / 2 * b, now)
            s = s + h / 6 * (a + 2 * b + 2 * c + rate(s + h * c, now))
    return out


def by_scipy(machine, readings, u, rng):
    truth = np.array(machine.truth)
    start = np.log(truth * rng.uniform(0.7, 1.3, len(truth)))
    noise = np.array(list(machine.sensors.values()))
    run = lambda q: (simulate(machine, np.exp(q), u) / noise).ravel()

    def slopes(q):
        delta = 1e-6
        sets = q[:, None] + np.concatenate([delta * np.eye(len(q)), -delta * np.eye(len(q))], 1)
        all = simulate(machine, np.exp(sets), u) / noise[:, None]
        return ((all[..., : len(q)] - all[..., len(q) :]) / (2 * delta)).reshape(-1, len(q))

    wanted = (readings / noise).ravel()
    with np.errstate(all="ignore"):
        found = least_squares(lambda q: np.nan_to_num(run(q) - wanted, nan=1e6), start, jac=slopes)
    spread = np.sum(found.fun**2) / (readings.size - len(truth))
    information = found.jac.T @ found.jac
    # Where the search ended at a place from which nothing moves the simulation, there is no result.
    if np.linalg.cond(information) > 1 / np.finfo(float).eps:
        return None
    covariance = np.linalg.inv(information) * spread
    value = np.exp(found.x)
    return value, np.sqrt(np.diag(covariance)) * value


def by_tpm(tpm, model, log, names):
    run = subprocess.run([tpm, "identify", model, "--log", log, "--hold", "zoh", "--json"], capture_output=True, text=True)
    if not run.stdout:
        return None, run.stderr.strip().splitlines()[-1:]
    reports = {own["name"]: own for own in json.loads(run.stdout)["parameters"]}
    value = np.array([reports[name].get("value") or np.nan for name in names], float)
    deviation = np.array([reports[name].get("std") or np.nan for name in names], float)
    return (value, deviation), run.returncode


def main(tpm, logs=20, *wanted):
    folder = Path(tempfile.mkdtemp())
    for kind in wanted or MACHINES:
        machine = MACHINES[kind]
        truth = np.array(machine.truth)
        block = machine.text.split("parameter", 1)[1].split(";", 1)[0]
        names = [part.split("[")[0].strip() for part in block.split(",")]
        model = folder / f"{kind}.tpm"
        model.write_text(machine.text)
        outcomes = {"tpm": [], "scipy": []}
        codes = []
        for seed in range(int(logs)):
            rng = np.random.default_rng(1000 + seed)
            t = np.arange(machine.samples) * machine.step
            u = machine.command(rng, t)
            readings = simulate(machine, truth, u, 4)
            readings += np.array(list(machine.sensors.values())) * rng.normal(size=readings.shape)
            log = folder / f"{kind}{seed}.csv"
            head = ",".join(["t_s", *machine.sensors, "u"])
            np.savetxt(log, np.column_stack([t, readings, u]), delimiter=",", header=head, comments="", fmt="%.12g")
            begun = time.perf_counter()
            found, code = by_tpm(tpm, model, log, names)
            outcomes["tpm"].append((time.perf_counter() - begun, found))
            codes.append(code)
            begun = time.perf_counter()
            found = by_scipy(machine, readings, u, rng)
            outcomes["scipy"].append((time.perf_counter() - begun, found))
        for tool, all in outcomes.items():
            whole = [found for _, found in all if found is not None and np.isfinite(found[0]).all() and np.isfinite(found[1]).all()]
            seconds = np.median([seconds for seconds, _ in all])
            if not whole:
                print(f"{kind:10} {tool:6} none of {len(all)} logs, {codes[0]}", flush=True)
                continue
            z = np.array([(value - truth) / deviation for value, deviation in whole])
            relative = np.array([value / truth - 1 for value, _ in whole])
            inside = np.sum(np.abs(z) < 1.96)
            print(
                f"{kind:10} {tool:6} largest error {np.abs(z).max():7.2f} deviations; {inside} of {z.size} intervals hold the truth "
                f"({100 * inside / z.size:.1f} %); rms error {100 * np.sqrt(np.mean(relative**2)):.3f} %; "
                f"{len(all) - len(whole)} of {len(all)} without a result; {seconds:.2f} s a log",
                flush=True,
            )
        print(f"{kind:10} exit codes of tpm: {codes}", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])

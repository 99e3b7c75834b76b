"""Adapters: each is given the model, the log and values that are 30 % off, and returns a dict with `values` (name: (value, deviation)),
`refused` (why, or None) and `causes` (of the faults that it names).

`tpm`: `tpm identify --hold zoh --json`. `output_error`: scipy's least squares over a simulation from the first reading on, the state there
among the unknowns, readings weighed by what is left of each, deviations from the Jacobian. `regression`: weighted least squares on the
inverse dynamics with smoothed derivatives (M. Gautier), rows weighed by what is left of each.
"""

import json
import subprocess
from signal import SIGXCPU

import numpy as np
from dynamics import Dynamics
from scipy import signal
from scipy.optimize import least_squares

CAUSES = {"missing_term", "limited", "halves", "repeats", "vibration", "unexplained", "unsettled", "other_hold", "exchanged",
          "negative_inertia", "gives_energy", "goes_against"}


def result(values=None, refused=None, causes=()):
    return dict(values=values or {}, refused=refused, causes=sorted(causes))


def tpm(program, folder):
    command = [program, "identify", folder / "model.tpm", "--log", folder / "log.csv", "--hold", "zoh", "--json"]
    run = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    (folder / "tpm.json").write_text(run.stdout)
    (folder / "tpm.txt").write_text(f"exit code {run.returncode}\n{run.stderr}")
    if run.returncode == -SIGXCPU:
        return result(refused="took too long")
    if run.returncode not in (0, 1) or not run.stdout:
        return result(refused=f"exit code {run.returncode}: {run.stderr.strip()[:200]}")
    said = json.loads(run.stdout)
    stated = [own for own in [*said["parameters"], *said["physical"]] if own["value"] is not None and own["std"]]
    values = {own["name"]: (own["value"], own["std"]) for own in stated}
    causes = {own["kind"] for own in said["findings"]} & CAUSES
    return result(values, f"exit code 1: {run.stderr.strip()[-200:]}" if run.returncode else None, causes)


class Task:
    """What every tool is told: layout, elements without their values, the log, the names, a start."""

    def __init__(self, layout, elements, log, start):
        n = layout["n"]
        self.layout, self.elements, self.start = layout, elements, start
        self.time, self.q, self.u = log[:, 0], log[:, 1 : 1 + n], log[:, 1 + n :]
        self.sample = self.time[1] - self.time[0]
        self.free = [k for k, e in enumerate(elements) if not e.get("known")]
        self.names = [elements[k]["name"] for k in self.free]

    def theta(self, x):
        theta = np.array([e["value"] if e.get("known") else 0.0 for e in self.elements])
        theta[self.free] = x
        return theta

    def first_state(self):
        """Positions and rates at the first sample, from a parabola through the first twentieth of a second."""
        count = max(6, round(0.05 / self.sample))
        fit = np.polynomial.polynomial.polyfit(self.time[:count] - self.time[0], self.q[:count], 2)
        return fit[0], fit[1]


def output_error(task):
    n, dynamics = task.layout["n"], Dynamics(task.layout, task.elements)
    q, v = task.first_state()
    start = np.array([task.start[name] for name in task.names])
    span = np.maximum(np.std(task.q, axis=0), 1e-9)
    rate = np.maximum(np.std(np.diff(task.q, axis=0), axis=0) / task.sample, 1e-9)
    scale = np.concatenate([np.abs(start), span, rate])
    p = len(start)

    def left(x, weight):
        run = dynamics.simulate(task.theta(x[:p] * scale[:p]), task.sample, x[p : p + n] * span, x[p + n :] * rate, inputs=task.u)
        if run is None or not np.all(np.isfinite(run[0])):
            return np.full(task.q.size, 1e3)
        return np.clip((run[0] - task.q) * weight, -1e9, 1e9).ravel()

    x = np.concatenate([start, q, v]) / scale
    weight, fit = 1 / span, None
    for most in (60, 30):
        # A millionth of the sum of squares is far below what noise does to it.
        fit = least_squares(left, x, args=(weight,), method="trf", ftol=1e-6, max_nfev=most)
        x = fit.x
        weight = weight / np.maximum(np.sqrt(np.mean(fit.fun.reshape(-1, n) ** 2, axis=0)), 1e-12)
    if fit.status <= 0:
        return result(refused="did not converge")
    freedom = fit.fun.size - len(x)
    variance = np.sum(fit.fun**2) / freedom
    length = np.linalg.norm(fit.jac, axis=0)
    if not np.all(length > 0) or np.linalg.cond(fit.jac / length) > 1e10:
        return result(refused="singular")
    covariance = np.linalg.inv((fit.jac / length).T @ (fit.jac / length)) * variance
    std = np.sqrt(np.diag(covariance)) / length * scale
    return result({name: (x[k] * scale[k], std[k]) for k, name in enumerate(task.names)})


def regression(task):
    n, rate = task.layout["n"], 1 / task.sample
    cut = []
    for column in task.q.T:
        f, power = signal.welch(column, rate, nperseg=min(len(column), round(2 * rate)), window="blackmanharris")
        above = f[power > 10 * np.median(power[-len(power) // 4 :])]
        cut.append(np.clip(1.5 * above.max(initial=0), 6, 0.2 * rate))
    low = min(cut)
    smooth = np.column_stack([signal.filtfilt(*signal.butter(4, f, fs=rate), x) for f, x in zip(cut, task.q.T)])
    v = np.gradient(smooth, task.sample, axis=0)
    a = np.gradient(v, task.sample, axis=0)
    # An input that is held is, at a sample, the mean of what was and what will be.
    u = np.vstack([task.u[:1], (task.u[1:] + task.u[:-1]) / 2])
    rows = Dynamics(task.layout, task.elements).rows(smooth, v, a, u)
    # The same low pass on both sides, then as many rows as its band has.
    every = max(1, int(0.8 * rate / (2 * low)))
    edge = round(2 * rate / low)
    rows = signal.filtfilt(*signal.butter(4, low, fs=rate), rows, axis=0)[edge:-edge:every]
    known = task.theta(np.zeros(len(task.free)))
    target, rows = -(rows @ known), rows[:, :, task.free]
    weight = np.ones(n)
    for _ in range(3):
        W, b = (rows * weight[:, None]).reshape(-1, len(task.free)), (target * weight).ravel()
        length = np.linalg.norm(W, axis=0)
        if not np.all(length > 0) or np.linalg.cond(W / length) > 1e10:
            return result(refused="singular")
        x = np.linalg.lstsq(W / length, b)[0] / length
        left = target - rows @ x
        weight = 1 / np.maximum(np.sqrt(np.mean(left**2, axis=0)), 1e-12)
    W, b = (rows * weight[:, None]).reshape(-1, len(task.free)), (target * weight).ravel()
    covariance = np.linalg.inv((W / length).T @ (W / length)) * np.sum((b - W @ x) ** 2) / (len(b) - len(x))
    std = np.sqrt(np.diag(covariance)) / length
    return result({name: (x[k], std[k]) for k, name in enumerate(task.names)})

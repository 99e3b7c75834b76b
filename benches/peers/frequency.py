"""H1 and the structured fit of benches/src/bin/frequency.rs by scipy, on the same data, with the same result.

usage: frequency.py FREQUENCY_BINARY

Needs numpy and scipy. Checks that H1 agrees to 1e-9 and the fitted parameters to 1e-6 of their values, and prints the times
of both and their ratio (more than 1: tpm is faster).
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy import optimize, signal

SEGMENT, SAMPLE_TIME = 32768, 1e-3
M2, L1, C2, G = 0.022, 0.16, 0.08, 9.8
MOTOR = 0.01826 / 2.5604
NAMES = ["J1", "J2", "C1", "C2"]
START = 1.5 * np.array([0.00215058, 0.00018773, 0.02, 3.168e-4])


def median(work):
    times, began = [], time.perf_counter()
    while time.perf_counter() - began < 1 or len(times) < 5:
        start = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times))


def h1(u, y):
    settings = {"fs": 1 / SAMPLE_TIME, "window": "hann", "nperseg": SEGMENT, "noverlap": SEGMENT // 2, "detrend": "constant"}
    frequency, cross = signal.csd(u, y, **settings)
    _, power = signal.welch(u, **settings)
    _, response = signal.welch(y, **settings)
    coherence = np.abs(cross) ** 2 / (power * response)  # part of the estimate in tpm
    w = 2 * np.pi * frequency[1:]
    hold = (1 - np.exp(-1j * w * SAMPLE_TIME)) / (1j * w * SAMPLE_TIME)
    return w, cross[1:] / power[1:] / hold, coherence[1:]


def fit(w, h, std):
    s = 1j * w

    def residuals(scaled):
        j1, j2, c1, c2 = scaled * START
        a, c, e = j1 + M2 * L1 * L1, M2 * L1 * C2, j2 + M2 * C2 * C2
        d = c1 + MOTOR * 0.01826
        below = (a * s + d) * (e * s * s + c2 * s + M2 * C2 * G) - c * c * s**3
        error = (h + 10 * MOTOR * c * s / below) / std
        return np.concatenate([error.real, error.imag])

    found = optimize.least_squares(residuals, np.ones(4), method="lm", xtol=1e-10, ftol=1e-10)
    return found.x * START


with tempfile.TemporaryDirectory() as folder:
    own = json.loads(subprocess.run([sys.argv[1], folder], check=True, capture_output=True, text=True).stdout)
    u, y = np.loadtxt(Path(folder) / "samples.csv", delimiter=",", unpack=True)
    w, re, im, std = np.loadtxt(Path(folder) / "lines.csv", delimiter=",", unpack=True)
frequency, response, _ = h1(u, y)
at = np.searchsorted(frequency, w - 1e-6)
difference = np.abs(response[at] / (re + 1j * im) - 1).max()
assert difference < 1e-9, f"H1 differs by {difference:.1e}"
found = fit(w, re + 1j * im, std)
for name, value in zip(NAMES, found):
    assert abs(value / own[name] - 1) < 1e-6, f"{name}: {value} and {own[name]}"
print(f"{own['lines']} lines; H1 agrees to {difference:.1e}")
print("| work | tpm [ms] | scipy [ms] | ratio |\n|---|---|---|---|")
for what, mine, theirs in [
    ("H1 of 180,000 samples", own["h1_ms"], median(lambda: h1(u, y))),
    ("structured fit", own["fit_ms"], median(lambda: fit(w, re + 1j * im, std))),
]:
    print(f"| {what} | {mine:.2f} | {theirs:.2f} | {theirs / mine:.1f} |")

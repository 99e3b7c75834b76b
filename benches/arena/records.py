"""The grammar's other half: how a machine is driven and recorded, and one fault of it, of the record, or of the model.

`draw(seed, number)` gives a `Case`: the machine as it is (`truth`: elements, what lies between record and motion, the noise), the log, and
the elements of the model that the tools are given.
"""

from dataclasses import dataclass, field

import numpy as np
from dynamics import SUBSTEP, Dynamics
from machines import draw as draw_machine
from machines import element, text

RIGHT = ("right", "coarse encoder", "coloured noise")
FAULTS = ("friction left out", "damping left out", "gravity left out", "coupling left out", "cogging", "friction varies with position",
          "dead zone", "backlash", "delay", "offset", "columns exchanged", "one sign wrong")


BEFORE = 40


@dataclass
class Case:
    number: int
    machine: object
    fault: str
    model: list  # elements that the tools know
    truth: list  # elements of the machine
    channel: dict = field(default_factory=dict)
    sample: float = 0.001
    log: np.ndarray = None  # time, coordinates, inputs, as they are written
    inputs: np.ndarray = None  # as they were applied, from `BEFORE` samples before the log
    start: tuple = None  # positions and rates then
    noise: dict = None
    record: str = ""

    def columns(self):
        return ["t_s", *[c[0] for c in self.machine.coordinates], *[u[0] for u in self.machine.inputs]]

    def text(self):
        return text(self.machine, self.model)

    def values(self):
        return {e["name"]: e["value"] for e in self.model if not e.get("known")}


def applicable(machine):
    parts = {e["part"] for e in machine.elements}
    coupled = "coupling" in parts or len(machine.layout["coordinate"]) + (machine.layout["cart"] >= 0) > 1
    possible = {
        "friction left out": "friction" in parts,
        "friction varies with position": "friction" in parts,
        "gravity left out": "moment" in parts,
        "coupling left out": coupled,
        "dead zone": True,
        "offset": True,
    }
    return [fault for fault in FAULTS if possible.get(fault, True)]


def model_of(machine, fault, rng):
    """The elements that the tools are given."""
    keep = list(machine.elements)
    if fault in ("friction left out", "damping left out"):
        return [e for e in keep if e["part"] != fault.split()[0]]
    cart = machine.layout["cart"] >= 0
    if fault == "gravity left out":
        # A first moment that only gravity shows goes with it.
        keep = [{**e, "second": 0} if e["part"] == "moment" else e for e in keep]
        return [e for e in keep if e["part"] != "moment" or cart or e["i"] > 0]
    if fault == "coupling left out":
        candidates = [e for e in keep if e["part"] == "coupling" or (e["part"] == "moment" and (cart or e["i"] > 0))]
        lost = candidates[rng.integers(len(candidates))]
        if lost["part"] == "coupling":
            return [e for e in keep if e is not lost]
        return [{**e, "first": 0} if e is lost else e for e in keep]
    return keep


def with_fault(machine, fault, rng, force):
    """Elements of the machine and what lies between record and motion; `force` is the rms force on every driven coordinate."""
    elements, channel = [dict(e) for e in machine.elements], {}
    k = int(rng.integers(len(machine.driven)))
    i = machine.driven[k]
    unit = "N" if machine.coordinates[i][1] == "m" else "N*m"
    if fault == "cogging":
        wave = rng.uniform(6, 30) * np.pi / machine.size[i]
        elements.append(element("cogging", i, "cogging", force[k] * rng.uniform(0.03, 0.3), unit, first=wave))
    elif fault == "friction varies with position":
        own = [e for e in elements if e["part"] == "friction"]
        e = own[rng.integers(len(own))]
        share = rng.uniform(0.3, 0.9) * rng.choice([-1, 1])
        elements.append(element("place_friction", e["i"], "slope", e["value"] * share / machine.size[e["i"]], "1"))
    elif fault == "offset":
        elements.append(element("offset", i, "offset", force[k] * rng.uniform(0.05, 0.5) * rng.choice([-1, 1]), unit))
    elif fault == "dead zone":
        gain = next((e["value"] for e in elements if e["kind"] == "input" and e["first"] == k), 1.0)
        channel["dead"] = [force[k] / gain * rng.uniform(0.05, 0.3) if l == k else 0.0 for l in range(len(machine.driven))]
    elif fault == "delay":
        channel["late"] = round(int(rng.integers(1, 6)) * 1e-3 / SUBSTEP)
    elif fault == "backlash":
        springs = [e for e in elements if e["kind"] == "spring" and e["j"] >= 0]
        if springs and rng.random() < 0.5:
            e = springs[rng.integers(len(springs))]
            e["first"] = machine.size[e["i"]] * 10 ** rng.uniform(-3, -2)
        else:
            channel["play"] = [machine.size[l] * 10 ** rng.uniform(-2.7, -1.7) if l == i else 0.0 for l in range(len(machine.size))]
    return elements, channel


def signal(rng, samples, sample, count, periodic, period):
    """One signal for every input: the harmonics of a period, or frequencies in no ratio, from 0.3 to 5 Hz."""
    t = np.arange(samples) * sample
    lines = np.arange(1, 1 + max(4, int(5 * period))) / period if periodic else np.sort(rng.uniform(0.3, 5, 14))
    amplitude = rng.normal(size=(len(lines), count)) / (1 + 0.4 * lines)[:, None]
    phase = rng.uniform(0, 2 * np.pi, (len(lines), count))
    return np.einsum("kc,tkc->tc", amplitude, np.sin(2 * np.pi * lines[None, :, None] * t[:, None, None] + phase))


def coloured(rng, shape, factor):
    """White, or of the first order with this factor from sample to sample, of unit variance."""
    white = rng.normal(size=shape)
    if factor == 0:
        return white
    from scipy.signal import lfilter
    return lfilter([np.sqrt(1 - factor**2)], [1, -factor], white, axis=0)


def hasty(motion, machine, sample):
    """Whether rates are beyond those of the signals that are played: a loop that is hardly stable."""
    rates = np.diff(motion, axis=0) / sample
    return np.any(np.sqrt(np.mean(rates**2, axis=0)) > 2 * np.pi * 5 * np.maximum(np.std(motion, axis=0), 0.1 * machine.size))


def draw(seed, number):
    rng = np.random.default_rng([seed, number])
    while True:
        case = attempt(rng, number)
        if case is not None:
            return case


def attempt(rng, number):
    machine = draw_machine(rng)
    fault = "right" if rng.random() < 0.3 else None
    fault = fault or str(rng.choice([*RIGHT[1:], *applicable(machine)]))
    n, m = machine.layout["n"], len(machine.driven)
    sample = 1 / rng.choice([200, 250, 500, 1000])
    closed = not machine.bound or rng.random() < 0.65
    periodic = rng.random() < 0.5
    period = round(rng.uniform(1, 1.6) / sample) * sample
    samples = int(rng.integers(3, 5)) * round(period / sample) if periodic else int(rng.uniform(3, 6) / sample)
    warm = round(4 * period / sample)
    shape = signal(rng, warm + samples, sample, m, periodic, period)

    # Noise of the readings: a share of the motion, white or not, and counts.
    count, factor = np.zeros(n), 0.0
    deviation = machine.size * 10 ** rng.uniform(-4.7, -3)
    if fault == "coarse encoder":
        count, deviation = machine.size * 10 ** rng.uniform(-2.6, -1.8), machine.size * 1e-5
    elif rng.random() < 0.4:
        count = machine.size * 10 ** rng.uniform(-4.7, -3.3)
    if fault == "coloured noise":
        factor, deviation = float(np.exp(-sample / rng.uniform(5e-3, 30e-3))), machine.size * 10 ** rng.uniform(-3.5, -2.6)

    plain = Dynamics(machine.layout, machine.elements)
    theta = [e["value"] for e in machine.elements]
    # The inertia that an input sees while the others give way: a loop on the larger one that it sees while they hold still is unstable.
    mass = 1 / np.diag(np.linalg.inv(plain.mass(theta, np.zeros(n))))[machine.driven]
    gains = np.array([next(e["value"] for e in machine.elements if e["kind"] == "input" and e["first"] == k) for k in range(m)])
    w = 2 * np.pi * rng.uniform(2, 4)
    loop = (machine.driven, mass * w**2 / gains, 1.4 * mass * w / gains, 3e-3)
    rest = np.zeros(n)
    play = lambda dynamics, theta, scale, **more: dynamics.simulate(
        theta, sample, rest, rest, **(dict(loop=(scale * shape, *loop)) if closed else dict(inputs=scale * shape)), **more)
    # Scaled so that the coordinate that moves most moves as far as the machine may.
    scale = (machine.size[machine.driven] if closed else machine.size[machine.driven] * mass * 40 / gains) / np.abs(shape).max(0)
    scale = scale * 0.05
    for _ in range(6):
        run = play(plain, theta, scale)
        if run is None or hasty(run[0][warm:], machine, sample):
            return None
        scale = scale * np.clip(1 / (np.abs(run[0][warm:]) / machine.size).max(), 0.3, 6)
    force = np.sqrt(np.mean(run[1][warm:] ** 2, axis=0)) * gains
    if not np.all(np.isfinite(force)) or not 0.3 < (np.abs(run[0][warm:]) / machine.size).max() < 2:
        return None

    model = model_of(machine, fault, rng)
    truth, channel = with_fault(machine, fault, rng, force)
    dynamics, theta = Dynamics(machine.layout, truth), [e["value"] for e in truth]
    noise = deviation * coloured(rng, (warm + samples, n), factor)
    run = play(dynamics, theta, scale, noise=noise, count=count, **channel)
    if run is None or np.abs(run[0][warm:] / machine.size).max() > 4:
        return None
    # The state some samples before the log begins (inputs may act late), from a run under the same inputs without noise.
    state = dynamics.simulate(theta, sample, rest, rest, inputs=run[1], **{key: value for key, value in channel.items() if key != "play"})
    if state is None or hasty(state[0][warm:], machine, sample):
        return None
    begin = warm - BEFORE
    rate = (state[0][begin + 1] - state[0][begin - 1]) / (2 * sample)
    readings, inputs = run[0][warm:], run[1][warm:]
    case = Case(number, machine, fault, model, truth, channel, sample)
    case.inputs, case.start = run[1][begin:], (state[0][begin], rate)
    case.noise = dict(deviation=list(deviation), count=list(count), factor=factor)
    case.record = ", ".join([
        "closed loop" if closed else "open loop", f"{1 / sample:.0f} Hz", f"{samples * sample:.1f} s",
        "periodic" if periodic else "not periodic", "encoder" if count.any() else "no encoder"])
    case.log = np.column_stack([np.arange(samples) * sample, *spoilt(machine, fault, readings, inputs, rng)])
    return case


def spoilt(machine, fault, readings, inputs, rng):
    """Readings and inputs as they stand in the file."""
    readings, inputs = readings.copy(), inputs.copy()
    if fault == "columns exchanged":
        n, m = readings.shape[1], inputs.shape[1]
        if n == 1:
            return inputs[:, :1], readings
        target, count = (readings, n) if m == 1 or rng.random() < 0.5 else (inputs, m)
        i, j = rng.choice(count, 2, replace=False)
        target[:, [i, j]] = target[:, [j, i]]
    elif fault == "one sign wrong":
        target = readings if rng.random() < 0.5 else inputs
        target[:, rng.integers(target.shape[1])] *= -1
    return readings, inputs

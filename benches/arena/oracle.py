"""Deviations that nobody can undercut: the Cramer-Rao bound of a log for somebody who knows the fault.

The machine as it is, with its fault's own size among the unknowns (amplitude, slope, offset, gap, dead zone, delay), and the state in
which the log begins. Inputs are what was recorded; readings have the noise that they have, rounding as a twelfth of a count squared.
"""

import numpy as np
from dynamics import Dynamics
from records import BEFORE


def bound(case):
    """The smallest deviation of every parameter of the model, by name; infinite where the log does not show it."""
    n = case.machine.layout["n"]
    free = [k for k, e in enumerate(case.truth) if not e.get("known")]
    theta = np.array([e["value"] for e in case.truth])
    size = case.machine.size
    rates = np.maximum(np.abs(case.start[1]), 3 * size)
    unknown = [("theta", k, 1e-4 * abs(theta[k])) for k in free]
    unknown += [("gap", k, 1e-2 * e["first"]) for k, e in enumerate(case.truth) if e["kind"] == "spring" and e.get("first", 0) > 0]
    unknown += [(name, k, 1e-2 * value) for name in ("dead", "play") for k, value in enumerate(case.channel.get(name, ())) if value > 0]
    unknown += [("late", 0, 1)] if case.channel.get("late", 0) else []
    unknown += [(which, k, 1e-4 * scale[k]) for which, scale in (("q", size), ("v", rates)) for k in range(n)]

    def readings(which, k, step):
        values, elements = theta.copy(), [dict(e) for e in case.truth]
        channel = {name: value if name == "late" else list(value) for name, value in case.channel.items()}
        q, v = (x.copy() for x in case.start)
        if which == "theta":
            values[k] += step
        elif which == "gap":
            elements[k]["first"] += step
        elif which == "late":
            channel["late"] += step
        elif which in ("q", "v"):
            (q if which == "q" else v)[k] += step
        else:
            channel[which][k] += step
        run = Dynamics(case.machine.layout, elements).simulate(values, case.sample, q, v, inputs=case.inputs, **channel)
        return None if run is None else run[0][BEFORE:]

    factor = case.noise["factor"]
    deviation = np.sqrt(np.array(case.noise["deviation"]) ** 2 + np.array(case.noise["count"]) ** 2 / 12)
    columns = []
    for which, k, step in unknown:
        ends = readings(which, k, step), readings(which, k, -step)
        if ends[0] is None or ends[1] is None:
            return None
        change = (ends[0] - ends[1]) / deviation
        columns.append(np.vstack([change[:1], (change[1:] - factor * change[:-1]) / np.sqrt(1 - factor**2)]).ravel() / 2)
    scale = np.array([np.linalg.norm(column) for column in columns])
    inverse = np.linalg.pinv((np.array(columns) / np.where(scale > 0, scale, 1)[:, None]).T, rcond=1e-12)
    spread = np.linalg.norm(inverse, axis=1) / np.where(scale > 0, scale, np.nan) * [step for _, _, step in unknown]
    return {case.truth[k]["name"]: spread[at] for at, k in enumerate(free)}

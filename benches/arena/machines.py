"""The grammar: machines drawn at random, as lists of elements with one value each, and their text in the language of tpm.

A machine is a chain of masses or rotors with springs (all of them driven, or the first one only, as belts are), or links that hang in a
vertical plane, on the ground (pendulum, planar arm) or on a driven cart. An element is a dict: kind, i, j (-1: the ground), name, unit,
value, known (its value is given to every tool), part (what a fault leaves out together).
"""

import numpy as np

GRAVITY = 9.81


def element(kind, i, name, value, unit, j=-1, part=None, **more):
    return dict(kind=kind, i=i, j=j, name=name, value=float(value), unit=unit, part=part, **more)


class Machine:
    """`layout` for `dynamics.Dynamics`, `elements`, `driven` (coordinate of every input), `size` (motion of every coordinate), names."""

    def __init__(self, kind, layout, elements, driven, size, coordinates, inputs, bound):
        self.kind, self.layout, self.elements, self.driven, self.size = kind, layout, elements, driven, size
        self.coordinates, self.inputs, self.bound = coordinates, inputs, bound


def chain(rng):
    """Masses or rotors in series; `bound` says whether springs hold it, so that it can be driven without a loop."""
    n = int(rng.choice([1, 2, 3, 4, 5, 6], p=[0.28, 0.28, 0.18, 0.12, 0.07, 0.07]))
    turns = rng.random() < 0.45
    only_first = n in (2, 3) and rng.random() < 0.5
    gain = n <= 2 and not only_first and rng.random() < 0.3
    scale, size, q, m, f = (0.03, 1.0, "rad", "kg*m^2", "N*m") if turns else (1.5, 0.1, "m", "kg", "N")
    inertia = scale * rng.uniform(0.4, 2.0, n)
    elements = [element("inertia", i, f"m{i + 1}", inertia[i], m) for i in range(n)]
    for i in range(n - 1):
        w = 2 * np.pi * rng.uniform(3, 9)
        light = min(inertia[i], inertia[i + 1])
        elements.append(element("spring", i, f"k{i + 1}{i + 2}", light * w**2, f"{f}/{q}", i + 1, "coupling"))
        elements.append(element("damper", i, f"c{i + 1}{i + 2}", 2 * light * w * rng.uniform(0.02, 0.1), f"{f}*s/{q}", i + 1, "coupling"))
    ground = [i for i in range(n) if rng.random() < 0.5]
    if gain:
        w = 2 * np.pi * rng.uniform(1, 2)
        elements.append(element("spring", 0, "ks", float(f"{inertia[0] * w**2:.3g}"), f"{f}/{q}", known=True))
        ground = [i for i in ground if i > 0]
    for i in ground:
        elements.append(element("spring", i, f"k{i + 1}", inertia[i] * (2 * np.pi * rng.uniform(0.8, 2.5)) ** 2, f"{f}/{q}"))
        if rng.random() < 0.3:
            k = elements[-1]["value"] * rng.uniform(0.1, 0.5) / size**2
            elements.append(element("cubic", i, f"kc{i + 1}", k, f"{f}/{q}^3"))
    rubs = rng.random() < 0.65
    for i in range(n):
        elements.append(element("damper", i, f"d{i + 1}", inertia[i] * rng.uniform(0.5, 3), f"{f}*s/{q}", part="damping"))
        if rubs:
            elements.append(element("friction", i, f"f{i + 1}", inertia[i] * size * 40 * rng.uniform(0.02, 0.12), f, part="friction"))
    if rng.random() < 0.15:
        elements.append(element("drag", 0, "b1", inertia[0] * rng.uniform(0.3, 1) / size, f"{f}*s^2/{q}^2"))
    driven = [0] if only_first else list(range(n))
    names = [f"u{k + 1}" for k in range(len(driven))]
    units = [f] * len(driven)
    for k, i in enumerate(driven):
        if gain and k == 0:
            elements.append(element("input", i, "Kt", scale * rng.uniform(5, 40), f"{f}/A", first=k))
            units[k] = "A"
        else:
            elements.append(element("input", i, names[k], 1, "1", first=k, known=True))
    layout = dict(n=n, inputs=len(driven), coordinate=[], length=[], cart=-1, gravity=GRAVITY)
    kind = ("rotors" if turns else "masses") + (", first driven" if only_first else "") + (", actuator's gain" if gain else "")
    letter = "q" if turns else "x"
    held = bool(gain or ground)
    coordinates = [(f"{letter}{i + 1}", q) for i in range(n)]
    return Machine(kind, layout, elements, driven, np.full(n, size), coordinates, list(zip(names, units)), held)


def links(rng):
    """A pendulum, a planar arm that hangs, or such on a cart that alone is driven."""
    cart = rng.random() < 0.4
    count = int(rng.choice([1, 2], p=[0.7, 0.3])) if cart else int(rng.choice([1, 2, 3, 4], p=[0.25, 0.4, 0.2, 0.15]))
    n = count + cart
    mass, length = rng.uniform(0.5, 2, count), np.round(rng.uniform(0.25, 0.5, count), 2)
    center = length * rng.uniform(0.4, 0.7, count)
    outer = np.append(np.cumsum(mass[::-1])[::-1][1:], 0.0)
    inertia = mass * center**2 + mass * length**2 * rng.uniform(0.05, 0.15, count) + outer * length**2
    moment = mass * center + outer * length
    at = lambda k: k + cart
    name = lambda k: str(k + 1)
    elements = [element("link_inertia", k, "J" + name(k), inertia[k], "kg*m^2") for k in range(count)]
    elements += [element("link_moment", k, "S" + name(k), moment[k], "kg*m", part="moment", first=1, second=1) for k in range(count)]
    if cart:
        elements.append(element("inertia", 0, "M", mass.sum() + rng.uniform(0.5, 2), "kg"))
    layout = dict(n=n, inputs=1 if cart else n, coordinate=[at(k) for k in range(count)], length=list(length), cart=0 if cart else -1,
                  gravity=GRAVITY, smooth=[0.0] * n)
    from dynamics import Dynamics
    loads = np.diag(Dynamics(layout, elements).mass([e["value"] for e in elements], np.zeros(n)))
    size = np.array([0.2] * cart + [0.8] * count)
    rubs = rng.random() < 0.6
    for i in range(n):
        slides = cart and i == 0
        q, f, tag = ("m", "N", "x") if slides else ("rad", "N*m", str(i + 1 - cart))
        elements.append(element("damper", i, "d" + tag, loads[i] * rng.uniform(0.3, 2), f"{f}*s/{q}", part="damping"))
        if rubs:
            share = rng.uniform(0.02, 0.1) if slides or not cart else rng.uniform(0.002, 0.01)
            elements.append(element("friction", i, "f" + tag, loads[i] * size[i] * 40 * share, f, part="friction"))
    if not cart and count > 1 and rng.random() < 0.4:
        # A harness that twists between the first two joints.
        elements.append(element("spring", 0, "kh", loads[1] * rng.uniform(20, 80), "N*m/rad", 1, "coupling"))
    driven = [0] if cart else list(range(n))
    inputs = [("u1", "N" if cart else "N*m")] if cart else [(f"u{i + 1}", "N*m") for i in range(n)]
    elements += [element("input", i, inputs[k][0], 1, "1", first=k, known=True) for k, i in enumerate(driven)]
    coordinates = [("x", "m")] * cart + [(f"q{k + 1}", "rad") for k in range(count)]
    kind = f"cart with {count} pendul{'um' if count == 1 else 'a'}" if cart else "pendulum" if count == 1 else f"arm of {count} links"
    machine = Machine(kind, layout, elements, driven, size, coordinates, inputs, not cart)
    machine.bodies = dict(mass=list(mass))
    return machine


def draw(rng):
    """A machine, with the rates below which its dry friction falls to zero (a thousandth of a usual rate, as far as RK4 is stable)."""
    from dynamics import SUBSTEP, Dynamics
    machine = chain(rng) if rng.random() < 0.6 else links(rng)
    machine.layout["smooth"] = [0.0] * machine.layout["n"]
    free = [e for e in machine.elements if e["kind"] != "friction"]
    mobility = np.diag(np.linalg.inv(Dynamics(machine.layout, free).mass([e["value"] for e in free], np.zeros(machine.layout["n"]))))
    smooth = 5e-3 * machine.size
    for e in machine.elements:
        if e["kind"] == "friction":
            smooth[e["i"]] = max(smooth[e["i"]], e["value"] * mobility[e["i"]] * SUBSTEP)
    machine.layout["smooth"] = list(smooth)
    return machine


def decimal(x):
    return np.format_float_positional(x, trim="-")


def text(machine, elements, name="Arena"):
    """The model of these elements in the language of tpm, from energies and forces."""
    q, u = [c[0] for c in machine.coordinates], [i[0] for i in machine.inputs]
    joints = [q[i] for i in machine.layout["coordinate"]]
    angle = lambda k: " + ".join(joints[: k + 1])
    rate = lambda k: "(" + " + ".join(f"dot({joint})" for joint in joints[: k + 1]) + ")"
    between = lambda i, k: " + ".join(joints[i + 1 : k + 1])
    kinetic, potential, losses, forces, constants = [], [], [], {name: [] for name in q}, []
    for e in elements:
        i, p = e["i"], e["name"]
        own, other = q[i], None if e["j"] < 0 else q[e["j"]]
        d = own if other is None else f"({own} - {other})"
        w = f"dot({own})" if other is None else f"(dot({own}) - dot({other}))"
        match e["kind"]:
            case "inertia":
                kinetic.append(f"1/2*{p}*dot({own})^2")
            case "link_inertia":
                kinetic.append(f"1/2*{p}*{rate(i)}^2")
            case "link_moment":
                if e["first"]:
                    kinetic += [f"{p}*l{k + 1}*cos({between(k, i)})*{rate(k)}*{rate(i)}" for k in range(i)]
                    if machine.layout["cart"] >= 0:
                        kinetic.append(f"{p}*cos({angle(i)})*{rate(i)}*dot({q[machine.layout['cart']]})")
                if e["second"]:
                    potential.append(f"-{p}*g*cos({angle(i)})")
            case "spring":
                potential.append(f"1/2*{p}*{d}^2")
            case "cubic":
                potential.append(f"1/4*{p}*{d}^4")
            case "damper":
                losses.append(f"1/2*{p}*{w}^2")
            case "drag":
                forces[own].append(f"- {p}*{w}*abs({w})")
            case "friction":
                forces[own].append(f"- {p}*sign({w})")
            case "input":
                signal = u[int(e["first"])]
                forces[own].insert(0, signal if e.get("known") else f"{p}*{signal}")
        if e.get("known") and e["kind"] != "input":
            constants.append(f"{p} = {decimal(e['value'])} [{e['unit']}]")
    for k, length in enumerate(machine.layout["length"][:-1]):
        if any(f"*l{k + 1}*" in term for term in kinetic):
            constants.append(f"l{k + 1} = {decimal(length)} [m]")
    if any("*g*" in term for term in potential):
        constants.append(f"g = {decimal(machine.layout['gravity'])} [m/s^2]")
    join = lambda terms: "\n        + ".join(terms).replace("+ -", "- ")
    lines = [f"model {name} {{"]
    lines.append("    coordinate " + ", ".join(f"{name} [{unit}]" for name, unit in machine.coordinates) + ";")
    lines.append("    input " + ", ".join(f"{name} [{unit}]" for name, unit in machine.inputs) + ";")
    lines.append("    parameter " + ", ".join(f"{e['name']} [{e['unit']}]" for e in elements if not e.get("known")) + ";")
    lines += [f"    constant {c};" for c in constants]
    lines.append(f"    kinetic = {join(kinetic)};")
    if potential:
        lines.append(f"    potential = {join(potential)};")
    if losses:
        lines.append(f"    dissipation = {join(losses)};")
    for own, terms in forces.items():
        if terms:
            lines.append(f"    force {own} = {' '.join(terms)};")
    return "\n".join([*lines, "}", ""])

"""Adapter of `mujoco.sysid` (`pip install 'mujoco[sysid]'`): the model as MJCF, its own optimiser and intervals.

Links have the masses that the machine was drawn with; their first moments and inertias are what is sought. The state in which the log
begins is among the unknowns, as for output error. A model without counterpart in MJCF is not attempted.
"""

import os

import mujoco
import numpy as np
from mujoco import sysid
from tools import result

STEP, MOST = 1e-3, 60


class Undescribed(Exception):
    """MuJoCo has no such element."""


def describe(task, values, step):
    """MJCF of the model with these values, by name."""
    layout, joints = task.layout, {}
    value = lambda e: e["value"] if e.get("known") else values[e["name"]]
    count = len(layout["coordinate"])
    ties, motors, inertia, moment = {}, [], {}, {}
    for i in range(layout["n"]):
        joints[i] = dict(stiffness=[0.0], damping=[0.0], frictionloss=0.0)
    weight = None
    for e in task.elements:
        i, j, p = e["i"], e["j"], value(e)
        own = joints.get(i) if j < 0 else ties.setdefault((i, j), dict(stiffness=[0.0], damping=[0.0], frictionloss=0.0))
        match e["kind"]:
            case "inertia":
                inertia[i] = p
            case "link_inertia":
                inertia["link", i] = p
            case "link_moment":
                if not e["first"] and (i > 0 or layout["cart"] >= 0):
                    raise Undescribed("a link that does not move the others")
                moment[i] = p
                weight = layout["gravity"] if e["second"] else 0.0
            case "spring":
                own["stiffness"][0] += p
            case "cubic":
                own["stiffness"] += [0.0, p]
            case "damper":
                own["damping"][0] += p
            case "drag":
                own["damping"] += [p]
            case "friction":
                own["frictionloss"] += p
            case "input":
                motors.append(f'<motor joint="j{i}" gear="{p:.17g}" ctrllimited="false"/>')
    numbers = lambda own: " ".join(
        f'{key}="{" ".join(f"{x:.17g}" for x in (own[key] if isinstance(own[key], list) else [own[key]]))}"' for key in own)

    def joint(i, kind, axis):
        soft = 'solreffriction="0.002 1" solimpfriction="0.99 0.999 0.001"'
        return f'<joint name="j{i}" type="{kind}" axis="{axis}" {numbers(joints[i])} {soft if joints[i]["frictionloss"] else ""}/>'

    def link(k):
        if k == count:
            return ""
        mass, outer, length = task.bodies["mass"][k], sum(task.bodies["mass"][k + 1 :]), layout["length"][k]
        center = (moment[k] - length * outer) / mass if k in moment else 0.0
        own = max(inertia["link", k] - mass * center**2 - outer * length**2, 1e-6)
        return (f'<body pos="0 0 {-layout["length"][k - 1] if k else 0:.17g}"><inertial pos="0 0 {-center:.17g}" mass="{mass:.17g}" '
                f'diaginertia="{own:.17g} {own:.17g} {own:.17g}"/>{joint(layout["coordinate"][k], "hinge", "0 -1 0")}{link(k + 1)}</body>')

    bodies = []
    for i in range(layout["n"]):
        if i in layout["coordinate"]:
            continue
        p = inertia[i] - (sum(task.bodies["mass"]) if i == layout["cart"] else 0.0)
        turns = task.units[i] == "rad"
        mass, own = (1.0, max(p, 1e-9)) if turns else (max(p, 1e-6), 1.0)
        bodies.append(f'<body><inertial pos="0 0 0" mass="{mass:.17g}" diaginertia="{own:.17g} {own:.17g} {own:.17g}"/>'
                      f'{joint(i, "hinge" if turns else "slide", "1 0 0")}{link(0) if i == layout["cart"] else ""}</body>')
    if count and layout["cart"] < 0:
        bodies.append(link(0))
    tendons = "".join(f'<fixed name="t{i}{j}" springlength="0" {numbers(own)}>'
                      f'<joint joint="j{i}" coef="1"/><joint joint="j{j}" coef="-1"/></fixed>' for (i, j), own in ties.items())
    sensors = "".join(f'<jointpos name="s{i}" joint="j{i}"/>' for i in range(layout["n"]))
    return (f'<mujoco><option timestep="{step:.17g}" integrator="RK4" gravity="0 0 {-(weight or 0.0)}"><flag contact="disable"/></option>'
            f'<compiler angle="radian" balanceinertia="false" inertiafromgeom="false"/><worldbody>{"".join(bodies)}</worldbody>'
            f'{f"<tendon>{tendons}</tendon>" if tendons else ""}<actuator>{"".join(motors)}</actuator><sensor>{sensors}</sensor></mujoco>')


def identify(task):
    n = task.layout["n"]
    every = max(1, round(task.sample / STEP))
    step = task.sample / every
    try:
        xml = describe(task, task.start, step)
    except Undescribed as fault:
        return result(refused=f"not attempted: {fault}")
    spec = mujoco.MjSpec.from_string(xml)
    plain = spec.compile()
    order = [plain.joint(f"j{i}").qposadr[0] for i in range(n)]
    q, v = task.first_state()
    span, rate = np.std(task.q, axis=0), np.std(np.diff(task.q, axis=0), axis=0) / task.sample
    params = sysid.ParameterDict({
        name: sysid.Parameter(name, 1.0, 0.05, 20.0) for name in task.names})
    for i in range(n):
        params[f"q{i} first"] = sysid.Parameter(f"q{i} first", q[i] / span[i], -50, 50)
        params[f"v{i} first"] = sysid.Parameter(f"v{i} first", v[i] / rate[i], -50, 50)
    values = lambda p: {name: float(p[name].value[0]) * task.start[name] for name in task.names}
    build = lambda p, _: mujoco.MjModel.from_xml_string(describe(task, values(p), step))
    begin = lambda p, which, scale: np.array([float(p[f"{which}{i} first"].value[0]) * scale[i] for i in np.argsort(order)])
    state_of = lambda model, p: sysid.create_initial_state(model, begin(p, "q", span), begin(p, "v", rate))

    def rollout(models, datas, control_signal, initial_states, param_dicts, rollout_signal_mapping, rollout_state_mapping, ctrl_mapping):
        begun = [state_of(model, p) for model, p in zip(models, param_dicts)]
        return sysid.sysid_rollout(models=models, datas=datas, control_signal=control_signal, initial_states=begun,
                                   rollout_signal_mapping=rollout_signal_mapping, rollout_state_mapping=rollout_state_mapping,
                                   ctrl_mapping=ctrl_mapping)

    def residual(p, predicted, measured, model, whole, state, **_):
        first = np.array([float(p[f"q{i} first"].value[0]) * span[i] for i in range(n)])
        motion = np.vstack([first, state[every - 1 :: every, 1 : 1 + n][:, order][: len(task.q) - 1]])
        left = (motion - task.q) / (np.linalg.norm(task.q, axis=0) / np.sqrt(2))
        return np.nan_to_num(left, nan=1e3, posinf=1e3, neginf=-1e3), measured, measured

    fine = np.arange(len(task.q) * every - every + 1) * step
    control = sysid.TimeSeries(fine, np.repeat(task.u, every, axis=0)[: len(fine)])
    reading = sysid.TimeSeries(fine, np.zeros((len(fine), n)))
    sequences = sysid.ModelSequences("arena", spec, "log", state_of(plain, params), control, reading)
    function = sysid.build_residual_fn(models_sequences=[sequences], build_model=build, modify_residual=residual, custom_rollout=rollout,
                                       resample_true=False, n_threads=1)
    # The optimiser writes every step: `verbose` of `optimize` does not reach it.
    with open(os.devnull, "w") as nowhere:
        found, fit = sysid.optimize(params, function, verbose=False, max_iters=MOST, output=nowhere)
    if len(fit.extras["objective"]) >= MOST:
        return result(refused="did not converge")
    left, _, _ = function(fit.x, found)
    _, half = sysid.calculate_intervals([np.concatenate([np.ravel(x) for x in left])], fit.jac)
    names = list(found.keys())
    std = {name: half[at] / 1.959964 for at, name in enumerate(names)}
    answer = {name: (task.start[name] * float(found[name].value[0]), abs(task.start[name]) * std[name]) for name in task.names}
    if not all(np.isfinite(s) and s > 0 for _, s in answer.values()):
        return result(refused="singular")
    return result(answer)


"""Checks of the arena's own mechanics: `python3 check.py [MACHINES]` (numpy, scipy, mujoco).

The simulation of machines without dry friction beside MuJoCo's, of another formulation and another program, from the same state under the
same inputs; and the rows of the inverse dynamics beside the simulation: accelerations by differences, rows times values is zero.
"""

import sys

import arena
import mujoco
import mujoco_sysid
import numpy as np
import records
from dynamics import Dynamics
from mujoco import rollout


def beside_mujoco(case, elements):
    """Largest difference of the motions, in the machine's size."""
    task = arena.task_of(case, 0)
    task.elements = elements
    every = max(1, round(case.sample / mujoco_sysid.STEP))
    values = {e["name"]: e["value"] for e in elements}
    model = mujoco.MjModel.from_xml_string(mujoco_sysid.describe(task, values, case.sample / every))
    data, n = mujoco.MjData(model), model.nq
    order = [model.joint(f"j{i}").qposadr[0] for i in range(n)]
    data.qpos[order], data.qvel[order] = case.start
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    motion = rollout.rollout(model, data, state, np.repeat(case.inputs, every, axis=0)[None])[0][0]
    own, _ = Dynamics(case.machine.layout, elements).simulate(list(values.values()), case.sample, *case.start, inputs=case.inputs)
    return np.abs((motion[every - 1 :: every, 1 : 1 + n][:-1, order] - own[1:]) / case.machine.size).max()


def beside_rows(case, elements):
    """Largest force that rows times values leave along a simulated motion, as a share of the largest that an element asks for."""
    dynamics, values, sample = Dynamics(case.machine.layout, elements), [e["value"] for e in elements], 5e-4
    inputs = np.repeat(case.inputs[100:101], 400, axis=0)  # One value, so that accelerations have no steps.
    q, _ = dynamics.simulate(values, sample, *case.start, inputs=inputs)
    difference = lambda x: (8 * (x[3:-1] - x[1:-3]) - (x[4:] - x[:-4])) / (12 * sample)
    v = difference(q)
    rows = dynamics.rows(q[4:-4], v[2:-2], difference(v), inputs[4:-4]) * values
    return np.abs(rows.sum(2)).max() / np.abs(rows).max()


def main(machines=40):
    worst = [0.0, 0.0]
    for number in range(int(machines)):
        case = records.draw(0, number)
        elements = [e for e in case.machine.elements if e["kind"] != "friction"]
        errors = beside_mujoco(case, elements), beside_rows(case, elements)
        worst = [max(pair) for pair in zip(worst, errors)]
        if errors[0] > 1e-6 or errors[1] > 1e-5:
            sys.exit(f"machine {number}, {case.machine.kind}: motions differ by {errors[0]:.1e}, rows leave {errors[1]:.1e}")
    print(f"{machines} machines: motions differ by at most {worst[0]:.1e} of their size, rows leave at most {worst[1]:.1e} of their forces")


if __name__ == "__main__":
    main(*sys.argv[1:])

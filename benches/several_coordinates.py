"""Right and wrong models of machines with several coordinates: `python3 several_coordinates.py TPM [LOGS [MACHINE ...]]`
(numpy).

Every machine is simulated in a loop (position and velocity feedback on noisy readings, inputs held for a millisecond), eight seconds a
log, with parameters, references and noise drawn anew for every log. It is identified with its own model and with models that lack a
term. Counted: confident wrong numbers (beyond 3.5 stated deviations and 1 %, exit code 0, no cause named), logs in which some term is
named as missing, logs that are warned about at all, exit codes 1, and the share of the truth inside the 95 % intervals.
"""

import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

# The steps of the integration are short beside the time in which dry friction, a steep function of the velocity near rest, stops a light link.
STEP, SUBSTEPS, SECONDS = 1e-3, 16, 8.0
CAUSES = {"missing_term", "limited", "halves", "repeats", "vibration", "unexplained", "unsettled", "other_hold", "exchanged",
          "gives_energy", "goes_against"}


class Arm:
    """Two links in a vertical plane."""

    columns, inputs, late = ("q1", "q2"), ("t1", "t2"), 3
    gains, noise = (np.array([120.0, 40.0]), np.array([12.0, 4.0])), 2e-6
    size, text = np.array([0.8, 1.0]), """model A {{ coordinate q1 [rad], q2 [rad]; input t1 [N*m], t2 [N*m];
    parameter p1 [kg*m^2], p2 [kg*m^2], p3 [kg*m^2], g1 [N*m]{names};
    p1*ddot(q1) + p2*(ddot(q1) + ddot(q2)) + p3*(cos(q2)*(2*ddot(q1) + ddot(q2)) - sin(q2)*(2*dot(q1)*dot(q2) + dot(q2)^2)){d1}
      + g1*cos(q1){g1}{f1} = t1;
    p2*(ddot(q1) + ddot(q2)) + p3*(cos(q2)*ddot(q1) + sin(q2)*dot(q1)^2){d2}{g2}{f2} = t2; }}"""
    parts = {
        "damping": dict(names=", d1 [N*m*s/rad], d2 [N*m*s/rad]", d1=" + d1*dot(q1)", d2=" + d2*dot(q2)"),
        "friction": dict(names=", f1 [N*m], f2 [N*m]", f1=" + f1*sign(dot(q1))", f2=" + f2*sign(dot(q2))"),
        "gravity": dict(names=", g2 [N*m]", g1=" + g2*cos(q1 + q2)", g2=" + g2*cos(q1 + q2)"),
    }

    def draw(self, rng, n):
        u = lambda a, b: rng.uniform(a, b, n)
        return dict(p1=u(0.2, 0.4), p2=u(0.04, 0.08), p3=u(0.05, 0.09), g1=u(6, 11), g2=u(1.5, 2.5), d1=u(0.2, 0.6),
                    d2=u(0.1, 0.3), f1=u(0.3, 0.7), f2=u(0.2, 0.6))

    def acceleration(self, p, q, v, u):
        c, s = np.cos(q[1]), np.sin(q[1])
        m11, m12, m22 = p["p1"] + p["p2"] + 2 * p["p3"] * c, p["p2"] + p["p3"] * c, p["p2"]
        sign = lambda v: np.tanh(v / 1e-3)
        both = p["g2"] * np.cos(q[0] + q[1])
        r1 = u[0] + p["p3"] * s * (2 * v[0] * v[1] + v[1] ** 2) - p["d1"] * v[0] - p["g1"] * np.cos(q[0]) - both - p["f1"] * sign(v[0])
        r2 = u[1] - p["p3"] * s * v[0] ** 2 - p["d2"] * v[1] - both - p["f2"] * sign(v[1])
        det = m11 * m22 - m12**2
        return np.array([(m22 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det])


class Belt:
    """A motor that moves a load by an elastic belt; no input acts on the load."""

    columns, inputs, late = ("x1", "x2"), ("u",), 3
    gains, noise = (np.array([3000.0, 0.0]), np.array([60.0, 0.0])), 1e-7
    size, text = np.array([0.1, 0.0]), """model B {{ coordinate x1 [m], x2 [m]; input u [N];
    parameter m1 [kg], m2 [kg], kb [N/m], cb [N*s/m]{names};
    m1*ddot(x1) + kb*(x1 - x2) + cb*(dot(x1) - dot(x2)){d1}{f1} = u;
    m2*ddot(x2) + kb*(x2 - x1) + cb*(dot(x2) - dot(x1)){d2}{f2} = 0; }}"""
    parts = {
        "damping": dict(names=", d1 [N*s/m], d2 [N*s/m]", d1=" + d1*dot(x1)", d2=" + d2*dot(x2)"),
        "friction": dict(names=", f1 [N], f2 [N]", f1=" + f1*sign(dot(x1))", f2=" + f2*sign(dot(x2))"),
    }

    def draw(self, rng, n):
        u = lambda a, b: rng.uniform(a, b, n)
        return dict(m1=u(0.6, 1.2), m2=u(1.0, 2.0), kb=u(4000, 9000), cb=u(4, 9), d1=u(1, 3), d2=u(2, 4), f1=u(0.5, 1), f2=u(0.8, 1.5))

    def acceleration(self, p, q, v, u):
        sign = lambda v: np.tanh(v / 1e-3)
        pull = p["kb"] * (q[0] - q[1]) + p["cb"] * (v[0] - v[1])
        return np.array([
            (u[0] - pull - p["d1"] * v[0] - p["f1"] * sign(v[0])) / p["m1"],
            (pull - p["d2"] * v[1] - p["f2"] * sign(v[1])) / p["m2"],
        ])


class CartPole:
    """A pendulum that hangs from a cart; no input acts on the pendulum. Gravity, which is known, gives the scale of its row."""

    columns, inputs, late = ("x", "phi"), ("u",), 3
    gains, noise = (np.array([60.0, 0.0]), np.array([25.0, 0.0])), 1e-6
    size, text = np.array([0.25, 0.0]), """model C {{ coordinate x [m], phi [rad]; input u [N]; constant g = 9.81 [m/s^2];
    parameter M [kg], P [kg*m], J [kg*m^2]{names};
    M*ddot(x){coupling}{d1}{f1} = u;
    J*ddot(phi) + P*(cos(phi)*ddot(x) + g*sin(phi)){d2}{f2} = 0; }}"""
    parts = {
        "damping": dict(names=", d1 [N*s/m], d2 [N*m*s/rad]", d1=" + d1*dot(x)", d2=" + d2*dot(phi)"),
        "friction": dict(names=", f1 [N], f2 [N*m]", f1=" + f1*sign(dot(x))", f2=" + f2*sign(dot(phi))"),
        "coupling": dict(coupling=" + P*(cos(phi)*ddot(phi) - sin(phi)*dot(phi)^2)"),
    }

    def draw(self, rng, n):
        u = lambda a, b: rng.uniform(a, b, n)
        p = dict(M=u(1.0, 2.0), P=u(0.15, 0.3), d1=u(2, 5), d2=u(0.005, 0.02), f1=u(0.5, 1.5), f2=u(0.002, 0.008))
        p["J"] = p["P"] * u(0.35, 0.6)
        return p

    def acceleration(self, p, q, v, u):
        sign = lambda v: np.tanh(v / 1e-3)
        c, s = np.cos(q[1]), np.sin(q[1])
        r1 = u[0] + p["P"] * s * v[1] ** 2 - p["d1"] * v[0] - p["f1"] * sign(v[0])
        r2 = -9.81 * p["P"] * s - p["d2"] * v[1] - p["f2"] * sign(v[1])
        det = p["M"] * p["J"] - (p["P"] * c) ** 2
        return np.array([(p["J"] * r1 - p["P"] * c * r2) / det, (p["M"] * r2 - p["P"] * c * r1) / det])


class ThreeJoints:
    """Three links in a vertical plane; `a`, `b` and `c` are their absolute angles."""

    columns, inputs, late = ("q1", "q2", "q3"), ("t1", "t2", "t3"), 3
    gains, noise = (np.array([160.0, 60.0, 15.0]), np.array([16.0, 6.0, 1.5])), 2e-6
    size = np.array([0.8, 1.0, 1.2])
    A, B, C = "ddot(q1)", "(ddot(q1) + ddot(q2))", "(ddot(q1) + ddot(q2) + ddot(q3))"
    first = "I1*ddot(q1) + B12*(cos(q2)*{B} - sin(q2)*{b}^2){first13} + G1*cos(q1)"
    second = "I2*{B} + B12*(cos(q2)*{A} + sin(q2)*{a}^2) + B23*(cos(q3)*{C} - sin(q3)*{c}^2) + G2*cos(q1 + q2)"
    third = "I3*{C}{third13} + B23*(cos(q3)*{B} + sin(q3)*{b}^2){gravity}"
    rates = dict(A=A, B=B, C=C, a="dot(q1)", b="(dot(q1) + dot(q2))", c="(dot(q1) + dot(q2) + dot(q3))")
    parts = {
        "damping": dict(names=", d1 [N*m*s/rad], d2 [N*m*s/rad], d3 [N*m*s/rad]", d1=" + d1*dot(q1)", d2=" + d2*dot(q2)", d3=" + d3*dot(q3)"),
        "friction": dict(names=", f1 [N*m], f2 [N*m], f3 [N*m]", f1=" + f1*sign(dot(q1))", f2=" + f2*sign(dot(q2))", f3=" + f3*sign(dot(q3))"),
        "gravity": dict(names=", G3 [N*m]", gravity=" + G3*cos(q1 + q2 + q3)"),
        "coupling": dict(
            names=", B13 [kg*m^2]",
            first13=" + B13*(cos(q2 + q3)*{C} - sin(q2 + q3)*{c}^2)".format(**rates),
            third13=" + B13*(cos(q2 + q3)*{A} + sin(q2 + q3)*{a}^2)".format(**rates),
        ),
    }

    @property
    def text(self):
        keep = dict(first13="{first13}", third13="{third13}", gravity="{gravity}", **self.rates)
        first, second, third = (row.format(**keep) for row in (self.first, self.second, self.third))
        return f"""model T {{{{ coordinate q1 [rad], q2 [rad], q3 [rad]; input t1 [N*m], t2 [N*m], t3 [N*m];
    parameter I1 [kg*m^2], I2 [kg*m^2], I3 [kg*m^2], B12 [kg*m^2], B23 [kg*m^2], G1 [N*m], G2 [N*m]{{names}};
    {first} + {second} + {third}{{d1}}{{f1}} = t1;
    {second} + {third}{{d2}}{{f2}} = t2;
    {third}{{d3}}{{f3}} = t3; }}}}"""

    def draw(self, rng, n):
        """Links with a mass, a centre and an inertia, so that the machine is possible."""
        u = lambda a, b: rng.uniform(a, b, n)
        m, l = (u(3, 5), u(1.5, 2.5), u(0.6, 1.2)), (0.4, 0.35)
        c = (u(0.15, 0.25), u(0.12, 0.2), u(0.08, 0.14))
        own = [m[i] * c[i] ** 2 + u(0.3, 0.6) * m[i] * c[i] ** 2 for i in range(3)]
        p = dict(I1=own[0] + (m[1] + m[2]) * l[0] ** 2, I2=own[1] + m[2] * l[1] ** 2, I3=own[2])
        p.update(B12=l[0] * (m[1] * c[1] + m[2] * l[1]), B13=l[0] * m[2] * c[2], B23=l[1] * m[2] * c[2])
        p.update(G1=9.81 * (m[0] * c[0] + (m[1] + m[2]) * l[0]), G2=9.81 * (m[1] * c[1] + m[2] * l[1]), G3=9.81 * m[2] * c[2])
        p.update(d1=u(0.3, 0.8), d2=u(0.15, 0.4), d3=u(0.03, 0.1), f1=u(0.5, 1.0), f2=u(0.3, 0.7), f3=u(0.08, 0.2))
        return p

    def acceleration(self, p, q, v, u):
        sign = lambda v: np.tanh(v / 1e-3)
        joint = u - np.array([p[f"d{i + 1}"] * v[i] + p[f"f{i + 1}"] * sign(v[i]) for i in range(3)])
        a, w = np.cumsum(q, 0), np.cumsum(v, 0)
        force = np.array([joint[0] - joint[1], joint[1] - joint[2], joint[2]])
        force -= np.array([p[f"G{i + 1}"] * np.cos(a[i]) for i in range(3)])
        mass = np.zeros((q.shape[1], 3, 3))
        for i in range(3):
            mass[:, i, i] = p[f"I{i + 1}"]
            for j in range(3):
                if i != j:
                    between = p[f"B{min(i, j) + 1}{max(i, j) + 1}"]
                    mass[:, i, j] = between * np.cos(a[i] - a[j])
                    force[i] -= between * np.sin(a[i] - a[j]) * w[j] ** 2
        angular = np.linalg.solve(mass, force.T[:, :, None])[:, :, 0].T
        return np.array([angular[0], angular[1] - angular[0], angular[2] - angular[1]])


def simulate(machine, logs, late, seed):
    """Parameters, times, readings and recorded inputs of some logs at once; inputs act `late` milliseconds late."""
    rng = np.random.default_rng(seed)
    p = machine.draw(rng, logs)
    n, c = int(SECONDS / STEP), len(machine.columns)
    k = np.arange(1, 9)
    amplitude = rng.normal(size=(8, c, logs)) / (1 + 0.3 * k)[:, None, None]
    phase = rng.uniform(0, 2 * np.pi, (8, c, logs))
    w = 2 * np.pi * 0.35 * k * rng.uniform(0.95, 1.05, 8)
    amplitude *= machine.size[:, None] / np.abs(amplitude).sum(0)
    t = np.arange(n) * STEP
    reference = np.einsum("kcl,tkcl->tcl", amplitude, np.sin(w[None, :, None, None] * t[:, None, None, None] + phase))
    rate = np.einsum("kcl,tkcl->tcl", amplitude * w[:, None, None], np.cos(w[None, :, None, None] * t[:, None, None, None] + phase))
    q, v = reference[0].copy(), rate[0].copy()
    kp, kd = (gain[:, None] for gain in machine.gains)
    readings, inputs, before = np.zeros((n, c, logs)), np.zeros((n, len(machine.inputs), logs)), None
    for i in range(n):
        readings[i] = q + machine.noise * rng.normal(size=q.shape)
        slow = (readings[i] - before) / STEP if before is not None else v
        before = readings[i]
        u = (kp * (reference[i] - readings[i]) + kd * (rate[i] - slow))[: len(machine.inputs)]
        inputs[i] = u
        acting = inputs[max(0, i - late)]
        h = STEP / SUBSTEPS
        for _ in range(SUBSTEPS):
            a1 = machine.acceleration(p, q, v, acting)
            a2 = machine.acceleration(p, q + h / 2 * v, v + h / 2 * a1, acting)
            a3 = machine.acceleration(p, q + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2, acting)
            a4 = machine.acceleration(p, q + h * v + h * h / 2 * a2, v + h * a3, acting)
            q, v = q + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return p, t, readings, inputs


def text(machine, without):
    fill = {key: "" for part in machine.parts.values() for key in part}
    for name, part in machine.parts.items():
        if name != without:
            for key, value in part.items():
                fill[key] += value
    return machine.text.format(**fill)


def main(tpm, logs=40, *only):
    logs = int(logs)
    folder = Path(tempfile.mkdtemp())
    machines = [machine for machine in (Arm(), Belt(), CartPole(), ThreeJoints()) if not only or type(machine).__name__ in only]
    for machine in machines:
        kind = type(machine).__name__
        for late in (0, machine.late):
            p, t, readings, inputs = simulate(machine, logs, late, 7)
            for i in range(logs):
                header = ",".join(["t_s", *machine.columns, *machine.inputs])
                rows = np.column_stack([t, readings[:, :, i], inputs[:, :, i]])
                np.savetxt(folder / f"{i}.csv", rows, delimiter=",", header=header, comments="", fmt="%.9g")
            for without in [None, *machine.parts] if late == 0 else [None]:
                model = folder / "model.tpm"
                model.write_text(text(machine, without))
                wrong = named = warned = ended = 0
                scores = []

                def identify(i):
                    command = [tpm, "identify", model, "--log", folder / f"{i}.csv", "--hold", "zoh", "--json"]
                    run = subprocess.run(command, capture_output=True, text=True)
                    return run.returncode, json.loads(run.stdout) if run.stdout else None

                with ThreadPoolExecutor(2) as pool:
                    results = list(pool.map(identify, range(logs)))
                for i, (code, result) in enumerate(results):
                    ended += code != 0
                    if result is None:
                        continue
                    causes = {own["kind"] for own in result["findings"]} & CAUSES
                    own = [(o["name"], o["value"], o["std"]) for o in result["parameters"] if o["value"] is not None and o["std"]]
                    z = [((value - p[name][i]) / std, abs(value / p[name][i] - 1)) for name, value, std in own]
                    bad = any(abs(score) > 3.5 and share > 0.01 for score, share in z)
                    wrong += bad and code == 0 and not causes
                    named += "missing_term" in causes
                    warned += bool(causes)
                    scores += [score for score, _ in z]
                scores = np.array(scores)
                what = "right" if without is None and late == 0 else (f"{late} ms late" if without is None else f"without {without}")
                print(
                    f"{kind:11} {what:18} logs {logs}, confident and wrong {wrong}, named {named}, any cause {warned}, exit 1 {ended}, "
                    f"inside 95 % {100 * np.mean(np.abs(scores) < 1.96):.1f} %, rms {np.sqrt(np.mean(scores**2)):.2f}, largest {np.abs(scores).max():.1f}",
                    flush=True,
                )


if __name__ == "__main__":
    main(*sys.argv[1:])

"""Recordings as people make them: `python3 recordings.py TPM [NAME ...]` (numpy).

Twenty machines of the kinds that are identified in public: motor rigs, robots, teaching shields, servo benches, free swings. Each is
simulated, and its log is written as such machines write theirs: counts, held commands, stamps of whole milliseconds, topics at their own
rates, consoles between the rows, dates. `tpm identify` gets the model and the log with no more flags than the shape of the file needs.
Printed: served (all parameters within 3 stated deviations or 2 % of the truth, exit code 0), wrong, or refused, with what was said.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

GRAVITY = 9.81
sign = lambda v: np.tanh(v / 1e-4)


def play(rate, state, t, command, substeps=20):
    """States at the stamps and what was applied from each on; `command(t, state)` is held between them."""
    state = np.array(state, float)
    states, applied = [], []
    for k, now in enumerate(t):
        u = np.atleast_1d(command(now, state))
        states.append(state.copy())
        applied.append(u)
        if k + 1 == len(t):
            break
        h = (t[k + 1] - now) / substeps
        f = lambda s: np.array(rate(s, u))
        for _ in range(substeps):
            a = f(state)
            b = f(state + h / 2 * a)
            c = f(state + h / 2 * b)
            state = state + h / 6 * (a + 2 * b + 2 * c + f(state + h * c))
    return np.array(states), np.array(applied)


def even(count, step):
    return np.arange(count) * step


def jumps(rng, every, low, high):
    values = rng.uniform(low, high, 1000)
    return lambda t, s: values[int(t / every + 1e-9)]


def table(header, *columns, form="%.9g"):
    rows = np.column_stack(columns)
    return header + "\n" + "".join(",".join("" if np.isnan(x) else form % x for x in row) + "\n" for row in rows)


MOTOR = """model Motor {{ coordinate q [rad]; input u [V]; parameter a [V*s^2/rad], b [V*s/rad], c [V];
a*ddot(q) + b*dot(q) + c*sign(dot(q)) = u; }}""".format()
MOTOR_TRUTH = dict(a=0.02, b=0.09, c=0.4)
motor = lambda s, u: [s[1], (u[0] - 0.09 * s[1] - 0.4 * sign(s[1])) / 0.02]


def motor_bang_bang(rng):
    """A motor switched between full forward and full back; an encoder of 1024 counts, stamps of whole milliseconds that jitter."""
    t = np.cumsum(rng.integers(9, 14, 1500)) * 1e-3
    s, u = play(motor, [0, 0], t, jumps(rng, 0.4, -6, 6))
    counts = np.floor(s[:, 0] / (2 * np.pi / 1024))
    return MOTOR, MOTOR_TRUTH, table("Timestamp,pwm,enc", 1e3 * t, u[:, 0], counts), [
        "--map", "q=enc", "--scale", "q=2*pi/1024", "--map", "u=pwm", "--hold", "zoh"]


def motor_short_chirp(rng):
    """A hundred and fifty rows of a servo that follows a chirp."""
    t = even(150, 0.02)
    want = lambda t: 0.8 * np.sin(2 * np.pi * (0.4 * t + 0.35 * t * t))
    s, u = play(motor, [0, 0], t, lambda t, s: np.clip(12 * (want(t) - s[0]) - 0.4 * s[1], -12, 12))
    return MOTOR, MOTOR_TRUTH, table("t_s,q,u", t, s[:, 0] + 2e-4 * rng.normal(size=150), u[:, 0]), ["--hold", "zoh"]


def motor_late_drive(rng):
    """A drive that acts 12 ms after it was told."""
    t = even(3000, 0.004)
    command = jumps(rng, 0.3, -6, 6)
    s, u = play(motor, [0, 0], t, lambda t, s: command(t - 0.012, s) if t >= 0.012 else 0)
    told = np.array([command(now, None) for now in t])
    return MOTOR, MOTOR_TRUTH, table("t_s,q,u", t, s[:, 0] + 2e-4 * rng.normal(size=len(t)), told), [
        "--hold", "zoh", "--delay", "u=fit"]


def motor_electrical(rng):
    """Voltage steps on a motor whose current answers within a millisecond."""
    text = """model Motor { coordinate q [rad], i [A]; input u [V]; constant kv = 1 [V*A*s/(N*m*rad)];
    parameter R [V/A], L [V*s/A], K [N*m/A], J [N*m*s^2/rad], b [N*m*s/rad];
    L*dot(i) + R*i + kv*K*dot(q) = u;
    J*ddot(q) + b*dot(q) - K*i = 0; }"""
    truth = dict(R=1.5, L=2e-3, K=0.03, J=2e-5, b=1e-5)
    rate = lambda s, u: [s[1], (0.03 * s[2] - 1e-5 * s[1]) / 2e-5, (u[0] - 1.5 * s[2] - 0.03 * s[1]) / 2e-3]
    t = even(4000, 5e-4)
    s, u = play(rate, [0, 0, 0], t, jumps(rng, 0.1, -6, 6), 8)
    noise = rng.normal(size=(2, len(t)))
    return text, truth, table("t_s,q,i,u", t, s[:, 0] + 1e-4 * noise[0], s[:, 2] + 5e-3 * noise[1], u[:, 0]), ["--hold", "zoh"]


SYSID = """model Drive { coordinate x [m]; input u [V]; parameter ks [V], kv [V*s/m], ka [V*s^2/m];
ka*ddot(x) + kv*dot(x) + ks*sign(dot(x)) = u; }"""
SYSID_TRUTH = dict(ks=0.2, kv=2.5, ka=0.4)
drive = lambda s, u: [s[1], (u[0] - 2.5 * s[1] - 0.2 * sign(s[1])) / 0.4]


def drive_run(rng, count=1500, step=0.02):
    t = even(count, step)
    s, u = play(drive, [0, 0], t, jumps(rng, 0.7, -7, 7))
    return t, s[:, 0] + 5e-4 * rng.normal(size=count), u[:, 0]


def robot_drive_json(rng):
    """A drive's log as JSON, lists by name."""
    t, x, u = drive_run(rng)
    return SYSID, SYSID_TRUTH, json.dumps(dict(t_s=list(t), x=list(x), u=list(u))), ["--hold", "zoh"], "json"


def robot_drive_topics(rng):
    """Topics at their own rates: the command where it changes, the position every third row."""
    t, x, u = drive_run(rng, 3000, 0.01)
    u[1:][u[1:] == u[:-1]] = np.nan
    x[np.arange(len(t)) % 3 != 1] = np.nan
    return SYSID, SYSID_TRUTH, table("t_s,x,u", t, x, u), ["--hold", "zoh"]


def robot_drive_console(rng):
    """A console that writes between the rows, and a last line that was cut off."""
    t, x, u = drive_run(rng)
    lines = table("t_s,x,u", t, x, u).splitlines()
    lines.insert(700, "[INFO] loop overrun, 3 ms")
    return SYSID, SYSID_TRUTH, "\n".join(lines) + "\n30.0,1.2", ["--hold", "zoh"]


def robot_drive_dates(rng):
    """Stamps as dates with times of day."""
    t, x, u = drive_run(rng)
    rows = [f"2026-03-01 10:{int(now // 60):02d}:{now % 60:06.3f},{a:.9g},{b:.9g}" for now, a, b in zip(t, x, u)]
    return SYSID, SYSID_TRUTH, "time,x,u\n" + "\n".join(rows) + "\n", ["--hold", "zoh"]


def robot_drive_no_time(rng):
    """A table without a time."""
    _, x, u = drive_run(rng)
    return SYSID, SYSID_TRUTH, table("x,u", x, u), ["--hold", "zoh", "--sample-time", "0.02"]


def robot_two_links(rng):
    """Two links in a vertical plane, in a loop."""
    text = """model Arm { coordinate q1 [rad], q2 [rad]; input t1 [N*m], t2 [N*m];
    parameter p1 [kg*m^2], p2 [kg*m^2], p3 [kg*m^2], g1 [N*m], g2 [N*m], d1 [N*m*s/rad], d2 [N*m*s/rad];
    p1*ddot(q1) + p2*(ddot(q1) + ddot(q2)) + p3*(cos(q2)*(2*ddot(q1) + ddot(q2)) - sin(q2)*(2*dot(q1)*dot(q2) + dot(q2)^2))
      + g1*cos(q1) + g2*cos(q1 + q2) + d1*dot(q1) = t1;
    p2*(ddot(q1) + ddot(q2)) + p3*(cos(q2)*ddot(q1) + sin(q2)*dot(q1)^2) + g2*cos(q1 + q2) + d2*dot(q2) = t2; }"""
    truth = dict(p1=0.3, p2=0.06, p3=0.07, g1=8.0, g2=2.0, d1=0.4, d2=0.2)

    def rate(s, u):
        q1, q2, v1, v2 = s
        c, sn = np.cos(q2), np.sin(q2)
        m11, m12, m22 = 0.36 + 0.14 * c, 0.06 + 0.07 * c, 0.06
        r1 = u[0] + 0.07 * sn * (2 * v1 * v2 + v2**2) - 0.4 * v1 - 8 * np.cos(q1) - 2 * np.cos(q1 + q2)
        r2 = u[1] - 0.07 * sn * v1**2 - 0.2 * v2 - 2 * np.cos(q1 + q2)
        det = m11 * m22 - m12**2
        return [v1, v2, (m22 * r1 - m12 * r2) / det, (m11 * r2 - m12 * r1) / det]

    t = even(4000, 2e-3)
    w = 2 * np.pi * np.array([0.4, 0.7, 1.1])
    want = lambda t, p: np.dot([0.5, 0.3, 0.2], np.sin(w * t + p))
    control = lambda t, s: [120 * (want(t, 0.0) - s[0]) - 12 * s[2], 40 * (want(t, 1.0) - s[1]) - 4 * s[3]]
    s, u = play(rate, [0, 0, 0, 0], t, control, 4)
    q = s[:, :2] + 2e-5 * rng.normal(size=(len(t), 2))
    return text, truth, table("t_s,q1,q2,t1,t2", t, q[:, 0], q[:, 1], u[:, 0], u[:, 1]), ["--hold", "zoh"]


def robot_flexible_joint(rng):
    """A joint with an elastic gear, of which the motor alone has an encoder."""
    text = """model Joint { coordinate q [rad]; unmeasured l [rad]; input u [N*m];
    parameter jm [kg*m^2], jl [kg*m^2], dm [N*m*s/rad], dl [N*m*s/rad], k [N*m/rad];
    jm*ddot(q) + dm*dot(q) + k*(q - l) = u;
    jl*ddot(l) + dl*dot(l) + k*(l - q) = 0; }"""
    truth = dict(jm=0.05, jl=0.2, dm=0.3, dl=0.1, k=60.0)
    rate = lambda s, u: [s[2], s[3], (u[0] - 0.3 * s[2] - 60 * (s[0] - s[1])) / 0.05, (60 * (s[0] - s[1]) - 0.1 * s[3]) / 0.2]
    t = even(2000, 0.005)
    s, u = play(rate, [0, 0, 0, 0], t, jumps(rng, 0.3, -2, 2), 6)
    return text, truth, table("t_s,q,u", t, s[:, 0] + 1e-4 * rng.normal(size=len(t)), u[:, 0]), ["--hold", "zoh"]


def shield_propeller(rng):
    """An arm with a propeller, whose thrust is the square of the command, in a log in degrees."""
    text = """model Propeller { coordinate phi [rad]; input u [V]; parameter J [kg*m^2], d [N*m*s/rad], k [N*m/V^2];
    constant mgl = 0.3 [N*m];
    J*ddot(phi) + d*dot(phi) + mgl*sin(phi) = k*u^2; }"""
    rate = lambda s, u: [s[1], (0.02 * u[0] ** 2 - 0.015 * s[1] - 0.3 * np.sin(s[0])) / 0.012]
    t = even(1500, 0.01)
    s, u = play(rate, [0, 0], t, jumps(rng, 0.5, 0.5, 3.2))
    return text, dict(J=0.012, d=0.015, k=0.02), table("t_s,phi [deg],u", t, np.degrees(s[:, 0]) + 0.05 * rng.normal(size=len(t)), u[:, 0]), [
        "--hold", "zoh"]


def shield_levitation(rng):
    """A ball under a magnet, held there by its loop; the force is that of the squared current over the squared gap."""
    text = """model Levitation { coordinate y [m]; input i [A]; parameter k [N*m^2/A^2], d [N*s/m]; constant m = 0.02 [kg], g = 9.81 [m/s^2];
    m*ddot(y) + d*dot(y) - m*g = -k*i^2/y^2; }"""
    rate = lambda s, u: [s[1], GRAVITY - (2e-5 * u[0] ** 2 / s[0] ** 2 + 0.05 * s[1]) / 0.02]
    t = even(4000, 1e-3)
    want = lambda t: 0.012 + 0.002 * np.sign(np.sin(2 * np.pi * 0.8 * t)) * (t > 0.2) + 0.0007 * np.sin(2 * np.pi * 3.1 * t)
    hold = lambda t, s: np.clip(1.19 + 280 * (s[0] - want(t)) + 5.5 * s[1], 0.0, 4.0)
    s, u = play(rate, [0.012, 0], t, hold, 4)
    return text, dict(k=2e-5, d=0.05), table("t_s,y,i", t, s[:, 0] + 5e-6 * rng.normal(size=len(t)), u[:, 0]), ["--hold", "zoh"]


def shield_ball_beam(rng):
    """A ball on a beam that a servo tilts."""
    text = """model Ball { coordinate x [m]; input a [rad]; parameter c [1], d [1/s]; constant g = 9.81 [m/s^2];
    ddot(x) + d*dot(x) = c*g*sin(a); }"""
    rate = lambda s, u: [s[1], 5 / 7 * GRAVITY * np.sin(u[0]) - 0.3 * s[1]]
    t = even(1200, 0.02)
    want = lambda t: 0.08 * np.sign(np.sin(2 * np.pi * 0.12 * t))
    s, u = play(rate, [0, 0], t, lambda t, s: np.clip(2.0 * (want(t) - s[0]) - 1.0 * s[1], -0.3, 0.3))
    return text, dict(c=5 / 7, d=0.3), table("t_s,x,a", t, s[:, 0] + 1e-3 * rng.normal(size=len(t)), u[:, 0]), ["--hold", "zoh"]


def shield_heater(rng):
    """A heated block, of which the temperature is read to a quarter of a kelvin every second."""
    text = "model Heater { coordinate T [K]; input p [1]; parameter a [s/K], b [1/K]; a*dot(T) + b*T = p; }"
    rate = lambda s, u: [(u[0] - 0.02 * s[0]) / 2.4]
    t = even(2400, 1.0)
    s, u = play(rate, [0.0], t, jumps(rng, 150.0, 0.0, 1.0), 2)
    reading = np.round((s[:, 0] + 0.15 * rng.normal(size=len(t))) / 0.25) * 0.25
    return text, dict(a=2.4, b=0.02), table("t_s,T,p", t, reading, u[:, 0]), ["--hold", "zoh"]


def bench_tanks(rng):
    """Two tanks, the lower level measured."""
    text = """model Tanks { coordinate h2 [1]; unmeasured h1 [1]; input u [1/s]; parameter a1 [1/s], a2 [1/s];
    dot(h1) + a1*sqrt(h1) = u;
    dot(h2) - a1*sqrt(h1) + a2*sqrt(h2) = 0; }"""
    rate = lambda s, u: [u[0] - 0.05 * np.sqrt(abs(s[0])), 0.05 * np.sqrt(abs(s[0])) - 0.04 * np.sqrt(abs(s[1]))]
    t = even(600, 1.0)
    s, u = play(rate, [3.0, 2.0], t, jumps(rng, 40.0, 0.045, 0.1), 4)
    return text, dict(a1=0.05, a2=0.04), table("t_s,h2,u", t, s[:, 1] + 5e-3 * rng.normal(size=len(t)), u[:, 0]), ["--hold", "zoh"]


def bench_axis(rng):
    """A linear axis with dry friction in a loop, that repeats a sum of sines."""
    text = """model Axis { coordinate x [m]; input f [N]; parameter m [kg], d [N*s/m], c [N];
    m*ddot(x) + d*dot(x) + c*sign(dot(x)) = f; }"""
    rate = lambda s, u: [s[1], (u[0] - 200 * s[1] - 20 * sign(s[1])) / 95]
    t = even(8000, 1e-3)
    want = lambda t: 0.1 * np.sin(2 * np.pi * 0.5 * t) + 0.03 * np.sin(2 * np.pi * 1.5 * t)
    s, u = play(rate, [0, 0], t, lambda t, s: 4e4 * (want(t) - s[0]) - 2500 * s[1], 4)
    return text, dict(m=95.0, d=200.0, c=20.0), table("t_s,x,f", t, s[:, 0] + 1e-6 * rng.normal(size=len(t)), u[:, 0]), ["--hold", "zoh"]


def bench_friction_map(rng):
    """A friction test: torque over steady speeds."""
    text = "model Map { coordinate w [rad/s]; input u [N*m]; parameter b [N*m*s/rad], c [N*m]; b*w + c*sign(w) = u; }"
    w = np.concatenate([np.linspace(-20, -2, 20), np.linspace(2, 20, 20)])
    u = 0.4 * w + 3.0 * np.sign(w) + 0.05 * rng.normal(size=40)
    return text, dict(b=0.4, c=3.0), table("t_s,w,u", even(40, 1.0), w, u), []


PENDULUM = """model Pendulum {{ coordinate q [rad]; {0}parameter J [kg*m^2], d [N*m*s/rad], c [N*m]; constant mgl = 0.15 [N*m];
J*ddot(q) + d*dot(q) + c*sign(dot(q)) + mgl*sin(q) = {1}; }}"""


def swing_free(rng):
    """A pendulum that is let go, with its weight known."""
    rate = lambda s, u: [s[1], (-2e-4 * s[1] - 8e-4 * sign(s[1]) - 0.15 * np.sin(s[0])) / 2e-3]
    t = even(1000, 0.01)
    s, _ = play(rate, [2.0, 0], t, lambda t, s: 0.0)
    return PENDULUM.format("", "0"), dict(J=2e-3, d=2e-4, c=8e-4), table("t_s,q", t, s[:, 0] + 1e-3 * rng.normal(size=len(t))), []


def swing_wrapped(rng):
    """A driven pendulum that turns over, with an angle between -pi and pi."""
    rate = lambda s, u: [s[1], (u[0] - 4e-3 * s[1] - 0.02 * sign(s[1]) - 0.15 * np.sin(s[0])) / 2e-3]
    t = even(2000, 0.005)
    s, u = play(rate, [0, 0], t, jumps(rng, 0.5, -0.4, 0.4))
    angle = (s[:, 0] + 1e-3 * rng.normal(size=len(t)) + np.pi) % (2 * np.pi) - np.pi
    return PENDULUM.format("input u [N*m]; ", "u"), dict(J=2e-3, d=4e-3, c=0.02), table("t_s,q,u", t, angle, u[:, 0]), ["--hold", "zoh"]


TWINS = [motor_bang_bang, motor_short_chirp, motor_late_drive, motor_electrical, robot_drive_json, robot_drive_topics, robot_drive_console,
         robot_drive_dates, robot_drive_no_time, robot_two_links, robot_flexible_joint, shield_propeller, shield_levitation, shield_ball_beam,
         shield_heater, bench_tanks, bench_axis, bench_friction_map, swing_free, swing_wrapped]


def main(tpm, *wanted):
    folder = Path(tempfile.mkdtemp())
    served = tried = 0
    for twin in TWINS:
        if wanted and twin.__name__ not in wanted:
            continue
        text, truth, content, flags, *ending = twin(np.random.default_rng(51))
        model, log = folder / "machine.tpm", folder / f"log.{ending[0] if ending else 'csv'}"
        model.write_text(text)
        log.write_text(content)
        begun = time.perf_counter()
        run = subprocess.run([tpm, "identify", model, "--log", log, "--json", *flags], capture_output=True, text=True)
        seconds = time.perf_counter() - begun
        tried += 1
        said = " | ".join(line for line in run.stderr.strip().splitlines() if not line.startswith("remark"))[:300]
        if not run.stdout:
            print(f"{twin.__name__:22} refused in {seconds:.1f} s: {said}", flush=True)
            continue
        found = {own["name"]: own for own in json.loads(run.stdout)["parameters"]}
        parts, right = [], run.returncode == 0
        for name, true in truth.items():
            value, deviation = found[name].get("value"), found[name].get("std")
            if value is None or deviation is None:
                right = False
                parts.append(f"{name} not identified")
                continue
            off, share = (value - true) / deviation if deviation else np.inf, value / true - 1
            right &= abs(off) < 3 or abs(share) < 0.02
            parts.append(f"{name} {100 * share:+.2f} % ({off:+.1f})")
        served += right
        word = "served" if right else "wrong" if run.returncode == 0 else "not served"
        print(f"{twin.__name__:22} {word} in {seconds:.1f} s, exit code {run.returncode}: {', '.join(parts)}; {said}", flush=True)
    print(f"{served} of {tried} served")


if __name__ == "__main__":
    main(*sys.argv[1:])

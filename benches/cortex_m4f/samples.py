"""What one model's program on the target needs, as a C header: patterns of the runs, constants, a guess, the true parameters
and how well they must be found, and one period of the forces that the true machine needs on each pattern.

Usage: samples.py mass_spring_drag|two_carts|closed_loop_arm [--rust]
"""
import sys
from math import cos, pi, radians, sin

SAMPLES = 1000


def series(amplitudes, order, phase, w):
    """A cosine series and its derivatives up to `order`."""
    turn = [lambda x: cos(x), lambda x: -sin(x), lambda x: -cos(x), lambda x: sin(x)]
    return [sum(a * (k * w) ** n * turn[n % 4](k * phase) for k, a in amplitudes.items()) for n in range(order + 1)]


def mass_spring_drag():
    """Feng, Eqn 3.24, with the parameters of the tests."""
    m, k1, k2 = 2.0, 40.0, 1.5

    def force(pattern, phase):
        amplitude, w = pattern
        x, v, a = series({1: amplitude, 3: -amplitude / 9}, 2, phase, w)
        return [m * a + k1 * x + k2 * v * v]

    return dict(patterns=[[0.3, 3.0]], constants=[], truth=[m, k1, k2], tolerance=1e-4, physical=[], force=force, direct=True)


def two_carts():
    """Feng, Eqns 4.30 to 4.34. The columns' condition number is 2e4, which is what single precision is multiplied by."""
    m1, m2, k1, k2, k3 = physical = [2.0, 1.0, 40.0, 300.0, 200.0]
    c = [m1 * m2 / k3, m1 + m2 + m2 * k1 / k3, 3 * m2 * k2 / k3, 3 * m2**2 * k2 / k3**2, m2**3 * k2 / k3**3, k1, k2]

    def force(pattern, phase):
        amplitude, w = pattern
        x, _, a, _, s = series({1: amplitude, 3: -amplitude / 6, 5: amplitude / 50}, 4, phase, w)
        return [c[0] * s + c[1] * a + c[2] * a * x * x + c[3] * x * a * a + c[4] * a**3 + c[5] * x + c[6] * x**3]

    return dict(patterns=[[0.4, 4.0]], constants=[], truth=c, tolerance=5e-3, physical=physical, names=["m1", "m2", "k1", "k2", "k3"], force=force, direct=True)


def closed_loop_arm():
    """Feng, Eqns 5.1 to 5.7, rig 1. One pattern shows six directions of nine; a second run, with the second joint the other way
    round, shows the rest."""
    a1, a2 = [2375.0, 891.0, 149.0], [209.0, 171.0, -225.0]
    a3, th20 = [-965.0, -807.0, 337.0], 5.42161682

    def force(pattern, phase):
        first, second, w = pattern
        _, d1, dd1 = series({0: -8 / 9 * first, 1: first, 3: -first / 9}, 2, phase, w)
        s, d2, dd2 = series({0: -8 / 9 * second, 1: second, 3: -second / 9}, 2, phase, w)
        value = lambda a: a[0] + a[1] * s + a[2] * s * s
        slope = lambda a: a[1] + 2 * a[2] * s
        return [
            2 * value(a1) * dd1 + value(a3) * dd2 + 2 * slope(a1) * d1 * d2 + slope(a3) * d2 * d2,
            value(a3) * dd1 + 2 * value(a2) * dd2 - slope(a1) * d1 * d1 + slope(a2) * d2 * d2,
        ]

    first, second = radians(-14.06), radians(11.43)
    patterns = [[first, second, 2.0], [first, -second, 2.0]]
    return dict(patterns=patterns, constants=[0.0, th20], truth=a1 + a2 + a3, tolerance=1e-3, physical=[], force=force, direct=False)


def of_model(model):
    """What programs call by one name, whether the model has constants, a direct solution and physical parameters or not."""
    constants = "&Constants::from_array(super::CONSTANTS), " if model["constants"] else ""
    last = constants.rstrip(" ,")
    columns, physical = len(model["truth"]), len(model["physical"])
    names = ", ".join(f'"{name}"' for name in model.get("names", []))
    direct = f"Some(pattern.parameters_direct({constants}effort).into_array())" if model["direct"] else "{ let _ = (pattern, effort); None }"
    unlump = "Parameters::from_array(found).unlump().into_array()" if physical else "{ let _ = found; [] }"
    return f"""
pub mod of_model {{
    #[allow(unused_imports, reason = "not every model has constants")]
    use crate::estimator::*;
    pub const DIRECT: bool = {str(model["direct"]).lower()};
    pub const PHYSICAL_NAMES: [&str; {physical}] = [{names}];
    pub fn reference_at(pattern: &Pattern<f32>, phase: f32) -> Motion<f32> {{
        pattern.reference_at({constants}phase)
    }}
    pub fn feed_forward(motion: &Motion<f32>, parameters: &Parameters<f32>) -> Inputs<f32> {{
        crate::estimator::feed_forward(motion, parameters, {last})
    }}
    pub fn estimator_matrix(pattern: &Pattern<f32>) -> [[f32; {columns}]; HARMONICS] {{
        pattern.estimator_matrix({last})
    }}
    pub fn direct(pattern: &Pattern<f32>, effort: &Harmonics<f32>) -> Option<[f32; {columns}]> {{
        {direct}
    }}
    pub fn unlump(found: [f32; {columns}]) -> [f32; {physical}] {{
        {unlump}
    }}
}}"""


def main():
    model = {f.__name__: f for f in (mass_spring_drag, two_carts, closed_loop_arm)}[sys.argv[1]]()
    rust = "--rust" in sys.argv
    tables = [[model["force"](p, 2 * pi * i / SAMPLES) for i in range(SAMPLES)] for p in model["patterns"]]
    guess = [0.75 * value for value in model["truth"]]
    # What rounding leaves of zero is below single precision.
    numbers = lambda list, end: ", ".join(f"{0.0 if abs(value) < 1e-30 else float(value)!r}{end}" for value in list)
    if rust:
        row = lambda list: f"[{numbers(list, '')}]"
        for name, value in [("SAMPLES", SAMPLES), ("RUNS", len(tables))]:
            print(f"pub const {name}: usize = {value};")
        print(f"pub const TOLERANCE: f32 = {model['tolerance']!r};")
        for name in ("truth", "physical", "constants"):
            print(f"pub const {name.upper()}: [f32; {len(model[name])}] = {row(model[name])};")
        print(f"pub const GUESS: [f32; {len(guess)}] = {row(guess)};")
        width = len(model["patterns"][0])
        print(f"pub const PATTERNS: [[f32; {width}]; RUNS] = [{', '.join(map(row, model['patterns']))}];")
        print(f"pub static FORCES: [[[f32; {len(tables[0][0])}]; SAMPLES]; RUNS] = [")
        for table in tables:
            print("    [" + ",\n     ".join(map(row, table)) + "],")
        print("];")
        print(of_model(model))
        return
    row = lambda list: f"{{{numbers(list, 'f')}}}"
    print(f"#define SAMPLES {SAMPLES}")
    print(f"#define RUNS {len(tables)}")
    print(f"#define TOLERANCE {model['tolerance']!r}f")
    print(f"static const estimator_pattern patterns[RUNS] = {{{', '.join(map(row, model['patterns']))}}};")
    print(f"static const float truth[] = {row(model['truth'])};")
    print(f"static const estimator_parameters guess = {row(guess)};")
    if model["constants"]:
        print(f"static const estimator_constants constants = {row(model['constants'])};")
        print("#define CONSTANTS , &constants")
    else:
        print("#define CONSTANTS")
    if model["physical"]:
        print(f"static const float physical_truth[] = {row(model['physical'])};")
        print("static const char *const physical_names[] = {" + ", ".join(f'"{name}"' for name in model["names"]) + "};")
        print("#define LUMPED")
    if model["direct"]:
        print("#define DIRECT")
    print("static const estimator_forces samples[RUNS][SAMPLES] = {")
    for table in tables:
        print("    {" + ",\n     ".join(map(row, table)) + "},")
    print("};")


main()

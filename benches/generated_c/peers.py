"""Feng's Eqns 5.1, 5.2 with second-order series as C, by SymPy (cse) and by CasADi: inputs and 2 x 9 regressor.

Usage: peers.py FOLDER. Writes sympy_arm.c and, when CasADi is there, casadi_arm.c.
"""

import sys
from pathlib import Path


def rows(th2, th20, d1, d2, dd1, dd2):
    """The regressor, row by row, as anybody would write it down."""
    s = th2 - th20
    f = [1, s, s**2]
    df = [0, 1, 2 * s]
    first = [2 * f[k] * dd1 + 2 * df[k] * d1 * d2 for k in range(3)]
    first += [0, 0, 0]
    first += [f[k] * dd2 + df[k] * d2**2 for k in range(3)]
    second = [-df[k] * d1**2 for k in range(3)]
    second += [2 * f[k] * dd2 + df[k] * d2**2 for k in range(3)]
    second += [f[k] * dd1 for k in range(3)]
    return first, second


def with_sympy(folder):
    import sympy as sp

    motion = sp.symbols("th1 th2 d1 d2 dd1 dd2")
    theta = sp.symbols("a:9")
    constants = sp.symbols("th10 th20")
    first, second = rows(motion[1], constants[1], *motion[2:])
    phi = [sp.sympify(entry) for entry in first + second]
    tau = [sum(p * a for p, a in zip(row, theta)) for row in (first, second)]
    shared, results = sp.cse(tau + phi, optimizations="basic")
    lines = ["#include <math.h>", '#include "peers.h"', "", "void sympy_arm(const double *motion, const double *theta,",
             "               const double *constants, double *tau, double *phi)", "{"]
    used = set().union(*(value.free_symbols for _, value in shared), *(value.free_symbols for value in results))
    for name, symbols in (("motion", motion), ("theta", theta), ("constants", constants)):
        lines += [f"    const double {s} = {name}[{i}];" for i, s in enumerate(symbols) if s in used]
    # Small powers as products, which is what its own option gives.
    from sympy.printing.c import C99CodePrinter

    class Printer(C99CodePrinter):
        def _print_Pow(self, expr):
            if expr.exp == 2:
                base = self.parenthesize(expr.base, 1000)
                return f"({base}*{base})"
            return super()._print_Pow(expr)

    code = Printer().doprint
    lines += [f"    const double {symbol} = {code(value)};" for symbol, value in shared]
    targets = [f"tau[{i}]" for i in range(2)] + [f"phi[{i}]" for i in range(18)]
    lines += [f"    {target} = {code(value)};" for target, value in zip(targets, results)]
    lines.append("}")
    (folder / "sympy_arm.c").write_text("\n".join(lines) + "\n")
    print(f"SymPy {sp.__version__}", file=sys.stderr)


def with_casadi(folder):
    import casadi as ca

    motion, theta, constants = ca.SX.sym("motion", 6), ca.SX.sym("theta", 9), ca.SX.sym("constants", 2)
    first, second = rows(motion[1], constants[1], *(motion[i] for i in range(2, 6)))
    phi = ca.vertcat(*first, *second)
    tau = ca.vertcat(*(sum(row[i] * theta[i] for i in range(9)) for row in (first, second)))
    arm = ca.Function("casadi_arm", [motion, theta, constants], [ca.densify(tau), ca.densify(phi)], {"cse": True})
    generator = ca.CodeGenerator("casadi_arm.c", {"with_header": False})
    generator.add(arm)
    generator.generate(str(folder) + "/")
    print(f"CasADi {ca.__version__}", file=sys.stderr)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    with_sympy(folder)
    with_casadi(folder)

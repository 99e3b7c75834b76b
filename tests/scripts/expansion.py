#!/usr/bin/env python3
"""Exact tables of random models with large exponents, against python-flint.

    tests/scripts/expansion.py TPM [MODELS [FIRST_SEED]]

TPM is the program to test, best of a build that checks overflows. Needs python-flint (`pip install python-flint`).

The twin knows nothing of tables: with z = exp(i w t), a sum of cosines is x = l X(z) and its rate dot(x) = i l w Y(z), where X and Y are
polynomials in z and 1/z over the rationals. A term is a product of powers of these and of the amplitude l, and FLINT multiplies it out.
"""

import json
import pathlib
import random
import subprocess
import sys
import tempfile

from flint import fmpq, fmpq_poly


def rational(text):
    numerator, _, denominator = text.partition("/")
    return fmpq(int(numerator), int(denominator or 1))


class Laurent:
    """Powers of the amplitude over polynomials in z, which are shifted by `shift`; to be multiplied by (i w)^rates."""

    def __init__(self, parts, shift, rates=0):
        self.parts, self.shift, self.rates = parts, shift, rates

    def __mul__(self, other):
        parts = {}
        for a, p in self.parts.items():
            for b, q in other.parts.items():
                parts[a + b] = parts.get(a + b, fmpq_poly()) + p * q
        return Laurent(parts, self.shift + other.shift, self.rates + other.rates)

    def power(self, exponent):
        result = Laurent({0: fmpq_poly([1])}, 0)
        for _ in range(exponent):
            result = result * self
        return result


def small(choice):
    return f"{choice.randint(1, 40)}/{choice.randint(1, 30)}"


def case(choice):
    """A model's text, and the entries of its table by (harmonic, function, parameter, powers)."""
    highest = choice.randint(1, 4)
    harmonics = {k: small(choice) for k in sorted(choice.sample(range(1, 6), highest))}
    top = max(harmonics)
    motion, rate = [fmpq(0)] * (2 * top + 1), [fmpq(0)] * (2 * top + 1)
    for k, text in harmonics.items():
        half = rational(text) / 2
        motion[top + k] += half
        motion[top - k] += half
        # d/dt of cos(k w t) is i k w (z^k - z^-k)/2.
        rate[top + k] += k * half
        rate[top - k] -= k * half
    x, dot = Laurent({1: fmpq_poly(motion)}, top), Laurent({1: fmpq_poly(rate)}, top, 1)

    terms, expected, seen = [], {}, set()
    for j in range(choice.randint(1, 3)):
        size = choice.choice([3, 6, 12, 24, 40])
        offset, n = small(choice), choice.randint(0, size)
        a, b = choice.randint(0, size // 2), choice.randint(0, size // 2)
        # Parameters of proportional terms are lumped: no two terms have the same powers.
        while n + a + b == 0 or (a, b) in seen:
            a += 1
        seen.add((a, b))
        monomial = fmpq_poly([0] * top + [rational(offset)])
        factor = Laurent({1: x.parts[1], 0: monomial}, top)
        product = x.power(a) * dot.power(b) * factor.power(n)
        name = f"p{j}"
        terms.append(f"{name}*x^{a}*dot(x)^{b}*(x + {offset})^{n}")
        for amplitude, polynomial in product.parts.items():
            # i^b times a polynomial that is even or odd under z -> 1/z, as b is.
            sign = [1, 1, -1, -1][b % 4]
            for k in range(0, polynomial.degree() - product.shift + 1):
                value = polynomial[product.shift + k]
                if b % 2 == 0:
                    coefficient, function = sign * value * (1 if k == 0 else 2), "cos"
                else:
                    # i (v z^k - v z^-k) = -2 v sin(k w t)
                    coefficient, function = -sign * value * 2, "sin"
                if coefficient != 0 and not (k == 0 and function == "sin"):
                    powers = tuple(sorted(p for p in [("l", amplitude), ("w", b)] if p[1]))
                    expected[(k, function, name, powers)] = coefficient
    names = ", ".join(f"p{j}" for j in range(len(terms)))
    series = " + ".join(f"{text}*cos({k}*w*t)" for k, text in harmonics.items())
    text = (
        f"model A {{ coordinate x; input u; parameter {names};\n{' + '.join(terms)} = u;\n"
        f"pattern {{ amplitude l; frequency w; x = l*({series}); }} }}\n"
    )
    return text, expected


def main():
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    tpm = str(pathlib.Path(sys.argv[1]).resolve())
    count, first = (int(text) for text in (sys.argv[2:] + ["100", "1"][len(sys.argv) - 2 :]))
    entries, digits, largest, refused = 0, 0, 0, 0
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder, "model.tpm")
        for seed in range(first, first + count):
            text, expected = case(random.Random(seed))
            path.write_text(text)
            run = subprocess.run([tpm, "expand", str(path), "--format", "json"], capture_output=True, text=True)
            if run.returncode == 2 and "--allow-large" in run.stderr:
                refused += 1
                continue
            if run.returncode != 0:
                sys.exit(f"seed {seed}: {run.stderr}\n{text}")
            found = {}
            for entry in json.loads(run.stdout)["entries"]:
                powers = tuple(sorted(entry["powers"].items()))
                key = (entry["harmonic"], entry["function"], entry["parameter"], powers)
                assert entry["pi"] == 0 and key not in found, (seed, entry)
                found[key] = rational(entry["coefficient"])
                digits = max(digits, len(entry["coefficient"]))
            if found != expected:
                wrong = [key for key in {**found, **expected} if found.get(key) != expected.get(key)]
                at = wrong[0]
                sys.exit(f"seed {seed}: {len(wrong)} entries differ, {at}: {found.get(at)}, FLINT: {expected.get(at)}\n{text}")
            entries, largest = entries + len(found), max(largest, len(found))
    print(
        f"{count - refused} models from seed {first}, {refused} too large: {entries} coefficients are equal, at most {largest} in a model "
        f"and {digits} characters long"
    )


if __name__ == "__main__":
    main()

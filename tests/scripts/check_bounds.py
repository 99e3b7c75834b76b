#!/usr/bin/env python3
"""Checks the bounds of rounding beside emitted C: derives them again from the C alone, and refuses those that are smaller.

    tests/scripts/check_bounds.py FILE.c FILE.bounds.json

Of the JSON document only the ranges, the parts into which they are cut, the precision, the assumed errors of functions and the bounds are read. Exit code 1 where a bound is
smaller than what is derived here, a result has none, or there is one for something that the code does not have. Python 3.9 or later, nothing
else. The derivation is that of `tpm-codegen/src/emit/rounding/tape.rs`, written again from its description.
"""

import itertools
import json
import math
import re
import sys
from functools import lru_cache

sys.setrecursionlimit(100_000)
MOST_TERMS, MOST_FACTORS, SLACK = 16, 4, 128.0
INF = math.inf
FUNCTIONS = {"sin", "cos", "tan", "asin", "acos", "atan", "sqrt", "tanh", "exp", "log", "fabs", "sign_of", "atan2"}
TOKEN = re.compile(r"\s*(?:(\d+\.?\d*(?:[eE][-+]?\d+)?)f?|([A-Za-z_]\w*(?:(?:->|\.)\w+|\[\d+\])*)|(\S))")


class Refused(Exception):
    pass


def up(x):
    return math.nextafter(x, INF)


def down(x):
    return math.nextafter(x, -INF)


def size(v):
    return max(v[1], -v[0])


def holds_zero(v):
    return v[0] <= 0.0 <= v[1]


def add(a, b):
    return down(a[0] + b[0]), up(a[1] + b[1])


def neg(a):
    return -a[1], -a[0]


def mul(a, b):
    ends = [x * y for x in a for y in b]
    return down(min(ends)), up(max(ends))


def wave(f, crest, v):
    if v[1] - v[0] >= 2 * math.pi or size(v) > 1e6:
        return -1.0, 1.0
    ends = f(v[0]), f(v[1])
    low, high = min(ends) - 1e-15, max(ends) + 1e-15
    for k in range(math.ceil((v[0] - crest - 1e-9) / math.pi), math.floor((v[1] - crest + 1e-9) / math.pi) + 1):
        low, high = (low, 1.0) if k % 2 == 0 else (-1.0, high)
    return max(low, -1.0), min(high, 1.0)


def increasing(f, v, least=-INF, greatest=INF):
    low, high = f(v[0]), f(v[1])
    for _ in range(4):
        low, high = down(low), up(high)
    return max(low, least), min(high, greatest)


def apply(name, v):
    half = up(math.pi / 2)
    if name in ("asin", "acos") and size(v) > 1 or name == "sqrt" and v[0] < 0 or name == "log" and v[0] <= 0:
        raise Refused(f"{name} of {v}")
    if name == "tan" and holds_zero(wave(math.cos, 0.0, v)):
        raise Refused(f"tan of {v}")
    return {
        "cos": lambda: wave(math.cos, 0.0, v),
        "sin": lambda: wave(math.sin, math.pi / 2, v),
        "tan": lambda: increasing(math.tan, v),
        "asin": lambda: increasing(math.asin, v, -half, half),
        "acos": lambda: increasing(lambda x: math.acos(-x), neg(v), 0.0, up(math.pi)),
        "atan": lambda: increasing(math.atan, v, -half, half),
        "sqrt": lambda: increasing(math.sqrt, v, 0.0),
        "tanh": lambda: increasing(math.tanh, v, -1.0, 1.0),
        "exp": lambda: increasing(math.exp, v, 0.0),
        "log": lambda: increasing(math.log, v),
        "fabs": lambda: (0.0, size(v)) if holds_zero(v) else v if v[0] > 0 else neg(v),
        "sign_of": lambda: (-1.0, 1.0) if holds_zero(v) else (math.copysign(1.0, v[0]),) * 2,
    }[name]()


class Tape:
    """Steps with intervals that hold their values, exact and rounded."""

    def __init__(self, precision, ulps, ranges):
        self.unit, self.tiny, self.max = precision["unit"], precision["tiny"], precision["max"]
        self.ulps, self.ranges = ulps, ranges
        self.steps, self.values, self.known = [], [], {}
        self.turn, self.length = lru_cache(None)(self._turn), lru_cache(None)(self._length)

    def push(self, *step):
        if step[0] in "+*":
            step = step[0], min(step[1:]), max(step[1:])
        if step in self.known:
            return self.known[step]
        kind = step[0]
        at = [] if kind in ("leaf", "number") else [self.values[i] for i in step[1:]]
        if kind == "leaf":
            if step[1] not in self.ranges:
                raise Refused(f"{step[1]} has no range")
            value = tuple(self.ranges[step[1]])
        elif kind == "number":
            value = step[1], step[1]
        elif kind == "+":
            value = add(*at)
        elif kind == "-":
            value = add(at[0], neg(at[1]))
        elif kind == "*" and step[1] == step[2]:
            least = 0.0 if holds_zero(at[0]) else min(abs(at[0][0]), abs(at[0][1]))
            value = max(0.0, down(least * least)), up(size(at[0]) ** 2)
        elif kind == "*":
            value = mul(*at)
        elif kind == "/":
            if holds_zero(at[1]):
                raise Refused(f"a divisor has the range {at[1]}")
            value = mul(at[0], (down(1 / at[1][1]), up(1 / at[1][0])))
        elif kind == "neg":
            value = neg(at[0])
        elif kind == "atan2":
            if holds_zero(at[0]) and at[1][0] <= 0:
                raise Refused("atan2 at its cut")
            ends = [math.atan2(y, x) for y in at[0] for x in at[1]]
            value = down(min(ends)) - 1e-15, up(max(ends)) + 1e-15
        else:
            value = apply(kind, at[0])
        e = self.rounding(step, value)
        index = len(self.steps)
        self.steps.append(step)
        self.values.append((down(value[0] - e), up(value[1] + e)) if e > 0 else value)
        self.known[step] = index
        if kind in "+-":
            self.tighten(index)
        if size(self.values[index]) > self.max:
            raise Refused("a number is beyond the largest one")
        return index

    def number(self, value):
        return self.push("number", value, False)

    def rounding(self, step, value):
        kind = step[0]
        half_ulp = lambda s: 0.0 if s == 0 else self.unit * math.ldexp(0.5, math.frexp(s)[1])
        if kind in ("leaf", "neg", "fabs") or kind == "number" and not step[2]:
            return 0.0
        if kind == "sign_of":
            return 0.0 if self.sign_is_exact(step[1]) or not holds_zero(self.values[step[1]]) else 2.0
        if kind in ("sin", "cos"):
            return 2 * self.ulps[kind] * half_ulp(min(size(value), down(1.0))) + self.tiny
        if kind in FUNCTIONS:
            return 2 * self.ulps[kind] * half_ulp(size(value)) + self.tiny
        power = lambda i: self.steps[i][0] == "number" and abs(math.frexp(self.steps[i][1])[0]) == 0.5
        if kind == "*" and (power(step[1]) or power(step[2])):
            return self.tiny
        return half_ulp(size(value)) + self.tiny

    def sign_is_exact(self, index):
        read = lambda i: self.steps[i][0] == "leaf" or self.steps[i][0] == "number" and not self.steps[i][2]
        step = self.steps[index]
        return all(map(read, step[1:])) if step[0] in "+-" or step[0] == "neg" else read(index)

    def terms(self, index, sign, terms):
        step = self.steps[index]
        if step[0] in "+-" and len(terms) + 1 < MOST_TERMS:
            self.terms(step[1], sign, terms)
            self.terms(step[2], sign if step[0] == "+" else -sign, terms)
        elif step[0] == "neg":
            self.terms(step[1], -sign, terms)
        else:
            own, factors = self.factors(index)
            terms.append((sign * own, factors))
        return terms

    def factors(self, index):
        step = self.steps[index]
        if step[0] == "neg":
            sign, factors = self.factors(step[1])
            return -sign, factors
        if step[0] == "*":
            (s, a), (t, b) = self.factors(step[1]), self.factors(step[2])
            return (s * t, a + b) if len(a + b) <= MOST_FACTORS else (1, (index,))
        return 1, (index,)

    def turning(self, factors):
        for place, factor in enumerate(factors):
            kind, *angle = self.steps[factor]
            if kind in ("sin", "cos"):
                yield angle[0], kind, factors[:place] + factors[place + 1 :]

    def product(self, factors):
        if not factors:
            return self.number(1.0)
        product = factors[0]
        for factor in factors[1:]:
            product = self.push("*", product, factor)
        return product

    def plus(self, total, term):
        if total is None:
            return term
        (s, a), (t, b) = total, term
        if s == t:
            return s, self.push("+", a, b)
        return 1, self.push("-", a, b) if s > 0 else self.push("-", b, a)

    def sum(self, terms):
        total = None
        for sign, factors in terms:
            total = self.plus(total, (sign, self.product(factors)))
        return total

    def _turn(self, index):
        if self.steps[index][0] not in "+-":
            return []
        terms, ways = self.terms(index, 1, []), []
        for angle in sorted({angle for _, factors in terms for angle, _, _ in self.turning(factors)}):
            parts = {"cos": [], "sin": [], "": []}
            for sign, factors in terms:
                found = next(((k, o) for a, k, o in self.turning(factors) if a == angle), ("", factors))
                parts[found[0]].append((sign, found[1]))
            if parts["cos"] and parts["sin"]:
                ways.append((angle, self.sum(parts["cos"]), self.sum(parts["sin"]), self.sum(parts[""])))
        return ways

    def size(self, signed):
        return 0.0 if signed is None else size(self.values[signed[1]])

    def tighten(self, index):
        ways = self.turn(index)
        if not ways:
            return
        slack = self.slack(index)
        for _, x, y, rest in ways:
            most = (self.length(x[1], y[1]) + self.size(rest)) * (1 + SLACK * self.unit) + slack
            low, high = self.values[index]
            self.values[index] = max(low, -up(most)), min(high, up(most))

    def slack(self, index):
        slack = 0.0
        for _, factors in self.terms(index, 1, []):
            sizes = [size(self.values[f]) for f in factors]
            slack += self.unit * math.prod(sizes) + self.tiny * math.prod(max(s, 1.0) for s in sizes)
        return SLACK * slack

    def _length(self, x, y):
        if x > y:
            return self.length(y, x)
        at = lambda i: size(self.values[i])
        hypot = lambda a, b: math.sqrt(a * a + b * b) * (1 + 1e-15)
        length = hypot(at(x), at(y))
        near, slack = 1 + SLACK * self.unit, self.slack(x) + self.slack(y)
        for angle, p, q, r in self.turn(x):
            for other, s, t, v in self.turn(y):
                if angle == other and p[1] == t[1] and q[1] == s[1] and p[0] * t[0] * q[0] * s[0] < 0:
                    length = min(length, (self.length(p[1], q[1]) + hypot(self.size(r), self.size(v))) * near + slack)
        (_, a), (_, b) = self.factors(x), self.factors(y)
        if len(a) > 1 and len(b) > 1:
            for place, factor in enumerate(a):
                if factor in b:
                    other = b.index(factor)
                    rest, others = self.product(a[:place] + a[place + 1 :]), self.product(b[:other] + b[other + 1 :])
                    length = min(length, at(factor) * hypot(at(rest), at(others)) * near + slack)
        for angle, kind, rest in self.turning(a):
            for other, own, others in self.turning(b):
                if angle == other and kind != own:
                    length = min(length, max(at(self.product(rest)), at(self.product(others))) * near + slack)
        return length

    def derivatives(self, index):
        kind, *of = self.steps[index]
        push, one = self.push, self.number(1.0)
        over = lambda step: push("/", one, step)
        if kind in ("leaf", "number", "sign_of"):
            return []
        if kind in "+-":
            return [(of[0], 1, None), (of[1], 1 if kind == "+" else -1, None)]
        if kind == "neg":
            return [(of[0], -1, None)]
        if kind == "*":
            return [(of[0], 1, of[1]), (of[1], 1, of[0])]
        if kind == "/":
            inverse = over(of[1])
            return [(of[0], 1, inverse), (of[1], -1, push("*", inverse, index))]
        if kind == "atan2":
            square = push("+", push("*", of[0], of[0]), push("*", of[1], of[1]))
            return [(of[0], 1, push("/", of[1], square)), (of[1], -1, push("/", of[0], square))]
        a = of[0]
        square = lambda i: push("*", i, i)
        root = lambda: over(push("sqrt", push("-", one, square(a))))
        sign, factor = {
            "sin": lambda: (1, push("cos", a)),
            "cos": lambda: (-1, push("sin", a)),
            "tan": lambda: (1, push("+", one, square(index))),
            "tanh": lambda: (1, push("-", one, square(index))),
            "asin": lambda: (1, root()),
            "acos": lambda: (-1, root()),
            "atan": lambda: (1, over(push("+", one, square(a)))),
            "sqrt": lambda: (1, over(push("+", index, index))),
            "exp": lambda: (1, index),
            "log": lambda: (1, over(a)),
            "fabs": lambda: (1, push("sign_of", a)),
        }[kind]()
        return [(a, sign, factor)]

    def bound(self, result):
        one = self.number(1.0)
        slopes, angles, total = {result: [(1, one)]}, {}, 0.0
        for step in range(result, -1, -1):
            slope = None
            for term in slopes.pop(step, []):
                slope = self.plus(slope, term)
            if slope is None:
                continue
            sign, slope = slope
            e = self.rounding(self.steps[step], self.values[step])
            if self.steps[step][0] in ("sin", "cos") and size(self.values[slope]) > 0:
                angles.setdefault(self.steps[step][1], []).append((slope, e))
            else:
                total = up(total + up(e * size(self.values[slope]))) if e else total
            for operand, own, factor in self.derivatives(step):
                moved = slope if factor is None else factor if slope == one else self.push("*", slope, factor)
                slopes.setdefault(operand, []).append((sign * own, moved))
        for own in angles.values():
            share = sum(e * size(self.values[slope]) for slope, e in own)
            if len(own) == 2:
                share = min(share, math.sqrt(2) * max(own[0][1], own[1][1]) * self.length(own[0][0], own[1][0]))
            total = up(total + share * (1 + 1e-15))
        return total


class Reader:
    """Expressions of C as steps."""

    def __init__(self, tape):
        self.tape, self.named = tape, {}

    def read(self, text):
        self.tokens = [m.groups() for m in TOKEN.finditer(text)]
        step = self.sum()
        if self.tokens:
            raise Refused(f"`{text}` is no expression of straight-line code")
        return step

    def next_is(self, *signs):
        return bool(self.tokens) and self.tokens[0][2] in signs and self.tokens.pop(0)[2]

    def sum(self):
        a = self.product()
        while sign := self.next_is("+", "-"):
            a = self.tape.push(sign, a, self.product())
        return a

    def product(self):
        a = self.atom()
        while sign := self.next_is("*", "/"):
            a = self.tape.push(sign, a, self.atom())
        return a

    def literal(self, text):
        value = float(text)
        if self.tape.max < 1e40:
            import struct

            value = struct.unpack("f", struct.pack("f", value))[0]
        exact = (value * 1024).is_integer() and abs(value) < 2**20
        return value, not exact

    def atom(self):
        if self.next_is("-"):
            if self.tokens and self.tokens[0][0]:
                value, rounded = self.literal(self.tokens.pop(0)[0])
                return self.tape.push("number", -value, rounded)
            return self.tape.push("neg", self.atom())
        if self.next_is("("):
            a = self.sum()
            self.next_is(")")
            return a
        number, name, _ = self.tokens.pop(0)
        if number:
            return self.tape.push("number", *self.literal(number))
        if self.next_is("("):
            name = name[:-1] if name not in FUNCTIONS else name
            if name not in FUNCTIONS:
                raise Refused(f"{name} is no known function")
            arguments = [self.sum()]
            while self.next_is(","):
                arguments.append(self.sum())
            self.next_is(")")
            return self.tape.push(name, *arguments)
        if name in self.named:
            return self.named[name]
        return self.tape.push("leaf", re.sub(r"^at\.", "motion.", name).replace("->", "."))


def results(source, name, tape):
    """The results of a function as steps, by their names; those behind the first `return` are of another way."""
    found = re.search(rf"^\w+ {name}\([^{{;]*\)\n\{{(.*?)^\}}", source, re.S | re.M)
    if not found:
        raise Refused(f"the code has no function {name}")
    body = re.sub(r"/\*.*?\*/", "", found[1], flags=re.S).split("return")[0]
    reader, stored = Reader(tape), {}
    for statement in body.split(";"):
        statement = " ".join(statement.split())
        if match := re.fullmatch(r"const (?:double|float) (\w+) = (.*)", statement):
            if "_EPSILON" not in match[2]:
                reader.named[match[1]] = reader.read(match[2])
            continue
        statement = statement.split("{")[-1].strip()
        if " = " in statement and not re.match(r"const \w+ at = ", statement):
            *targets, value = statement.split(" = ")
            if set(targets) and re.fullmatch(r"(?:\w+->\w+|matrix\[\d+\]\[\d+\])", targets[0]):
                step = reader.read(value)
                stored.update((target.replace("->", "."), step) for target in targets)
    return stored


def boxes(ranges, parts):
    """The boxes into which parts of ranges cut all of them."""
    edge = lambda ends, k, n: ends[1] if k == n else ends[0] + (ends[1] - ends[0]) * (k / n)
    cut = {name: [(edge(ranges[name], k, n), edge(ranges[name], k + 1, n)) for k in range(n)] for name, n in parts.items()}
    for own in itertools.product(*cut.values()):
        yield {**ranges, **dict(zip(cut, own))}


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    source, document = open(sys.argv[1]).read(), json.load(open(sys.argv[2]))
    prefix = re.search(r'#include "(\w+)\.h"', source)[1]
    kind = "double" if re.search(r"\bdouble\b", re.sub(r"/\*.*?\*/", "", source, flags=re.S)) else "single"
    if kind not in document["precisions"]:
        sys.exit(f"the code is in {kind} precision, the bounds are not")
    faults = checked = 0
    for function, own in document["functions"].items():
        if "refused" in own:
            continue
        try:
            derived = {}
            for box in boxes(document["ranges"], own["parts"].get(kind, {})):
                tape = Tape(document["precisions"][kind], document["assumed_ulps"], box)
                for name, step in results(source, f"{prefix}_{function}", tape).items():
                    derived[name] = max(derived.get(name, 0.0), tape.bound(step))
        except Refused as fault:
            print(f"{function}: {fault}")
            faults += 1
            continue
        stated = {name: result[kind]["bound"] for name, result in own["results"].items()}
        for name in sorted(derived.keys() | stated.keys()):
            bound = derived.get(name)
            checked += 1
            if bound is None or name not in stated and bound > 0 or stated.get(name, 0.0) < bound:
                print(f"{function}, {name}: {stated.get(name)} is stated, {bound} derived")
                faults += 1
    print(f"{checked} bounds, {faults} refused")
    sys.exit(1 if faults or not checked else 0)


main()

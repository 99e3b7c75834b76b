"""The workloads as straight-line programs that every peer executes.

A program has bases (Laurent polynomials in z = e^{i w t}), nodes (each an earlier node times a base) and groups (entries of
one equation, parameter and product of amplitudes, as a sum of rational multiples of nodes). Coordinates are already
measured from their offsets and common products are already shared, so that the peers are timed on multiplying, adding and
reducing alone.

A cosine series is symmetric and a sine series i times antisymmetric in z, so all coefficients stay rational: a product of
n sine factors carries 1/i^n, that is a sign and, for odd n, sines.
"""
from collections import Counter
from fractions import Fraction
from itertools import combinations_with_replacement
from math import comb, factorial


def rest_to_rest(l):
    return {2 * i + 1: Fraction((-1) ** i * comb(2 * l + 1, l - i), (2 * i + 1) * comb(2 * l + 1, l)) for i in range(l + 1)}


def laurent(shape, order):
    """The n-th derivative, as (harmonic -> coefficient of z^k, k of both signs) without the 1/i of sines."""
    out = {}
    for k, c in shape.items():
        if k == 0:
            if order == 0:
                out[0] = c
            continue
        value = c * k ** order * (1, -1, -1, 1)[order % 4] / 2
        out[k] = value
        out[-k] = value if order % 2 == 0 else -value
    return {k: c for k, c in out.items() if c}


class Program:
    def __init__(self, name, shapes, terms):
        """shapes: coordinate -> (amplitude, shape); terms: (equation, parameter, coefficient, {(coordinate, order): exponent})"""
        self.name = name
        keys, self.bases = {}, []
        nodes, self.nodes = {(): 0}, [None]
        groups = {}

        def base(coordinate, order):
            shape = shapes[coordinate][1]
            key = (tuple(sorted(shape.items())), order)
            if key not in keys:
                keys[key] = len(self.bases)
                self.bases.append(laurent(shape, order))
            return keys[key]

        def node(path):
            for end in range(1, len(path) + 1):
                prefix = path[:end]
                if prefix not in nodes:
                    nodes[prefix] = len(self.nodes)
                    self.nodes.append((nodes[prefix[:-1]], prefix[-1]))
            return nodes[path]

        for equation, parameter, coefficient, factors in terms:
            powers, path, sines = {}, [], 0
            for (coordinate, order), exponent in sorted(factors.items()):
                amplitude = shapes[coordinate][0]
                powers[amplitude] = powers.get(amplitude, 0) + exponent
                powers['w'] = powers.get('w', 0) + order * exponent
                path += [base(coordinate, order)] * exponent
                sines += order % 2 * exponent
            path = tuple(sorted(path))
            text = ''.join(sorted(f' {s}^{e}' for s, e in powers.items() if e))
            group = groups.setdefault((equation, parameter, text), {'sin': sines % 2, 'parts': {}})
            assert group['sin'] == sines % 2
            index = node(path)
            value = Fraction(coefficient) * (-1) ** (sines // 2)
            group['parts'][index] = group['parts'].get(index, 0) + value
        # With harmonics of one parity a base is z^-highest times a polynomial in z^2.
        pure = all(len({k % 2 for k in b}) <= 1 for b in self.bases)
        self.step = 2 if pure else 1
        self.highest = [max(b) for b in self.bases]
        self.span = [0]
        for parent, b in self.nodes[1:]:
            self.span.append(self.span[parent] + self.highest[b])
        self.groups = []
        for (equation, parameter, text), group in groups.items():
            parts = [(i, c) for i, c in group['parts'].items() if c]
            if parts:
                self.groups.append((equation, parameter, text, group['sin'], parts))

    def dense(self, b):
        """Coefficients of base b times z^highest, as a polynomial in z^step."""
        h = self.highest[b]
        return [self.bases[b].get(k, Fraction(0)) for k in range(-h, h + 1, self.step)]

    def lines(self, table):
        """table: per group a list of (harmonic, coefficient)."""
        out = []
        for (equation, parameter, text, sine, _), entries in zip(self.groups, table):
            function = 'sin' if sine else 'cos'
            out += [f'{equation} {parameter} {function} {k} {c}{text}' for k, c in entries]
        return sorted(out)


def numbering(regressor):
    """Lumped parameters: highest derivative, descending; its exponent; the total degree; then the same for the rest."""
    if not regressor:
        return []
    highest = max(regressor)
    rest = {n: e for n, e in regressor.items() if n != highest}
    return [(-highest, regressor[highest], sum(regressor.values()))] + numbering(rest)


def chain_symbols(carts):
    """Symbols of k2 x1^3; h1, h2, ... are 1/g1, 1/g2, ..., so that everything is a polynomial."""
    return ['k2'] + [f'm{i}' for i in range(2, carts + 1)] + [f'h{i}' for i in range(1, carts)] + [f'x{2 * k}' for k in range(carts)]


def chain_cube(carts, symbols, one, power):
    """k2 x1^3 in any arithmetic, x_{i-1} = x_i + (m_i x_i'' + ... + m_l x_l'') h_{i-1}, each x_i as coefficients of x_l^(2k)."""
    s = dict(zip(chain_symbols(carts), symbols))
    x, forces = [one], []
    for cart in range(carts, 1, -1):
        forces += [0] * (len(x) + 1 - len(forces))
        for k, coefficient in enumerate(x):
            forces[k + 1] = forces[k + 1] + coefficient * s[f'm{cart}']
        x.append(0)
        for k in range(1, len(x)):
            x[k] = x[k] + forces[k] * s[f'h{cart - 1}']
    total = 0
    for k, coefficient in enumerate(x):
        total = total + coefficient * s[f'x{2 * k}']
    return power(total) * s['k2']


def chain_lines(carts, terms):
    """terms: pairs of exponents in the order of the symbols, and a coefficient."""
    symbols = chain_symbols(carts)
    lines = []
    for exponents, c in terms:
        powers = [f' g{s[1:]}^{-e}' if s[0] == 'h' else f' {s}^{e}' for s, e in zip(symbols, exponents) if e]
        lines.append(f'{c}' + ''.join(sorted(powers)))
    return sorted(lines)


def program(name):
    kind, _, size = name.partition(':')
    l1, l2 = rest_to_rest(1), rest_to_rest(2)
    if kind == 'w1':
        terms = [('u', 'm', 1, {('x', 2): 1}), ('u', 'k1', 1, {('x', 0): 1}), ('u', 'k2', 1, {('x', 1): 2})]
        return Program(name, {'x': ('lambda', l1)}, terms)
    if kind == 'w2':
        regressors = [{4: 1}, {2: 1}, {0: 2, 2: 1}, {0: 1, 2: 2}, {2: 3}, {0: 1}, {0: 3}]
        terms = [('F', f'c{i + 1}', 1, {('x', n): e for n, e in r.items()}) for i, r in enumerate(regressors)]
        return Program(name, {'x': ('lambda', l2)}, terms)
    if kind == 'w5b':
        carts = int(size)
        regressors = [{2 * i: 1} for i in range(carts + 1)]
        for orders in combinations_with_replacement(range(0, 2 * carts, 2), 3):
            regressors.append(dict(Counter(orders)))
        regressors.sort(key=numbering)
        terms = [('F', f'c{i + 1}', 1, {('x', n): e for n, e in r.items()}) for i, r in enumerate(regressors)]
        return Program(name, {'x': ('lambda', rest_to_rest(carts))}, terms)
    if kind == 'w3':
        shape = {**l1, 0: Fraction(-8, 9)}
        terms = []
        one, two, y = 'th1', 'th2', ('th2', 0)

        def f(i, equation, factor, rest):
            for k in range(3):
                terms.append((equation, f'a{i}{k}', factor, {**({y: k} if k else {}), **rest}))

        def slope(i, equation, factor, rest):
            terms.append((equation, f'a{i}1', factor, dict(rest)))
            terms.append((equation, f'a{i}2', 2 * factor, {y: 1, **rest}))

        f(1, 'tau1', 2, {(one, 2): 1})
        f(3, 'tau1', 1, {(two, 2): 1})
        slope(1, 'tau1', 2, {(one, 1): 1, (two, 1): 1})
        slope(3, 'tau1', 1, {(two, 1): 2})
        f(3, 'tau2', 1, {(one, 2): 1})
        f(2, 'tau2', 2, {(two, 2): 1})
        slope(1, 'tau2', -1, {(one, 1): 2})
        slope(2, 'tau2', 1, {(two, 1): 2})
        return Program(name, {one: ('lambda1', shape), two: ('lambda2', shape)}, terms)
    if kind == 'w4':
        d = int(size)
        terms = []
        for p in range(d + 1):
            for q in range(d + 1 - p):
                terms.append(('u', f'k_{p}_{q}', 1, {k: e for k, e in {('x', 0): p, ('x', 1): q}.items() if e}))
        return Program(name, {'x': ('lambda', l1)}, terms)
    if kind == 'w6':
        n = int(size)
        cosine = [(k, Fraction((-1) ** (k // 2), factorial(k))) for k in range(0, n + 1, 2)]
        sine = [(k, Fraction((-1) ** (k // 2), factorial(k))) for k in range(1, n + 1, 2)]
        terms = []

        def add(equation, parameter, factor, q1, q2, rest):
            factors = dict(rest)
            for key, e in ((('q1', 0), q1), (('q2', 0), q2)):
                if e:
                    factors[key] = factors.get(key, 0) + e
            terms.append((equation, parameter, factor, factors))

        a1, a2, v1, v2 = ('q1', 2), ('q2', 2), ('q1', 1), ('q2', 1)
        add('tau1', 'p1', 1, 0, 0, {a1: 1})
        add('tau1', 'p3', 1, 0, 0, {a2: 1})
        add('tau2', 'p3', 1, 0, 0, {a1: 1})
        add('tau2', 'p3', 1, 0, 0, {a2: 1})
        for k, c in cosine:
            add('tau1', 'p2', 2 * c, 0, k, {a1: 1})
            add('tau1', 'p2', c, 0, k, {a2: 1})
            add('tau2', 'p2', c, 0, k, {a1: 1})
            add('tau1', 'p4', c, k, 0, {})
            for i in range(k + 1):
                for equation in ('tau1', 'tau2'):
                    add(equation, 'p5', c * comb(k, i), i, k - i, {})
        for k, c in sine:
            add('tau1', 'p2', -2 * c, 0, k, {v1: 1, v2: 1})
            add('tau1', 'p2', -c, 0, k, {v2: 2})
            add('tau2', 'p2', c, 0, k, {v1: 2})
        return Program(name, {'q1': ('lambda1', l1), 'q2': ('lambda2', l1)}, terms)
    raise SystemExit(f'unknown workload {name}')

"""Runs the peers on the workloads, checks that all give tpm's table, and prints the ratios. Started by `run`."""
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from workloads import chain_cube, chain_lines, chain_symbols, program


def flint_expand(p):
    from flint import fmpq, fmpq_poly
    dense = [[fmpq(c.numerator, c.denominator) for c in p.dense(b)] for b in range(len(p.bases))]
    groups = [(g[:4], [(i, fmpq(c.numerator, c.denominator)) for i, c in g[4]]) for g in p.groups]
    nodes, span, step = p.nodes, p.span, p.step
    shift = lambda poly, n: fmpq_poly([0] * n + poly.coeffs()) if n else poly

    def work():
        bases = [fmpq_poly(list) for list in dense]
        values = [fmpq_poly([1])]
        for parent, base in nodes[1:]:
            values.append(values[parent] * bases[base])
        table = []
        for key, parts in groups:
            top = max(span[i] for i, _ in parts)
            total = None
            for i, c in parts:
                term = values[i] if c == 1 else values[i] * c
                term = shift(term, (top - span[i]) // step)
                total = term if total is None else total + term
            coefficients = total.coeffs()
            middle = (top + step - 1) // step
            entries = []
            for index, c in enumerate(coefficients[middle:], middle):
                if c:
                    k = step * index - top
                    entries.append((k, c if k == 0 else 2 * c))
            table.append((key, entries))
        return table
    return work


def flint_whole(start):
    """From where tpm starts: the terms of the regressor form and the series of the pattern, as `expansion ... start` lists them.

    The method is tpm's: substitute the parts of every motion, collect, so that offsets cancel; then multiply out every
    product of series that is left once, and sort its harmonics into the table.
    """
    from flint import fmpq, fmpq_poly
    exact = lambda text: fmpq(*map(int, text.split('/')))
    motions, terms, numbers = {}, [], {'w': 0}
    number = lambda symbol: numbers.setdefault(symbol, len(numbers))
    for kind, *rest in map(str.split, start):
        if kind == 'motion':
            coordinate, symbol, *series = rest
            pairs = [(int(k), exact(c)) for k, c in (pair.split(':') for pair in series)]
            motions.setdefault(int(coordinate), []).append((number(symbol), pairs))
        else:
            equation, parameter, coefficient, *factors = rest
            atoms = []
            for atom, exponent in (factor.split('^') for factor in factors):
                coordinate, _, order = atom.partition('.')
                atoms.append((int(coordinate), int(order), int(exponent)) if order else (None, number(atom), int(exponent)))
            terms.append((equation, parameter, exact(coefficient), atoms))
    symbols, width = list(numbers), len(numbers)
    zero, one, half, turns = fmpq(0), fmpq(1), fmpq(1, 2), (1, -1, -1, 1)

    def work():
        # Coordinates on the same series share its powers; a constant part needs none.
        series, parts = [], {}
        for coordinate, motion in motions.items():
            of = parts[coordinate] = []
            for symbol, pairs in motion:
                if len(pairs) == 1 and pairs[0][0] == 0:
                    of.append((symbol, None, pairs[0][1]))
                    continue
                if pairs not in series:
                    series.append(pairs)
                of.append((symbol, series.index(pairs), one))
        # With harmonics of one parity a series is z^-highest times a polynomial in z^2.
        step = 2 if all(len({k % 2 for k, _ in pairs}) == 1 for pairs in series) else 1
        groups = {}
        for equation, parameter, coefficient, atoms in terms:
            powers, path, several = [0] * width, [], []
            for coordinate, order, exponent in atoms:
                if coordinate is None:
                    powers[order] += exponent
                    continue
                powers[0] += order * exponent
                moving = parts[coordinate]
                if order:
                    moving = [part for part in moving if part[1] is not None]
                if len(moving) == 1:
                    symbol, index, factor = moving[0]
                    powers[symbol] += exponent
                    if index is None:
                        coefficient = coefficient * factor ** exponent
                    else:
                        path += [(index, order)] * exponent
                else:
                    several += [(moving, order)] * exponent
            sums = {(tuple(powers), tuple(path)): coefficient}
            for moving, order in several:
                following = {}
                for (powers, path), c in sums.items():
                    for symbol, index, factor in moving:
                        raised = powers[:symbol] + (powers[symbol] + 1,) + powers[symbol + 1:]
                        key = raised, path if index is None else path + ((index, order),)
                        following[key] = following.get(key, zero) + c * factor
                sums = following
            for (powers, path), c in sums.items():
                key = equation, parameter, powers
                if key not in groups:
                    groups[key] = {}
                group, path = groups[key], tuple(sorted(path))
                group[path] = group[path] + c if path in group else c
        bases, table = {}, []
        # Products by their factors, as a tree of (polynomial, z^-span in front of it, the products with one factor more).
        root = fmpq_poly([1]), 0, {}
        for key, group in groups.items():
            nodes, top, sine = [], 0, False
            for path, c in group.items():
                if not c:
                    continue
                node, sines = root, 0
                for factor in path:
                    sines += factor[1] % 2
                    following = node[2].get(factor)
                    if following is None:
                        base = bases.get(factor)
                        if base is None:
                            pairs, order = series[factor[0]], factor[1]
                            high = max(k for k, _ in pairs)
                            dense = [zero] * (2 * high // step + 1)
                            for k, x in pairs:
                                if k:
                                    x = x * (turns[order % 4] * k ** order) * half
                                    dense[(high + k) // step] = x
                                    dense[(high - k) // step] = -x if order % 2 else x
                                elif not order:
                                    dense[high // step] = x
                            base = bases[factor] = fmpq_poly(dense), high
                        following = node[2][factor] = node[0] * base[0], node[1] + base[1], {}
                    node = following
                nodes.append((node[0], node[1], -c if sines // 2 % 2 else c))
                top, sine = max(top, node[1]), sines % 2
            total = None
            for poly, span, c in nodes:
                if c != 1:
                    poly = poly * c
                if span != top:
                    poly = fmpq_poly([0] * ((top - span) // step) + poly.coeffs())
                total = poly if total is None else total + poly
            if total is None:
                continue
            coefficients = total.coeffs()
            middle = (top + step - 1) // step
            entries = []
            for index, c in enumerate(coefficients[middle:], middle):
                if c:
                    k = step * index - top
                    entries.append((k, c if k == 0 else 2 * c))
            table.append((key, sine, entries))
        return table

    def lines(table):
        out = []
        for (equation, parameter, powers), sine, entries in table:
            text = ''.join(sorted(f' {s}^{e}' for s, e in zip(symbols, powers) if e))
            function = 'sin' if sine else 'cos'
            out += [f'{equation} {parameter} {function} {k} {c}{text}' for k, c in entries]
        return sorted(out)
    return work, lines


def sympy_expand(p):
    from sympy import QQ, ring
    domain, _ = ring('z', QQ)
    from_dict, one = domain.from_dict, domain.one
    dense = [{(i,): QQ(c.numerator, c.denominator) for i, c in enumerate(p.dense(b)) if c} for b in range(len(p.bases))]
    groups = [(g[:4], [(i, QQ(c.numerator, c.denominator)) for i, c in g[4]]) for g in p.groups]
    nodes, span, step = p.nodes, p.span, p.step

    def work():
        bases = [from_dict(terms) for terms in dense]
        values = [one]
        for parent, base in nodes[1:]:
            values.append(values[parent] * bases[base])
        table = []
        for key, parts in groups:
            top = max(span[i] for i, _ in parts)
            total = None
            for i, c in parts:
                term = values[i] if c == 1 else values[i] * c
                if top != span[i]:
                    term = term.mul_monom(((top - span[i]) // step,))
                total = term if total is None else total + term
            entries = []
            for (index,), c in total.items():
                k = step * index - top
                if k >= 0:
                    entries.append((k, c if k == 0 else 2 * c))
            table.append((key, entries))
        return table
    return work


def symengine_expand(p):
    import symengine
    z = symengine.Symbol('z')
    powers = {z ** k: k for k in range(-max(p.span) - 1, max(p.span) + 2)}
    powers[symengine.Integer(1)] = 0
    rational = lambda c: symengine.Rational(c.numerator, c.denominator)
    terms = [[(rational(c), z ** k) for k, c in b.items()] for b in p.bases]
    groups = [(g[:4], [(i, rational(c)) for i, c in g[4]]) for g in p.groups]
    nodes = p.nodes

    def work():
        bases = [symengine.Add(*[c * power for c, power in base]) for base in terms]
        values = [symengine.Integer(1)]
        for parent, base in nodes[1:]:
            values.append(symengine.expand(values[parent] * bases[base]))
        table = []
        for key, parts in groups:
            total = symengine.expand(symengine.Add(*[c * values[i] for i, c in parts]))
            entries = []
            for monomial, c in total.as_coefficients_dict().items():
                k = powers[monomial]
                if k >= 0 and c != 0:
                    entries.append((k, c if k == 0 else 2 * c))
            table.append((key, entries))
        return table
    return work


def flint_cube(carts):
    from flint import Ordering, fmpz_mpoly_ctx
    context = fmpz_mpoly_ctx.get(chain_symbols(carts), Ordering.degrevlex)
    symbols, one = context.gens(), context.constant(1)
    return lambda: chain_cube(carts, symbols, one, lambda x: x ** 3), lambda cube: cube.to_dict().items()


def sympy_cube(carts):
    from sympy import ZZ, ring
    domain, *symbols = ring(chain_symbols(carts), ZZ)
    return lambda: chain_cube(carts, symbols, domain.one, lambda x: x ** 3), lambda cube: cube.terms()


def symengine_cube(carts):
    import symengine
    names = chain_symbols(carts)
    symbols = [symengine.Symbol(name) for name in names]
    expand = symengine.expand

    def terms(cube):
        for monomial, c in cube.as_coefficients_dict().items():
            if c == 0:
                continue
            powers = {str(base): e for base, e in monomial.as_powers_dict().items()}
            yield [int(powers.get(name, 0)) for name in names], c
    return lambda: expand(chain_cube(carts, symbols, symengine.Integer(1), lambda x: expand(expand(x) ** 3))), terms


def outside_cube(carts, text):
    """Lines `coefficient symbol^power ...` and, last, the time."""
    symbols = chain_symbols(carts)
    *lines, last = [line for line in text.split('\n') if line.strip()]
    terms = []
    for line in lines:
        c, *powers = line.split()
        exponents = dict(power.split('^') for power in powers)
        terms.append(([int(exponents.get(s, 0)) for s in symbols], c))
    return chain_lines(carts, terms), float(last)


def gp_cube(carts, seconds, gp):
    script = f'l={carts};seconds={seconds};\n' + Path(__file__).with_name('cube.gp').read_text()
    return outside_cube(carts, subprocess.run([gp, '-q', '-f'], input=script, check=True, capture_output=True, text=True).stdout)


def c_cube(carts, seconds, binary):
    return outside_cube(carts, subprocess.run([binary, str(carts), str(seconds)], check=True, capture_output=True, text=True).stdout)


def median_of(work, seconds):
    batch, elapsed = 1, 0
    while True:
        start = time.process_time()
        for _ in range(batch):
            work()
        elapsed = time.process_time() - start
        if elapsed > 1e-3:
            break
        batch *= 2
    times, end = [], time.process_time() + seconds
    while time.process_time() < end or len(times) < 5:
        start = time.process_time()
        for _ in range(batch):
            work()
        times.append((time.process_time() - start) / batch * 1e6)
    return statistics.median(times)


def flat(p):
    """The program as numbers, for the peers that are not in Python."""
    out = [p.step, len(p.bases)]
    for b in range(len(p.bases)):
        dense = p.dense(b)
        out += [p.highest[b], len(dense)]
        for c in dense:
            out += [c.numerator, c.denominator]
    out += [len(p.nodes)]
    for parent, base in p.nodes[1:]:
        out += [parent, base]
    out += [len(p.groups)]
    for g in p.groups:
        out += [len(g[4])]
        for i, c in g[4]:
            out += [i, c.numerator, c.denominator]
    return out


def outside_table(p, text):
    table = [[] for _ in p.groups]
    for line in text.splitlines():
        group, harmonic, coefficient = line.split()
        table[int(group)].append((int(harmonic), coefficient))
    return table


def run_c(p, seconds, binary):
    with tempfile.NamedTemporaryFile('w', suffix='.txt') as file:
        file.write(' '.join(map(str, flat(p))))
        file.flush()
        table = outside_table(p, subprocess.run([binary, file.name, 'list'], check=True, capture_output=True, text=True).stdout)
        return table, float(subprocess.run([binary, file.name, 'time', str(seconds)], check=True, capture_output=True, text=True).stdout)


def run_gp(p, seconds, gp):
    script = Path(__file__).with_name('expand.gp').read_text()
    rational = lambda c: f'{c.numerator}/{c.denominator}'
    dense = ','.join('[' + ','.join(map(rational, p.dense(b))) + ']' for b in range(len(p.bases)))
    nodes = ';'.join(f'{parent + 1},{base + 1}' for parent, base in p.nodes[1:])
    groups = ','.join('Mat([' + ';'.join(f'{i + 1},{rational(c)}' for i, c in g[4]) + '])' for g in p.groups)
    data = f'step={p.step};span={[s for s in p.span]};dense=[{dense}];nodes=Mat([{nodes}]);groups=[{groups}];seconds={seconds};\n'
    with tempfile.NamedTemporaryFile('w', suffix='.gp') as file:
        file.write(data + script)
        file.flush()
        out = subprocess.run([gp, '-q', '-f', file.name], check=True, capture_output=True, text=True, stdin=subprocess.DEVNULL).stdout
    lines = [line for line in out.splitlines() if line.strip()]
    return outside_table(p, '\n'.join(lines[:-1])), float(lines[-1])


def main():
    options = json.loads(sys.argv[1])
    seconds = options['seconds']
    available = {}
    for name, module, make in (('python-flint', 'flint', flint_expand), ('SymPy', 'sympy', sympy_expand), ('SymEngine', 'symengine', symengine_expand)):
        try:
            __import__(module)
            available[name] = make
        except ImportError:
            print(f'{name}: not installed, left out', file=sys.stderr)
    cubes = {'python-flint': flint_cube, 'SymPy': sympy_cube, 'SymEngine': symengine_cube}
    scripting = list(available) + (['PARI/GP'] if options['gp'] else [])
    peers = scripting + (['FLINT from C'] if options['c'] else [])
    print('| workload | entries | tpm, us | ' + ' | '.join(peers) + ' | best scripting |')
    print('|---|---|---|' + '---|' * len(peers) + '---|')
    for name in options['workloads']:
        kind, _, size = name.partition(':')
        carts = int(size) if kind == 'w5a' else None
        p = None if carts else program(name)
        tpm = [options['tpm'], name]
        expected = sorted(subprocess.run(tpm + ['list'], check=True, capture_output=True, text=True).stdout.splitlines())
        own, ratios = [], {peer: [] for peer in peers}
        # Peers and tpm alternate, so that a change of the machine's load meets all of them.
        for repetition in range(options['repetitions']):
            own.append(float(subprocess.run(tpm + ['time', str(seconds)], check=True, capture_output=True, text=True).stdout))
            for peer in peers:
                if carts:
                    if peer in available:
                        work, terms = cubes[peer](carts)
                        lines, median = chain_lines(carts, terms(work())), median_of(work, seconds)
                    elif peer == 'PARI/GP':
                        lines, median = gp_cube(carts, seconds, options['gp'])
                    else:
                        lines, median = c_cube(carts, seconds, options['c_cube'])
                elif peer == 'FLINT from C':
                    table, median = run_c(p, seconds, options['c'])
                elif peer == 'PARI/GP':
                    table, median = run_gp(p, seconds, options['gp'])
                else:
                    work = available[peer](p)
                    table, median = [entries for _, entries in work()], median_of(work, seconds)
                if not carts:
                    lines = p.lines(table)
                if repetition == 0 and lines != expected:
                    different = set(lines) ^ set(expected)
                    raise SystemExit(f'{peer} disagrees on {name}: {sorted(different)[:6]}')
                ratios[peer].append(median / own[-1])
        middle = {peer: statistics.median(values) for peer, values in ratios.items()}
        best = min(middle[peer] for peer in scripting)
        cells = ' | '.join(f'{middle[peer]:.1f}' for peer in peers)
        print(f'| {name} | {len(expected)} | {statistics.median(own):.1f} | {cells} | {best:.1f} |', flush=True)


main()

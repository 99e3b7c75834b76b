"""Runs the peers on the workloads, checks that all give tpm's table, and prints the ratios. Started by `run`."""
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from workloads import chain_cube, chain_lines, chain_symbols, program


def flint_entries(total, top, step):
    """The coefficients of the harmonics from 0 on of z^-top times a polynomial in z^step."""
    middle = (top + step - 1) // step
    entries = []
    for index, c in enumerate(total.coeffs()[middle:], middle):
        if c:
            k = step * index - top
            entries.append((k, c if k == 0 else 2 * c))
    return entries


def sympy_entries(total, top, step):
    entries = []
    for (index,), c in total.items():
        k = step * index - top
        if k >= 0:
            entries.append((k, c if k == 0 else 2 * c))
    return entries


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
            table.append((key, flint_entries(total, top, step)))
        return table
    return work


def flint_tools(count):
    """What the derivation from the model needs of python-flint."""
    from flint import Ordering, fmpq, fmpq_mpoly_ctx, fmpq_poly
    generators = fmpq_mpoly_ctx.get([f'a{i}' for i in range(count)], Ordering.lex).gens()
    shift = lambda poly, n: fmpq_poly([0] * n + poly.coeffs())
    return fmpq, generators, lambda poly: poly.to_dict().items(), fmpq_poly, shift, flint_entries


def sympy_tools(count):
    """The same of SymPy."""
    from sympy import QQ, ring
    _, *generators = ring([f'a{i}' for i in range(count)], QQ)
    domain, _ = ring('z', QQ)
    series = lambda dense: domain.from_dict({(i,): QQ(c) for i, c in enumerate(dense) if c})
    return QQ, generators, lambda poly: poly.items(), series, lambda poly, n: poly.mul_monom((n,)), sympy_entries


def read_model(source):
    """What `expansion ... source` lists: per coordinate the parts (symbol, [(harmonic, coefficient)]) of its motion, the nodes
    (kind, what it has), and the equations (name, [node])."""
    motions, nodes, equations = {}, [], []
    for kind, *rest in map(str.split, source):
        if kind == 'motion':
            coordinate, symbol, *pairs = rest
            pairs = [(int(k), c) for k, c in (pair.split(':') for pair in pairs)]
            motions.setdefault(int(coordinate), []).append((symbol, pairs))
        elif kind == 'equation':
            equations.append((rest[0], [int(node) for node in rest[1:]]))
        else:
            _, what, *rest = rest
            nodes.append((what, *(rest if what in ('number', 'constant', 'parameter', 'input') else map(int, rest))))
    return motions, nodes, equations


def from_model(source, tools):
    """From the model's expressions to the table, as `expansion ... source` lists them.

    The method is tpm's: multiply the equations out over coordinates, constants and parameters, substitute the parts of every
    motion, collect, so that offsets cancel; then multiply out every product of series that is left once, and sort its
    harmonics into the table. With z and the amplitudes among the variables of one polynomial it takes longer.
    """
    motions, nodes, equations = read_model(source)
    atoms, numbers = [], {'w': 0}
    number = lambda symbol: numbers.setdefault(symbol, len(numbers))
    for i, (what, *rest) in enumerate(nodes):
        if what not in ('number', 'sum', 'product', 'power'):
            nodes[i] = 'atom', len(atoms)
            atoms.append((what, *rest) if what == 'derivative' else (what, number(rest[0]) if what == 'constant' else rest[0], 0))
    rational, generators, terms_of, polynomial, shift, entries_of = tools(len(atoms))
    exact = lambda text: rational(*map(int, text.split('/')))
    motions = {c: [(number(symbol), [(k, exact(x)) for k, x in pairs]) for symbol, pairs in motion] for c, motion in motions.items()}
    nodes = [(what, exact(rest[0]) if what == 'number' else rest[0] if what == 'atom' else rest) for what, *rest in nodes]
    symbols, width = list(numbers), len(numbers)
    zero, one, half, turns = rational(0), rational(1), rational(1, 2), (1, -1, -1, 1)

    def work():
        values = []
        for what, rest in nodes:
            if what == 'atom':
                value = generators[rest]
            elif what == 'number':
                value = rest
            elif what == 'power':
                value = values[rest[0]] ** rest[1]
            else:
                value = values[rest[0]]
                for i in rest[1:]:
                    value = value + values[i] if what == 'sum' else value * values[i]
            values.append(value)
        # Coordinates on the same series share its powers; a constant part needs none, and has no derivative.
        series, parts = [], {}
        for coordinate, motion in motions.items():
            of = []
            for symbol, pairs in motion:
                if len(pairs) == 1 and pairs[0][0] == 0:
                    of.append((symbol, None, pairs[0][1]))
                    continue
                if pairs not in series:
                    series.append(pairs)
                of.append((symbol, series.index(pairs), one))
            parts[coordinate] = of, [part for part in of if part[1] is not None]
        # With harmonics of one parity a series is z^-highest times a polynomial in z^2.
        step = 2 if all(len({k % 2 for k, _ in pairs}) == 1 for pairs in series) else 1
        groups = {}
        for equation, terms in equations:
            total = values[terms[0]]
            for i in terms[1:]:
                total = total + values[i]
            for exponents, coefficient in terms_of(total):
                powers, path, several, parameter = [0] * width, [], [], ('known', '-')
                for i, exponent in enumerate(exponents):
                    if not exponent:
                        continue
                    what, name, order = atoms[i]
                    if what == 'derivative':
                        powers[0] += order * exponent
                        moving = parts[name][order > 0]
                        if len(moving) == 1:
                            symbol, index, factor = moving[0]
                            powers[symbol] += exponent
                            path += [(index, order)] * exponent
                        else:
                            several += [(moving, order)] * exponent
                    elif what == 'constant':
                        powers[name] += exponent
                    else:
                        parameter = what, name
                if parameter[0] == 'input':
                    continue
                sums = {(tuple(powers), tuple(path)): coefficient}
                for moving, order in several:
                    following = {}
                    for (powers, path), c in sums.items():
                        for symbol, index, factor in moving:
                            raised = powers[:symbol] + (powers[symbol] + 1,) + powers[symbol + 1:]
                            key = raised, path if index is None else path + ((index, order),)
                            part = c if factor is one else c * factor
                            following[key] = following[key] + part if key in following else part
                    sums = following
                for (powers, path), c in sums.items():
                    key = equation, parameter[1], powers
                    group = groups.get(key)
                    if group is None:
                        group = groups[key] = {}
                    path = tuple(sorted(path))
                    group[path] = group[path] + c if path in group else c
        bases, table = {}, []
        # Products by their factors, as a tree of (polynomial, z^-span in front of it, the products with one factor more).
        root = polynomial([one]), 0, {}
        for key, group in groups.items():
            found, top, sine = [], 0, False
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
                            base = bases[factor] = polynomial(dense), high
                        following = node[2][factor] = node[0] * base[0], node[1] + base[1], {}
                    node = following
                found.append((node[0], node[1], -c if sines // 2 % 2 else c))
                top, sine = max(top, node[1]), sines % 2
            total = None
            for poly, span, c in found:
                if c != 1:
                    poly = poly * c
                if span != top:
                    poly = shift(poly, (top - span) // step)
                total = poly if total is None else total + poly
            if total is not None:
                table.append((key, sine, entries_of(total, top, step)))
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
            table.append((key, sympy_entries(total, top, step)))
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


def outside_cube(carts, lines):
    """Lines `coefficient symbol^power ...` and, last, the times of the polynomial and of it with its terms read out."""
    symbols = chain_symbols(carts)
    *lines, last = lines
    terms = []
    for line in lines:
        c, *powers = line.split()
        exponents = dict(power.split('^') for power in powers)
        terms.append(([int(exponents.get(s, 0)) for s in symbols], c))
    return chain_lines(carts, terms), *map(float, last.split())


def gp_lines(gp, name, data):
    """What a script prints that finds this data, without empty lines."""
    parts = [Path(__file__).with_name(part).read_text() for part in ('common.gp', name)]
    with tempfile.NamedTemporaryFile('w', suffix='.gp') as file:
        file.write('\n'.join([data, *parts]))
        file.flush()
        out = subprocess.run([gp, '-q', '-f', file.name], check=True, capture_output=True, text=True, stdin=subprocess.DEVNULL).stdout
    return [line for line in out.splitlines() if line.strip()]


quoted = lambda names: '[' + ','.join(f'"{name}"' for name in names) + ']'


def gp_cube(carts, seconds, gp):
    return outside_cube(carts, gp_lines(gp, 'cube.gp', f'l={carts};seconds={seconds};names={quoted(chain_symbols(carts))};'))


def c_cube(carts, seconds, binary):
    out = subprocess.run([binary, str(carts), str(seconds)], check=True, capture_output=True, text=True).stdout
    return outside_cube(carts, out.splitlines())


def least(work, seconds):
    """The least time of a run, over batches of a millisecond: a virtual machine halves its speed now and then."""
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
    return min(times)


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


def outside_table(p, lines):
    table = [[] for _ in p.groups]
    for line in lines:
        group, harmonic, coefficient = line.split()
        table[int(group)].append((int(harmonic), coefficient))
    return table


def run_c(p, seconds, binary):
    with tempfile.NamedTemporaryFile('w', suffix='.txt') as file:
        file.write(' '.join(map(str, flat(p))))
        file.flush()
        table = outside_table(p, subprocess.run([binary, file.name, 'list'], check=True, capture_output=True, text=True).stdout.splitlines())
        return table, float(subprocess.run([binary, file.name, 'time', str(seconds)], check=True, capture_output=True, text=True).stdout)


def run_gp(p, seconds, gp):
    rational = lambda c: f'{c.numerator}/{c.denominator}'
    dense = ','.join('[' + ','.join(map(rational, p.dense(b))) + ']' for b in range(len(p.bases)))
    nodes = ';'.join(f'{parent + 1},{base + 1}' for parent, base in p.nodes[1:])
    groups = ','.join('Mat([' + ';'.join(f'{i + 1},{rational(c)}' for i, c in g[4]) + '])' for g in p.groups)
    data = f'step={p.step};span={[s for s in p.span]};dense=[{dense}];nodes=Mat([{nodes}]);groups=[{groups}];seconds={seconds};'
    *lines, last = gp_lines(gp, 'expand.gp', data)
    return outside_table(p, lines), float(last)


def gp_model(source, seconds, gp):
    """The lines of the table and the time from the model's expressions, with z and everything else variables of one polynomial."""
    motions, nodes, equations = read_model(source)
    names = ['z', 'w']

    def variable(name):
        if name not in names:
            names.append(name)
        return names.index(name) + 1
    listed = lambda items: '[' + ','.join(map(str, items)) + ']'
    codes = {'input': 0, 'number': 1, 'parameter': 2, 'constant': 2, 'derivative': 3, 'sum': 4, 'product': 5, 'power': 6}
    written = []
    for what, *rest in nodes:
        if what in ('parameter', 'constant'):
            rest = [variable(rest[0])]
        elif what in ('sum', 'product'):
            rest = [node + 1 for node in rest]
        elif what in ('derivative', 'power'):
            rest[0] += 1
        written.append(listed([codes[what], *(rest if what != 'input' else [])]))
    moving = [[listed([variable(symbol), listed(map(listed, pairs))]) for symbol, pairs in motions[c]] for c in sorted(motions)]
    high = [max(k for _, pairs in motions[c] for k, _ in pairs) for c in sorted(motions)]
    sums = [listed(node + 1 for node in terms) for _, terms in equations]
    data = (f'names={quoted(names)};high={high};seconds={seconds};motions={listed(map(listed, moving))};'
            f'nodes={listed(written)};equations={listed(sums)};')
    *found, last = gp_lines(gp, 'model.gp', data)
    parameters = {rest[0] for what, *rest in nodes if what == 'parameter'}
    lines = []
    for line in found:
        equation, harmonic, c, *powers = line.split()
        exponents = dict(power.split('^') for power in powers)
        parameter = next((name for name in exponents if name in parameters), '-')
        function = 'sin' if int(exponents.get('w', 0)) % 2 else 'cos'
        rest = ''.join(sorted(f' {name}^{e}' for name, e in exponents.items() if name != parameter))
        lines.append(f'{equations[int(equation)][0]} {parameter} {function} {harmonic} {c}{rest}')
    return sorted(lines), float(last)


def ratios(measures, tpm, repetitions):
    """tpm's least time and, per peer, its least time over tpm's; they alternate."""
    own, found = [], {peer: [] for peer in measures}
    for _ in range(repetitions):
        own.append(tpm())
        for peer, measure in measures.items():
            found[peer].append(measure())
    return min(own), {peer: min(times) / min(own) for peer, times in found.items()}


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
    whole_tools = {'python-flint': flint_tools, 'SymPy': sympy_tools}
    cubes = {'python-flint': flint_cube, 'SymPy': sympy_cube, 'SymEngine': symengine_cube}
    scripting = list(available) + (['PARI/GP'] if options['gp'] else [])
    peers = scripting + (['FLINT from C'] if options['c'] else [])
    print('| workload | entries | tpm, us | ' + ' | '.join(peers) + ' | best scripting |')
    print('|---|---|---|' + '---|' * len(peers) + '---|')

    def row(name, entries, own, ratios):
        cells = ' | '.join(f'{ratios[peer]:.1f}' if peer in ratios else '' for peer in peers)
        best = min(ratio for peer, ratio in ratios.items() if peer in scripting)
        print(f'| {name} | {entries} | {own:.1f} | {cells} | {best:.1f} |', flush=True)

    for name in options['workloads']:
        kind, _, size = name.partition(':')
        carts = int(size) if kind == 'w5a' else None
        p = None if carts else program(name)
        tpm = lambda *arguments: subprocess.run([options['tpm'], name, *arguments], check=True, capture_output=True, text=True).stdout
        expected = sorted(tpm('list').splitlines())

        def check(peer, lines):
            if lines != expected:
                different = set(lines) ^ set(expected)
                raise SystemExit(f'{peer} disagrees on {name}: {sorted(different)[:6]}')

        # What a peer takes from a prepared program to the polynomials, and from tpm's start to tpm's end, in microseconds.
        prepared, whole = {}, {}
        for peer in peers:
            if carts and peer in available:
                work, terms = cubes[peer](carts)
                check(peer, chain_lines(carts, terms(work())))
                prepared[peer] = lambda work=work: least(work, seconds)
                whole[peer] = lambda work=work, terms=terms: least(lambda: list(terms(work())), seconds)
            elif carts:
                run = (lambda: gp_cube(carts, seconds, options['gp'])) if peer == 'PARI/GP' else (lambda: c_cube(carts, seconds, options['c_cube']))
                check(peer, run()[0])
                prepared[peer], whole[peer] = lambda run=run: run()[1], lambda run=run: run()[2]
            elif peer in available:
                work = available[peer](p)
                check(peer, p.lines([entries for _, entries in work()]))
                prepared[peer] = lambda work=work: least(work, seconds)
                if peer in whole_tools and kind != 'w5b':
                    work, lines = from_model(tpm('source').splitlines(), whole_tools[peer])
                    check(peer, lines(work()))
                    whole[peer] = lambda work=work: least(work, seconds)
            else:
                run = (lambda: run_gp(p, seconds, options['gp'])) if peer == 'PARI/GP' else (lambda: run_c(p, seconds, options['c']))
                check(peer, p.lines(run()[0]))
                prepared[peer] = lambda run=run: run()[1]
                # Larger tables take seconds from the model.
                if peer == 'PARI/GP' and kind != 'w5b' and len(expected) < 1000:
                    run = lambda: gp_model(tpm('source').splitlines(), seconds, options['gp'])
                    check(peer, run()[0])
                    whole[peer] = lambda run=run: run()[1]
        row(name, len(expected), *ratios(prepared, lambda: float(tpm('time', str(seconds))), options['repetitions']))
        if whole:
            how = 'time' if carts else 'derive'
            row(f'{name}, whole', '', *ratios(whole, lambda: float(tpm(how, str(seconds))), options['repetitions']))


main()

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

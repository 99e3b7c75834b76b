#!/usr/bin/env python3
"""How far the bounds of `tpm generate --range` lie above the worst rounding error of random and corner points.

    benches/bounds.py TPM POINTS MODEL.tpm[=VALUES.toml] ...

TPM is the program. Every function of every model is generated in C, in both precisions, compiled with gcc beside a twin of more digits
(`double` for `float`, `long double` for `double`), and called at POINTS random points, of which three quarters have some or all inputs at ends
of their ranges. Ranges: positions and velocities 3.2, accelerations and higher derivatives 15, all else .9 to 1.1 unless VALUES has a value.
Prints the results, the largest and the median ratio of bound and worst error, and the time of `tpm generate` with the bounds, less that
without them, by functions; then the largest ratio of all. Exit code 1 where a bound is below an error, or the checker refuses one.
"""

import json
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile
import time

CHECKER = pathlib.Path(__file__).parent.parent / "tests/scripts/check_bounds.py"
PARTS = ["gravity", "mass_matrix", "forward_dynamics", "base_regressor"]
MOTION = ["*=-3.2..3.2", "dot(*)=-3.2..3.2", "ddot(*)=-15..15", "der(*, 3)=-15..15", "der(*, 4)=-15..15", "der(*, 5)=-15..15", "der(*, 6)=-15..15"]

PROGRAM = """#include <stdio.h>
#include <stdint.h>
#include <math.h>
%(code)s
static uint64_t state = 88172645463325252u;
static double share(void) { state ^= state << 13; state ^= state >> 7; state ^= state << 17; return (double)(state >> 11) * 0x1p-53; }
int main(void)
{
    static const double low[] = {%(low)s}, high[] = {%(high)s};
    static %(wide)s worst[%(results)d], z[%(results)d];
    static %(real)s x[%(reads)d], y[%(results)d];
    for (long k = 0; k < %(points)s; ++k) {
        for (int i = 0; i < %(reads)d; ++i) {
            double a = share();
            if (k %% 4 == 1 || (k %% 4 == 2 && i %% 3 != 0) || (k %% 4 == 3 && share() < .5)) a = a < .5 ? 0 : 1;
            double v = low[i] + (high[i] - low[i]) * a;
            x[i] = (%(real)s)(v < low[i] ? low[i] : v > high[i] ? high[i] : v);
        }
        narrow(x, y);
        wide(x, z);
        for (int o = 0; o < %(results)d; ++o) {
            %(wide)s e = y[o] > z[o] ? y[o] - z[o] : z[o] - y[o];
            if (!(e <= worst[o])) worst[o] = e;
        }
    }
    for (int o = 0; o < %(results)d; ++o) printf("%%.9e\\n", (double)worst[o]);
    return 0;
}
"""


def body(source, function):
    """The statements of a function up to its first `return`."""
    found = re.search(rf"^\w+ {function}\([^{{;]*\)\n\{{(.*?)^\}}", source, re.S | re.M)[1]
    found = re.sub(r"/\*.*?\*/", "", found, flags=re.S).split("return")[0]
    statements = (" ".join(statement.split()) for statement in found.split(";"))
    return [re.sub(r"^if .*\{ ", "", statement) for statement in statements if statement]


def twin(name, statements, reads, results, real, given, suffix):
    """The function over arrays, with the elementary functions of a precision."""
    lines = []
    for text in statements:
        text = re.sub(r"\bat\.", "motion->", text)
        text = re.sub(r"\b(sin|cos|tan|asin|acos|atan2|atan|sqrt|fabs|tanh|exp|log)f?\(", rf"\1{suffix}(", text)
        text = text.replace("sign_of(", f"sign_{name}(")
        text = re.sub(r"\w+->\w+(?:\.\w+)*", lambda m: f"x[{reads.index(m[0])}]" if m[0] in reads else m[0], text)
        if match := re.fullmatch(r"const (?:double|float) (\w+) = (.*)", text):
            if "_EPSILON" not in text:
                lines.append(f"const {real} {match[1]} = {match[2]};")
            continue
        *targets, value = text.split(" = ")
        lines += [f"y[{results.index(target)}] = {value};" for target in targets if target in results]
    return (
        f"static {real} sign_{name}({real} x) {{ return x > 0 ? 1 : x < 0 ? -1 : 0; }}\n"
        f"static void {name}(const {given} *given, {real} *y)\n{{\n{real} x[{len(reads)}];\n"
        f"for (int i = 0; i < {len(reads)}; ++i) x[i] = given[i];\n" + "\n".join(lines) + "\n}\n"
    )


def worst(folder, source, function, own, ranges, points, single):
    names = [name.replace(".", "->", 1) if "[" not in name else name for name in own["results"]]
    statements = body(source, function)
    text = re.sub(r"\bat\.", "motion->", " ".join(statements))
    reads = sorted({read for read in re.findall(r"\w+->\w+(?:\.\w+)*", text) if read.replace("->", ".") in ranges})
    if not reads or not names:
        return None
    real, wide = ("float", "double") if single else ("double", "long double")
    code = twin("narrow", statements, reads, names, real, real, "f" if single else "")
    code += twin("wide", statements, reads, names, wide, real, "" if single else "l")
    ends = [ranges[read.replace("->", ".")] for read in reads]
    numbers = [", ".join(repr(end[side]) for end in ends) for side in (0, 1)]
    file = pathlib.Path(folder) / "sample.c"
    file.write_text(PROGRAM % {
        "code": code, "low": numbers[0], "high": numbers[1], "real": real, "wide": wide,
        "results": len(names), "reads": len(reads), "points": points,
    })
    subprocess.run(["gcc", "-O2", "-ffp-contract=off", "-w", file, "-o", f"{folder}/sample", "-lm"], check=True)
    output = subprocess.run([f"{folder}/sample"], check=True, capture_output=True, text=True).stdout
    return dict(zip(own["results"], map(float, output.split())))


def generate(tpm, model, values, real, folder, ranges):
    def run(parts, ranges):
        command = [tpm, "generate", model, "--lang", "c", "--prefix", "m", "--real", real, "-o", folder]
        command += ["--with", ",".join(parts)] if parts else []
        command += ["--params", values] if values else []
        started = time.time()
        done = subprocess.run(command + (["--range", ",".join(ranges)] if ranges else []), capture_output=True, text=True)
        return time.time() - started, done

    parts = [part for part in PARTS if run([part], [])[1].returncode == 0]
    plain, _ = run(parts, [])
    header = pathlib.Path(folder, "m.h").read_text()
    for record in ["constants", "inputs"] + ([] if values else ["physical", "parameters"]):
        if found := re.search(rf"typedef struct m_{record} \{{(.*?)^\}}", header, re.S | re.M):
            ranges = ranges + [f"{name}=0.9..1.1" for name in re.findall(r"^    \w+ (\w+);", found[1], re.M)]
    orders = re.findall(r"^    \w+ (dot|ddot|der3|der4|der5|der6);", header, re.M)
    known = {"*", *(f"{order}(*)" for order in orders if order.startswith("d") and not order.startswith("der"))}
    known |= {f"der(*, {order[3]})" for order in orders if order.startswith("der")}
    ranges = [own for own in dict.fromkeys(ranges) if "*" not in own or own.split("=")[0] in known]
    taken, done = run(parts, ranges)
    if done.returncode:
        sys.exit(done.stderr)
    return taken - plain, done


def main():
    tpm, points, *models = sys.argv[1:]
    failed, largest = False, 0.0
    print("| model | precision | function | results | largest ratio | median |\n|---|---|---|---|---|---|")
    for given in models:
        model, _, values = given.partition("=")
        for real in ["double", "float"]:
            with tempfile.TemporaryDirectory() as folder:
                taken, done = generate(tpm, model, values, real, folder, MOTION)
                source = pathlib.Path(folder, "m.c").read_text()
                document = json.loads(pathlib.Path(folder, "m.bounds.json").read_text())
                name, ratios = pathlib.Path(model).stem, []
                kind = "single" if real == "float" else "double"
                for function, own in document["functions"].items():
                    if "refused" in own:
                        print(f"| {name} | {kind} | `{function}` | {own['refused']} | | |")
                        continue
                    errors = worst(folder, source, f"m_{function}", own, document["ranges"], points, real == "float")
                    bounds = {result: of[kind]["bound"] for result, of in own["results"].items()}
                    for result, error in (errors or {}).items():
                        if not error <= bounds[result]:
                            print(f"BELOW: {name} {kind} {function} {result}: {bounds[result]} < {error}")
                            failed = True
                    own_ratios = [bounds[result] / error for result, error in (errors or {}).items() if error > 0]
                    if own_ratios:
                        ratios += own_ratios
                        print(f"| {name} | {kind} | `{function}` | {len(bounds)} | {max(own_ratios):.1f} | {statistics.median(own_ratios):.1f} |", flush=True)
                started = time.time()
                check = subprocess.run([sys.executable, CHECKER, f"{folder}/m.c", f"{folder}/m.bounds.json"], capture_output=True, text=True)
                failed |= check.returncode != 0
                count = len(document["functions"])
                print(
                    f"| {name} | {kind} | all: {taken / count:.2f} s a function; checker {time.time() - started:.1f} s: "
                    f"{check.stdout.strip().splitlines()[-1] if check.stdout else check.stderr[-300:]} | | {max(ratios, default=0):.1f} | |",
                    flush=True,
                )
                largest = max([largest, *ratios])
    print(f"\nlargest ratio: {largest:.1f}")
    sys.exit(failed)


main()

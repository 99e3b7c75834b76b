"""Machines drawn at random, with one fault or none, identified by tpm and by other tools:

    python3 arena.py --tpm TPM --seed SEED --machines N --json FILE --table FILE [--keep FOLDER] [--seconds 60] [--tools NAME ...]

(`pip install numpy scipy 'mujoco[sysid]'`, and a C compiler as `cc`.) `machines.py` and `records.py` are the grammar, `tools.py` and
`mujoco_sysid.py` the adapters, `oracle.py` the Cramer-Rao bound, `report.py` the table. A machine depends on seed and number alone. What
FILE holds already is not done again, so that a run that was stopped goes on, and a tool can be added.
Folders of machines of which tpm states a wrong number, exit code 0 and no cause named, are kept in FOLDER.
"""

import argparse
import json
import math
import multiprocessing
import resource
import shutil
import signal
import tempfile
import time
from datetime import date
from pathlib import Path

import numpy as np
import oracle
import records
import report
import tools

OTHERS = ("output error", "regression", "mujoco.sysid")
CONFIDENT, SHARE, PATIENCE = 3.5, 0.01, 20


def start_of(case, rng):
    """Values 30 % off, up or down; links' inertias and moments all down, since a body must be able to have them."""
    links = ("link_inertia", "link_moment")
    return {e["name"]: e["value"] * (0.7 if e["kind"] in links or rng.random() < 0.5 else 1.3) for e in case.model if not e.get("known")}


def task_of(case, seed):
    told = [{key: value for key, value in e.items() if key != "value" or e.get("known")} for e in case.model]
    task = tools.Task(case.machine.layout, told, case.log, start_of(case, np.random.default_rng([seed, case.number, 1])))
    task.bodies = getattr(case.machine, "bodies", None)
    task.units = [unit for _, unit in case.machine.coordinates]
    return task


def write(case, task, folder):
    folder.mkdir(parents=True)
    (folder / "model.tpm").write_text(case.text())
    np.savetxt(folder / "log.csv", case.log, delimiter=",", header=",".join(case.columns()), comments="", fmt="%.10g")
    truth = dict(machine=case.machine.kind, fault=case.fault, record=case.record, elements=case.truth, channel=case.channel,
                 noise=case.noise, values=case.values(), start=task.start)
    (folder / "truth.json").write_text(json.dumps(truth, indent=1, default=float) + "\n")


def call(name, task, program, folder):
    match name:
        case "tpm":
            return tools.tpm(program, folder)
        case "output error":
            return tools.output_error(task)
        case "regression":
            return tools.regression(task)
        case "mujoco.sysid":
            import mujoco_sysid
            return mujoco_sysid.identify(task)


def spent():
    """Processor time of this process and of those that it started, s: others may share the machine."""
    return time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])


def child(pipe, *arguments):
    begun, seconds = spent(), arguments[-1]
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))  # Programs that are started inherit it.
    try:
        answer = call(*arguments[:-1])
    except Exception as fault:  # Whatever a tool throws is its refusal.
        answer = tools.result(refused=f"{type(fault).__name__}: {fault}"[:300])
    pipe.send((answer, spent() - begun))


def run(name, task, program, folder, seconds):
    """A tool in a process of its own, which ends when it takes too long: by processor time, or because nothing happens any more."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.Process(target=child, args=(sender, name, task, program, folder, seconds))
    process.start()
    sender.close()
    late = tools.result(refused="took too long")
    try:
        answer, taken = receiver.recv() if receiver.poll(PATIENCE * seconds) else (late, seconds)
    except EOFError:
        process.join()
        answer, taken = (late, seconds) if process.exitcode == -signal.SIGXCPU else (tools.result(refused="crashed"), 0.0)
    if process.is_alive():
        process.terminate()
    process.join()
    return {**answer, "seconds": taken}


def judge(case, answer, least):
    """The answer with the errors of its numbers, and whether it is confident and wrong."""
    numbers = {}
    for name, truth in case.values().items():
        value, std = answer["values"].get(name, (None, None))
        if value is None or not (math.isfinite(value) and math.isfinite(std)) or std <= 0:
            continue
        z, share = (value - truth) / std, abs(value / truth - 1)
        width = std / least[name] if least and least.get(name) and math.isfinite(least[name]) else None
        numbers[name] = dict(truth=truth, value=value, std=std, errors=z, share=share, width=width,
                             wrong=bool(abs(z) > CONFIDENT and share > SHARE))
    stated = not answer["refused"] and not answer["causes"]
    return dict(refused=answer["refused"], causes=answer["causes"], seconds=answer["seconds"], numbers=numbers,
                confident=[name for name, own in numbers.items() if own["wrong"]] if stated else [])


def save(path, text):
    partial = path.with_name(path.name + ".part")
    partial.write_text(text)
    partial.replace(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tpm", required=True, help="the program")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--machines", type=int, required=True)
    parser.add_argument("--json", type=Path, required=True, help="all numbers")
    parser.add_argument("--table", type=Path, required=True, help="the tables, in markdown")
    parser.add_argument("--keep", type=Path, help="folder for machines of which tpm states a wrong number")
    parser.add_argument("--seconds", type=int, default=60, help="processor time that a tool may take for a machine")
    parser.add_argument("--tools", nargs="+", choices=("tpm", *OTHERS), default=("tpm", *OTHERS))
    parser.add_argument("--sparse", nargs=2, action="append", default=[], metavar=("NAME", "N"), help="gives a tool every Nth machine only")
    options = parser.parse_args()
    sparse = {name: int(every) for name, every in options.sparse}
    machines = []
    if options.json.exists():
        before = json.loads(options.json.read_text())
        if before["seed"] != options.seed:
            parser.error(f"{options.json} holds machines of seed {before['seed']}: give another file")
        machines = before["machines"]
    begun = dict(date=date.today().isoformat(), seed=options.seed)
    with tempfile.TemporaryDirectory() as scratch:
        for number in range(options.machines):
            known = machines[number]["tools"] if number < len(machines) else {}
            given = [name for name in options.tools if number % sparse.get(name, 1) == 0 and name not in known]
            if not given:
                continue
            case = records.draw(options.seed, number)
            task, folder = task_of(case, options.seed), Path(scratch) / f"{options.seed}-{number:03}"
            write(case, task, folder)
            least = machines[number]["bound"] if known else oracle.bound(case)
            judged = {name: judge(case, run(name, task, options.tpm, folder, options.seconds), least) for name in given}
            if not known:
                machines.append(dict(number=number, machine=case.machine.kind, coordinates=case.machine.layout["n"], fault=case.fault,
                                     record=case.record, bound=least, tools={}))
            machines[number]["tools"].update(judged)
            if judged.get("tpm", {}).get("confident") and options.keep:
                shutil.copytree(folder, options.keep / folder.name, dirs_exist_ok=True)
            shutil.rmtree(folder)
            said = ", ".join(f"{name} {own['seconds']:.1f} s " + ("refused " if own["refused"] else "") + "/".join(own["causes"])
                             + ("WRONG " + " ".join(own["confident"]) if own["confident"] else "") for name, own in judged.items())
            print(f"{number} {case.machine.kind}, {case.fault} ({case.record}): {said}", flush=True)
            save(options.json, json.dumps({**begun, "machines": machines}, indent=1, default=float) + "\n")
            save(options.table, report.tables({**begun, "machines": machines}))


if __name__ == "__main__":
    main()

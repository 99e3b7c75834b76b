"""Tables in markdown of what `arena.py` counted."""

import numpy as np
from records import FAULTS, RIGHT


def share(part, whole):
    return f"{100 * part / whole:.1f} %" if whole else "-"


def numbers_of(entries):
    return [number for own in entries for number in own["numbers"].values()]


def median(values, digits=2):
    values = [value for value in values if value is not None]
    return f"{np.median(values):.{digits}f}" if values else "-"


def summary(name, machines):
    own = [(m, m["tools"][name]) for m in machines if name in m["tools"]]
    tried = [(m, t) for m, t in own if not (t["refused"] or "").startswith("not attempted")]
    answered = [(m, t) for m, t in tried if not t["refused"]]
    right = [t for m, t in answered if m["fault"] in RIGHT]
    wrong = [t for m, t in answered if m["fault"] not in RIGHT]
    late = sum(t["refused"] == "took too long" for _, t in tried)
    count = lambda entries: f"{sum(bool(t['confident']) for t in entries)} of {len(entries)} ({sum(len(t['confident']) for t in entries)})"
    held = numbers_of(right)
    inside = sum(abs(n["errors"]) < 1.96 for n in held)
    quiet = [t for t in wrong if not t["causes"]]
    seconds = [t["seconds"] for _, t in tried]
    return [
        name, str(len(tried)), str(len(tried) - len(answered) - late), str(late), count(right), count(wrong),
        f"{share(inside, len(held))} of {len(held)}", median([n["width"] for n in held]), median([n["width"] for n in numbers_of(wrong)]),
        str(len(wrong) - len(quiet)), median(seconds, 1), f"{max(seconds, default=0):.1f}"]


def table(head, rows):
    return "\n".join(["| " + " | ".join(head) + " |", "|" + "---|" * len(head), *("| " + " | ".join(row) + " |" for row in rows)])


def by_fault(fault, names, machines):
    own = [m for m in machines if m["fault"] == fault]
    cells = []
    for name in names:
        entries = [m["tools"][name] for m in own if name in m["tools"]]
        tried = [t for t in entries if not (t["refused"] or "").startswith("not attempted")]
        confident, refused = sum(bool(t["confident"]) for t in tried), sum(bool(t["refused"]) for t in tried)
        named = sum(bool(t["causes"]) and not t["refused"] for t in tried)
        cells.append(f"{confident} / {refused}" + (f" / {named}" if name == "tpm" else ""))
    return [fault, str(len(own)), *cells]


def tables(whole):
    machines = whole["machines"]
    names = list(machines[0]["tools"])  # The first machine is given to every tool.
    head = ["tool", "machines", "refused", "too long", "right models: confident and wrong", "wrong models: confident and wrong",
            "95 % intervals of right models", "width / bound, right", "width / bound, wrong", "wrong models: cause named",
            "processor time, s", "largest"]
    right = sum(m["fault"] in RIGHT for m in machines)
    lines = [f"{whole['date']}, seed {whole['seed']}, {len(machines)} machines, {right} with their right model.",
             "", table(head, [summary(name, machines) for name in names]), "",
             "Machines with a confident wrong number / refused / with a cause named (tpm alone names causes), fault by fault:", "",
             table(["fault", "machines", *names], [by_fault(fault, names, machines) for fault in (*RIGHT, *FAULTS)])]
    own = [(m, m["tools"]["tpm"]) for m in machines if "tpm" in m["tools"]]
    rows = [[str(m["number"]), m["machine"], m["fault"], name, f"{n['errors']:+.1f}", f"{100 * n['share']:.1f} %"]
            for m, t in own for name in t["confident"] for n in [t["numbers"][name]]]
    lines += ["", "Confident wrong numbers of tpm:", "",
              table(["number", "machine", "fault", "parameter", "stated deviations", "off by"], rows) if rows else "None."]
    return "\n".join(lines) + "\n"

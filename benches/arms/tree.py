"""A torso with two arms as a model of tpm: N revolute joints about axes that alternate, viscous and dry friction in every drive."""

import sys


def tree(joints: int) -> str:
    """The text of the model."""
    torso = min(2, joints)
    left = (joints - torso + 1) // 2
    parents = [i - 1 for i in range(joints)]
    if joints > torso + left:
        parents[torso + left] = torso - 1
    axes = ["z", "y", "x", "y"]
    origins = ["(0, 0, 0.3)", "(0.05, 0, 0.25)", "(0, 0.2, 0.1)", "(0.3, 0, 0.02)"]
    turns = ["", " turned (pi/2, 0, 0)", "", " turned (0, pi/2, 0)"]
    names = range(1, joints + 1)
    lines = [f"model Tree{joints} {{"]
    lines.append("    coordinate " + ", ".join(f"q{i} [rad]" for i in names) + ";")
    lines.append("    input " + ", ".join(f"tau{i} [N*m]" for i in names) + ";")
    lines.append("    mechanism {")
    lines.append("        gravity (0, 0, -9.81);")
    for i, parent in enumerate(parents):
        on = f" on l{parent + 1}" if parent >= 0 else ""
        place = f"about {axes[i % 4]} at {origins[i % 4]}{turns[i % 4]}"
        lines.append(f"        body l{i + 1}{on} {{ revolute q{i + 1} {place}; inertia parameters; }}")
    for i in names:
        lines.append(f"        drive q{i} by tau{i} with viscous, coulomb;")
    return "\n".join([*lines, "    }", "}", ""])


if __name__ == "__main__":
    sys.stdout.write(tree(int(sys.argv[1])))

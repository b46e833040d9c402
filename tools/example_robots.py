"""Writes docs/data/example-robots.csv: how each robot of the `example-robot-data` wheel loads, and what is wrong with it.

    .venv/bin/python tools/example_robots.py

Needs the wheel and Pinocchio. The documentation shows the table from the committed file, and so builds without them.
"""

from __future__ import annotations

import csv
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / "docs" / "data" / "example-robots.csv"
HEAD = ("file", "joints", "from Pinocchio", "loads", "faults found")
SHOWN = 3  # names; more are counted

# What a warning becomes: a pattern of its text, and the words of the table. `{n}` counts the links or joints it names.
FAULTS = (
    (r"an impossible inertia.*eigenvalue (\S+),", None),
    (r"no inertia is stated", "{n} without inertia, massless"),
    (r"radius of gyration (\S+) m, .* are (\S+) m apart", "radius of gyration {0} m in a size of {1} m: {names}"),
    (r"these are (.*?):", "{0}: {names}"),
    (r"the effort limits of (.*?):", "effort limits of {0}"),
    (r"dry friction of (\S+) (N m|N) holds", "dry friction of {0} {1}, not below the effort limit: {names}"),
    (r"position limits leave no room", "no range of motion given: {n}"),
    (r"position limits of (\S+) or more", "position limits of {0}: {n}"),
    (r"(velocity|effort) limit 0", "{0} limit 0: {n}"),
    (r"gear ratio (\S+) of its transmission", "reduction {0} without a motor: {n}"),
    (r"mimics another joint", "{n} mimic others"),
    (r"<dynamics (\S+)> is another", "<dynamics {0}> of another simulator: {n}"),
    (r"<gazebo> <(\w+)>", "<gazebo> {0}: {n}"),
    (r"tensor of inertia and no mass", "a tensor without mass: {names}"),
    (r"of 0, that of a point", "a tensor of 0: {n}"),
    (r"(\w+) = .*(millimetres for metres|degrees for radians)", "{0}, {1}?: {names}"),
    (r"<(\w+)> is not used: give", "<{0}> of a transmission: {n}"),
    (r"its joint .* does not exist", "{n} of joints that do not exist"),
    (r"text between its elements", "stray text: {names}"),
    (r"couples several joints", "a transmission of several joints"),
    (r"no <limit>", "no limits: {n}"),
    (r"its axis is not of length 1", "axis not of length 1: {n}"),
    (r"is not on the search path|is no \.stl", "{n} with meshes that are not found or read"),
    (r"capsule is not drawn", "{n} with capsules"),
    (r"moves? no mass", "joints that move no mass"),
)


def fault(warning: str) -> str | None:
    """A warning in the words of the table; None for those that are counted together."""
    for pattern, words in FAULTS:
        found = re.search(pattern, warning)
        if found is None:
            continue
        if words is None:
            return None
        who = warning[: found.start()]
        kind, names = who.partition(" ")[0], re.findall(r"'(.*?)'", who)
        shown = ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
        counted = f"{len(names)} {kind.removesuffix('s')}{'s' if len(names) != 1 else ''}"
        return words.format(*found.groups(), n=counted, names=shown)
    raise SystemExit(f"no words for this warning: {warning}")


def faults(warnings: tuple[str, ...]) -> str:
    """All that is wrong with a robot; nothing where nothing is."""
    impossible = [re.match(r"link '(.*?)'.*eigenvalue (\S+),", w) for w in warnings if "impossible inertia" in w]
    fault_texts = []
    if impossible:
        worst = min((found for found in impossible if found), key=lambda found: float(found[2]))
        more = f", and {len(impossible) - 1} more" if len(impossible) > 1 else ""
        fault_texts.append(f"impossible inertia: {worst[1]} (eigenvalue {worst[2]}){more}")
    fault_texts += [words for words in map(fault, warnings) if words is not None]
    return "; ".join(fault_texts)


def main() -> None:
    """Examines every robot and writes the table."""
    sys.path.insert(0, str(ROOT / "tests"))
    from reference.example_robots import examined, robot_files

    rows = []
    for name, path in robot_files().items():
        verdict = examined(path)
        if verdict.arm is None or verdict.error is None:
            rows.append((name, "", "", "refused", re.sub(r"^.*?\.urdf(:\d+)?: ", "", verdict.refused or "")))
            continue
        needs = ['mimic="independent"'] * verdict.mimic + ['on_impossible="warn"'] * verdict.impossible
        error = f"{verdict.error:.0e}" if verdict.error else "0"
        loads = " and ".join(f"with {need}" for need in needs) or "as it is"
        rows.append((name, verdict.arm.n, error, loads, faults(verdict.arm.warnings) or "none"))
        print(*rows[-1][:4])
    TABLE.parent.mkdir(exist_ok=True)
    with open(TABLE, "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEAD)
        writer.writerows(rows)
    agree = sum(bool(row[2]) and float(row[2]) <= 1e-9 for row in rows)
    print(f"{len(rows)} robots, {agree} agree with Pinocchio; wrote {TABLE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()

"""`armwright assemble`: an arm from modules; or all arms that a set of modules makes, and the best one for a task."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import armwright as aw
from armwright.cli.arguments import argument, flag, option, output_option
from armwright.cli.outcome import TOML, check_file, say_notes
from armwright.cli.tables import console_for_tables, number, table
from armwright.errors import ScenarioError
from armwright.progress import progress

ENDINGS = (".toml", ".csv")


def assemble(
    assembly: str | None = argument("[FILE.assembly.toml]", "An assembly's file, or the name of a built-in one.", None),
    output: Path | None = output_option(
        "FILE", "ARM.toml, the arm; with --all a list as .csv, or the best arm as .toml."
    ),
    every: bool = flag("--all", "List all arms that the connectors allow instead."),
    modules: str | None = option("FILE", "With --all: a module library's file, or the name of a built-in one."),
    task: Path | None = option("FILE", "With --all: rank them by how well they do the task in this file."),
    max_joints: int = option("N", "With --all: most joints of an arm.", 6, show_default=True),
    min_joints: int = option("N", "With --all: fewest joints of an arm.", 1, show_default=True),
    max_links: int = option("N", "With --all: how many modules without joints in a row.", 1, show_default=True),
    limit: int = option("N", "With --all: how many are computed.", 1000, names="--max-assemblies", show_default=True),
    show: int = option("N", "With --all: how many are printed.", 20, show_default=True),
) -> None:
    """Put modules together, check that they fit, and write the resulting arm.

    Every number of the arm keeps its source, which names the module. Without -o the arm is only shown.

    With --all no assembly is needed: every chain that the connectors allow is listed, with mass, reach and the payload
    at the worst pose, held at rest; with --task the arms that reach its poses with its payload in its time come first.

    \b
    Examples:
      armwright assemble lwa4p.assembly.toml -o arm.toml
      armwright assemble --all --modules improv --max-joints 4 --max-assemblies 100
      armwright assemble --all --modules improv --min-joints 6 --task pick.task.toml -o best.toml
    """
    if every == (assembly is not None):
        what = "--all and a file given" if every else "neither a file nor --all given"
        raise ScenarioError(what, place="assemble", expected="FILE.assembly.toml, or --all --modules FILE")
    check_file(output, ENDINGS if every else TOML)
    if assembly is not None:
        _one(assembly, output, unused={"--modules": modules, "--task": task})
    elif modules is None:
        raise ScenarioError(place="assemble --all", expected="--modules FILE, or the name of a built-in library")
    else:
        rules = {"max_joints": max_joints, "min_joints": min_joints, "max_links": max_links, "limit": limit}
        _all(modules, task, rules, output, show)


def _one(source: str, output: Path | None, unused: dict[str, Any]) -> None:
    from armwright.description.writer import write_toml
    from armwright.kinematics.reach import reach
    from armwright.model import build_model

    for name, value in unused.items():
        if value is not None:
            raise ScenarioError("goes with --all, not with a file", place=f"assemble {name}")
    record = aw.modules.assemble(source, folder=None if output is None else output.parent)
    arm = build_model(record)
    if output is not None:
        write_toml(record, output)
    console = console_for_tables()
    far = f", reach {number(reach(arm))} m to {arm.tip}" if arm.tip is not None else ""
    console.print(f"{arm.name}: {arm.n} joints, {number(record.total_mass)} kg{far}", style="bold")
    rows = []
    for body in arm.bodies:
        limits = (body.limits.torque, body.limits.velocity)
        rows.append([body.joint, body.link, number(body.mass), number(body.drive.gear_ratio), *map(number, limits)])
    heads = ("joint", "moves", "mass behind it [kg]", "gear", "torque ≤ [N m | N]", "velocity ≤ [rad/s | m/s]")
    shown = table("", heads, rows, left=("moves",))
    if output is None and shown is not None:
        console.print(shown)
    if output is not None:
        console.print(f"wrote {output}")
    say_notes(arm.warnings)


def _all(modules: str, task: Path | None, rules: dict[str, int], output: Path | None, show: int) -> None:
    from armwright.description.writer import write_toml

    library = aw.modules.read_modules(modules)
    wanted = None if task is None else aw.modules.read_task(task)
    if output is not None and output.suffix == ".toml" and wanted is None:
        raise ScenarioError("an arm as .toml needs --task FILE to find the best", file=output, expected=".csv")
    with progress(f"{library.name}: assembling") as tell:
        if wanted is None:
            result = aw.modules.enumerate_assemblies(library, **rules, progress=tell)
            best, open_ = result.candidates[0].assembly, result.total
        else:
            result = aw.modules.rank_assemblies(library, wanted, **rules, progress=tell)
            if not result.ranked:
                what = f"none of the {result.total} arms is long enough for its furthest pose"
                raise ScenarioError(what, place=wanted.name)
            best, open_ = result.ranked[0].assembly, result.long_enough
            if output is not None and output.suffix == ".toml" and not result.ranked[0].feasible:
                what = f"no arm does it; the best, {best.name}: {result.ranked[0].why_not}"
                raise ScenarioError(what, place=wanted.name)
        if output is not None and output.suffix == ".toml":
            write_toml(aw.modules.assemble(best, [library]), output)
        elif output is not None:
            result.save(output)
    console = console_for_tables()
    (found,) = result.tables()
    rows = found.cells
    console.print(replace(found, title=f"{library.name}: {found.title}", cells=rows[: max(show, 0)]))
    if len(rows) > show > 0:
        console.print(f"… and {len(rows) - show} more (--show {len(rows)}, or -o FILE.csv)")
    if open_ < result.total:
        console.print(f"{result.total - open_} are too short for the furthest pose")
    if len(rows) < open_:
        order = "others" if task is not None else "longer ones"
        console.print(f"{open_ - len(rows)} {order} were not computed (--max-assemblies {rules['limit']})")
    say_notes(f"module {name} is left out: {reason}" for name, reason in result.left_out.items())
    if output is not None:
        console.print(f"wrote {output}")

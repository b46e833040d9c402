"""The saved numbers as tables: on the terminal and in Markdown, the same cells. Nothing is run here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from records import Record
from rich.console import Console
from rich.table import Table

Saved = dict[str, Any]  # machine, repetitions, chapters: their rows and notes


@dataclass(frozen=True)
class Column:
    """A column: its head, and a record's cell in it, "" where the record has none."""

    head: str
    cell: Callable[[Record], str]
    left: bool = False


def label(head: str, key: str) -> Column:
    """Column of a label of the rows."""
    return Column(head, lambda r: str(r["labels"].get(key, "")), left=key in LEFT)


LEFT = ("arm", "work", "form", "between")  # words, not numbers


def time(head: str, column: str) -> Column:
    """Median, and in brackets the least; a failed check stands in place of both."""
    return Column(head, lambda r: _time(r["timings"].get(column)))


def ratio(head: str, column: str) -> Column:
    """A peer's time over ours: median, and the least and most of the repetitions; what is wanted of it, if anything."""

    def cell(r: Record) -> str:
        found = r["ratios"].get(column)
        if found is None or not r["checked"]:
            return ""
        wanted = found.get("expected")
        verdict = "" if wanted is None else f" {'✓' if found['median'] >= wanted else '✗'} ≥ {wanted:g}"
        spread = f"{number(found['lowest'])}–{number(found['highest'])}"
        return f"{number(found['median'])} ({spread}){verdict}"

    return Column(head, cell)


def share(head: str, key: str, judged: bool = True) -> Column:
    """Of the machine's limit; whether it is as much as is wanted, if anything is and it is `judged`."""

    def cell(r: Record) -> str:
        if key not in r["facts"]:
            return ""
        of, wanted = r["facts"][key], r["facts"].get("wanted") if judged else None
        verdict = "" if wanted is None else f" {'✓' if of >= wanted else '✗'} ≥ {100 * wanted:.0f}"
        return f"{100 * of:.0f} %{verdict}"

    return Column(head, cell)


def fact(head: str, key: str, shown: Callable[[Any], str]) -> Column:
    return Column(head, lambda r: shown(r["facts"][key]) if key in r["facts"] else "")


def worst(head: str) -> Column:
    """The check that came nearest to failing."""

    def cell(r: Record) -> str:
        checks = list(r["timings"].values())
        found = max(checks, key=lambda c: c["error"] / c["tolerance"] if c["error"] == c["error"] else float("inf"))
        return f"{found['error']:.0e} {'≤' if found['passed'] else 'not ≤'} {found['tolerance']:.0e}"

    return Column(head, cell)


def number(value: float) -> str:
    """Three digits or so."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.1f}" if value >= 1 else f"{value:.2f}"


def _time(timing: Record | None) -> str:
    if timing is None:
        return ""
    if not timing["passed"]:
        return f"FAILED: {timing['error']:.1e} not ≤ {timing['tolerance']:.0e}"
    return f"{number(timing['median'])} ({number(timing['best'])})"


def _plan(head: str, column: str) -> Column:
    """Median time of all points together [ms], in brackets the least, and whether the median is as little as is wanted."""

    def cell(r: Record) -> str:
        timing = r["timings"].get(column)
        if timing is None or not timing["passed"]:
            return _time(timing)
        median, best = (1e-6 * timing[key] * r["labels"]["points"] for key in ("median", "best"))
        most = r["facts"].get("at_most", {}).get(column)
        verdict = "" if most is None else f" {'✓' if median <= most else '✗'} ≤ {most:g}"
        return f"{number(median)} ({number(best)}){verdict}"

    return Column(head, cell)


def _whole(head: str) -> Column:
    """Seconds of all the work, and whether they are as few as is wanted, if anything is."""

    def cell(r: Record) -> str:
        seconds, most = r["facts"].get("seconds"), r["facts"].get("wanted")
        if seconds is None:
            return ""
        return number(seconds) + ("" if most is None else f" {'✓' if seconds <= most else '✗'} ≤ {most:g}")

    return Column(head, cell)


def _least(head: str, part: str) -> Column:
    """The best of the samples, and whether it is as little as is wanted, if anything is."""

    def cell(r: Record) -> str:
        timing = r["timings"].get(part)
        if timing is None or not timing["passed"]:
            return _time(timing)
        most = r["facts"].get("at_most", {}).get(part)
        verdict = "" if most is None else f" {'✓' if timing['best'] <= most else '✗'} ≤ {most:g}"
        return f"{number(timing['best'])}{verdict}"

    return Column(head, cell)


CHAPTERS: dict[str, tuple[str, tuple[Column, ...]]] = {
    "kernels": (
        "Kernels, ns per state",
        (
            *(label("arm", "arm"), label("joints", "joints"), label("kernel", "work"), time("ours, batch", "batch")),
            *(time("Pinocchio C++", "pinocchio_loop"), ratio("Pinocchio C++ ÷ ours", "pinocchio_loop")),
            *(time("MuJoCo", "mujoco"), ratio("MuJoCo ÷ ours", "mujoco")),
            *(time("ours, one call, bound", "bound"), time("plain", "plain")),
            *(time("Pinocchio from Python", "pinocchio_python"), ratio("from Python ÷ bound", "pinocchio_python")),
            fact("operations", "slots", str),
            *(
                fact("at the machine's limit", "limit", number),
                share("of the limit", "of_slots"),
                share("as flops", "of_flops", judged=False),
            ),
            worst("error"),
        ),
    ),
    "calls": (
        "One call, from Python, ns per call",
        (
            *(label("arm", "arm"), label("joints", "joints"), label("kernel", "work"), label("states", "states")),
            *(time("plain", "plain"), time("Pinocchio", "pinocchio_python")),
            *(ratio("Pinocchio ÷ plain", "pinocchio_python"), time("bound", "bound"), ratio("bound ÷ plain", "bound")),
            *(time("held before its first call", "held"), ratio("held ÷ plain", "held")),
            *(time("general path", "general"), ratio("general ÷ plain", "general"), worst("error")),
        ),
    ),
    "variants": (
        "Other forms of the kernels of puma560, ns per state",
        (
            *(label("kernel", "work"), label("form", "form"), time("this form", "variant")),
            *(time("the usual", "usual"), ratio("usual ÷ this", "usual")),
            *(time("Pinocchio C++", "pinocchio_loop"), ratio("Pinocchio C++ ÷ ours", "pinocchio_loop"), worst("error")),
        ),
    ),
    "simulation": (
        "Simulation, ns per step",
        (
            *(label("work", "work"), label("form", "form"), label("lanes", "lanes"), time("ours", "ours")),
            *(
                time("MuJoCo Euler", "Euler"),
                ratio("Euler ÷ ours", "Euler"),
                time("MuJoCo RK4", "RK4"),
                ratio("RK4 ÷ ours", "RK4"),
            ),
            worst("error"),
        ),
    ),
    "auto": (
        "Price of steps of their own choice, of a step by hand and of sticking, ns for a simulated ms",
        (
            *(label("arm", "arm"), label("work", "work"), label("lanes", "lanes"), time("rk3, 1 ms", "rk3")),
            *(time("auto", "auto"), ratio("auto ÷ rk3", "auto")),
            *(time("without the note of a coarse step", "unnoted"), ratio("rk3 ÷ without", "rk3")),
            *(time("rk3, sticking", "sticking"), ratio("sticking ÷ rk3", "sticking"), worst("error")),
        ),
    ),
    "stiff": (
        "Stiff arms at equal error, ns for a simulated ms",
        (
            *(label("arm", "arm"), label("work", "work"), label("lanes", "lanes"), time("ours, rodas3", "ours")),
            *(time("MuJoCo implicitfast", "implicitfast"), ratio("implicitfast ÷ ours", "implicitfast")),
            *(time("CVODES", "cvodes"), ratio("CVODES ÷ ours", "cvodes"), worst("error")),
        ),
    ),
    "control": (
        "Sampled control, ns per step",
        (
            *(label("work", "work"), label("lanes", "lanes"), time("ours", "ours")),
            *(
                time("MuJoCo Euler", "Euler"),
                ratio("Euler ÷ ours", "Euler"),
                time("MuJoCo RK4", "RK4"),
                ratio("RK4 ÷ ours", "RK4"),
            ),
            worst("error"),
        ),
    ),
    "closed loops": (
        "Closed loops of lwa4p as a tuning runs them, ns a lane and tick",
        (
            *(label("work", "work"), label("lanes", "lanes"), label("threads", "threads"), time("ours", "ours")),
            *(fact("price", "price", number), _whole("all of them, s"), time("MuJoCo Euler", "Euler")),
            *(ratio("Euler ÷ ours", "Euler"), worst("error")),
        ),
    ),
    "batch size": (
        "Batch size, ns per state",
        (
            *(label("kernel", "work"), label("states", "states"), time("ours", "batch")),
            *(time("Pinocchio C++", "pinocchio_loop"), ratio("Pinocchio C++ ÷ ours", "pinocchio_loop"), worst("error")),
        ),
    ),
    "large results": (
        "Results larger than the cache, ns per state",
        (
            *(label("arm", "arm"), label("kernel", "work"), label("bytes a state", "bytes"), label("states", "states")),
            *(time("few", "few"), time("1024", "some"), time("many", "many"), time("a fill of as many bytes", "fill")),
            *(ratio("few ÷ many", "few"), ratio("fill ÷ many", "fill")),
            *(time("4096, plain", "plain"), ratio("again ÷ plain", "again"), worst("error")),
        ),
    ),
    "gpu": (
        "A GPU beside this processor, ns per state",
        (
            *(label("arm", "arm"), label("kernel", "work"), label("numbers", "form"), label("states", "states")),
            *(time("one thread", "one"), time("all threads", "threads"), time("GPU", "gpu"), time("copied", "copied")),
            *(ratio("one thread ÷ GPU", "one"), ratio("all threads ÷ GPU", "threads")),
            fact("same bits", "same", lambda share: f"{100 * share:.4g} %"),
            *(fact("bytes a state", "bytes", number), worst("error")),
        ),
    ),
    "threads": (
        "Threads, ns per state",
        (
            *(label("work", "work"), label("threads", "threads"), time("ours", "threads")),
            *(ratio("times as fast as one", "one"), ratio("bare multiply-adds beside it", "bare one"), worst("error")),
        ),
    ),
    "between": (
        "A batch between other work, ns per state",
        (
            *(label("kernel", "work"), label("states", "states"), label("between", "between")),
            *(time("by default", "default"), time("one thread", "one"), time("all threads", "all")),
            fact("default ÷ best", "times of the best", number),
            worst("error"),
        ),
    ),
    "start": (
        "From nothing to a result, ms",
        (
            *(
                label("work", "work"),
                _least("all", "all"),
                _least("load", "load"),
                _least("kernel", "kernel"),
            ),
            *(_least(f"import {name}", f"import {name}") for name in ("numpy", "casadi", "llvmlite", "pydantic")),
            worst("error"),
        ),
    ),
    "commands": (
        "Commands, ms of CPU",
        (
            label("work", "work"),
            *(_least(name, name) for name in ("all", "import packages", "above packages")),
            worst("error"),
        ),
    ),
    "identification": (
        "Normal equations of a log's states, ns per state",
        (
            *(label("arm", "arm"), label("work", "work"), label("states", "states"), time("ours", "ours")),
            *(time("triangular factor", "factor"), ratio("triangular factor ÷ ours", "factor")),
            time("Pinocchio's regressor from Python", "pinocchio_python"),
            *(ratio("Pinocchio ÷ ours", "pinocchio_python"), worst("error")),
        ),
    ),
    "ik": (
        "Inverse kinematics, ns per pose",
        (
            *(label("arm", "arm"), label("work", "work"), label("poses", "states"), time("ours", "ours")),
            *(time("ours, for AVX2", "avx2"), time("ours, by default", "default")),
            *(time("EAIK", "eaik"), ratio("EAIK ÷ ours", "eaik")),
            *(time("Robotics Toolbox C++, tol 1e-6", "toolbox"), ratio("tol 1e-6 ÷ ours", "toolbox")),
            *(time("tol 1e-16", "toolbox fine"), ratio("tol 1e-16 ÷ ours", "toolbox fine")),
            fact("iterations, mean", "iterations", number),
            fact("solved from the first start", "first start", "{:.1%}".format),
            worst("error"),
        ),
    ),
    "planning": (
        "Planning of motions, ms a plan",
        (
            *(label("arm", "arm"), label("joints", "joints"), label("work", "work"), label("points", "points")),
            *(_plan("ours", "ours"), _plan("toppra", "toppra"), ratio("toppra ÷ ours", "toppra")),
            _plan("SciPy's spline alone", "scipy"),
            fact("our motion, s", "motion", "{:.4g}".format),
            fact("toppra's motion, s", "toppra's motion", "{:.4g}".format),
            worst("error"),
        ),
    ),
    "compile": (
        "Tracing and compiling with a cold cache, ms",
        (
            *(label("arm", "arm"), label("kernel", "work"), label("operations", "operations"), _least("all", "all")),
            worst("error"),
        ),
    ),
}
PER_JOINT = "Cost per joint, ns per state and joint"


def heading(saved: Saved) -> str:
    machine = saved["machine"]
    return f"{machine['processor']} ({machine['cpu']}), Python {machine['versions']['python']}, {machine['date']}"


def about(saved: Saved) -> list[str]:
    """Origin of the numbers, in sentences."""
    machine = saved["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items() if version is not None)
    load = "" if machine["load"] is None else f"; load average when it began {machine['load'][0]:g}"
    return [
        f"{machine['system']}, {machine['processors']} processors on {machine['cores'] or '?'} cores: "
        f"{machine['topology']}{load}",
        f"{versions}; commit {machine['commit']}",
        f"times: median of {saved['repetitions']} samples taken in turns, the least in brackets; ratio: median of neighbouring "
        "samples, the lowest and highest in brackets",
    ]


def tables(saved: Saved) -> Iterator[tuple[str, list[str], list[list[str]], list[str], list[bool]]]:
    """Of every chapter that has rows: title, heads, cells, notes, and which columns stand at the left."""
    for chapter, (title, columns) in CHAPTERS.items():
        rows = saved["chapters"].get(chapter, {}).get("rows", [])
        if rows:
            cells = [[column.cell(row) for column in columns] for row in rows]
            used = [k for k in range(len(columns)) if any(line[k] for line in cells)]  # a peer that is not there
            heads = [columns[k].head for k in used]
            notes = saved["chapters"][chapter]["notes"] + (_sharing(rows) if chapter == "threads" else [])
            notes = _another_day(saved["chapters"][chapter]) + notes
            yield title, heads, [[line[k] for k in used] for line in cells], notes, [columns[k].left for k in used]
        if chapter == "kernels":
            yield from _per_joint(rows)


def _another_day(chapter: dict[str, Any]) -> list[str]:
    """Date of a chapter that is not of the same run as the others."""
    if "machine" not in chapter:
        return []
    machine = chapter["machine"]
    load = "" if machine["load"] is None else f", load average when it began {machine['load'][0]:g}"
    of = f"{DATED}{machine['date']}, commit {machine['commit']}, on a machine of the same kind{load}"
    return [f"{of}; median of {chapter['repetitions']} samples"]


DATED = "measured on "  # how the note begins


def _sharing(rows: list[Record]) -> list[str]:
    """Speed-up by a second thread of pure arithmetic, which tells hyper-threads from cores better than any system does."""
    bare = [row for row in rows if row["labels"]["arm"] == "" and row["labels"]["threads"] == 2 and row["ratios"]]
    if not bare:
        return []
    times = bare[0]["ratios"]["one"]["median"]
    verdict = (
        "they share one core's ports" if times < SHARED else "the cores are their own" if times > OWN else "unclear"
    )
    return [f"measured: two threads do {number(times)} times the fused multiply-adds of one: {verdict}"]


SHARED, OWN = 1.3, 1.7  # times as fast


def _per_joint(rows: list[Record]) -> Iterator[tuple[str, list[str], list[list[str]], list[str], list[bool]]]:
    """Ours and the peers on the random chains: how the cost of a joint grows with their number."""
    chains = [row for row in rows if row["labels"]["arm"].startswith("chain-") and row["checked"]]
    sizes = sorted({row["labels"]["joints"] for row in chains})
    if len(sizes) < 2:
        return
    cells = []
    for work in dict.fromkeys(row["labels"]["work"] for row in chains):
        for who, column in (("ours", "batch"), ("Pinocchio C++", "pinocchio_loop"), ("MuJoCo", "mujoco")):
            costs = {
                row["labels"]["joints"]: row["timings"][column]["median"] / row["labels"]["joints"]
                for row in chains
                if row["labels"]["work"] == work and column in row["timings"]
            }
            if len(costs) > 1:
                growth = costs[max(costs)] / costs[min(costs)]
                cells.append([work, who, *(number(costs[n]) if n in costs else "" for n in sizes), number(growth)])
    heads = ["kernel", "who", *(f"{n} joints" for n in sizes), "most joints ÷ fewest"]
    yield PER_JOINT, heads, cells, [], [True, True, *(False for _ in range(len(sizes) + 1))]


def markdown(saved: Saved) -> str:
    """All tables."""
    parts = [f"# {heading(saved)}", "\n".join(f"- {line}" for line in about(saved))]
    for title, heads, cells, notes, left in tables(saved):
        ruler = [":---" if at_left else "---:" for at_left in left]
        lines = [f"| {' | '.join(line)} |" for line in (heads, ruler, *cells)]
        parts += [f"## {title}", "\n".join(lines)]
        parts += ["\n".join(f"- {note}" for note in notes)] if notes else []
    return "\n\n".join(parts) + "\n"


def show(saved: Saved, console: Console) -> None:
    """All tables on the terminal."""
    console.print(f"[bold]{heading(saved)}[/bold]", highlight=False)
    for line in about(saved):
        console.print(f"- {line}", soft_wrap=True, highlight=False)
    for title, heads, cells, notes, left in tables(saved):
        table = Table(title=title, title_justify="left")
        for head, at_left in zip(heads, left, strict=True):
            table.add_column(head, justify="left" if at_left else "right")
        before = None
        for line in cells:
            if before not in (None, line[0]):
                table.add_section()
            before = line[0]
            table.add_row(*line)
        console.print()
        console.print(table)
        for note in notes:
            console.print(f"- {note}", soft_wrap=True, highlight=False)

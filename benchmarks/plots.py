"""Pictures of saved numbers: cost against joints, batch size and threads.

python benchmarks/plots.py [RESULT.json] [FOLDER]      by default the newest result, into docs/images
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from records import Record
from report import Saved, heading

RESULTS = Path(__file__).with_name("results")
IMAGES = Path(__file__).parents[1] / "docs" / "images"
# Okabe and Ito's colours, which colour-blind readers tell apart; and a marker and a dash each, for prints without colour
WHO = {
    "ours": ("#0072B2", "o", "-"),
    "Pinocchio C++": ("#D55E00", "s", "--"),
    "MuJoCo": ("#009E73", "^", "-."),
}
WORKS = {
    "inverse_dynamics": ("#0072B2", "o", "-"),
    "mass_matrix": ("#E69F00", "D", "--"),
    "forward_dynamics": ("#009E73", "^", "-."),
    "inverse_dynamics_derivatives": ("#CC79A7", "v", ":"),
}
INK = "#777777"  # seen on white and on black
ON_ANY_PAPER = dict.fromkeys(
    ("text.color", "axes.labelcolor", "axes.edgecolor", "axes.titlecolor", "xtick.color", "ytick.color"), INK
)
JOINTS = ("inverse_dynamics", "mass_matrix", "forward_dynamics")


def main(arguments: list[str]) -> int:
    results = sorted(RESULTS.glob("*.json"))
    if not arguments and not results:
        print(f"{RESULTS}: no result is saved; python benchmarks/run.py --save makes one", file=sys.stderr)
        return 2
    source = Path(arguments[0]) if arguments else results[-1]
    for path in draw(json.loads(source.read_text(encoding="utf-8")), Path(arguments[1]) if arguments[1:] else IMAGES):
        print(path)
    return 0


def draw(saved: Saved, folder: Path) -> list[Path]:
    """The pictures as PNG files, each under 150 kB."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, drawn in (("joints", joints), ("batch", batch_sizes), ("threads", threads)):
        with matplotlib.rc_context(ON_ANY_PAPER):
            figure = drawn(saved, pyplot)
        for axes in figure.axes:
            axes.grid(True, which="major", color="#99999955", linewidth=0.6)
            axes.spines[["top", "right"]].set_visible(False)
        figure.suptitle(heading(saved), fontsize=8, color=INK, x=0.01, ha="left")
        path = folder / f"bench-{name}.png"
        figure.savefig(path, dpi=110, transparent=True)
        pyplot.close(figure)
        paths.append(path)
    return paths


def joints(saved: Saved, pyplot: Any) -> Any:
    """Random chains: ns a state against their joints, three kernels."""
    figure, every = pyplot.subplots(1, 3, figsize=(10, 3.8), sharey=True, layout="constrained")
    rows = [row for row in _rows(saved, "kernels") if row["labels"]["arm"].startswith("chain-")]
    for axes, work in zip(every, JOINTS, strict=True):
        lines = {who: _line(rows, "joints", column, work) for who, column in _columns().items()}
        for who, points in lines.items():
            _plot(axes, points, WHO[who], who)
        axes.set(xscale="log", yscale="log", xlabel="joints", title=work.replace("_", " "))
        ticks = sorted({x for points in lines.values() for x, _ in points})
        axes.set_xticks(ticks, [str(n) for n in ticks])
        axes.minorticks_off()
    every[0].set_ylabel("ns a state")
    handles, names = every[2].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    return figure


def batch_sizes(saved: Saved, pyplot: Any) -> Any:
    """ns a state against the states of a call from Python, the peer's loop beside the first."""
    figure, axes = pyplot.subplots(figsize=(6.5, 4.4), layout="constrained")
    rows = _rows(saved, "batch size")
    for work, style in WORKS.items():
        _plot(axes, _line(rows, "states", "batch", work), style, work.replace("_", " "))
    peer = _line(rows, "states", "pinocchio_loop", "inverse_dynamics")
    _plot(axes, peer, ("#D55E00", "s", "--"), "inverse dynamics, Pinocchio C++")
    axes.set(xscale="log", yscale="log", xlabel="states a call", ylabel="ns a state", title="puma560, one thread")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure


def threads(saved: Saved, pyplot: Any) -> Any:
    """Speed-up over one thread."""
    figure, axes = pyplot.subplots(figsize=(5.5, 4.4), layout="constrained")
    rows = [row for row in _rows(saved, "threads") if "one" in row["ratios"]]
    limit = [row for row in rows if row["labels"]["work"] not in WORKS]
    counts = sorted({row["labels"]["threads"] for row in rows})
    axes.plot(counts, counts, color="#999999", linewidth=0.8, label="as many times as threads")
    series: Iterator[tuple[list[Record], tuple[str, str, str], str]] = iter(
        [
            (limit, (INK, "s", "--"), "fused multiply-adds, nothing else"),
            *(
                ([r for r in rows if r["labels"]["work"] == w], style, w.replace("_", " "))
                for w, style in WORKS.items()
            ),
        ]
    )
    for found, style, name in series:
        _plot(axes, [(r["labels"]["threads"], r["ratios"]["one"]["median"]) for r in found], style, name)
    states = max((row["labels"]["states"] for row in rows), default=0)
    axes.set(xlabel="threads", ylabel="times as fast as one", xticks=counts, title=f"puma560, batches of {states:,}")
    axes.set_ylim(bottom=0)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return figure


def _columns() -> dict[str, str]:
    return {"ours": "batch", "Pinocchio C++": "pinocchio_loop", "MuJoCo": "mujoco"}


def _rows(saved: Saved, chapter: str) -> list[Record]:
    return [row for row in saved["chapters"].get(chapter, {}).get("rows", []) if row["checked"]]


def _line(rows: list[Record], key: str, column: str, work: str) -> list[tuple[float, float]]:
    chosen: Callable[[Record], bool] = lambda row: row["labels"]["work"] == work and column in row["timings"]  # noqa: E731
    return sorted((row["labels"][key], row["timings"][column]["median"]) for row in rows if chosen(row))


def _plot(axes: Any, points: list[tuple[float, float]], style: tuple[str, str, str], name: str) -> None:
    if points:
        colour, marker, dash = style
        axes.plot(*zip(*points, strict=True), color=colour, marker=marker, linestyle=dash, markersize=4, label=name)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""The README's short table, between its marks, from saved numbers."""

from __future__ import annotations

import os
from pathlib import Path

from records import Record
from report import Saved

README = Path(__file__).parents[1] / "README.md"
MARKS = "<!-- speed -->", "<!-- /speed -->"
VECTORS = {8: "AVX-512", 4: "AVX2", 2: "128 bits"}
NARROW = "x86-64-v3"
PROCESSORS = {"znver4": "Zen 4", "znver3": "Zen 3", "emeraldrapids": "Emerald Rapids"}  # LLVM's name: as people say it
WORKS = {
    "inverse_dynamics": "inverse dynamics, batch of 4096",
    "forward_dynamics": "forward dynamics",
    "mass_matrix": "mass matrix",
    "inverse_dynamics_derivatives": "derivatives of inverse dynamics",
    "forward_dynamics_derivatives": "derivatives of forward dynamics",
}
INTEGRATORS = {"Euler": "`cmu-dd` with motors, RK3 step, 1,000 lanes", "RK4": "the same"}


def speed_table(saved: Saved) -> str:
    """Ours on this processor and for AVX2, beside the peers; rows without a peer's loop are left out."""
    rows = [_kernel(saved, work, title) for work, title in WORKS.items()]
    rows += [_simulation(saved, integrator, title) for integrator, title in INTEGRATORS.items()]
    machine = saved["machine"]
    on = PROCESSORS.get(machine["cpu"], machine["cpu"])
    wide = f"{VECTORS.get(machine['width'], 'all')} on {on}"
    head = ["work, 6 joints", f"Armwright, {wide}", "ratio", f"AVX2 on {on}", "ratio", "peer"]
    lines = [f"| {' | '.join(line)} |" for line in [head, *filter(None, rows)]]
    return "\n".join([lines[0], f"|---|{'---:|' * 5}", *lines[1:]])


def update(saved: Saved, path: Path = README) -> Path:
    """The file with the table between its marks.

    Raises:
        ValueError: the marks are not there.
    """
    text = path.read_text(encoding="utf-8")
    before, first, rest = text.partition(MARKS[0])
    _, second, behind = rest.partition(MARKS[1])
    if not (first and second):
        raise ValueError(f"{path}: expected the marks {' and '.join(MARKS)}")
    part = path.with_name(path.name + ".part")
    part.write_text(f"{before}{first}\n\n{speed_table(saved)}\n\n{second}{behind}", encoding="utf-8")
    os.replace(part, path)
    return path


def _kernel(saved: Saved, work: str, title: str) -> list[str]:
    usual = _row(saved, "kernels", arm="puma560", work=work)
    narrow = _row(saved, "variants", work=work, form=NARROW)
    return _line(f"`puma560` {title}", "Pinocchio C++", "pinocchio_loop", (usual, "batch"), (narrow, "variant"))


def _simulation(saved: Saved, integrator: str, title: str) -> list[str]:
    usual = _row(saved, "simulation", work="RK3, final state", form="this processor")
    narrow = _row(saved, "simulation", work="RK3, final state", form=NARROW)
    return _line(title, f"MuJoCo {integrator}", integrator, (usual, "ours"), (narrow, "ours"))


def _line(title: str, who: str, column: str, *ours: tuple[Record | None, str]) -> list[str]:
    usual = ours[0][0]
    if usual is None or column not in usual["ratios"]:
        return []
    cells = [title]
    for k, (row, own) in enumerate(ours):
        if row is None or column not in row["ratios"]:
            cells += ["", ""]
            continue
        times = f"{row['ratios'][column]['median']:.0f}×"
        cells += [_short(row["timings"][own]["median"]), times if k else f"**{times}**"]
    return [*cells, f"{who} {usual['timings'][column]['median']:.0f}"]


def _short(nanoseconds: float) -> str:
    return f"{nanoseconds:.1f}" if nanoseconds < 50 else f"{nanoseconds:.0f}"


def _row(saved: Saved, chapter: str, **labels: str) -> Record | None:
    rows = saved["chapters"].get(chapter, {}).get("rows", [])
    return next((row for row in rows if labels.items() <= row["labels"].items()), None)

"""HTML for notebooks of an arm, a compiled arm or a scenario: a small picture beside tables, for light and dark pages."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from html import escape
from math import degrees, isfinite
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ArmwrightError
from armwright.kernels.compiled import CompiledArm
from armwright.model import Model
from armwright.output import working_folder
from armwright.pictures.png import write_png
from armwright.pictures.posed_arm import posed_arm
from armwright.printable import printable
from armwright.simulation.scenario import Scenario

SIZE = 260  # pixels of the picture's longer side
MANY = 60  # visuals of an arm that is drawn as a figure of its joints: a cell should not wait for a picture
STYLE = (
    "<style>.armwright{display:flex;flex-wrap:wrap;gap:12px 20px;align-items:flex-start;color:inherit}"
    ".armwright img{border-radius:8px;background:#fff}.armwright table{border-collapse:collapse}"
    ".armwright th,.armwright td{padding:2px 12px 2px 0;text-align:left;border:0;background:none;color:inherit}"
    ".armwright th{font-weight:600;opacity:.75}</style>"
)


def html_of(thing: Any) -> str:
    """HTML of an arm, a compiled arm or a scenario."""
    if isinstance(thing, Scenario):
        return _page(thing.arm.name, "scenario", _scenario(thing), thing.arm, _start(thing))
    if isinstance(thing, CompiledArm):
        return _page(thing.arm.name, "compiled arm", _compiled(thing), thing.arm)
    title = "" if thing.description is None else thing.description.title or ""
    return _page(thing.name, title, _joints(thing), thing)


def _page(name: str, about: str, tables: str, arm: Model, q: tuple[float, ...] | None = None) -> str:
    picture = _picture(arm, q)
    image = (
        f'<img alt="{_text(arm.name)}" width="{SIZE * 2 // 3}" src="data:image/png;base64,{picture}">'
        if picture
        else ""
    )
    return f'{STYLE}<div class="armwright">{image}<div><b>{_text(name)}</b> {_text(about)}{tables}</div></div>'


@lru_cache(maxsize=16)
def _picture(arm: Model, q: tuple[float, ...] | None) -> str:
    """A PNG as base64; nothing where the arm cannot be drawn, as a notebook's cell should show the rest."""
    description = arm.description
    if description is not None and sum(len(link.visuals) for link in description.links) > MANY:
        arm = replace(arm, description=None)
    try:
        with working_folder() as folder:
            path = folder / "arm.png"
            write_png(posed_arm(arm, None if q is None else list(q)), path, SIZE)
            return base64.b64encode(path.read_bytes()).decode("ascii")
    except ArmwrightError:
        return ""


def _joints(arm: Model) -> str:
    rows = []
    for body in arm.coordinates:
        drive, angle = body.drive, not body.kind.units.linear
        low, high = (degrees(float(limit)) if angle else float(limit) for limit in body.limits.position)
        place = f"{low:.4g} … {high:.4g} {'°' if angle else 'm'}" if isfinite(low) or isfinite(high) else "no limits"
        gear = f"{float(drive.gear_ratio):.5g}" if drive.gear_ratio is not None else ""
        rows.append([body.joint, body.kind.name, place, drive.command, gear])
    return _table(("joint", "type", "position", "driven by", "gear ratio"), rows)


def _compiled(dyn: CompiledArm) -> str:
    about = {
        "made for": f"{dyn.target.cpu}, {dyn.target.width} states at once, {dyn.dtype}",
        "threads": str(dyn.threads),
        "varied": ", ".join(dyn.varied.names) if dyn.varied is not None else "",
    }
    return _facts(about) + _joints(dyn.arm)


def _scenario(scenario: Scenario) -> str:
    loop, driven = scenario.loop, "Simulation.step"
    if scenario.command is not None:
        driven = type(scenario.command).__name__ if hasattr(scenario.command, "t") else "constant commands"
    if loop is not None and loop.controller is not None:
        driven = f"{type(loop.controller).__name__}, every {1e3 * scenario.tick:g} ms"
    about = {
        "driven by": driven,
        "duration": "" if scenario.duration is None else f"{scenario.duration:g} s",
        "solver": f"{scenario.solver.integrator}, {scenario.solver.step * 1e3:g} ms"
        if isinstance(scenario.solver.step, float)
        else str(scenario.solver.integrator),
        "lanes": "" if scenario.lane_count is None else str(scenario.lane_count),
        "varied": ", ".join(scenario.vary),
        "seed": str(scenario.seed),
        "notes": "; ".join(scenario.notes),
    }
    return _facts(about) + _joints(scenario.arm)


def _start(scenario: Scenario) -> tuple[float, ...] | None:
    """Initial positions, where they are plain numbers."""
    try:
        q = scalar.real_numbers(scenario.start.q)
    except (AttributeError, TypeError, ValueError):
        return None
    return tuple(map(float, q)) if q.shape == (scenario.arm.n,) and np.isfinite(q).all() else None


def _facts(about: Mapping[str, str]) -> str:
    return _table((), [[name, value] for name, value in about.items() if value])


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = f"<tr>{''.join(f'<th>{_text(each)}</th>' for each in heads)}</tr>" if heads else ""
    return f"<table>{head}{''.join(f'<tr>{_cells(row)}</tr>' for row in rows)}</table>"


def _cells(row: Sequence[str]) -> str:
    return "".join(f"<td>{_text(cell)}</td>" for cell in row)


def _text(text: str) -> str:
    return escape(printable(text))

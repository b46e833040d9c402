"""Audit of a parts build as one HTML page that needs no other file."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources
from typing import Any

import numpy as np

from armwright.description.paths import quantities
from armwright.description.robot import RobotDescription
from armwright.errors import Problem
from armwright.parts.audit import Row, audit
from armwright.parts.build import PartsBuild
from armwright.parts.link_picture import colour_of_part, link_picture
from armwright.parts.mass_properties import ENTRIES, WeighedLink


def audit_page(build: PartsBuild, previous: RobotDescription | None = None) -> str:
    """Per link the contribution of every section, a picture and the total; what changed; every warning.

    Args:
        build: the arm with its parts.   previous: the arm's file as it was before, if there was one.
    Returns:
        html: the page, with its style and pictures inside.
    """
    arm = build.description
    assert arm.built_from is not None
    notes = [
        *(_box("warning", warning) for warning in build.warnings),
        *(_box("note", note) for note in build.overrides),
    ]
    if not notes:
        notes = ['<p class="quiet">No warnings. Nothing was measured: every number is computed from sections.</p>']
    body = [
        f"<h1>{escape(arm.name)}: audit of its parts</h1>",
        f'<p class="quiet">{escape(arm.title or "")}</p>',
        f'<p class="quiet">Built from {escape(arm.built_from.file)}, SHA-256 {arm.built_from.sha256}</p>',
        _block("Links", _links(build)),
        _block("Warnings and measurements", "\n".join(notes)),
        _block("Changes since the previous file", _changes(previous, arm)),
        *(_block(link.link.name, _link(link, arm), link.link.name) for link in build.links),
    ]
    style = (resources.files("armwright.parts") / "audit.css").read_text(encoding="utf-8")
    head = f'<meta charset="utf-8"><title>{escape(arm.name)}: audit of its parts</title><style>\n{style}</style>'
    page = "\n".join(body)
    return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head>\n<body><main>\n{page}\n</main></body></html>\n'


@dataclass(frozen=True)
class Change:
    """A number that differs between two descriptions.

    Args:
        path: as `provenance` takes it.   before, after: the values; None: there was, or is, no such number.
    """

    path: str
    before: float | tuple[float, ...] | None
    after: float | tuple[float, ...] | None


def changes(before: RobotDescription, after: RobotDescription) -> list[Change]:
    """Every number that differs, pictures aside: those of `after` in its order, then those that only `before` has."""
    old, new = _numbers(before), _numbers(after)
    changed = [Change(path, old.get(path), value) for path, value in new.items() if old.get(path) != value]
    return changed + [Change(path, value, None) for path, value in old.items() if path not in new]


def _numbers(robot: RobotDescription) -> dict[str, Any]:
    return {path: quantity.value for path, quantity, _ in quantities(robot, pictures=False)}


def _block(title: str, inner: str, anchor: str = "") -> str:
    where = f' id="{escape(anchor)}"' if anchor else ""
    return f"<section{where}><h2>{escape(title)}</h2>\n{inner}\n</section>"


def _box(kind: str, problem: Problem) -> str:
    return f'<div class="{kind}">{escape(str(problem))}</div>'


def _table(heads: Iterable[str], rows: Iterable[str], words: int) -> str:
    cells = "".join(f'<th class="word">{h}</th>' if k < words else f"<th>{h}</th>" for k, h in enumerate(heads))
    return f"<table><thead><tr>{cells}</tr></thead>\n<tbody>\n{chr(10).join(rows)}\n</tbody></table>"


def _row(cells: Sequence[str], words: int, kind: str = "") -> str:
    inner = "".join(f'<td class="word">{c}</td>' if k < words else f"<td>{c}</td>" for k, c in enumerate(cells))
    return f'<tr class="{kind}">{inner}</tr>' if kind else f"<tr>{inner}</tr>"


def _links(build: PartsBuild) -> str:
    rows = []
    for link in build.description.links:
        name = f'<a href="#{escape(link.name)}">{escape(link.name)}</a>'
        principal = np.sort(np.linalg.eigvalsh(link.inertia_kg_m2.matrix().astype(float)))
        cells = [name, f"{float(link.mass_kg):.6f}", *(f"{v:.6f}" for v in np.array(link.com_m))]
        rows.append(_row([*cells, *(f"{v:.6f}" for v in principal)], 1))
    rows.append(_row(["all links", f"{build.description.total_mass:.6f}", *[""] * 6], 1, "total"))
    heads = ("link", "mass [kg]", "x [m]", "y [m]", "z [m]", "J₁ [kg m²]", "J₂", "J₃")
    note = "Centre of mass in the link's frame; principal moments of inertia about it."
    return f'<p class="quiet">{note}</p>{_table(heads, rows, 1)}'


def _link(link: WeighedLink, arm: RobotDescription) -> str:
    if not link.parts:
        return '<p class="quiet">No parts: massless, as the file says.</p>'
    rows, total = audit(link, arm.link(link.link.name))
    lines, part, k = [], None, -1
    for row in rows:
        if row.part != part:
            part, k = row.part, k + 1
            lines.append(_part_line(row, k))
        lines.append(_line(row))
    lines.append(_line(total))
    heads = ["section", "solid", "material", "volume [cm³]", "mass [kg]", "x [m]", "y [m]", "z [m]"]
    heads += [f"I{entry} [kg m²]" if entry == "xx" else f"I{entry}" for entry in ENTRIES]
    picture = ""
    if any(part.sections for part in link.parts):
        data = base64.b64encode(link_picture(link)).decode("ascii")
        picture = f'<img alt="link {escape(link.link.name)} from its sections" src="data:image/png;base64,{data}">'
    note = (
        "Centres in the link's frame; tensors about the link's centre of mass (the black dot), in its axes: masses and "
        "tensors add up down the columns."
    )
    return f'{picture}<p class="quiet">{note}</p>{_table(heads, lines, 3)}'


def _part_line(row: Row, k: int) -> str:
    swatch = f'<span class="swatch" style="background:{colour_of_part(k)}"></span>'
    return (
        f'<tr class="part"><td colspan="14">{swatch}{escape(" ".join(filter(None, (row.part, row.title))))}</td></tr>'
    )


def _line(row: Row) -> str:
    """Row of a section, of the effect of measurements, or of the total."""
    numbers = "".join(f"<td>{text}</td>" for text in (row.mass, *row.centre, *row.inertia))
    if row.kind in ("measured", "total"):
        name = row.name if row.kind == "measured" else f"{row.name}, as in the file"
        return f'<tr class="{row.kind}"><td class="word" colspan="4">{escape(name)}</td>{numbers}</tr>'
    words = "".join(f'<td class="word">{escape(text)}</td>' for text in (row.name, row.shape, row.substance))
    return f'<tr class="{row.kind}">{words}<td>{row.volume}</td>{numbers}</tr>'


def _changes(previous: RobotDescription | None, arm: RobotDescription) -> str:
    if previous is None:
        return '<p class="quiet">There was no previous file.</p>'
    changed = changes(previous, arm)
    if not changed:
        return '<p class="quiet">None: every number is as it was.</p>'
    rows = [_row([escape(c.path), _value(c.before), _value(c.after), _difference(c)], 1) for c in changed]
    return _table(("parameter", "before", "now", "change"), rows, 1)


def _value(value: float | tuple[float, ...] | None) -> str:
    if value is None:
        return "—"
    return " ".join(f"{v:.9g}" for v in value) if isinstance(value, tuple) else f"{value:.9g}"


def _difference(change: Change) -> str:
    before, after = change.before, change.after
    if before is None or after is None:
        return "new" if before is None else "gone"
    if isinstance(before, tuple) or isinstance(after, tuple) or not before:
        return ""
    return f"{100 * (after - before) / abs(before):+.3g} %"

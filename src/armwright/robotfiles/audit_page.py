"""Audit of a parts build as one HTML page that needs no other file."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

import numpy as np

from armwright.description.robot import RobotDescription
from armwright.parts.audit import AuditRow, audit
from armwright.parts.build import PartsBuild
from armwright.parts.mass_properties import ENTRIES, WeighedLink
from armwright.results.page_parts import html_table, report_html, section
from armwright.robotfiles.difference import Change, changed_parameters
from armwright.robotfiles.link_picture import colour_of_part, link_picture


def audit_page(build: PartsBuild, previous: RobotDescription | None = None) -> str:
    """Per link the contribution of every section, a picture and the total; what changed; every warning.

    Args:
        build: the arm with its parts.   previous: the arm's file as it was before, if there was one.
    Returns:
        html: the page, with its style and pictures inside.
    """
    arm = build.description
    assert arm.built_from is not None
    notes = "\n".join(
        f'<div class="{kind}">{escape(str(problem))}</div>'
        for kind, problems in (("warning", build.warnings), ("note", build.overrides))
        for problem in problems
    )
    nothing = '<p class="quiet">No warnings. Nothing was measured: every number is computed from sections.</p>'
    about = f"Built from {escape(arm.built_from.file)}, SHA-256 {arm.built_from.sha256}"
    body = [
        section("Links", f'<p class="quiet">{about}</p>{_links(build)}'),
        section("Warnings and measurements", notes or nothing),
        section("Changes since the previous file", _changes(previous, arm)),
        *(section(link.link.name, _link(link, arm), link.link.name) for link in build.links),
    ]
    return report_html(f"{arm.name}: audit of its parts", body, arm.title or "")


def _table(heads: Sequence[str], rows: Iterable[str], words: int) -> str:
    """A table of rows that are HTML already."""
    empty = html_table(heads, (), range(words))
    return empty.replace("<tbody>\n", "<tbody>\n" + "\n".join(rows))


def _row(cells: Sequence[str], kind: str = "") -> str:
    """A row whose first cell is a word."""
    first, *others = cells
    return f'<tr class="{kind}"><td class="word">{first}</td>{"".join(f"<td>{each}</td>" for each in others)}</tr>'


def _links(build: PartsBuild) -> str:
    rows = []
    for link in build.description.links:
        name = f'<a href="#{escape(link.name)}">{escape(link.name)}</a>'
        principal = np.sort(np.linalg.eigvalsh(link.inertia_kg_m2.matrix().astype(float)))
        cells = [name, f"{float(link.mass_kg):.6f}", *(f"{v:.6f}" for v in np.array(link.com_m))]
        rows.append(_row([*cells, *(f"{v:.6f}" for v in principal)]))
    rows.append(_row(["all links", f"{build.description.total_mass:.6f}", *[""] * 6], "total"))
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


def _part_line(row: AuditRow, k: int) -> str:
    swatch = f'<span class="swatch" style="background:{colour_of_part(k)}"></span>'
    return (
        f'<tr class="part"><td colspan="14">{swatch}{escape(" ".join(filter(None, (row.part, row.title))))}</td></tr>'
    )


def _line(row: AuditRow) -> str:
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
    changed = [each for each in changed_parameters(previous, arm) if not each.is_source_only]
    if not changed:
        return '<p class="quiet">None: every number is as it was.</p>'
    rows = [[escape(c.path), _value(c.before), _value(c.after), _difference(c)] for c in changed]
    return html_table(("parameter", "before", "now", "change"), rows, (0,))


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_value, value))
    return "—" if value is None else f"{value:.9g}" if isinstance(value, float) else escape(str(value))


def _difference(change: Change) -> str:
    before, after = change.before, change.after
    if before is None or after is None:
        return "new" if before is None else "gone"
    if not isinstance(before, float) or not isinstance(after, float) or not before:
        return ""
    return f"{100 * (after - before) / abs(before):+.3g} %"

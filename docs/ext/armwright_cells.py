"""Cells of tables that a narrow window would squeeze.

Quantities stay on one line: 0.55 mm, (0.94–1.4), ≥ 0.83. Narrow columns would break them at a space or dash.
A cell of several words has the class `prose`, a longer one `passage`: the style sheet gives them a least width.
A table of words with many columns has the class `stacked`: on a telephone its rows become paragraphs, in which the cells' heads
stand before them.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

SPACE = re.compile(r"(?<=\d) (?=(?:[°%]|[kmnµ]?(?:rad|Hz|[ABJNVWgms])(?![A-Za-z])))|(?<=[≤≥]) (?=\d)")
PROSE, PASSAGE = 40, 120  # letters
HALF = 24  # letters, half a telephone's width
WIDE = 5  # columns of words that a telephone has no room for
CLEAR = ("", "takes", "unit", "value", "meaning", "what it is", "servo")  # heads that a cell says itself
DASH = re.compile(r"(?<=\d)–(?=\d)|(?<=\de)-(?=\d)")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connects the extension."""
    app.connect("doctree-read", arrange_cells)
    app.connect("doctree-read", stack_rows)
    return {"parallel_read_safe": True}


def arrange_cells(app: Sphinx, tree: nodes.document) -> None:
    """Joins numbers with their units, ranges and signs of comparison, code excepted; marks cells of text."""
    for cell in tree.findall(nodes.entry):
        letters = len(cell.astext())
        if letters > PROSE:
            cell["classes"].append("prose" if letters <= PASSAGE else "passage")
        for text in list(cell.findall(nodes.Text)):
            if not isinstance(text.parent, nodes.literal):
                text.parent.replace(text, nodes.Text(joined(text)))


def stack_rows(app: Sphinx, tree: nodes.document) -> None:
    """Marks tables of words whose columns do not fit a telephone, and puts each cell's head before it, hidden elsewhere."""
    for table in tree.findall(nodes.table):
        head, *rows = [list(row.children) for row in table.findall(nodes.row)]
        cells = [cell for row in rows for cell in row]
        text = [any({"prose", "passage"} & set(row[k]["classes"]) for row in rows) for k in range(len(head))]
        words = sum(len(cell.astext()) > 1 and not any(map(str.isdigit, cell.astext())) for cell in cells)
        if len(head) == 2:
            stacks = all(any(len(row[k].astext()) > HALF for row in rows) for k in range(2))
        else:
            stacks = any(text) or (len(head) >= WIDE and 2 * words > len(cells))
        if not stacks:
            continue
        table["classes"].append("stacked")
        for column in zip(head, *rows, strict=True):
            label = column[0].astext()
            for cell in column[1:]:
                if not cell.astext():
                    cell["classes"].append("empty")
                elif column[0] is not head[0] and label not in CLEAR:
                    cell.children[0].insert(0, nodes.inline("", f"{label}: ", classes=["column"]))
        for row in rows:
            if text[-1]:
                row[-1]["classes"].append("line")


def joined(text: str) -> str:
    """Text with no-break spaces, and with word joiners around dashes of ranges and exponents."""
    return DASH.sub("\u2060\\g<0>\u2060", SPACE.sub("\u00a0", text))

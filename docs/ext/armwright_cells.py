"""Cells of tables that a narrow window would squeeze.

Quantities stay on one line: 0.55 mm, (0.94–1.4), ≥ 0.83. Narrow columns would break them at a space or dash.
A cell of several words has the class `prose`, a longer one `passage`: the style sheet gives them a least width.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx

SPACE = re.compile(r"(?<=\d) (?=(?:[°%]|[kmnµ]?(?:rad|Hz|[ABJNVWgms])(?![A-Za-z])))|(?<=[≤≥]) (?=\d)")
PROSE, PASSAGE = 40, 120  # letters
DASH = re.compile(r"(?<=\d)–(?=\d)|(?<=\de)-(?=\d)")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connects the extension."""
    app.connect("doctree-read", arrange_cells)
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


def joined(text: str) -> str:
    """Text with no-break spaces, and with word joiners around dashes of ranges and exponents."""
    return DASH.sub("\u2060\\g<0>\u2060", SPACE.sub("\u00a0", text))

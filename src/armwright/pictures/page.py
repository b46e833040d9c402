"""Pages that need nothing beside them: template, style, scripts and data in one file of HTML."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np


class Numbers:
    """Arrays of a page in single precision, one after the other; each is known by its place."""

    def __init__(self) -> None:
        self._arrays: list[np.ndarray] = []
        self._count = 0

    def add(self, values: np.ndarray) -> list[int]:
        """Where the values (k,) stand: [first, k]."""
        place = [self._count, len(values)]
        with np.errstate(over="ignore"):  # a diverging run's 1e300 is shown as a gap, like what is not known
            self._arrays.append(np.asarray(values, dtype="<f4"))
        self._count += len(values)
        return place

    def text(self) -> str:
        """All of them as text: first the low bytes of all, then the next, … which packs best, then as `packed`."""
        values = np.concatenate([np.empty(0, dtype="<f4"), *self._arrays])
        return packed(values.view(np.uint8).reshape(-1, 4).T.tobytes())


def packed(data: bytes) -> str:
    """Deflated, and as text: what `unpack` of pages/unpack.js undoes."""
    return base64.b64encode(zlib.compress(data, 9)).decode("ascii")


def embedded(value: Any) -> str:
    """A value as JSON that cannot end the script element around it."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def page(name: str, scripts: Sequence[str], styles: Sequence[str], words: dict[str, str], **data: str) -> str:
    """A page of the folder `pages` with its scripts, styles and data inside.

    Args:
        name: the template.   scripts, styles: files of the folder, in order.
        words: texts that readers see, escaped here.   data: what `packed`, `embedded` or `Numbers.text` made.
    Returns:
        html: the page.
    """
    folder = files("armwright.pictures") / "pages"
    text = {file: (folder / file).read_text(encoding="utf-8") for file in (name, *scripts, *styles)}
    inside = {"script": "\n".join(text[file] for file in scripts), "style": "\n".join(text[file] for file in styles)}
    return Template(text[name]).substitute(inside | data | {key: escape(word) for key, word in words.items()})

"""Offline pages: a plot of runs as JSON, its numbers and the drawing script, in one HTML file."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from armwright.results.plot_curves import BAND_OPACITY, INK, Plot, Style

PAGES = Path(__file__).parent / "pages"
EVEN = 1e-9  # of a step: times this near to even ones are stored as start and step


def plot_page(plot: Plot) -> str:
    """HTML page of a plot: zoom into times, read values under the pointer, hide curves."""
    numbers = PageNumbers()
    words = {"title": plot.title, "heading": plot.title, "subtitle": plot.note}
    data = {"plot": embedded(plot_data(plot, numbers)), "numbers": numbers.text()}
    scripts = [PAGES / "unpack.js", PAGES / "charts.js"]
    return page(PAGES / "plot.html", scripts, [PAGES / "page.css"], words, **data)


def plot_data(plot: Plot, numbers: PageNumbers) -> dict[str, Any]:
    """Description that `Charts` of pages/charts.js draws; its arrays are added to the numbers."""

    def look(style: Style) -> dict[str, Any]:
        colour = "currentColor" if style.colour == INK else style.colour  # the page's own ink, dark or light
        return {"colour": colour, "dash": style.dash, "width": style.width, "opacity": style.opacity}

    return {
        "times": [_time(t, numbers) for t in plot.times],
        "band_opacity": BAND_OPACITY,
        "panels": [
            {
                "title": panel.title, "symbol": panel.symbol, "unit": panel.unit, "stepped": panel.stepped,
                "curves": [
                    {
                        "joint": curve.joint, "run": curve.run, "series": curve.series, **look(curve.style),
                        "values": numbers.add(curve.values),
                        "bands": [[numbers.add(edge) for edge in band] for band in curve.bands],
                    }
                    for curve in panel.curves
                ],
            }
            for panel in plot.panels
        ],
        "legend": [
            {"name": entry.name, "group": entry.group, "value": entry.value, **look(entry.style)} for entry in plot.legend
        ],
    }  # fmt: skip


def _time(t: np.ndarray, numbers: PageNumbers) -> dict[str, Any]:
    """Even times as start, step and count; others as sums of two single-precision numbers, as one has too few digits."""
    if len(t) > 1:
        step = (t[-1] - t[0]) / (len(t) - 1)
        if np.abs(t - (t[0] + step * np.arange(len(t)))).max() <= EVEN * step + 1e-14 * np.abs(t).max():
            return {"start": float(t[0]), "step": float(step), "count": len(t)}
    high = t.astype(np.float32)
    return {"high": numbers.add(high), "low": numbers.add(t - high)}


class PageNumbers:
    """Arrays of a page in single precision, one after the other; each is known by its place."""

    def __init__(self) -> None:
        self._arrays: list[np.ndarray] = []
        self._count = 0

    def add(self, values: np.ndarray) -> list[int]:
        """Place of the values (k,): [first, k]."""
        place = [self._count, len(values)]
        with np.errstate(over="ignore"):  # a diverging run's 1e300 is shown as a gap, like what is not known
            self._arrays.append(np.asarray(values, dtype="<f4"))
        self._count += len(values)
        return place

    def text(self) -> str:
        """All arrays as text: first the low bytes of all numbers, then the next, … which compresses best, then `packed`."""
        values = np.concatenate([np.empty(0, dtype="<f4"), *self._arrays])
        return packed(values.view(np.uint8).reshape(-1, 4).T.tobytes())


def packed(data: bytes) -> str:
    """Data deflated, as text; `unpack` of pages/unpack.js reverses it."""
    return base64.b64encode(zlib.compress(data, 9)).decode("ascii")


def embedded(value: Any) -> str:
    """A value as JSON that cannot end the script element around it."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def page(
    template: Path,
    scripts: Sequence[Path],
    styles: Sequence[Path],
    words: dict[str, str],
    **data: str,
) -> str:
    """HTML page with its scripts, styles and data inside.

    Args:
        template: file of the page after pages/head.html, which all pages share.   scripts, styles: files, in order.
        words: texts that readers see, escaped here.
        data: results of `packed`, `embedded` or `Numbers.text`.
    """
    joined = {"script": scripts, "style": styles}
    inside = {name: "\n".join(file.read_text(encoding="utf-8") for file in files) for name, files in joined.items()}
    texts = {key: escape(word) for key, word in words.items()}
    whole = "".join(file.read_text(encoding="utf-8") for file in (PAGES / "head.html", template))
    return Template(whole).substitute(inside | data | texts)

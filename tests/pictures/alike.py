"""Comparison of two pictures: PNG by their pixels, SVG by their curves and words.

Neither rounding nor the last pixel of an edge counts; a curve that goes elsewhere, another word or another size do.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter
from scipy.spatial import cKDTree

from pictures.paper import on_white

NEAR = 3  # pixels of a PNG, points of an SVG: so far anything may be from where it was
TONE = 40  # of 255: so much lighter or darker it may be than all that is near
FAINT = 24  # of 255: what differs less from the paper is paper
SHARE = 0.02  # of all that is not paper: so much may be elsewhere
OTHER_FONTS = 0.2  # the same where letters are the browser's own, and its graphics those of the machine


def unlike(made: Path, kept: Path, share: float = SHARE) -> str | None:
    """Difference of the two in words; None: they show the same."""
    if made.suffix.lower() == ".svg":
        return _unlike_drawings(made, kept)
    return unlike_pixels(on_white(made), on_white(kept), share)


def unlike_pixels(made: np.ndarray, kept: np.ndarray, share: float = SHARE) -> str | None:
    """The same of pixels (height, width, 3), 0 to 255."""
    if made.shape != kept.shape:
        return f"made {made.shape[1]} × {made.shape[0]} pixels, kept {kept.shape[1]} × {kept.shape[0]}"
    moved = ink = 0
    for one, other in ((made, kept), (kept, made)):
        paper = np.median(one.reshape(-1, 3), axis=0)
        ink += int((np.abs(one - paper).max(axis=2) > FAINT).sum())
        low, high = (f(other, size=(2 * NEAR + 1, 2 * NEAR + 1, 1)) for f in (minimum_filter, maximum_filter))
        moved += int(((one < low - TONE) | (one > high + TONE)).any(axis=2).sum())
    return None if moved <= share * max(ink, 1) else f"{moved / ink:.1%} of what is drawn is elsewhere"


def _unlike_drawings(made: Path, kept: Path) -> str | None:
    ours, theirs = (_drawing(path) for path in (made, kept))
    for what, one, other in zip(("size", "words"), ours, theirs, strict=False):
        if one != other:
            return f"{what}: made {one}, kept {other}"
    curves, others = ours[2], theirs[2]
    if [colour for colour, _ in curves] != [colour for colour, _ in others]:
        return f"made {len(curves)} lines, kept {len(others)}, or of other colours"
    for k, ((colour, one), (_, other)) in enumerate(zip(curves, others, strict=True), 1):
        away = max(cKDTree(a).query(b)[0].max() for a, b in ((one, other), (other, one)))
        if away > NEAR:
            return f"line {k}, {colour}, goes up to {away:.1f} points beside the one that is kept"
    return None


def _drawing(path: Path) -> tuple[str, list[str], list[tuple[str, np.ndarray]]]:
    """Size, words and lines (colour, points (k, 2), close together) of a picture by matplotlib."""
    root = ET.parse(path, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))).getroot()
    words = [str(node.text).strip() for node in root.iter(ET.Comment)]
    lines = []
    for node in root.iter("{*}path"):
        colour = re.search(r"stroke: (#\w+)", node.get("style", ""))
        if node.get("clip-path") and colour:
            lines.append((colour[1], _close(node.get("d", ""))))
    return str(root.get("viewBox")), words, lines


def _close(path: str) -> np.ndarray:
    """Points along a path of straight lines, at most a point apart."""
    corners = np.array([float(number) for number in re.findall(r"-?\d+\.?\d*", path)]).reshape(-1, 2)
    parts = [corners[:1]]
    for start, end in pairwise(corners):
        count = int(np.ceil(np.linalg.norm(end - start))) + 1
        parts.append(start + (end - start) * np.linspace(0.0, 1.0, count)[1:, None])
    return np.concatenate(parts)

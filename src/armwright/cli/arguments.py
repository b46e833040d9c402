"""Arguments that several commands share, and how vectors are written on the command line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import isfinite, nan, pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armwright.errors import ScenarioError

if TYPE_CHECKING:
    import numpy as np

Robot = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT",
        help="Name of a built-in arm, or path of a robot's TOML, URDF or MJCF file.",
        show_default=False,
    ),
]
Table = Annotated[Path, typer.Argument(metavar="IN.csv", help="CSV file, one set of data a row.", show_default=False)]
Out = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="OUT.csv", help="CSV file for the results; without it they are printed.",
        show_default=False,
    ),
]  # fmt: skip

ANGLE = re.compile(r"^(?P<factor>[+-]?[\d.]*)\*?pi(?:/(?P<by>[\d.]+))?$")


def vector(option: str, text: str, names: Sequence[str], units: Sequence[str]) -> np.ndarray:
    """`"1,2,3"` as one number a joint; a single number is meant for every joint.

    Angles may be written `30deg` or `pi/2` where the joint's unit is rad (or rad/s).

    Args:
        option: what errors call it.   text: what was typed.   names: (n,) the joints.   units: (n,) their units.
    Returns:
        values: (n,).
    Raises:
        ScenarioError: too few or too many numbers, or something that is no finite number.
    """
    import numpy as np

    parts = [part.strip() for part in text.split(",")]
    if len(parts) not in (1, len(names)):
        expected = f"{len(names)} numbers ({', '.join(names)})" if len(names) > 1 else "1 number"
        raise ScenarioError(f"{option} {text}: holds {len(parts)}; expected {expected}, or one for all joints")
    if len(parts) == 1:
        parts = parts * len(names)
    return np.array([_number(option, part, name, unit) for part, name, unit in zip(parts, names, units, strict=True)])


def _number(option: str, text: str, name: str, unit: str) -> float:
    angle = unit.startswith("rad")
    word, factor = text, 1.0
    if angle and text.endswith("deg"):
        word, factor = text.removesuffix("deg"), pi / 180
    match = ANGLE.match(text) if angle else None
    try:
        if match:
            signs = {"": 1.0, "+": 1.0, "-": -1.0}
            times = signs[match["factor"]] if match["factor"] in signs else float(match["factor"])
            value = times * pi / float(match["by"] or 1)
        else:
            value = float(word) * factor
    except (ValueError, ZeroDivisionError):
        value = nan
    if not isfinite(value):
        example = "such as 0.5, 30deg or pi/6" if angle else "such as 0.5"
        raise ScenarioError(f"{option}: {text!r} for joint {name!r}: expected a finite number [{unit}], {example}")
    return value

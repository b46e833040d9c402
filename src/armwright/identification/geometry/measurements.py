"""Measurements of an arm's geometry: joint readings with points, poses or distances, and the checks of what they hold."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal

import numpy as np

from armwright.errors import LogError, check_known
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.scalar import real_numbers

Kind = Literal["point", "pose", "distance", "fixed point"]
WIDTHS = {"point": 3, "pose": 7, "distance": 1, "fixed point": 1}  # numbers of a row
MEANINGS = {
    "point": "x, y, z [m]",
    "pose": "x, y, z [m] and quaternion w, x, y, z",
    "distance": "distance [m]",
    "fixed point": "number of the point",
}
STILL = 1e-9  # [rad | m] by which the readings of a joint that stands still differ at most
LEAST = 4  # poses
RIGID = 0.05  # of the distance of two points, by which half of the poses may differ from the middle


@dataclass(frozen=True, eq=False)
class Measured:
    """One quantity, measured in many poses.

    Attributes:
        name: what results call it.   kind: "point": of the tool, in the measuring frame; "pose": of a frame there; "distance":
            from an anchor to a point of the tool; "fixed point": a point of the tool touches one that does not move.
        values: (poses, 3), (poses, 7), (poses, 1) [m], quaternions as w, x, y, z; of a fixed point (poses, 1) its number.
            NaN where nothing was measured.   frame: that carries the point or is the one measured; None: the tip.
        place: (3,) [m] of the point in that frame; None: unknown.   anchor: (3,) [m] in base axes; None: unknown.
    """

    name: str
    kind: Kind
    values: np.ndarray
    frame: str | None = None
    place: Any = None
    anchor: Any = None

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise LogError(place="Measured.name", value=self.name, expected="a name")
        check_known(LogError, self.kind, WIDTHS, place=f"{self.name}: kind")
        values = _array(f"{self.name}: values", self.values, (None, WIDTHS[self.kind]), MEANINGS[self.kind])
        if np.isinf(values).any():
            raise LogError("infinite", place=f"{self.name}: values", expected="numbers, or NaN where none was measured")
        object.__setattr__(self, "values", np.where(np.isfinite(values).all(axis=1, keepdims=True), values, np.nan))
        if self.kind == "pose":
            size = np.linalg.norm(self.values[:, 3:], axis=1)
            wrong = np.flatnonzero(np.abs(size - 1.0) > 0.01)
            if len(wrong):
                what = f"a quaternion of length {size[wrong[0]]:.4g} in pose {wrong[0] + 1}"
                raise LogError(what, place=f"{self.name}: values", expected="unit quaternions w, x, y, z")
        for key in ("place", "anchor"):
            if getattr(self, key) is not None:
                given = _array(f"{self.name}: {key}", getattr(self, key), (3,), "3 numbers [m]")
                if not np.isfinite(given).all():
                    raise LogError("is not finite", place=f"{self.name}: {key}", expected="3 numbers [m]")
                object.__setattr__(self, key, given)

    @property
    def seen(self) -> np.ndarray:
        """(poses,) True where it was measured."""
        return np.isfinite(self.values[:, 0])


@dataclass(frozen=True, eq=False)
class Measurements(Result):
    """Joint readings and what was measured at each of them.

    Attributes:
        joints: (n) names.   q: (poses, n) [rad | m].   measured: the quantities.
        measuring_frame: what the frame of points and poses is called.   placed: (6,) x, y, z [m], roll, pitch, yaw [rad] of
            it in the base; None: unknown.   locked: positions [rad | m] of joints that were not read; absent: 0.
        robot: name or file of the arm; None: to be given.   kinematics_only: its links may lack masses.
        findings: what is wrong with the columns.   sha256: of all numbers, or of the files.   name: of the file.
    """

    joints: tuple[str, ...]
    q: np.ndarray
    measured: tuple[Measured, ...]
    measuring_frame: str = "measuring"
    placed: Any = None
    locked: dict[str, float] = field(default_factory=dict)
    robot: str | None = None
    kinematics_only: bool = False
    findings: tuple[str, ...] = ()
    sha256: str = ""
    name: str = ""

    def __post_init__(self) -> None:
        joints = _listed("joints", self.joints, str, "names of joints")
        measured = _listed("measured", self.measured, Measured, "some Measured")
        if len(set(joints)) < len(joints):
            raise LogError("a name twice", place="Measurements.joints", value=joints)
        q = _array("Measurements.q", self.q, (None, len(joints)), f"(poses, {len(joints)}) [rad | m]")
        for each in measured:
            if len(each.values) != len(q):
                what, expected = f"{len(each.values)} rows", f"{len(q)}, as there are poses"
                raise LogError(what, place=f"{each.name}: values", expected=expected)
        names = [each.name for each in measured]
        if len(set(names)) < len(names):
            raise LogError("a name twice", place="Measurements.measured", value=names)
        if not np.isfinite(q).all():
            row = int(np.flatnonzero(~np.isfinite(q).all(axis=1))[0])
            raise LogError("is not finite", place=f"q of pose {row + 1}", expected="a reading of each joint")
        if self.placed is not None:
            object.__setattr__(self, "placed", _array("Measurements.placed", self.placed, (6,), "6 numbers [m], [rad]"))
        kept, findings = _checked(joints, q, measured)
        digest = hashlib.sha256(q.tobytes())
        for each in measured:
            digest.update(each.values.tobytes())
        values = {"joints": joints, "q": q, "measured": kept, "findings": (*self.findings, *findings)}
        values["sha256"] = self.sha256 or digest.hexdigest()
        for key, value in values.items():
            object.__setattr__(self, key, value)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.name or 'measurements'}: {len(self)} poses"

    def tables(self) -> list[Table]:
        """A row for each quantity; then the readings of the joints."""
        rows = [[m.name, m.kind, number(m.seen.sum(), ".0f"), m.frame or "tip"] for m in self.measured]
        low, high = self.q.min(axis=0), self.q.max(axis=0)
        joints = [[name, number(a), number(b)] for name, a, b in zip(self.joints, low, high, strict=True)]
        found = Table(self.heading, ("measured", "kind", "poses", "frame"), rows, ("kind", "frame"))
        return [found, Table("joints", ("joint", "lowest [rad | m]", "highest [rad | m]"), joints)]

    def sentences(self) -> list[str]:
        """Findings of the checks."""
        return list(self.findings)


def _checked(
    joints: Sequence[str], q: np.ndarray, measured: tuple[Measured, ...]
) -> tuple[tuple[Measured, ...], list[str]]:
    """The quantities without copies of others, and what was found.

    Raises:
        LogError: too few poses, or nothing measured in any.
    """
    seen = np.any([each.seen for each in measured], axis=0)
    if seen.sum() < LEAST:
        raise LogError(f"{seen.sum()} poses with a measurement", place="measurements", expected=f"{LEAST} or more")
    copies = {two.name: one.name for one, two in combinations(measured, 2) if _same(one, two)}
    findings = [f"{two} repeats the columns of {one}: left out" for two, one in copies.items()]
    still = [name for name, low, high in zip(joints, q.min(axis=0), q.max(axis=0), strict=True) if high - low < STILL]
    findings += [f"joint {name} stands still in all poses: nothing about it can be found" for name in still]
    kept = tuple(each for each in measured if each.name not in copies)
    findings += [*_repeats(q, kept), *_not_rigid(kept)]
    return kept, findings


def _not_rigid(measured: Sequence[Measured]) -> Iterator[str]:
    """Sentences on points of one frame whose distance is not the same in all poses: half of them differ by more than a share."""
    for one, two in combinations([each for each in measured if each.kind == "point"], 2):
        if one.frame == two.frame and (both := one.seen & two.seen).any():
            distance = np.linalg.norm(one.values[both] - two.values[both], axis=1)
            spread = np.median(np.abs(distance - np.median(distance))) / max(np.median(distance), np.finfo(float).tiny)
            if spread > RIGID:
                what = f"{one.name} and {two.name} are fixed to one frame, but their distance varies by {spread:.0%}"
                yield f"{what}: units, columns or frames?"


def _same(one: Measured, two: Measured) -> bool:
    """True of two quantities with the same numbers: one column was copied, or written twice."""
    return one.kind == two.kind != "fixed point" and np.array_equal(one.values, two.values, equal_nan=True)


def _repeats(q: np.ndarray, measured: Sequence[Measured]) -> Iterator[str]:
    """Sentences on values that a tracker held while the arm moved."""
    moved = np.abs(np.diff(q, axis=0)).max(axis=1) > STILL
    for each in measured:
        if each.kind == "fixed point":
            continue
        held = np.flatnonzero(moved & (np.diff(each.values, axis=0) == 0.0).all(axis=1))
        if len(held):
            rows = ", ".join(str(k + 2) for k in held[:4])
            yield f"{each.name} is that of the pose before in pose {rows}, though joints moved: a value that was held?"


def _listed(name: str, given: Any, kind: type, expected: str) -> tuple[Any, ...]:
    """A list of things of one kind, one at least.

    Raises:
        LogError: something else.
    """
    if not isinstance(given, (list, tuple)) or not given or not all(isinstance(each, kind) for each in given):
        raise LogError(place=f"Measurements.{name}", value=given, expected=expected)
    return tuple(given)


def _array(place: str, value: Any, shape: tuple[int | None, ...], expected: str) -> np.ndarray:
    """Numbers of a shape, None for any length.

    Raises:
        LogError: something else.
    """
    try:
        array = real_numbers(value).copy()
    except ValueError as error:
        raise LogError(str(error), place=place, expected=expected) from None
    fits = array.ndim == len(shape) and all(w is None or w == n for w, n in zip(shape, array.shape, strict=True))
    if not fits:
        raise LogError(f"shape {array.shape}", place=place, expected=expected)
    return array

"""Corrections that an arm's record can have, and the chain from its base to a frame with all of them.

| joint of the record | corrections                                                                             |
|---------------------|-----------------------------------------------------------------------------------------|
| dh, modified_dh     | its four numbers: zero (the offset), r, a, alpha                                            |
| frame               | in the frame whose z is the axis: zero, shifts along x, y, z, tilts about x, y          |
| any that turns      | on request: eccentricity of its gear (cos q, sin q) [JuddKnasinski1990]                 |
| any                 | on request: give of joint and link by the moment of gravity [GongYuanNi2000]            |
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armwright.description.paths import path_name
from armwright.errors import IdentificationError, ModelError, check_known
from armwright.identification.geometry.chain import Constant, Correction, Factor, Motion, Weight, matrix_of
from armwright.kinematics.forward_kinematics import body_placements
from armwright.model import BASE, Model
from armwright.model.build import joint_placement
from armwright.spatial import Placement, rotation_rpy

TERMS = ("zeros", "frames", "eccentricity", "joint compliance", "link compliance")
STORED = TERMS[:2]  # what a record has numbers for that all rooms read
OF_TERM = {
    "zeros": ("zero",),
    "frames": ("length", "angle"),
    **{term: (term,) for term in TERMS[2:]},
}  # kinds of columns
ORDER = ("frame", "point", "zero", "length", "angle", *TERMS[2:])  # who stays where columns depend on each other
AXES = "xyz"


@dataclass(frozen=True)
class GeometryColumn:
    """A parameter of the geometry.

    Attributes:
        name: in words.   kind: one of `ORDER`.   unit: of the parameter.   joint: whose it is, if any.
        path: of the record's number that it adds to; "" for one that changes a whole frame.
    """

    name: str
    kind: str
    unit: str
    joint: str = ""
    path: str = ""


@dataclass
class Columns:
    """Columns of a calibration as they are found, each with its number."""

    found: list[GeometryColumn] = field(default_factory=list)

    def add(self, name: str, kind: str, unit: str, joint: str = "", path: str = "") -> int:
        """A new column, or that of the same name; its number."""
        for k, known in enumerate(self.found):
            if known.name == name:
                return k
        self.found.append(GeometryColumn(name, kind, unit, joint, path))
        return len(self.found) - 1

    def frame(self, name: str, kind: str = "frame") -> list[Correction]:
        """Six corrections of a frame, in its own axes: shifts, then turns."""
        shifts = [Correction(self.add(f"{name} shift {AXES[k]}", kind, "m"), k, False) for k in range(3)]
        return shifts + [Correction(self.add(f"{name} turn {AXES[k]}", kind, "rad"), k, True) for k in range(3)]

    def point(self, name: str) -> list[Correction]:
        """Three corrections of a point."""
        return [Correction(self.add(f"{name} {AXES[k]}", "point", "m"), k, False) for k in range(3)]


@dataclass(frozen=True, eq=False)
class ArmChains:
    """An arm whose chains are asked for.

    Attributes:
        arm: the model.   terms: of `TERMS`, which are corrected.   columns: that the chains have so far.
        known: loads by gravity, by the positions they belong to.
    """

    arm: Model
    terms: tuple[str, ...]
    columns: Columns
    known: dict[bytes, np.ndarray] = field(default_factory=dict)

    def to(self, frame: str | None) -> list[Factor]:
        """Factors from the base to a frame or link, by default the tip.

        Raises:
            ModelError: no such frame; an arm that branches and names no tip.
        """
        record, name = self.arm.record, frame if frame is not None else self.arm.tip
        self.arm.frame(name)
        named = next((each for each in record.frames if each.name == name), None)
        link = name if named is None else named.link
        path, by_child = [], {joint.child: joint for joint in record.joints}
        while link in by_child:
            path.append(by_child[link])
            link = path[-1].parent
        factors: list[Factor] = [factor for joint in reversed(path) for factor in self.joint(joint)]
        if named is not None:
            placed = Placement(rotation_rpy(*named.rpy_rad.numbers), np.asarray(named.xyz_m))
            factors.append(Constant(matrix_of(placed)))
        if not any(isinstance(each, Motion) for each in factors):
            raise ModelError("no joint moves it", place="frame", value=name, expected="a frame behind a joint")
        return factors

    def joint(self, joint: Any) -> list[Factor]:
        """Factors of a joint: before its motion, the motion, and behind it."""
        before, after = (Constant(matrix_of(each)) for each in joint_placement(joint))
        if not joint.kind.moves:
            return [before, after]
        if joint.dh is not None:
            along_z, along_x = self._row(joint, "dh")
            return [before, *along_z, *self._eccentric(joint), self.motion(joint), *self._sag(joint), after, *along_x]
        if joint.modified_dh is not None:
            along_z, along_x = self._row(joint, "modified_dh")
            return [*along_x, before, *along_z, *self._eccentric(joint), self.motion(joint), *self._sag(joint), after]
        return [before, *self._frame(joint), *self._eccentric(joint), self.motion(joint), *self._sag(joint), after]

    def motion(self, joint: Any) -> Motion:
        """Motion of a joint, or of one that follows another."""
        if joint.mimic is None:
            return Motion(joint.kind, self.arm.names.index(joint.name))
        masters = {each.name: each for each in self.arm.record.moving_joints}
        own = self.motion(masters[joint.mimic.joint])
        times, offset = joint.mimic.multiplier.number, joint.mimic.offset
        return Motion(joint.kind, own.column, times * own.multiplier, times * own.offset + offset)

    def _row(self, joint: Any, key: str) -> tuple[list[Correction], list[Correction]]:
        """Corrections of a Denavit-Hartenberg row: along z, and along x."""
        zero, other = ("offset_rad", "r_m") if joint.kind.turns else ("offset_m", "theta_rad")
        place, found = path_name(joint.name), []
        for name, axis in ((zero, 2), (other, 2), ("a_m", 0), ("alpha_rad", 0)):
            turns = name.endswith("_rad")
            kind = "zero" if name == zero else "angle" if turns else "length"
            if self._asked(kind):
                word, unit = "zero" if name == zero else name.partition("_")[0], "rad" if turns else "m"
                number = self.columns.add(f"{place} {word}", kind, unit, joint.name, f"{place}.{key}.{name}")
                found.append(Correction(number, axis, turns))
        return [each for each in found if each.axis == 2], [each for each in found if each.axis == 0]

    def _frame(self, joint: Any) -> Iterator[Correction]:
        """Corrections of a joint's frame, whose z is the axis: Tx Ty Tz Rx Ry Rz."""
        for turns in (False, True):
            for axis in range(3):
                is_zero = axis == 2 and turns == joint.kind.turns
                kind = "zero" if is_zero else "angle" if turns else "length"
                word = "zero" if is_zero else f"{'tilt' if turns else 'shift'} {AXES[axis]}"
                if self._asked(kind):
                    unit = "rad" if turns else "m"
                    number = self.columns.add(f"{path_name(joint.name)} {word}", kind, unit, joint.name)
                    yield Correction(number, axis, turns)

    def _eccentric(self, joint: Any) -> Iterator[Correction]:
        """First harmonic of a gear that turns: δq = a cos q + b sin q."""
        if not self._asked("eccentricity") or not joint.kind.turns or joint.mimic is not None:
            return
        column = self.arm.names.index(joint.name)
        for word, wave in (("cos", np.cos), ("sin", np.sin)):
            name = f"{path_name(joint.name)} eccentricity {word}"
            number = self.columns.add(name, "eccentricity", "rad", joint.name)
            yield Correction(number, 2, True, lambda q, wave=wave: wave(q[:, column]))

    def _sag(self, joint: Any) -> Iterator[Correction]:
        """Turns by gravity: about the axis what joint and gear give, about x and y what the link does."""
        turns = joint.kind.turns
        asked = [("joint compliance", 2, turns)] + [("link compliance", axis, True) for axis in (0, 1)]
        for kind, axis, turning in asked:
            if self._asked(kind):
                name = f"{path_name(joint.name)} {kind} {AXES[axis]}"
                number = self.columns.add(name, kind, "rad/(N m)" if turning else "m/N", joint.name)
                yield Correction(number, axis, turning, self._moment(joint.name, axis, turning))

    def _moment(self, joint: str, axis: int, turning: bool) -> Weight:
        body = next(k for k, each in enumerate(self.arm.bodies) if each.joint == joint)
        return lambda q: self.loads(q)[:, body, 3 * turning + axis]

    def loads(self, q: np.ndarray) -> np.ndarray:
        """Wrench of gravity (poses, bodies, 6) on each body and all that it carries at q; computed once for equal q."""
        key = q.tobytes()
        if key not in self.known:
            self.known[key] = gravity_loads(self.arm, q)
        return self.known[key]

    def _asked(self, kind: str) -> bool:
        return any(kind in OF_TERM[term] for term in self.terms)


def gravity_loads(arm: Model, q: np.ndarray) -> np.ndarray:
    """Force and moment of gravity on each body and all bodies behind it, in the body's axes about its origin.

    Args:
        arm: the model.   q: (poses, n) [rad | m].
    Returns:
        loads: (poses, bodies, 6) [N, N m]: force, then moment.
    """
    loads = np.zeros((len(q), len(arm.bodies), 6))
    for row, pose in enumerate(q):
        placed = body_placements(arm, pose)
        forces, moments = np.zeros((len(arm.bodies), 3)), np.zeros((len(arm.bodies), 3))  # about the base's origin
        for i, body in arm.inward():
            force, at = body.mass * np.asarray(arm.gravity), placed[i]
            first = at.rotation @ body.first_moment + body.mass * at.position
            forces[i] += force
            moments[i] += np.cross(first, arm.gravity)
            if body.parent != BASE:
                forces[body.parent] += forces[i]
                moments[body.parent] += moments[i]
        for i in range(len(arm.bodies)):
            turn = np.asarray(placed[i].rotation, dtype=float)
            moment = moments[i] - np.cross(np.asarray(placed[i].position, dtype=float), forces[i])
            loads[row, i] = np.concatenate([turn.T @ forces[i], turn.T @ moment])
    return loads


def checked_terms(terms: Sequence[str], arm: Model) -> tuple[str, ...]:
    """Terms in their order.

    Raises:
        IdentificationError: none, a name that is no term, or compliance of an arm without masses.
    """
    if isinstance(terms, str) or not isinstance(terms, Sequence) or not terms:
        raise IdentificationError(place="terms", value=terms, expected=f"some of {', '.join(TERMS)}")
    for term in terms:
        check_known(IdentificationError, term, TERMS, "no such term", place="terms")
    found = tuple(term for term in TERMS if term in terms)
    if not has_masses(arm) and any("compliance" in term for term in found):
        raise IdentificationError(
            "some of its links have no masses", place=f"arm {arm.name!r}", expected="terms without compliance"
        )
    return found


def has_masses(arm: Model) -> bool:
    """True if gravity is known to load some joint."""
    return not arm.record.without_masses and any(float(body.mass) > 0 for body in arm.bodies)

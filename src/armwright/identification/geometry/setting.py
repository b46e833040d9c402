"""Setting of a calibration: columns, targets and structure, from an arm and measurements."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright.description.paths import quantities
from armwright.errors import IdentificationError, check_known
from armwright.identification.arm.base import NEARLY, BaseParameters, regrouped, regrouped_further
from armwright.identification.geometry import start
from armwright.identification.geometry.arm_chain import AXES, ORDER, ArmChains, Columns, GeometryColumn
from armwright.identification.geometry.chain import Constant, Correction, Factor, Motion, moved
from armwright.identification.geometry.measurements import Measured, Measurements
from armwright.identification.geometry.problem import Rows, Target, errors_at, sensitivities
from armwright.model import Model
from armwright.model.build import joint_placement
from armwright.scalar import real_number
from armwright.spatial import Placement, rotation_rpy

RANDOM = 30  # poses at least that show the structure
ROWS = 3  # numbers by column in them


@dataclass(frozen=True, eq=False)
class Setting:
    """A calibration that is ready to be fitted.

    Attributes:
        arm: the model.   measurements: of it.   q: (poses, n) of all joints.   terms: that are corrected.
        columns: all parameters.   targets: the measured quantities.
        base: (4, 4) of the arm's base in the measuring frame for parameters of 0; None without points and poses.
        structural: identifiable parameters by the structure.   grouped: by these poses.   remarks: for the user.
    """

    arm: Model
    measurements: Measurements
    q: np.ndarray
    terms: tuple[str, ...]
    columns: tuple[GeometryColumn, ...]
    targets: tuple[Target, ...]
    base: np.ndarray | None
    structural: BaseParameters
    grouped: BaseParameters
    remarks: tuple[str, ...] = ()

    def all_parameters(self, values: np.ndarray) -> np.ndarray:
        """(p,) values of all columns from those (b,) of the identifiable parameters, others 0."""
        full = np.zeros(len(self.columns))
        full[self.grouped.independent] = values
        return full

    def rows(self, values: np.ndarray) -> Rows:
        """Errors and derivatives by the identifiable parameters, at their values (b,)."""
        found = errors_at(self.targets, self.q, self.all_parameters(values))
        return replace(found, jacobian=found.jacobian[:, self.grouped.independent])

    @property
    def kept(self) -> list[GeometryColumn]:
        """Columns of the identifiable parameters."""
        return [self.columns[k] for k in self.grouped.independent]


def setting_of(arm: Model, measurements: Measurements, terms: tuple[str, ...]) -> Setting:
    """The setting, with first guesses of what the record does not know.

    Raises:
        IdentificationError: joints that the arm lacks, or measurements that determine nothing.   ModelError: no such frame.
    """
    q = positions(arm, measurements)
    first = ArmChains(arm, terms, Columns())
    _targets(first, measurements, q)
    columns = sorted(first.columns.found, key=lambda column: ORDER.index(column.kind))  # who stays stands first
    targets, base = _targets(replace(first, columns=Columns(columns)), measurements, q)
    zero = np.zeros(len(columns))
    drawn = random_positions(arm, max(RANDOM, ROWS * len(columns) // len(targets)))
    at_random = sensitivities(targets, drawn, zero).jacobian
    every: Any = tuple(columns)  # of which names, kinds and units are read
    structural = regrouped(every, np.asarray(np.linalg.qr(at_random, mode="r")), NEARLY)
    structural = structural.without(_base_corrections(measurements, targets))
    lengths = _held_length(arm, measurements, structural)
    structural = structural.without(lengths)
    here = errors_at(targets, q, zero).jacobian
    if len(here) <= len(structural):
        what = f"{len(here)} measured numbers for {len(structural)} identifiable parameters"
        raise IdentificationError(what, place="measurements", expected="more poses, or fewer terms")
    grouped = regrouped_further(structural, np.asarray(np.linalg.qr(here, mode="r")), NEARLY)
    why = "is kept: points that are touched say nothing about the arm's size"
    remarks = tuple(f"{columns[k].name} {why}" for k in lengths)
    return Setting(arm, measurements, q, terms, tuple(columns), targets, base, structural, grouped, remarks)


def positions(arm: Model, measurements: Measurements) -> np.ndarray:
    """(poses, n) of all joints of the arm; those that were not read stand where they are locked, or at 0.

    Raises:
        IdentificationError: a name that is no joint.
    """
    for name in (*measurements.joints, *measurements.locked):
        check_known(IdentificationError, name, arm.names, f"no joint of {arm.name!r}", place="joint")
    q = np.zeros((len(measurements), arm.n))
    for name, value in measurements.locked.items():
        q[:, arm.names.index(name)] = value
    q[:, [arm.names.index(name) for name in measurements.joints]] = measurements.q
    return q


def two_or_more(place: str, value: Any) -> int:
    """A whole number of 2 or more.

    Raises:
        IdentificationError: something else.
    """
    found = real_number(value)
    if found is None or found != int(found) or found < 2:
        raise IdentificationError(place=place, value=value, expected="a whole number of 2 or more")
    return int(found)


def random_positions(arm: Model, count: int, seed: int = 0) -> np.ndarray:
    """(count, n) positions within the joints' limits."""
    low, high = np.array([body.sampled_range for body in arm.coordinates], dtype=float).T
    return np.random.default_rng(seed).uniform(low, high, (count, arm.n))


def _targets(
    chains: ArmChains, measurements: Measurements, q: np.ndarray
) -> tuple[tuple[Target, ...], np.ndarray | None]:
    """Chains of all quantities, from the guesses on, and the base in the measuring frame."""
    arms = {each.name: chains.to(each.frame) for each in measurements.measured}
    none = np.zeros(len(chains.columns.found))
    poses = {name: moved(factors, q, none).placement for name, factors in arms.items()}
    framed = [each for each in measurements.measured if each.kind in ("point", "pose")]
    known, places = _known_base(measurements), {}
    base = known
    if framed:
        shown = [poses[each.name][each.seen] for each in framed]
        values = [each.values[each.seen, :3] for each in framed]
        base, found = start.measuring_frame(shown, values, [each.place for each in framed], known)
        places = dict(zip((each.name for each in framed), found, strict=True))
    front = chains.columns.frame(measurements.measuring_frame) if framed and known is None else []
    whole: dict[tuple[str | None, bool], list[Factor]] = {}
    targets = []
    for each in measurements.measured:
        ahead: list[Factor] = [] if base is None or each.kind not in ("point", "pose") else [Constant(base), *front]
        carrier = whole.setdefault((each.frame, bool(ahead)), [*ahead, *arms[each.name]])
        targets.append(_target(chains.columns, each, carrier, poses[each.name], base, places.get(each.name)))
    return tuple(targets), base


def _known_base(measurements: Measurements) -> np.ndarray | None:
    """(4, 4) of the base in a measuring frame whose place in the base is known."""
    if measurements.placed is None:
        return None
    placed = Placement(rotation_rpy(*measurements.placed[3:]), measurements.placed[:3])
    return np.asarray(placed.inverse().matrix(), dtype=float)


def _target(
    columns: Columns,
    measured: Measured,
    carrier: list[Factor],
    poses: np.ndarray,
    base: np.ndarray | None,
    place: np.ndarray | None,
) -> Target:
    """The chain of one quantity, with its point on the tool and the points that do not move."""
    ends, fixed, seen = np.zeros((0, 3), dtype=int), np.zeros((1, 3)), measured.seen
    if measured.kind == "pose":
        assert base is not None
        assert place is not None
        tool = shifted(place)
        tool[:3, :3] = start.tool_turn(base, poses[seen], measured.values[seen, 3:])
        return Target(measured, carrier, [Constant(tool), *columns.frame(measured.name, "point")], ends, fixed)
    if measured.kind == "fixed point":
        labels = np.unique(measured.values[seen, 0])
        which = np.searchsorted(labels, measured.values[seen, 0])
        place, fixed = start.touched(poses[seen], which, measured.place)
        names = [f"{measured.name} point {label:g}" for label in labels]
    elif measured.kind == "distance":
        place = np.zeros(3) if measured.place is None else measured.place
        at = poses[seen, :3, :3] @ place + poses[seen, :3, 3]
        known = measured.anchor is not None
        fixed = np.array([measured.anchor if known else start.anchor(at, measured.values[seen, 0])])
        names = [] if known else [f"{measured.name} anchor"]
    else:
        names = []
    if names:
        ends = np.array([[each.parameter for each in columns.point(name)] for name in names])
    tool = [Constant(shifted(place)), *([] if measured.place is not None else columns.point(measured.name))]
    return Target(measured, carrier, tool, ends, fixed)


def shifted(place: np.ndarray | None) -> np.ndarray:
    """(4, 4) of a shift."""
    matrix = np.eye(4)
    matrix[:3, 3] = place
    return matrix


def _base_corrections(measurements: Measurements, targets: Sequence[Target]) -> list[int]:
    """Corrections before the first motion, which place the arm as a whole, where points are touched whose place is not known.

    An arm that is turned as a whole touches points that are turned with it. Derivatives show that only where errors are 0.
    """
    known = measurements.placed is not None or any(each.anchor is not None for each in measurements.measured)
    touched = next((each for each in targets if each.measured.kind == "fixed point"), None)
    if known or touched is None:
        return []
    before = itertools.takewhile(lambda factor: not isinstance(factor, Motion), touched.factors)
    return [factor.parameter for factor in before if isinstance(factor, Correction)]


def _held_length(arm: Model, measurements: Measurements, base: BaseParameters) -> list[int]:
    """The longest identifiable length, where nothing but touched points was measured: an arm of another size does the same.

    With all lengths l of the record larger by a share, the identifiable parameters change along A l.
    """
    if any(each.kind != "fixed point" or each.place is not None for each in measurements.measured):
        return []
    by_size = base.of(np.array([_length(arm, column) for column in base.columns]))
    kept = [(abs(by_size[b]), int(k)) for b, k in enumerate(base.independent) if base.columns[k].kind == "length"]
    return [max(kept)[1]] if kept else []


def _length(arm: Model, column: Any) -> float:
    """Number of the record that a correction adds to [m]; 0 of one that is no length."""
    if column.kind != "length":
        return 0.0
    if column.path:
        return float(next(quantity for path, quantity, _ in quantities(arm.record) if path == column.path))
    joint = next(each for each in arm.record.joints if each.name == column.joint)
    before, _ = joint_placement(joint)
    return float((before.rotation.T @ before.position)[AXES.index(column.name[-1])])

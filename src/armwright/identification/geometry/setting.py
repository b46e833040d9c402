"""Setting of a calibration: columns, targets and structure, from an arm and measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright.errors import IdentificationError
from armwright.identification.arm.base import NEARLY, BaseParameters, regrouped, regrouped_further
from armwright.identification.geometry import start
from armwright.identification.geometry.arm_chain import ORDER, ArmChains, Columns, GeometryColumn
from armwright.identification.geometry.chain import Constant, Factor, moved
from armwright.identification.geometry.measurements import Measured, Measurements
from armwright.identification.geometry.problem import Rows, Target, errors_at, sensitivities
from armwright.model import Model
from armwright.spatial import Placement, rotation_rpy

RANDOM = 30  # poses at least that show the structure
ROWS = 3  # numbers by column in them
WIDE = np.pi  # [rad | m] to either side, of a joint without limits


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

    def rows(self, values: np.ndarray) -> Rows:
        """Errors and derivatives by the identifiable parameters, at their values (b,)."""
        kept = self.grouped.independent
        full = np.zeros(len(self.columns))
        full[kept] = values
        found = errors_at(self.targets, self.q, full)
        return replace(found, jacobian=found.jacobian[:, kept])

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
    fixed, remarks = _held_scale(columns, measurements)
    at_random = sensitivities(
        targets, random_positions(arm, max(RANDOM, ROWS * len(columns) // len(targets))), zero
    ).jacobian
    every: Any = tuple(columns)  # of which names, kinds and units are read
    structural = regrouped(every, _triangular(at_random, fixed), NEARLY)
    here = errors_at(targets, q, zero).jacobian
    if len(here) <= len(structural):
        what = f"{len(here)} measured numbers for {len(structural)} identifiable parameters"
        raise IdentificationError(what, place="measurements", expected="more poses, or fewer terms")
    grouped = regrouped_further(structural, _triangular(here, fixed), NEARLY)
    return Setting(arm, measurements, q, terms, tuple(columns), targets, base, structural, grouped, remarks)


def positions(arm: Model, measurements: Measurements) -> np.ndarray:
    """(poses, n) of all joints of the arm; those that were not read stand where they are locked, or at 0.

    Raises:
        IdentificationError: a name that is no joint.
    """
    for name in (*measurements.joints, *measurements.locked):
        if name not in arm.names:
            raise IdentificationError(f"no joint of {arm.name!r}", place="joint", value=name, choices=tuple(arm.names))
    q = np.zeros((len(measurements), arm.n))
    for name, value in measurements.locked.items():
        q[:, arm.names.index(name)] = value
    q[:, [arm.names.index(name) for name in measurements.joints]] = measurements.q
    return q


def random_positions(arm: Model, count: int, seed: int = 0) -> np.ndarray:
    """(count, n) positions within the joints' limits."""
    low, high = np.array([np.clip(body.limits.position, -WIDE, WIDE) for body in arm.coordinates], dtype=float).T
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


def _held_scale(columns: Sequence[GeometryColumn], measurements: Measurements) -> tuple[list[int], tuple[str, ...]]:
    """The longest length of the record where nothing but fixed points was measured: these say nothing about its size."""
    if any(each.kind != "fixed point" or each.place is not None for each in measurements.measured):
        return [], ()
    lengths = [k for k, column in enumerate(columns) if column.kind == "length"]
    if not lengths:
        return [], ()
    return lengths[-1:], (
        f"{columns[lengths[-1]].name} is kept: points that are touched say nothing about the arm's size",
    )


def _triangular(jacobian: np.ndarray, fixed: Sequence[int]) -> np.ndarray:
    """R of derivatives, without some columns."""
    jacobian[:, list(fixed)] = 0.0
    return np.asarray(np.linalg.qr(jacobian, mode="r"))

"""Poses for a calibration: those of many reachable, collision-free ones that tell most of the geometry. [BormMenq1991]

    O1 = (σ1 σ2 … σb)^(1/b) / √poses,   σ the singular values of what all poses measure, by the identifiable corrections

The largest O1 of a given number of poses is the largest determinant of the information, so they are exchanged one by one for
those that raise it most. [Fedorov1972]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.collision.clearance import Clearance, clearance as clearance_of
from armwright.entry import AnyArm, as_arm, expect
from armwright.errors import IdentificationError, ModelError
from armwright.identification.arm.base import NEARLY, regrouped
from armwright.identification.geometry.arm_chain import STORED, ArmChains, Columns, checked_terms
from armwright.identification.geometry.chain import Constant, Correction, moved
from armwright.identification.geometry.measurements import Measured
from armwright.identification.geometry.problem import Target, sensitivities
from armwright.identification.geometry.setting import random_positions, shifted, two_or_more
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.results.result import BLUE, Result
from armwright.results.svg import ink_axes
from armwright.results.table import Table, number
from armwright.scalar import numbers_or_nan

CANDIDATES = 400  # poses that are chosen from
DRAWN = 40  # times as many are drawn before the free ones are given up
PASSES = 20  # through all poses, until none is exchanged
GAIN = 1e-9  # of the logarithm of the determinant, for an exchange
RANDOM_SETS = 20  # to compare with
RIDGE = 1e-9  # of the mean information, while the first poses do not tell everything


@dataclass(frozen=True, eq=False)
class CalibrationPoses(Result):
    """Poses of `design_poses`.

    Attributes:
        arm: the model.   q: (poses, n) [rad | m].   points: (k, 3) [m] on the tool, in the frame that carries them.
        o1: observability index of the poses.   random_o1: of as many random ones, the mean of 20 sets.
        condition: of the scaled derivatives.   deviations: (b,) of the corrections by those of random poses.
        names: (b,) of the corrections.   least: smallest distance between links and from obstacles [m]; None: not looked at.
    """

    arm: Model
    q: np.ndarray
    points: np.ndarray
    o1: float
    random_o1: float
    condition: float
    deviations: np.ndarray
    names: tuple[str, ...]
    least: float | None

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{len(self.q)} poses of {self.arm.name} for a calibration"

    def tables(self) -> list[Table]:
        """A pose a row; then how much they tell."""
        units = joint_units(self.arm, "q")
        heads = ["pose", *(f"{name} [{unit}]" for name, unit in zip(self.arm.names, units, strict=True))]
        poses = [[str(k + 1), *map(number, row)] for k, row in enumerate(self.q)]
        measures = [
            ["O1", number(self.o1, ".4g"), number(self.random_o1, ".4g")],
            ["condition", number(self.condition, ".4g"), ""],
            ["mean deviation of a correction, by random", number(self.deviations.mean(), ".3g"), number(1.0)],
            ["least distance [m]", number(self.least, ".3g"), ""],
        ]
        return [Table(self.heading, heads, poses), Table("information", ("", "these", "random"), measures)]

    def sentences(self) -> list[str]:
        """A remark if collisions were not checked."""
        said = "no link has a shape, so collisions were not looked at: radius gives them one"
        return [said] if self.least is None else []

    def draw(self, figure: Any, ink: str, quiet: str) -> None:
        """Draws the deviation of every correction, by that of random poses."""
        axes, rows = figure.subplots(), np.arange(len(self.names))
        axes.bar(rows, self.deviations, color=BLUE)
        axes.axhline(1.0, color=quiet, linewidth=0.8)
        axes.set_xticks(rows, self.names, rotation=90)
        axes.set_ylabel("deviation by that of random poses", color=ink)
        ink_axes(axes, ink)


def design_poses(
    arm: AnyArm,
    count: int,
    points: Any,
    *,
    frame: str | None = None,
    clearance: Clearance | None = None,
    box: Any = None,
    terms: Sequence[str] = STORED,
    candidates: int = CANDIDATES,
    seed: int = 0,
) -> CalibrationPoses:
    """Poses in which a tracker should measure points on the tool, so that a calibration finds most: the largest O1.

    They are chosen from random poses within the joint limits that keep the clearance, by exchange. Where the points are on the
    tool and where the tracker stands may be known roughly only: both are found with the calibration.

    Args:
        arm: the arm.   count: of poses.   points: (k, 3) [m] on the tool.   frame: that carries them; by default the tip.
        clearance: of `aw.collision.clearance`, with its obstacles and least distance; by default that of the links themselves,
            where the record has their shapes.   box: (2, 3) [m] lowest and highest corner, in base axes, within which all
            points must be, such as what a camera sees.   terms: as of `calibrate`.
        candidates: how many poses they are chosen from.   seed: of these.
    Returns:
        poses: with O1, and the deviations that they promise.
    Raises:
        IdentificationError: arguments that are none, fewer poses than determine the geometry, or no free ones.
        ModelError: no such frame.
    Example:
        >>> points = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
        >>> poses = aw.identification.design_poses("lwa4p", 12, points, candidates=50)
        >>> poses.q.shape
        (12, 6)
    """
    model = as_arm(arm)
    wanted, many = (two_or_more(name, value) for name, value in (("count", count), ("candidates", candidates)))
    if many <= wanted:
        raise IdentificationError(place="candidates", value=candidates, expected=f"more than count, {wanted}")
    places = np.atleast_2d(numbers_or_nan(points))
    if places.ndim != 2 or places.shape[1] != 3 or not np.isfinite(places).all():
        raise IdentificationError(place="points", value=points, expected="(k, 3) numbers [m]")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise IdentificationError(place="seed", value=seed, expected="a whole number of 0 or more")
    if clearance is not None:
        expect(clearance, Clearance, "clearance", "what aw.collision.clearance returns", IdentificationError)
    columns = Columns()
    targets = _targets(ArmChains(model, checked_terms(terms, model), columns), places, frame)
    free = _free(model, clearance)
    q, least = _candidates(model, many, seed, free, targets, _corners(box))
    rows = sensitivities(targets, q, np.zeros(len(columns.found)))
    every: Any = tuple(columns.found)  # of which names, kinds and units are read
    base = regrouped(every, np.asarray(np.linalg.qr(rows.jacobian, mode="r")), NEARLY)
    own = rows.jacobian[:, base.independent]
    size = np.linalg.norm(own, axis=0) / np.sqrt(len(q))
    by_pose = (own / size)[np.argsort(rows.pose, kind="stable")].reshape(len(q), -1, own.shape[1])
    if wanted * by_pose.shape[1] < len(base):
        what = f"{wanted} poses measure {wanted * by_pose.shape[1]} numbers"
        raise IdentificationError(what, place="count", expected=f"{-(-len(base) // by_pose.shape[1])} poses or more")
    chosen = exchanged(by_pose, wanted, np.random.default_rng([seed, 1]))
    return _found(model, q, places, least, by_pose, chosen, tuple(columns.found[k].name for k in base.independent))


def exchanged(by_pose: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count,) numbers of the poses whose information has the largest determinant, by exchange from random ones.

    Args:
        by_pose: (candidates, rows, b) derivatives.   count: of poses.   rng: for the first ones.
    """
    chosen = rng.choice(len(by_pose), count, replace=False)
    information = by_pose[chosen].reshape(-1, by_pose.shape[2])
    matrix = information.T @ information
    ridge = RIDGE * np.trace(matrix) / len(matrix) * np.eye(len(matrix))
    one = np.eye(by_pose.shape[1])
    for _ in range(PASSES):
        changed = False
        for place in range(count):
            old = by_pose[chosen[place]]
            without = matrix - old.T @ old + ridge
            gained = np.linalg.slogdet(one + by_pose @ np.linalg.solve(without, by_pose.transpose(0, 2, 1)))[1]
            before = gained[chosen[place]]
            gained[np.delete(chosen, place)] = -np.inf  # each pose once
            best = int(np.argmax(gained))
            if gained[best] > before + GAIN:
                matrix = matrix - old.T @ old + by_pose[best].T @ by_pose[best]
                chosen[place], changed = best, True
        if not changed:
            break
    return chosen


def _found(
    arm: Model,
    q: np.ndarray,
    points: np.ndarray,
    least: np.ndarray | None,
    by_pose: np.ndarray,
    chosen: np.ndarray,
    names: tuple[str, ...],
) -> CalibrationPoses:
    """The chosen poses beside random ones."""
    rng = np.random.default_rng(2)
    random = [rng.choice(len(q), len(chosen), replace=False) for _ in range(RANDOM_SETS)]
    others = [_measures(by_pose[each]) for each in random]
    o1, condition, spread = _measures(by_pose[chosen])
    usual = np.median([each[2] for each in others], axis=0)
    closest = None if least is None else float(least[chosen].min())
    return CalibrationPoses(
        arm,
        q[chosen],
        points,
        o1,
        float(np.mean([each[0] for each in others])),
        condition,
        spread / usual,
        names,
        closest,
    )


def _measures(derivatives: np.ndarray) -> tuple[float, float, np.ndarray]:
    """O1, condition, and deviations (b,) for noise of 1, of poses (count, rows, b)."""
    singular = np.linalg.svd(derivatives.reshape(-1, derivatives.shape[2]), compute_uv=False)
    stacked = derivatives.reshape(-1, derivatives.shape[2])
    spread = np.sqrt(np.diag(np.linalg.pinv(stacked.T @ stacked)))
    tiny = np.finfo(float).tiny
    o1 = float(np.exp(np.log(np.maximum(singular, tiny)).mean()) / np.sqrt(len(derivatives)))
    return o1, float(singular[0] / max(singular[-1], tiny)), spread


def _targets(chains: ArmChains, places: np.ndarray, frame: str | None) -> list[Target]:
    """Points on the tool, seen by a tracker at an unknown place."""
    factors = [*chains.columns.frame("tracker"), *chains.to(frame)]
    none, ends, fixed = np.zeros((1, 3)), np.zeros((0, 3), dtype=int), np.zeros((1, 3))
    return [
        Target(
            Measured(f"point{k + 1}", "point", none, frame),
            factors,
            [Constant(shifted(place)), *chains.columns.point(f"point{k + 1}")],
            ends,
            fixed,
        )
        for k, place in enumerate(places)
    ]


def _free(arm: Model, clearance: Clearance | None) -> Clearance | None:
    """Distances that the poses keep; None of an arm without shapes."""
    if clearance is not None:
        return clearance
    try:
        return clearance_of(arm)
    except ModelError:
        return None


def _candidates(
    arm: Model, count: int, seed: int, free: Clearance | None, targets: Sequence[Target], corners: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions (count, n) that are free, and their least distances.

    Raises:
        IdentificationError: too few of many.
    """
    q = random_positions(arm, DRAWN * count, seed)
    kept = np.ones(len(q), dtype=bool)
    least = None
    if free is not None and free.pairs:
        least = free.distances(q).min(axis=1)
        kept &= least > free.least
    if corners is not None:
        numbers = [each.parameter for target in targets for each in target.tool if isinstance(each, Correction)]
        values = np.zeros(1 + max(numbers))
        for target in targets:
            at = moved([*target.factors, *target.tool], q, values).placement[:, :3, 3]
            kept &= (at >= corners[0]).all(axis=1) & (at <= corners[1]).all(axis=1)
    rows = np.flatnonzero(kept)[:count]
    if len(rows) < count:
        what = f"{len(rows)} of {len(q)} random poses are free"
        raise IdentificationError(what, place="candidates", expected="fewer candidates, less clearance or a larger box")
    return q[rows], None if least is None else least[rows]


def _corners(box: Any) -> np.ndarray | None:
    """(2, 3) of a box.

    Raises:
        IdentificationError: no two corners.
    """
    if box is None:
        return None
    corners = numbers_or_nan(box)
    if corners.shape != (2, 3) or np.isnan(corners).any() or not (corners[0] < corners[1]).all():
        raise IdentificationError(place="box", value=box, expected="(2, 3) [m]: lowest and highest corner")
    return corners

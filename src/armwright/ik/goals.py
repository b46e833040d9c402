"""Secondary goals of redundant arms: joint positions move within a pose until the goal grows no better. [Liegeois1977]

A step is a descent of the goal h in the null space of the Jacobian J, in the metric W (diagonal):

    d = -P W⁻¹ ∇h,    P = 1 - W⁻¹ Jᵀ (J W⁻¹ Jᵀ)⁻¹ J,    then  q += W⁻¹ Jᵀ (J W⁻¹ Jᵀ)⁻¹ e  until the pose is met again.

Joints at a limit that d would cross are held, W⁻¹ = 0 there. The step grows where h got smaller and shrinks where it did not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from armwright import scalar
from armwright.errors import ModelError
from armwright.ik.chain import TURN, JointChain
from armwright.ik.descent import LaneState, chosen
from armwright.program import Program, trace
from armwright.scalar import Array, Scalar

Best = Literal["nearest", "limits", "manipulability"]
CORRECTIONS = 5  # steps back to the pose after one along it
GROW, SHRINK, SHORTEST = 2.0, 0.25, 1e-6  # factors of the step; a shorter one ends the search
LONGEST = 0.3  # [rad | m] of a joint in one step
# Factor of d at most: W⁻¹ is the inverse of h's second derivative, but for manipulability, which may be flat.
MOST_LENGTH = {"nearest": 1.0, "limits": 1.0, "manipulability": 1e3}
STILL = 1e-7  # [rad | m] of d where the goal is reached
MOST = 150  # evaluations of one search
AT_LIMIT = 1e-9  # [rad | m]
TINY = 1e-13  # relative, on the diagonal: at singular poses J W⁻¹ Jᵀ has no inverse


@dataclass(frozen=True)
class Goal:
    """Cost by which solutions are compared, and the weight of an angle against a length.

    Args:
        best: of the joint positions that meet a pose those "nearest" to given ones (least Σ (q - near)²), farthest from the
            "limits" (least Σ of squared distances from the middles of the joints' ranges, in halves of them), or of most
            "manipulability" (angles times `length`); absent: the first that is found.
        length: [m/rad] of angles, also where a target is not reached; absent: a third of the arm's reach.
    Raises:
        ModelError: no such goal, a length that is none.
    Example:
        >>> arm, q = aw.load("panda"), [0.0, -0.8, 0.0, -2.3, 0.0, 1.6, 0.8]
        >>> pose = aw.forward_kinematics(arm, q)
        >>> goal = aw.kinematics.Goal("limits")
        >>> bool(aw.inverse_kinematics(arm, pose, goal=goal).success)
        True
    """

    best: Best | None = None
    length: float | None = None

    def __post_init__(self) -> None:
        if self.best is not None and self.best not in get_args(Best):
            raise ModelError(place="goal", value=self.best, choices=get_args(Best))
        length = None if self.length is None else scalar.real_number(self.length)
        if self.length is not None and (length is None or not 1e-6 <= length <= 1e6):
            raise ModelError(place="length", value=self.length, expected="a number from 1e-6 to 1e6 [m/rad]")

    @classmethod
    def of(cls, value: Any) -> Goal:
        """The goal that a word names; that of None has no preference.

        Raises:
            ModelError: no such word; says which there are.
        """
        return value if isinstance(value, cls) else cls(value)


def goal_value(chain: JointChain, goal: Best, q: Array, preferred: Array) -> Scalar:
    """Value of a goal, the smaller the better.

    nearest: ½ Σ (q - q*)², of joints that turn around by the shorter way.   limits: ½ Σ ((q - middle) / half the range)² over
    joints with two limits that do not turn around.   manipulability: -½ log det(J Jᵀ), angles times the chain's weight.
    """
    if goal == "nearest":
        return 0.5 * sum(x * x for x in _difference(chain, q, preferred))
    if goal == "limits":
        middle, scale = _ranges(chain)
        return 0.5 * sum(((x - m) * s) * ((x - m) * s) for x, m, s in zip(q, middle, scale, strict=True) if s > 0.0)
    rows = chain.slopes(q)
    if len(rows) > chain.n:
        rows = rows.T
    inverse = scalar.factor_symmetric(rows @ rows.T + 1e-12 * np.eye(len(rows))).inverse
    return 0.5 * sum(scalar.log(scalar.maximum(x, 1e-300)) for x in inverse)


def _difference(chain: JointChain, q: Array, preferred: Array) -> list[Scalar]:
    difference = q - preferred
    return [
        x - TURN * scalar.floor(x / TURN + 0.5) if t else x for x, t in zip(difference, chain.turns_around, strict=True)
    ]


def _ranges(chain: JointChain) -> tuple[np.ndarray, np.ndarray]:
    """Middles (n,) of joint ranges and 1 / half of each; 0 for joints without two limits or that turn around."""
    low, high = (np.asarray(each, dtype=float) for each in (chain.low, chain.high))
    limited = np.isfinite(high - low) & (high > low)
    low, high = np.where(limited, low, -1.0), np.where(limited, high, 1.0)
    return 0.5 * (low + high), np.where(limited, 2.0 / (high - low), 0.0)


def goal_search(chain: JointChain, goal: Best, tolerance: float) -> Program:
    """Program  task, fresh, state → state_next, over, fresh_next, result  of one evaluation.

    task: that of the pose, joint positions that meet it (n), preferred ones (n). result: joint positions, goal, evaluations.

    Args:
        chain: the arm's.   goal: what is to be small.   tolerance: on the error of the pose [m | rad].
    """
    n, size = chain.n, chain.task_size
    numbers = dict.fromkeys(("least", "length", "corrections", "spent"), 1)
    layout = LaneState({"q": n, "trial": n, "way": n} | numbers)
    solved = (tolerance * min(1.0, float(chain.weight))) ** 2
    scale = _ranges(chain)[1] if goal == "limits" else np.ones(n)
    # W⁻¹: about that of h's second derivative
    metric = 1.0 / np.where(scale > 0.0, scale, scale.max(initial=0.0) or 1.0) ** 2

    def step(task: Array, fresh: Array, state: Array) -> tuple[np.ndarray, ...]:
        old, first = layout.split(state), scalar.less(0.0, fresh[0])
        q = chosen(first, task[size : size + n], old["trial"])
        error, slope = chain.error(q, task)
        value = goal_value(chain, goal, q, task[size + n :])
        gradient = scalar.jacobian(lambda x: scalar.array([goal_value(chain, goal, x, task[size + n :])]), q)[0]
        met = scalar.where(first, 1.0, scalar.less(error @ error, solved))
        better = scalar.where(first, 1.0, met * scalar.less(value, old["least"][0]))
        tried = scalar.where(first, 0.0, old["corrections"][0])
        corrects = (1.0 - met) * scalar.less(tried, float(CORRECTIONS))
        way = chosen(better, _descent_direction(chain, q, slope, -gradient, metric), old["way"])
        length = scalar.where(
            better, scalar.minimum(old["length"][0] * GROW, MOST_LENGTH[goal]), old["length"][0] * SHRINK
        )
        length = scalar.where(first, 1.0, scalar.where(corrects, old["length"][0], length))
        kept = chosen(better, q, old["q"])
        least = scalar.where(better, value, old["least"][0])
        spent = scalar.where(first, 1.0, old["spent"][0] + 1.0)
        trial = chosen(corrects, _corrected(chain, q, slope, error, metric), _moved(chain, kept, way, length))
        still = scalar.less(_largest(way), STILL) * (1.0 - corrects)
        ends = still + scalar.less(length, SHORTEST) + scalar.less_equal(float(MOST), spent)
        numbers = {
            "least": least,
            "length": length,
            "corrections": scalar.where(corrects, tried + 1.0, 0.0),
            "spent": spent,
        }
        parts = {"q": kept, "trial": trial, "way": way}
        state_next = layout.joined(parts | {name: scalar.array([each]) for name, each in numbers.items()})
        over = scalar.where(scalar.less(0.0, ends), 2.0, 0.0)
        return state_next, scalar.array([over]), scalar.zeros(1), scalar.array([*kept, least, spent])

    shapes = {"task": (size + 2 * n,), "fresh": (1,), "state": (layout.size,)}
    return trace("goal_search", step, shapes, ("state_next", "over", "fresh_next", "result"))


def _descent_direction(chain: JointChain, q: Array, slope: Array, downhill: Array, metric: np.ndarray) -> np.ndarray:
    """d (n,), where joints at a limit that it would cross are held; once more where others then cross theirs."""
    inverse = scalar.array(metric)
    way = _projected(slope, downhill, inverse)
    for _ in range(2):
        inverse = scalar.array([x * _free(chain, i, q[i], way[i]) for i, x in enumerate(inverse)])
        way = _projected(slope, downhill, inverse)
    return scalar.array([x * _free(chain, i, q[i], x) for i, x in enumerate(way)])


def _free(chain: JointChain, joint: int, at: Scalar, way: Scalar) -> Scalar:
    """0 for a joint at a limit that would be crossed, else 1."""
    crosses = 0.0
    if np.isfinite(chain.low[joint]):
        crosses = crosses + scalar.less(at, chain.low[joint] + AT_LIMIT) * scalar.less(way, 0.0)
    if np.isfinite(chain.high[joint]):
        crosses = crosses + scalar.less(chain.high[joint] - AT_LIMIT, at) * scalar.less(0.0, way)
    return 1.0 - crosses


def _projected(slope: Array, downhill: Array, inverse: Array) -> np.ndarray:
    """P W⁻¹ downhill."""
    plain = inverse * downhill
    return plain - _correction_step(slope, slope @ plain, inverse)


def _correction_step(slope: Array, error: Array, inverse: Array) -> np.ndarray:
    """The shortest step in the metric that takes an error away:  W⁻¹ Jᵀ (J W⁻¹ Jᵀ)⁻¹ e."""
    weighted = slope * inverse
    square = weighted @ slope.T
    rest = TINY * sum(square[i, i] for i in range(len(square)))
    return weighted.T @ scalar.solve_symmetric(square + np.eye(len(square)) * (rest + 1e-300), error)


def _corrected(chain: JointChain, q: Array, slope: Array, error: Array, metric: np.ndarray) -> np.ndarray:
    step = _correction_step(slope, error, scalar.array(metric))
    held = scalar.array([x * _free(chain, i, q[i], step[i]) for i, x in enumerate(metric)])
    return chain.within(q + _correction_step(slope, error, held))


def _moved(chain: JointChain, q: Array, way: Array, length: Scalar) -> np.ndarray:
    """q + length way, no joint by more than LONGEST, and no further than to the first limit."""
    factor = scalar.minimum(length, LONGEST / scalar.maximum(_largest(way), 1e-12))
    for i in range(chain.n):
        for limit in (chain.low[i], chain.high[i]):
            if np.isfinite(limit):
                towards = scalar.less(0.0, way[i] * (limit - q[i]))
                share = scalar.where(towards, (limit - q[i]) / scalar.where(towards, way[i], 1.0), factor)
                factor = scalar.minimum(factor, scalar.maximum(share, 0.0))
    return chain.within(q + factor * way)


def _largest(values: Array) -> Scalar:
    largest = scalar.abs(values[0])
    for value in values[1:]:
        largest = scalar.maximum(largest, scalar.abs(value))
    return largest

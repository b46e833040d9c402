"""Time-optimal moves limited in jerk, from any moving state to any other, by the library Ruckig. [BerscheidKroeger2021]

Ruckig's free version sends waypoints to a service on the network. None are passed here: what is computed is one move from
state to state, on this machine.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.parameters import UNSET, Numbers, NumbersOrNone
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.minimum_jerk import check_states
from armwright.trajectory.piecewise import PiecewiseMotion, PiecewisePolynomial
from armwright.trajectory.poses import check_limits, check_number, plain_pose

SHORTEST = 1e-14  # of the move: a segment that is shorter, as one of a huge jerk, cannot be told from rounding
STATES = ("start", "goal", "start_velocity", "start_acceleration", "goal_velocity", "goal_acceleration")


@dataclass(frozen=True, eq=False)
class Ruckig(PiecewiseMotion):
    """Fastest move between two moving states within limits of speed, acceleration and jerk; joints end together.

    A start that is faster than its limits is braked first. Needs `pip install armwright[trajectory]`.

    Args:
        start, goal: (n,) [rad | m].   limits: velocity, acceleration, jerk (perhaps infinite), position.
        duration: [s]; None: the shortest.   start_velocity, goal_velocity: (n,) [rad/s | m/s]; None: 0.
        start_acceleration, goal_acceleration: (n,) [rad/s² | m/s²]; None: 0.   time: [s] of its beginning.
    Raises:
        ScenarioError: Ruckig is not installed; a joint that moves without a limit of acceleration or jerk; a pose or the state at
            the goal outside its limits; a way that leaves the limits of position, with the joint and how far; a duration that is
            not possible.
    Example:
        >>> own = {"velocity": 1.0, "acceleration": 4.0, "jerk": 40.0}
        >>> limits = aw.trajectories.MotionLimits.of("two-link", **own)
        >>> start, goal, speed = [0.0, 0.0], [0.5, -0.5], [0.2, 0.0]
        >>> move = aw.trajectories.Ruckig(start, goal, limits, start_velocity=speed)
        >>> round(float(move.duration), 3)
        0.85
    """

    start: Numbers
    goal: Numbers
    limits: MotionLimits
    duration: Any = None
    start_velocity: NumbersOrNone = UNSET
    start_acceleration: NumbersOrNone = UNSET
    goal_velocity: NumbersOrNone = UNSET
    goal_acceleration: NumbersOrNone = UNSET
    time: float = 0.0

    def __post_init__(self) -> None:
        check_limits("Ruckig", self.limits)
        check_number("Ruckig", "time", self.time)
        if self.duration is not None:
            check_number("Ruckig", "duration", self.duration, above=0.0)
        n, limits = self.limits.n, self.limits
        poses = {
            name: plain_pose("Ruckig", name, getattr(self, name), n if name != "start" else None) for name in STATES
        }
        if len(poses["start"]) != n:
            raise ScenarioError(
                f"{len(poses['start'])} numbers", place="Ruckig.start", expected=f"{n}, one for each joint"
            )
        # zeros in place of the start's speeds and accelerations, which may exceed their limits: they are braked
        goal = [np.stack([np.zeros(n), poses[name]]) for name in ("goal_velocity", "goal_acceleration")]
        check_states("Ruckig", limits, np.stack([poses["start"], poses["goal"]]), *goal)
        at_rest = not any(poses[name].any() for name in STATES[2:])
        if at_rest and np.array_equal(poses["start"], poses["goal"]):
            raise ScenarioError("the move has no length", place="Ruckig.goal", expected="another pose than start")
        moving = (poses["start"] != poses["goal"]) | np.any([poses[name] != 0.0 for name in STATES[2:]], axis=0)
        if np.isinf(limits.jerk[moving]).any():
            limits.required("acceleration", moving=moving & np.isinf(limits.jerk))
        polynomial = _planned(poses, limits, self.duration)
        _check_way(polynomial, limits)
        object.__setattr__(self, "duration", polynomial.duration)
        self.set_polynomial(polynomial.delayed(float(self.time)))


def _planned(poses: dict[str, np.ndarray], limits: MotionLimits, duration: float | None) -> PiecewisePolynomial:
    """The move from time 0."""
    try:
        import ruckig  # type: ignore[import-not-found]
    except ImportError:
        expected = "pip install armwright[trajectory], on a platform that Ruckig has wheels for"
        raise ScenarioError("needs ruckig, which is not installed", place="Ruckig", expected=expected) from None
    asked = ruckig.InputParameter(limits.n)
    for theirs, ours in (("current", "start"), ("target", "goal")):
        setattr(asked, f"{theirs}_position", poses[ours].tolist())
        setattr(asked, f"{theirs}_velocity", poses[f"{ours}_velocity"].tolist())
        setattr(asked, f"{theirs}_acceleration", poses[f"{ours}_acceleration"].tolist())
    asked.max_velocity, asked.max_acceleration = limits.velocity.tolist(), limits.acceleration.tolist()
    asked.max_jerk = limits.jerk.tolist()
    if duration is not None:
        asked.minimum_duration = float(duration)
    found = ruckig.Trajectory(limits.n)
    try:
        result = ruckig.Ruckig(limits.n).calculate(asked, found)
    except ruckig.RuckigError as error:
        said = str(error).partition("input:")[0]  # all states and limits follow
        joint = re.search(r"dof: (\d+)", said)
        what = f"found no move of {limits.names[int(joint[1])]}" if joint else " ".join(said.split())
        raise ScenarioError(what, place="Ruckig", expected="states that a move within the limits can join") from None
    except ValueError:  # a result that its Python bindings do not know
        result = -1
    if int(result) < 0:
        expected = "states and limits whose magnitudes differ less"
        raise ScenarioError("found no move", place="Ruckig", expected=expected)
    if duration is not None and found.duration > duration * (1.0 + 1e-9):
        expected = f"{found.duration:.6g} s, the next that is possible"
        raise ScenarioError(place="Ruckig.duration", value=duration, expected=expected)
    return PiecewisePolynomial.side_by_side([_one_joint(profile, found.duration) for profile in found.profiles[0]])


def _one_joint(profile: Any, duration: float) -> PiecewisePolynomial:
    """Ruckig's profile of a joint: up to two segments of braking, then seven of constant jerk."""
    brake = profile.brake
    lengths = np.array([*brake.t, *profile.t])
    rows = np.array(
        [
            [*brake.p, *profile.p[:7]],
            [*brake.v, *profile.v[:7]],
            [*brake.a, *profile.a[:7]],
            [*brake.j, *profile.j],
        ]
    ) / np.array([[1.0], [1.0], [2.0], [6.0]])
    kept = lengths > SHORTEST * duration
    knots = np.append(0.0, np.cumsum(lengths[kept]))
    if not kept.any():  # a joint that stands
        return PiecewisePolynomial(np.array([0.0, duration]), np.full((1, 1, 1), profile.pf))
    knots[-1] = duration  # the sum of its parts but for rounding
    return PiecewisePolynomial(knots, rows.T[kept][:, None, :])


def _check_way(polynomial: PiecewisePolynomial, limits: MotionLimits) -> None:
    """Refuses a move that leaves the limits of position on its way."""
    low, high = polynomial.extrema(0)
    beyond = np.maximum(limits.position[:, 0] - low.min(axis=0), high.max(axis=0) - limits.position[:, 1])
    joint = int(np.argmax(beyond))
    if beyond[joint] > 1e-9 * (1.0 + np.abs(limits.position[joint]).max()):
        what = (
            f"{limits.names[joint]} leaves its position limits by {beyond[joint]:.4g} {limits.unit('position', joint)}"
        )
        raise ScenarioError(
            what, place="Ruckig", expected="a start that can stop before them, or a goal further inside"
        )

"""Motions of least jerk between any two states: one polynomial of fifth degree. [FlashHogan1985]"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.parameters import UNSET, Numbers, NumbersOrNone
from armwright.trajectory.limits import MotionLimits
from armwright.trajectory.piecewise import PiecewiseMotion, PiecewisePolynomial
from armwright.trajectory.poses import check_limits, check_number, chosen_duration, plain_pose, rest_to_rest_times
from armwright.trajectory.rest_to_rest import Quintic

GROWTH = 1.1  # from one tried duration to the next
LONGEST = 100.0  # by the time that the limits alone ask for: longest and shortest duration that is tried
HALVINGS = 25  # of the last interval of durations


@dataclass(frozen=True, eq=False)
class MinimumJerk(PiecewiseMotion):
    """Motion that minimises ∫ (d³q/dt³)² dt between two states in a given time: a polynomial of fifth degree per joint.

    From rest to rest it is a `Quintic`. With limits and without a duration it is the first duration, tried upwards from 0,
    at which all limits are kept: exactly, at the extrema of the polynomials.

    Args:
        start, goal: (n,) [rad | m].   duration: [s]; None: by the limits.   time: [s] of its beginning.
        start_velocity, goal_velocity: (n,) [rad/s | m/s]; None: 0.
        start_acceleration, goal_acceleration: (n,) [rad/s² | m/s²]; None: 0.   limits: that are kept; None: none are.
    Raises:
        ScenarioError: names the field, its value and what was expected; a state outside its limits; no duration that keeps them.
    Example:
        >>> move = aw.trajectories.MinimumJerk([0.0, 0.0], [0.5, -0.5], duration=1.0)
        >>> move.at([0.0, 0.5, 1.0])[0].round(3)
        array([[ 0.  ,  0.  ],
               [ 0.25, -0.25],
               [ 0.5 , -0.5 ]])
    """

    start: Numbers
    goal: Numbers
    duration: Any = None
    start_velocity: NumbersOrNone = UNSET
    start_acceleration: NumbersOrNone = UNSET
    goal_velocity: NumbersOrNone = UNSET
    goal_acceleration: NumbersOrNone = UNSET
    limits: MotionLimits | None = None
    time: float = 0.0

    def __post_init__(self) -> None:
        start = plain_pose("MinimumJerk", "start", self.start)
        n = len(start)
        given = {
            name: plain_pose("MinimumJerk", name, getattr(self, name), n)
            for name in ("goal", "start_velocity", "goal_velocity", "start_acceleration", "goal_acceleration")
        }
        q = np.stack([start, given["goal"]])
        qd = np.stack([given["start_velocity"], given["goal_velocity"]])
        qdd = np.stack([given["start_acceleration"], given["goal_acceleration"]])
        check_number("MinimumJerk", "time", self.time)

        def of(duration: float) -> PiecewisePolynomial:
            return PiecewisePolynomial.hermite(self.time + np.array([0.0, duration]), q, qd, qdd)

        if self.limits is not None:
            check_limits("MinimumJerk", self.limits)
            check_states("MinimumJerk", self.limits, q, qd, qdd)
        if self.duration is None:
            if self.limits is None:
                raise ScenarioError("missing", place="MinimumJerk.duration", expected="a duration [s], or limits")
            object.__setattr__(self, "duration", _shortest(of, self.limits, q, qd, qdd))
        check_number("MinimumJerk", "duration", self.duration, above=0.0)
        self.set_polynomial(of(float(self.duration or 0.0)))
        if self.limits is None:
            return
        excess = largest_excess(self.polynomial, self.limits)
        if excess[0] > 1.0 + 1e-9:
            _, quantity, joint = excess
            what = f"{self.limits.names[joint]} would use {excess[0]:.1%} of its {quantity} limit"
            if quantity == "position":
                what = f"{self.limits.names[joint]} would swing {excess[0] - 1.0:.4g} {self.limits.unit(quantity, joint)} outside"
            do = _sufficient(of, self.limits, (q, qd, qdd), float(self.duration or 0.0))
            raise ScenarioError(what, place="MinimumJerk.duration", value=self.duration, expected=do)


def check_states(kind: str, limits: MotionLimits, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> None:
    """Refuses states at start and goal, each (2, n), that are outside the limits.

    Raises:
        ScenarioError: names the joint, the value and the limit.
    """
    for row, end in enumerate(("start", "goal")):
        limits.check_position(f"{kind}.{end}", q[row])
        for name, values, most in (("velocity", qd, limits.velocity), ("acceleration", qdd, limits.acceleration)):
            beyond = np.flatnonzero(np.abs(values[row]) > most * (1.0 + 1e-12))
            if len(beyond):
                joint = int(beyond[0])
                place = f"{kind}.{end}_{name} of {limits.names[joint]}"
                expected = f"{most[joint]:.6g} {limits.unit(name, joint)} at most"
                raise ScenarioError(place=place, value=float(values[row, joint]), expected=expected)


def largest_excess(polynomial: PiecewisePolynomial, limits: MotionLimits) -> tuple[float, str, int]:
    """Largest share of a limit that is used, by exact extrema, with its quantity and the number of the joint.

    Of positions it is 1 within the limits, and above 1 by the way outside [rad | m].
    """
    low, high = polynomial.extrema(0)
    outside = np.maximum(limits.position[:, 0] - low.min(axis=0), high.max(axis=0) - limits.position[:, 1])
    # rounding of a pose on its limit is no excess
    outside = np.where(outside > 1e-12 * (1.0 + np.abs(limits.position).min(axis=1)), outside, 0.0)
    shares = {"position": 1.0 + np.maximum(outside, 0.0)}
    for order, quantity in enumerate(("velocity", "acceleration", "jerk"), 1):
        shares[quantity] = polynomial.largest(order) / getattr(limits, quantity)
    quantity = max(shares, key=lambda name: shares[name].max())
    joint = int(np.argmax(shares[quantity]))
    return float(shares[quantity][joint]), quantity, joint


def _sufficient(
    of: Any, limits: MotionLimits, states: tuple[np.ndarray, np.ndarray, np.ndarray], duration: float
) -> str:
    """Advice, in words, on a duration [s] that exceeds limits."""
    moving = states[1].any() or states[2].any()
    for least in (duration, 0.0):
        try:
            found = _shortest(of, limits, *states, least)
        except ScenarioError:
            continue
        # moving, a longer one may swing further
        return f"{found:.6g} s, which keeps them" if moving else f"{found:.6g} s or more"
    return "other states or limits: no duration keeps them"


def _shortest(
    of: Any, limits: MotionLimits, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, least: float = 0.0
) -> float:
    """First duration [s] from a least one on, tried upwards, at which the motion keeps its limits."""
    way, bounds = np.abs(q[1] - q[0]), np.stack([limits.velocity, limits.acceleration, limits.jerk])
    at_rest = float(rest_to_rest_times(Quintic.PEAKS, way, limits).max())
    if not qd.any() and not qdd.any():
        free = (way > 0.0) & limits.unlimited
        return chosen_duration("MinimumJerk", None, np.where(free, np.inf, at_rest), limits)
    changes = np.abs(qd).sum(axis=0) / bounds[1] + (np.abs(qd).sum(axis=0) / bounds[2]) ** 0.5
    longest = LONGEST * (at_rest + float((changes + np.abs(qdd).sum(axis=0) / bounds[2]).max()))
    if not 0.0 < longest < np.inf:
        raise ScenarioError("no limit says how long it takes", place="MinimumJerk", expected="limits, or a duration")
    inner = np.linspace(0.0, 1.0, 33)

    def keeps(duration: float) -> bool:
        motion = of(duration)
        _, speed, acceleration = motion.at(motion.time + duration * inner)
        if (np.abs(speed) > limits.velocity).any() or (np.abs(acceleration) > limits.acceleration).any():
            return False  # found without the extrema, which take longer
        return largest_excess(motion, limits)[0] <= 1.0 + 1e-12

    low = high = max(longest / LONGEST**2, least)
    while not keeps(high):
        low, high = high, high * GROWTH
        if high > longest:
            share, quantity, joint = largest_excess(of(at_rest or longest / LONGEST), limits)
            what = f"no duration keeps the limits: {limits.names[joint]} would need {share:.1%} of its {quantity} limit"
            raise ScenarioError(what, place="MinimumJerk", expected="other states or limits")
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if keeps(middle) else (middle, high)
    return high

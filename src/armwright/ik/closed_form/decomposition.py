"""Six joints decomposed into subproblems: arms with a spherical wrist, and arms with three parallel axes. [EliasWen2025]

θ_i are the joints' angles in the frames of `Links`, T = L_0 Rz(θ_1) L_1 … Rz(θ_6) L_6, and L_i = (R_i, p_i).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from armwright.ik.closed_form.axes import Links
from armwright.ik.closed_form.subproblems import (
    Turn,
    turn_along,
    turn_onto,
    turns_to_distance,
    turns_to_level,
    two_turns,
)
from armwright.scalar import Array
from armwright.spatial import Placement

Turns = tuple[Turn, ...]
Shoulder = Callable[[Links, Array, Array, Sequence[Turn]], list[Turns]]


def spherical_wrist(shoulder: Shoulder) -> Callable[[Links, Placement, Sequence[Turn]], list[Turns]]:
    """The decomposition of arms whose last three axes meet: the first three joints place that point, the others turn.

    Args:
        shoulder: gives all (θ_1, θ_2, θ_3) that bring the point w, in the frame of joint 3, to a point before joint 1.
    """

    def solve(links: Links, target: Placement, instead: Sequence[Turn]) -> list[Turns]:
        """All (θ_1 … θ_6) for a pose of the tip; `instead` (6) where any angle does."""
        base, second, third, fourth, fifth, sixth, tip = links.placements
        hand = target @ tip.inverse()  # its origin is the point where the axes meet
        centre, turned = base.inverse().point(hand.position), base.rotation.T @ hand.rotation
        branches = []
        for first3 in shoulder(links, fourth.position, centre, instead):
            columns = [turned[:, 0], turned[:, 2]]
            for turn, link in zip(first3, (second, third, fourth), strict=True):
                columns = [link.rotation.T @ turn.inverse.of(column) for column in columns]
            x, z = columns  # of  Rz(θ_4) R_4 Rz(θ_5) R_5 Rz(θ_6)
            for turn4, turn5 in two_turns(sixth.rotation[:, 2], fifth.rotation, z, instead[3], instead[4]):
                left = fifth.rotation.T @ turn4.inverse.of(x)
                left = sixth.rotation.T @ turn5.inverse.of(left)
                branches.append((*first3, turn4, turn5, turn_along(left[0], left[1], instead[5])))
        return branches

    return solve


def shoulder_of_parallel_second_and_third(
    links: Links, w: Array, centre: Array, instead: Sequence[Turn]
) -> list[Turns]:
    """Axes 2 and 3 parallel: neither changes the height of w along axis 2, which is subproblem 4 in θ_1; a plane is left."""
    second, third = links.placements[1:3]
    height = third.position[2] + third.rotation[2, 2] * w[2]
    found = []
    for turn1 in _to_height(second, centre, height, instead[0]):
        v = second.inverse().point(turn1.inverse.of(centre))
        found += [(turn1, *pair) for pair in _in_plane(third, w, v, instead[1], instead[2])]
    return found


def shoulder_of_meeting_first_and_second(links: Links, w: Array, centre: Array, instead: Sequence[Turn]) -> list[Turns]:
    """Axes 1 and 2 meet, neither changes the distance of w from there: subproblem 3 in θ_3, then 2 in θ_1 and θ_2."""
    second, third = links.placements[1:3]
    b = third.rotation.T @ third.position
    square = centre @ centre - (b[2] + w[2]) ** 2
    found = []
    for turn3 in turns_to_distance(w, b, square, instead[2]):
        x = third.point(turn3.of(w))
        found += [(*pair, turn3) for pair in two_turns(x, second.rotation, centre, instead[0], instead[1])]
    return found


def shoulder_of_meeting_second_and_third(links: Links, w: Array, centre: Array, instead: Sequence[Turn]) -> list[Turns]:
    """Axes 2 and 3 meet, neither changes the distance of w from there: subproblem 3 in θ_1, then 2 in θ_2 and θ_3."""
    second, third = links.placements[1:3]
    square = w @ w - (centre[2] - second.position[2]) ** 2
    found = []
    for turn1 in turns_to_distance(second.position, -centre, square, instead[0]):
        v = second.inverse().point(turn1.inverse.of(centre))
        found += [(turn1, *pair) for pair in two_turns(w, third.rotation, v, instead[1], instead[2])]
    return found


def shoulder_of_parallel_first_and_second(
    links: Links, w: Array, centre: Array, instead: Sequence[Turn]
) -> list[Turns]:
    """Axes 1 and 2 parallel: neither changes the height of w along axis 1, subproblem 4 in θ_3; a plane is left."""
    second, third = links.placements[1:3]
    up = second.rotation[2, 2]
    row = third.rotation[2]
    level = up * (centre[2] - second.position[2]) - third.position[2] - row[2] * w[2]
    square = (row[0] ** 2 + row[1] ** 2) * (w[0] ** 2 + w[1] ** 2) - level * level
    found = []
    for turn3 in turns_to_level(w, row, level, square, instead[2]):
        x = third.point(turn3.of(w))
        found += [(*pair, turn3) for pair in _in_plane(second, x, centre, instead[0], instead[1])]
    return found


def three_parallel(links: Links, target: Placement, instead: Sequence[Turn]) -> list[Turns]:
    """Axes 2, 3 and 4 parallel, 5 and 6 meet: all (θ_1 … θ_6) for a pose of the tip.

    Three parallel axes change neither the height of the point where 5 and 6 meet, subproblem 4 in θ_1, nor their own
    direction, subproblem 2 in θ_5 and θ_6. A plane is left.
    """
    base, second, third, fourth, fifth, sixth, tip = links.placements
    hand = target @ tip.inverse()  # its origin is where axes 5 and 6 meet
    centre, turned = base.inverse().point(hand.position), base.rotation.T @ hand.rotation
    height = third.position[2] + third.rotation[2, 2] * (fourth.position[2] + fourth.rotation[2, 2] * fifth.position[2])
    up = third.rotation[2, 2] * fourth.rotation[2, 2]
    branches = []
    for turn1 in _to_height(second, centre, height, instead[0]):
        along = turned.T @ turn1.of(second.rotation[:, 2]) * up  # the direction of axis 4, seen from the hand
        v = second.inverse().point(turn1.inverse.of(centre))
        pairs = two_turns(fifth.rotation[2], sixth.rotation.T, along, instead[5].inverse, instead[4].inverse)
        for back6, back5 in pairs:

            def to_base(vector: Array, back6: Turn = back6, back5: Turn = back5, turn1: Turn = turn1) -> Array:
                """A direction on link 4 in axes before joint 2."""
                hand_side = back6.of(sixth.rotation.T @ back5.of(fifth.rotation.T @ vector))
                return second.rotation.T @ turn1.inverse.of(turned @ hand_side)

            x = to_base(np.array([1.0, 0.0, 0.0]))
            elbow = v - to_base(fifth.position)
            for turn2, turn3 in _in_plane(third, fourth.position, elbow, instead[1], instead[2]):
                left = third.rotation.T @ turn2.inverse.of(x)
                left = fourth.rotation.T @ turn3.inverse.of(left)
                turn4 = turn_along(left[0], left[1], instead[3])
                branches.append((turn1, turn2, turn3, turn4, back5.inverse, back6.inverse))
    return branches


def _to_height(second: Placement, centre: Array, height: Array, instead: Turn) -> tuple[Turn, Turn]:
    """Both θ_1 that bring a point to a height along axis 2:  h_2 · (Rz(-θ_1) centre - p_1) = height."""
    h = second.rotation[:, 2]
    level = height + h @ second.position - h[2] * centre[2]
    far = (h[0] ** 2 + h[1] ** 2) * (centre[0] ** 2 + centre[1] ** 2)
    return turns_to_level(h, centre, level, far - level * level, instead)


def _in_plane(link: Placement, u: Array, v: Array, outer: Turn, inner: Turn) -> list[tuple[Turn, Turn]]:
    """Both pairs of turns about parallel axes with  Rz(θ) (p + R Rz(θ') u) = v  in x and y."""
    b = link.rotation.T @ link.position
    turns = turns_to_distance(u, b, v[0] * v[0] + v[1] * v[1], inner)
    return [(turn_onto(link.point(turn.of(u)), v, outer), turn) for turn in turns]

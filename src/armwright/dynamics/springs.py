"""Springs of the arm: at joints, and as cylinders between links. On the link side, beside gravity."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.actuators.springs import spring_energy, spring_torque
from armwright.kinematics.forward_kinematics import body_placements
from armwright.kinematics.joint_motion import JointMotion, joint_motions
from armwright.model import Mimics, Model, SpringCylinder, on_tree, one_state
from armwright.scalar import Array, Scalar
from armwright.spatial import cross


@one_state
def spring_torques(arm: Model, q: Array) -> np.ndarray:
    """Torques that hold the arm against its springs:  s(q) = ∂U/∂q,  U their energy; what the joints need beside g(q).

    A spring at a joint with the torque t(q) asks for s = -t(q). A cylinder of length L that pushes with F(L) asks for
    s = -F ∂L/∂q of every joint between its ends.

    Args:
        arm: the model.   q: (n,) [rad | m].
    Returns:
        s: (n,) [N m | N]; 0 where no spring acts.
    Example:
        >>> arm = aw.load("two-link")
        >>> aw.spring_torques(arm, [0.3, 0.5])  # this arm has no springs
        array([0., 0.])
    """
    return sprung_torques(arm, q)


@on_tree(Mimics.torques)
def sprung_torques(arm: Model, q: Array, nudge: Array | None = None) -> np.ndarray:
    """`spring_torques`; `nudge` (n,) moves q on by a first-order amount, for derivatives."""
    s = scalar.zeros(arm.n)
    for i, body in arm.outward():
        if body.spring is not None:
            s[i] = -spring_torque(body.spring, q[i] if nudge is None else q[i] + nudge[i])
    if arm.cylinders:
        motion = joint_motions(arm, q, nudge)
        for cylinder in arm.cylinders:
            _add_cylinder(s, arm, cylinder, motion)
    return scalar.array(s)


def _add_cylinder(s: np.ndarray, arm: Model, cylinder: SpringCylinder, motion: list[JointMotion]) -> None:
    """Adds a cylinder's torques to s (n,), in the frame of the last body that carries both ends."""
    paths = [arm.path(body) for body in cylinder.bodies]
    common = sum(a == b for a, b in zip(*paths, strict=False))  # both begin at the base and part once
    ends, levers = [], []
    for path, point in zip(paths, cylinder.ends, strict=True):
        arms = {}  # from each joint's origin to the end, in the axes of the joint's parent
        for i in reversed(path[common:]):
            arms[i] = motion[i].to_parent(point)
            point = arms[i] + motion[i].position
        ends.append(point)
        levers.append(arms)
    line = ends[1] - ends[0]
    push = _force_over_length(cylinder, scalar.sqrt(line @ line)) * line  # on the second end
    for arms, path, force in zip(levers, paths, (-push, push), strict=True):
        for k, i in enumerate(path[common:]):
            axis = arm.bodies[i].placement.rotation[:, 2]
            s[i] = s[i] - axis @ arm.bodies[i].kind.project(cross(arms[i], force), force)
            if k < len(path) - common - 1:
                force = motion[i].to_body(force)


def _force_over_length(cylinder: SpringCylinder, length: Scalar) -> Scalar:
    """F/ℓ = (preload + stiffness length₀)/ℓ - stiffness  [N/m]; infinite where the ends meet."""
    return (cylinder.preload + cylinder.stiffness * cylinder.length) / length - cylinder.stiffness


def spring_potential(arm: Model, q: Array) -> Scalar:
    """Energy of all springs [J]: of each joint's 0 at its rest or its table's first point, of a cylinder 0 at its stated length.

    Args:
        arm: the model.   q: (n,) [rad | m].
    Returns:
        U: () [J].
    """
    return _at_joints(arm, q) + cylinder_energy(arm, q)


@on_tree()
def _at_joints(arm: Model, q: Array) -> Scalar:
    return sum(spring_energy(body.spring, q[i]) for i, body in arm.outward() if body.spring is not None)


def cylinder_energy(arm: Model, q: Array) -> Scalar:
    """½ stiffness (ℓ - length)² - preload (ℓ - length)  [J], summed over the cylinders."""
    total = 0.0
    placed = body_placements(arm, q) if arm.cylinders else {}
    for cylinder in arm.cylinders:
        a, b = (placed[body].point(end) for body, end in zip(cylinder.bodies, cylinder.ends, strict=True))
        way = scalar.sqrt((b - a) @ (b - a)) - cylinder.length
        total = total + 0.5 * cylinder.stiffness * way * way - cylinder.preload * way
    return total

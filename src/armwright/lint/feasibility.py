"""Mass properties and drives that no real arm can have. [Wensing2018]"""

from __future__ import annotations

import numpy as np

from armwright.description.drive import Motor
from armwright.description.paths import quantities, unit_at
from armwright.description.robot import Link, MovingJoint, RobotDescription
from armwright.errors import DescriptionError, Problem
from armwright.lint.drives import contradictions
from armwright.spatial import parallel_axes, pseudo_inertia

IMPOSSIBLE = 1e-9  # an eigenvalue of the pseudo-inertia below minus this share of the largest is no rounding
LARGEST = 1e100  # of any number
FARTHEST = 1e9  # m
TOO_LARGE = "its numbers are too large to compute with"
SELF_LOCKING = 0.5  # a real gear below this efficiency holds its load by itself; the model of gear loss does not
SIGNIFICANT = 0.01  # a product m c c above this share of the tensor's largest entry would show in it
SAME = 1e-3  # relative: a product that was printed with three digits or more is no coincidence


def check_bodies(robot: RobotDescription, on_impossible: str) -> list[Problem]:
    """Warnings about links that no real body can be, where they are accepted.

    Raises:
        DescriptionError: names the links and by how much their moments of inertia fail.
    """
    errors = body_problems(robot) if on_impossible == "error" else oversized(robot)
    if errors:
        raise DescriptionError.of(*errors)
    return [
        Problem(f"{_fault(link)}{'; accepted: ' if reason else ''}{reason}", f"link {link.name!r} inertia_kg_m2")
        for link in impossible_links(robot)
        for reason in [link.accept_impossible or ""]
    ]


def body_problems(robot: RobotDescription) -> list[Problem]:
    """Numbers too large to compute with, or else links that no real body can be and that no reason accepts."""
    expected = 'a real body, or accept_impossible = "reason" in the link, or on_impossible="warn"'
    return oversized(robot) or [
        Problem(_fault(link), f"link {link.name!r} inertia_kg_m2", expected=expected)
        for link in impossible_links(robot)
        if link.accept_impossible is None
    ]


def _fault(link: Link) -> str:
    """Reason why no real body has the mass properties of a link, such as the moment that is too large and by how much."""
    says, tensor = "an impossible inertia:", link.inertia_kg_m2.matrix()
    moments, axes = np.linalg.eigh(tensor)
    name = ["the least principal moment", "the middle one", "the largest principal moment"]
    if np.abs(tensor - np.diag(np.diag(tensor))).max() <= SAME * np.abs(tensor).max():  # the user's own three numbers
        name = [f"{'xyz'[k]}{'xyz'[k]}" for k in np.abs(axes).argmax(axis=0)]
    if moments[0] < -IMPOSSIBLE * abs(moments[2]):
        return f"{says} {name[0]} = {moments[0]:.6g} kg m² is negative"
    most = moments[0] + moments[1]
    if moments[2] > most * (1 + IMPOSSIBLE):
        return (
            f"{says} {name[2]} = {moments[2]:.6g} > {name[0]} + {name[1]} = {most:.6g} kg m², by {moments[2] - most:.3g}; "
            f"{most:.6g} at most is possible"
        )
    eigenvalues = np.linalg.eigvalsh(_body(link))
    share = -eigenvalues[0] / max(abs(eigenvalues[-1]), 1e-300)
    return f"{says} its pseudo-inertia has the eigenvalue {eigenvalues[0]:.4g}, {share:.2g} of the largest below 0"


def oversized(robot: RobotDescription) -> list[Problem]:
    """Numbers whose squares and products would leave the range of floats, and places beyond the Moon's orbit."""
    found = []
    for path, quantity, _ in quantities(robot):
        values = np.abs(np.asarray(quantity.value, dtype=float))
        most = FARTHEST if values.max() > FARTHEST and unit_at(path) == "m" else LARGEST
        if values.max() > most:
            found.append(Problem(place=path, value=quantity.value, expected=f"numbers of a robot, {most:g} at most"))
    return found


def impossible_links(robot: RobotDescription) -> list[Link]:
    """The links that no real body can be, accepted or not."""
    return [link for link in robot.links if link.mass_kg is not None and not is_possible(_body(link))]


def _body(link: Link) -> np.ndarray:
    """(4, 4) pseudo-inertia."""
    return pseudo_inertia(float(link.mass_kg), np.array(link.com_m), link.inertia_kg_m2.matrix())


def is_possible(body: np.ndarray) -> np.ndarray:
    """(…) whether pseudo-inertias (…, 4, 4) are positive semidefinite, but for rounding."""
    eigenvalues = np.linalg.eigvalsh(body)
    least, most = eigenvalues[..., 0], eigenvalues[..., -1]
    return (least >= -IMPOSSIBLE * np.maximum(most, 0.0)) & (most >= 0)


def about_com(mass: float, com: np.ndarray, tensor: np.ndarray, about: str) -> np.ndarray:
    """The tensor about the centre of mass (3, 3) [kg m²]:  I_com = I - m ( |c|² 1 - c cᵀ )  where `about` is "frame".

    Args:
        mass: [kg].   com: (3,) [m] in the body's frame.   tensor: (3, 3) [kg m²].   about: "com" or "frame".
    """
    return tensor if about == "com" else tensor - parallel_axes(mass, com)


def impossible(mass: float, com: np.ndarray, tensor: np.ndarray, about: str) -> str | None:
    """The reason why no real body has this tensor about that point, or None: principal moments obey a triangle inequality.

    Args:
        mass: [kg].   com: (3,) [m] in the body's frame.   tensor: (3, 3) [kg m²].   about: "com" or "frame".
    """
    with np.errstate(over="ignore", invalid="ignore"):
        moved = about_com(mass, com, tensor, about)
        if not np.isfinite(pseudo_inertia(mass, com, moved).astype(float)).all():
            return TOO_LARGE
    if _possible(mass, com, moved):
        return None
    a, b, c = np.linalg.eigvalsh(moved)
    fault = f"its principal moments about the centre of mass, {a:.4g}, {b:.4g} and {c:.4g} kg m², break the triangle inequality"
    if about == "com":
        return fault
    if _possible(mass, com, tensor):
        return f'{fault}; about the centre of mass it would be possible: did you mean inertia_about = "com"?'
    return f"{fault}, and so they would about any other point"


def frame_origin_sign(mass: float, com: np.ndarray, tensor: np.ndarray) -> str | None:
    """The sign that a tensor given about the centre of mass is about the frame's origin: its products are  -m c_i c_j.

    That is what the parallel axes alone give to a body which is symmetric about its own centre. The sign is reported only
    where all products that m and c would make visible are there, to three digits, and the body without them is possible.

    Args:
        mass: [kg].   com: (3,) [m] in the body's frame.   tensor: (3, 3) [kg m²], said to be about the centre of mass.
    Returns:
        sign: a sentence, or None.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        shift = parallel_axes(mass, com)
    if not np.isfinite(shift).all():
        return None
    visible = [
        (i, j) for i, j in ((0, 1), (0, 2), (1, 2)) if abs(shift[i, j]) > SIGNIFICANT * float(np.abs(tensor).max())
    ]
    if not visible or any(abs(tensor[i, j] - shift[i, j]) > SAME * abs(shift[i, j]) for i, j in visible):
        return None
    if not _possible(mass, com, tensor - shift):
        return None
    i, j = visible[0]
    x, y = "xyz"[i], "xyz"[j]
    return f"{x}{y} = {tensor[i, j]:.4g} is -m c_{x} c_{y} = {shift[i, j]:.4g}: it looks like a tensor about the frame's origin"


def _possible(mass: float, com: np.ndarray, inertia_com: np.ndarray) -> bool:
    return bool(is_possible(pseudo_inertia(mass, com, inertia_com).astype(float)))


def _efficiencies(motor: Motor) -> list[tuple[str, float]]:
    """Efficiency of a gear under its largest load, by key; small loads of a table lose most of it without locking."""
    if motor.gear_efficiency_table is None:
        return [] if motor.gear_efficiency is None else [("gear_efficiency", float(motor.gear_efficiency))]
    rows = motor.gear_efficiency_table.rows
    return [(f"gear_efficiency_table.rows[{k}].driving", row.driving.numbers[-1]) for k, row in enumerate(rows)]


def _held_by_friction(joint: MovingJoint) -> list[Problem]:
    """A warning if dry friction either way is not below the largest torque of the motor."""
    friction, largest, unit = joint.friction, joint.limit("torque"), joint.kind.units.torque
    if friction is None or largest is None:
        return []
    key = friction.units.key("coulomb_positive", "torque")
    levels = [getattr(friction, side) for side in (key, key.replace("positive", "negative"))]
    if None in levels:
        return []
    level = min(map(float, levels))
    if friction.side == "motor" and joint.motor is not None:
        level *= abs(float(joint.motor.gear_ratio))
    if level < float(largest):
        return []
    what = f"dry friction of {level:g} {unit} holds the joint: its motor gives {float(largest):g} {unit} at most"
    return [Problem(what, f"joint {joint.name!r} friction.{key}", float(levels[0]))]


def check_drives(robot: RobotDescription) -> list[Problem]:
    """Warnings about self-locking gears, friction that no torque overcomes, and numbers that contradict each other."""
    warnings = []
    for joint in robot.moving_joints:
        warnings += _held_by_friction(joint)
        if joint.motor is None:
            continue
        motor, place = joint.motor, f"joint {joint.name!r} motor"
        for key, efficiency in _efficiencies(motor):
            if efficiency < SELF_LOCKING:
                what = (
                    f"below {SELF_LOCKING}: a real gear is self-locking there, in this model the load drives it back; "
                    "a brake or motor-side friction can hold the load"
                )
                warnings.append(Problem(what, f"{place}.{key}", efficiency))
    return warnings + contradictions(robot)


def senses_of_gears(robot: RobotDescription) -> list[Problem]:
    """Notes about negative gear ratios, which are right where a motor is mounted so that it turns against its joint."""
    what = "negative: the motor turns against the joint"
    return [
        Problem(what, f"joint {joint.name!r} motor.gear_ratio", float(joint.motor.gear_ratio))
        for joint in robot.moving_joints
        if joint.motor is not None and float(joint.motor.gear_ratio) < 0.0
    ]

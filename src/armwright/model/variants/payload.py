"""An arm with a payload."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.description.robot import FixedJoint, Inertia, JointFrame, Link, RobotDescription
from armwright.errors import DescriptionError
from armwright.model.variants.edits import CHOSEN, check_name, checked, replaced, tip_of
from armwright.spatial import TENSOR


def with_payload(
    robot: RobotDescription,
    mass: Any,
    com: Any,
    inertia: Any,
    frame: str | None = None,
    *,
    name: str = "payload",
    source: str = CHOSEN,
) -> RobotDescription:
    """The description with one more link, fixed to a frame; its tip does not change.

    Args:
        robot: the description.
        mass: () [kg].   com: (3,) [m] centre of mass, in the frame.
        inertia: (3, 3) [kg m²] about the centre of mass, in the frame's axes, or the three principal moments along them.
        frame: name of a frame or link; by default the tip.
        name: of the new link, whose numbers are NAME.mass_kg and so on.   source: where its numbers come from.
    Raises:
        DescriptionError: a number that is none, a name that is taken, no such frame, or no tip.
    """
    place = f"with_payload(name={name!r})"
    tip = tip_of(robot)
    ends = [*(frame.name for frame in robot.frames), *(link.name for link in robot.links), robot.base]
    if frame is None and tip is None:
        raise DescriptionError(
            "the arm names no tip", place=f"{place}.frame", expected="a frame", choices=ends, file=robot.name
        )
    at = frame if frame is not None else tip
    assert at is not None
    check_name(robot, f"{place}.frame", at, ends)
    if name in ends or name in {joint.name for joint in robot.joints}:
        raise DescriptionError("the arm has this name already", place=place, expected="another name", file=robot.name)
    tensor = _tensor(place, inertia)
    moments = checked(Inertia, place, **{name: float(tensor[entry]) for name, entry in TENSOR.items()})
    try:
        link = checked(Link, place, name=name, mass_kg=mass, com_m=com, inertia_kg_m2=moments, source=source)
    except DescriptionError as error:  # in the words of the caller, who gave no units
        raise error.renamed(lambda key: key.replace(".mass_kg", ".mass").replace(".com_m", ".com")) from None
    placed = next((frame for frame in robot.frames if frame.name == at), None)
    if placed is None:
        where = checked(JointFrame, place, xyz_m=(0.0, 0.0, 0.0), rpy_rad=(0.0, 0.0, 0.0), source=CHOSEN)
    else:
        where = checked(JointFrame, place, **{key: getattr(placed, key) for key in ("source", "xyz_m", "rpy_rad")})
    carrier = at if placed is None else placed.link
    mount = checked(FixedJoint, place, name=f"{name}_mount", type="fixed", parent=carrier, child=name, frame=where)
    return replaced(robot, place, joints=(*robot.joints, mount), links=(*robot.links, link), tip=tip)


def _tensor(place: str, inertia: Any) -> np.ndarray:
    """(3, 3), symmetric."""
    tensor = scalar.numbers_or_nan(inertia)
    tensor = np.diag(tensor) if tensor.shape == (3,) else tensor
    if tensor.shape != (3, 3) or not np.isfinite(tensor).all() or not np.allclose(tensor, tensor.T, rtol=1e-9, atol=0):
        expected = "a symmetric (3, 3) tensor or three moments [kg m²]; zeros for a point mass"
        raise DescriptionError(place=f"{place}.inertia", value=inertia, expected=expected)
    return 0.5 * (tensor + tensor.T)

"""`<transmission>`: the gear ratio between one actuator and one joint. A URDF knows no motor that it could turn."""

from __future__ import annotations

from armwright.description.urdf.reading import TRANSMISSION_HARMLESS, TRANSMISSION_PHYSICS, UrdfReading, unknown_tag
from armwright.description.xml_tree import NUMBER, Element

TAGS = ("mechanicalReduction", "mechanical_reduction")


def reductions(reading: UrdfReading, robot: Element) -> dict[str, float]:
    """Motor radians per joint radian (or metre), by joint; transmissions of several joints are remarked and left out.

    A reduction that is no number other than 0, two transmissions for a joint that disagree, and tags that nobody would read
    are kept as wrong.
    """
    by_joint: dict[str, float] = {}
    known = {joint.attributes.get("name") for joint in robot.all("joint")}
    for transmission in robot.all("transmission"):
        reading.attempt(_add_reduction, reading, transmission, known, by_joint)
    return by_joint


def _add_reduction(
    reading: UrdfReading, transmission: Element, known: set[str | None], by_joint: dict[str, float]
) -> None:
    """Adds the reduction of a transmission to those by joint."""
    name = transmission.attributes.get("name", "")
    joints = [joint.attributes.get("name", "") for joint in transmission.all("joint")]
    ends = [*transmission.all("actuator"), *transmission.all("joint")]
    _check(reading, transmission, name, read=("joint", "actuator"))
    for end in ends:
        _check(reading, end, name)
    # the first that says it holds
    places = (*transmission.all("actuator"), transmission, *transmission.all("joint"))
    ratios = [ratio for place in places for ratio in _ratios(place)]
    strangers = [joint for joint in joints if joint not in known]
    if strangers:
        reading.remark("transmission", name, f"its joint {strangers[0]!r} does not exist, and it is not used")
        return
    if len(joints) != 1 or len(transmission.all("actuator")) > 1:
        if any(abs(ratio) != 1.0 for ratio in ratios):
            reading.remark("transmission", name, "couples several joints or motors, and is not used")
        reading.ignored["transmission of several joints"] += 1
        return
    ratio = ratios[0] if ratios else 1.0
    if by_joint.get(joints[0], ratio) != ratio:
        expected = f"{by_joint[joints[0]]:g}, as in the transmission before"
        raise transmission.error(place=f"joint {joints[0]!r} mechanicalReduction", value=ratio, expected=expected)
    by_joint[joints[0]] = ratio


def _check(reading: UrdfReading, element: Element, name: str, read: tuple[str, ...] = ()) -> None:
    """Adds a remark for physics of other programs, and records unknown tags as errors."""
    for child in element.children:
        if child.tag in (*read, *TAGS, *TRANSMISSION_HARMLESS):
            continue
        if child.tag in TRANSMISSION_PHYSICS:
            reading.remark("transmission", name, f"<{child.tag}> is not used: give what it says in the drive file")
        elif child.tag in reading.ignore:
            reading.leave_out(child.tag, f"transmission/{child.tag}")
        else:
            known = (*read, *TAGS, *TRANSMISSION_HARMLESS, *TRANSMISSION_PHYSICS)
            raise unknown_tag(child, f"<{element.tag}> of transmission {name!r}", known)


def _ratios(element: Element) -> list[float]:
    ratios = []
    for tag in element.children:
        if tag.tag in TAGS:
            text = tag.text.strip()
            if not NUMBER.fullmatch(text) or not 0 < abs(float(text)) < 1e9:
                raise tag.error(value=text, expected="a number other than 0")
            ratios.append(float(text))
    return ratios

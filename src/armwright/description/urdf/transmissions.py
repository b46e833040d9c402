"""`<transmission>`: the gear ratio between one actuator and one joint. A URDF knows no motor that it could turn."""

from __future__ import annotations

from armwright.description.urdf.reading import UrdfReading
from armwright.description.xml_tree import NUMBER, Element

TAGS = ("mechanicalReduction", "mechanical_reduction")


def reductions(reading: UrdfReading, robot: Element) -> dict[str, float]:
    """Motor radians per joint radian (or metre), by joint; transmissions of several joints are remarked and left out.

    Raises:
        DescriptionError: a reduction that is no number other than 0, or two transmissions for a joint that disagree.
    """
    found: dict[str, float] = {}
    for transmission in robot.all("transmission"):
        joints = [joint.attributes.get("name", "") for joint in transmission.all("joint")]
        places = (
            *transmission.all("actuator"),
            transmission,
            *transmission.all("joint"),
        )  # the first that says it holds
        ratios = [ratio for place in places for ratio in _ratios(place)]
        if len(joints) != 1 or len(transmission.all("actuator")) > 1:
            if any(abs(ratio) != 1.0 for ratio in ratios):
                name = transmission.attributes.get("name", "")
                reading.remark("couples several joints or motors, and is not used", "transmission", name)
            reading.ignored["transmission of several joints"] += 1
            continue
        ratio = ratios[0] if ratios else 1.0
        if found.get(joints[0], ratio) != ratio:
            told = f"joint {joints[0]!r} has the reductions {found[joints[0]]:g} and {ratio:g}: expected one"
            raise transmission.error(told)
        found[joints[0]] = ratio
    return found


def _ratios(element: Element) -> list[float]:
    ratios = []
    for tag in element.children:
        if tag.tag in TAGS:
            text = tag.text.strip()
            if not NUMBER.fullmatch(text) or not 0 < abs(float(text)) < 1e9:
                raise tag.error(f"<{tag.tag}>{text[:60]}</{tag.tag}>: expected a number other than 0")
            ratios.append(float(text))
    return ratios

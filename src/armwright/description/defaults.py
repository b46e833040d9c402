"""Tables that joints share: `[defaults.motor]` and `[defaults.friction]` of a robot file, merged into the joints on reading.

A joint's own keys stand before those of the defaults, which keep their own source. A friction with a `law` of its own takes
nothing of the default friction; a joint with a `servo`, a `mimic` or of type "fixed" takes no defaults.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any

from pydantic import create_model

from armwright.description.drive import LinearFriction, Motor, RotaryFriction
from armwright.description.robot import friction_kind
from armwright.description.todo import todo_problems
from armwright.errors import DescriptionError
from armwright.joint_kinds import moving_kinds
from armwright.quantity import Record, optional
from armwright.validation import validated


def _shared(name: str, about: str, *records: type[Record]) -> type[Record]:
    """A record with the keys of others, each of which may be absent."""
    fields: dict[str, Any] = {}
    for record in records:
        for key, field in record.model_fields.items():
            changed = copy(field)
            changed.default = None
            fields.setdefault(key, (field.rebuild_annotation() | None, changed))
    return create_model(name, __base__=Record, __module__=__name__, __doc__=about, **fields)


SharedMotor = _shared("SharedMotor", "Keys of `[joints.motor]` for all joints that do not state them.", Motor)
SharedFriction = _shared(
    "SharedFriction",
    "Keys of `[joints.friction]` for all joints that do not state them.",
    RotaryFriction,
    LinearFriction,
)


class Defaults(Record):
    """Motor and friction of all joints that state none."""

    motor: SharedMotor | None = optional("Motor and gear.")  # type: ignore[valid-type]
    friction: SharedFriction | None = optional("Friction.")  # type: ignore[valid-type]


def with_defaults(document: Mapping[str, Any], file: Any) -> dict[str, Any]:
    """A document without `defaults`, whose tables stand in its joints.

    Args:
        document: of a robot file.   file: for errors.
    Raises:
        DescriptionError: a mistake in the defaults; a value to fill in there, together with those of the rest; a friction in
            N m for a joint that slides, or in N for one that turns, and that has none of its own.
    """
    document = dict(document)
    missing = todo_problems(document)
    if any(each.place.startswith("defaults.") for each in missing):
        raise DescriptionError.of(*(each.within(file=file) for each in missing))
    defaults, joints = document.pop("defaults"), document.get("joints")
    validated(Defaults, defaults, place="defaults", file=file)
    if isinstance(joints, list):
        document["joints"] = [
            filled_in(joint, defaults, document.get("source"), file) if _has_own_drive(joint) else joint
            for joint in joints
        ]
    return document


def _has_own_drive(joint: Any) -> bool:
    is_plain = isinstance(joint, dict) and "mimic" not in joint and "servo" not in joint
    return is_plain and joint.get("type") in moving_kinds()


def filled_in(joint: dict[str, Any], defaults: dict[str, Any], around: Any, file: Any) -> dict[str, Any]:
    """A joint with the default tables below its own.

    Args:
        joint: its type, and its name for errors, among its keys.   defaults: tables by name, which `Defaults` has accepted.
        around: source of numbers of the document that name none.   file: for errors.
    """
    made, outer = dict(joint), joint.get("source", around)
    for part, shared in defaults.items():
        own = joint.get(part, {})
        if not isinstance(own, dict) or (part == "friction" and not _is_friction_of(joint, shared, file)):
            continue
        if not own:
            made[part] = shared if outer == around or around is None else {"source": around, **shared}
            continue
        table, source = {key: it for key, it in shared.items() if key != "source"}, shared.get("source", around)
        if source is not None and source != own.get("source", outer):
            table = {key: _with_source(it, source) for key, it in table.items()}
        made[part] = {**table, **own}
    return made


def _is_friction_of(joint: dict[str, Any], shared: dict[str, Any], file: Any) -> bool:
    """True if a default friction goes into a joint: one without a law of its own, in the units of its coordinate."""
    own, kind = joint.get("friction", {}), friction_kind(shared)
    slides = moving_kinds()[joint["type"]].units.linear
    fits = shared.get("side") == "motor" or (kind == "LinearFriction") == slides
    if not fits and not own:
        what = f"in {'N m' if slides else 'N'}, and joint {joint.get('name')!r} {'slides' if slides else 'turns'}"
        raise DescriptionError(what, place="defaults.friction", expected="[joints.friction] in that joint", file=file)
    return fits and "law" not in own


def _with_source(value: Any, source: str) -> Any:
    """A number, several numbers, or a table of the defaults, with its source."""
    if isinstance(value, dict):
        return {"source": source, **value}
    return value if isinstance(value, (str, bool, list)) else {"value": value, "source": source}

"""Linear twins of rotary records: one table of keys serves joints that turn and joints that slide.

A twin has the keys of its rotary record with their endings in metres and newtons, and `force` in place of `torque`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from copy import copy
from typing import Any, TypeVar

from pydantic import create_model

from armwright.joint_kinds import LINEAR
from armwright.quantity import Record

T = TypeVar("T", bound=Record)


def twin_of(rotary: type[Record], *kept: str) -> Callable[[type[T]], type[T]]:
    """Adds the keys of a rotary record to a class of records, in metres and newtons.

    Args:
        rotary: the record that has the table of keys.   kept: keys that stay as they are, such as a motor's angle.
    Returns:
        decorator: of a class with a docstring, and with the keys that differ in more than their unit.
    """

    def completed(own: type[T]) -> type[T]:
        fields: dict[str, Any] = {}
        for name, field in rotary.model_fields.items():
            renamed = name if name in kept else LINEAR.renamed(name)
            if renamed not in own.model_fields:
                fields[renamed] = (field.rebuild_annotation(), changed := copy(field))
                changed.description = _in_metres(field.description or "")
        return create_model(own.__name__, __base__=own, __module__=own.__module__, __doc__=own.__doc__, **fields)

    return completed


def _in_metres(text: str) -> str:
    """A description with the twin's keys, and with forces in place of torques."""
    text = re.sub(r"\w+_\w+", lambda key: LINEAR.renamed(key[0]), text)
    return text.replace("torque", "force").replace("Torque", "Force")

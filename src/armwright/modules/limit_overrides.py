"""Limits of an assembly's joints that are narrower than the modules' own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright.description.robot import FixedJoint
from armwright.errors import DescriptionError, nearest
from armwright.modules.assembly import Assembly
from armwright.quantity import Quantity
from armwright.validation import validated


def narrowed(assembly: Assembly, joints: Sequence[Any]) -> list[Any]:
    """Joints with the assembly's own limits, which may be narrower than the module's and not wider."""
    known = {joint.name: k for k, joint in enumerate(joints) if not isinstance(joint, FixedJoint)}
    joints = list(joints)
    for name, given in assembly.limits.items():
        if name not in known:
            raise DescriptionError(f"limits.{name}: no joint is called so; {nearest(name, known)}")
        joint = joints[known[name]]
        data = {key: value for key, value in given.items() if key != "source"}
        source = given.get("source") or assembly.source
        narrowed = validated(type(joint.limits), data, place=f"limits.{name}")
        new = {}
        for key in narrowed.model_fields_set:
            value, old = getattr(narrowed, key), getattr(joint.limits, key)
            if old is not None and not _within(value, old):
                raise DescriptionError(
                    f"limits.{name}.{key}: wider than the module's {_shown(old)}; expected it within"
                )
            new[key] = value if value.source else value.replace(source=source)
        joints[known[name]] = joint.replace(limits=joint.limits.replace(**new))
    return joints


def _within(new: Quantity, old: Quantity) -> bool:
    a, b = np.atleast_1d(np.array(new)), np.atleast_1d(np.array(old))
    return bool(a[0] >= b[0] and a[1] <= b[1]) if len(a) == 2 else bool(a[0] <= b[0])


def _shown(quantity: Quantity) -> str:
    return str(list(quantity.value) if isinstance(quantity.value, tuple) else quantity.value)

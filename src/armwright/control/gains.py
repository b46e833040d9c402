"""Gains of a controller, checked: one number for all joints or one for each, or a `Batch` of such."""

from __future__ import annotations

import numbers
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.model.joint_signals import command_unit
from armwright.parameters import Batch, lane_values


def gain_units(arm: Model, law: Any, name: str) -> list[str]:
    """The unit of a controller's gain for each joint, from its class's `gain_units`; "" if unknown.

    Args:
        arm: the model.   law: the controller.   name: of its gain.
    """
    unit, units = getattr(law, "gain_units", {}).get(name, ""), []
    for body in arm.coordinates:
        within = getattr(law, "current_kp", None) is not None  # the speed stage then commands a current
        command = "A" if within else command_unit(body.drive.command, body.kind.units)
        units.append(unit.replace("U", command).replace("Q", body.kind.units.position))
    return units


def per_joint(arm: Model, law: str, name: str, value: Any, *, low: float = 0.0, limit: bool = False) -> Any:
    """A gain as (n,), or a batch of such.

    Args:
        arm: the model.   law, name: who asks, for errors.
        value: a number for all joints, (n,), or a `Batch` of either.
        low: the least that is allowed.   limit: whether it may be infinite, which None says too.
    Raises:
        ScenarioError: names the gain, its shape or value, and what was expected.
    """
    n = arm.n
    value = np.inf if limit and value is None else value
    try:
        rows = np.asarray(lane_values(value))
        is_wrong = rows.dtype.kind not in "iufO" or scalar.has_masked_entries(value)  # True would be a number to NumPy
        array = None if is_wrong else rows.astype(float)
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is None:
        raise ScenarioError(place=f"{law}.{name}", value=value, expected="a number, or one for each joint")
    if array.shape[1:] not in ((), (n,)):
        expected = f"one number or ({n},): {', '.join(arm.names)}; rows that differ by lane are a Batch"
        raise ScenarioError(f"shape {array.shape[1:]}", place=f"{law}.{name}", expected=expected)
    rows = np.array(np.broadcast_to(array.reshape(len(array), -1), (len(array), n)))
    wrong = ~(rows >= low) | (np.isinf(rows) & (not limit))
    if wrong.any():
        lane, joint = np.argwhere(wrong)[0]
        expected = f"a number of {low:g} or more" if low == 0.0 else f"a number above {np.nextafter(low, 0):g}"
        place = f"{law}.{name} of joint {arm.names[joint]!r}"
        place += f" of lane {lane}" if isinstance(value, Batch) else ""
        raise ScenarioError(place=place, value=float(rows[lane, joint]), expected=expected)
    return Batch(rows) if isinstance(value, Batch) else rows[0]


def positive_limit(arm: Model, law: str, name: str, value: Any) -> Any:
    """A limit as `per_joint` gives it, above 0; None becomes infinite."""
    return per_joint(arm, law, name, value, low=float(np.nextafter(0.0, 1.0)), limit=True)


def check_model(law: str, model: Any) -> None:
    """Refuses a model argument that is not a `Model`.

    Raises:
        ScenarioError: names it.
    """
    if model is not None and not isinstance(model, Model):
        raise ScenarioError(place=f"{law}.model", value=model, expected="an arm, as aw.load(name) gives, or none")


def model_for(law: str, model: Model | None, arm: Model) -> Model:
    """The model that a controller of an arm reckons with: the arm itself without one.

    Raises:
        ScenarioError: a model of other joints.
    """
    if model is not None and model.n != arm.n:
        expected = f"the {arm.n} of {arm.name}: {', '.join(arm.names)}"
        raise ScenarioError(f"the model has {model.n} joints", place=f"{law}.model", expected=expected)
    return model or arm


def check_whole(law: str, name: str, value: Any, low: int, expected: str) -> None:
    """Refuses a value that is not a whole number of at least `low`.

    Raises:
        ScenarioError: names it and what was expected.
    """
    if scalar.real_number(value) is None or not isinstance(value, numbers.Integral) or value < low:
        raise ScenarioError(place=f"{law}.{name}", value=value, expected=expected)


def check_delay_ticks(law: str, ticks: Any) -> None:
    """Refuses what is neither a whole number of ticks, 0 or more, nor absent.

    Raises:
        ScenarioError: names it.
    """
    if ticks is not None:
        check_whole(law, "delay_ticks", ticks, 0, "a whole number of ticks, 0 or more, or none: the loop's")


def check_time(law: str, name: str, value: Any) -> None:
    """Refuses a value that is not a number above 0.

    Raises:
        ScenarioError: names it.
    """
    number = scalar.real_number(value)
    if number is None or not 0.0 < number < np.inf:
        raise ScenarioError(place=f"{law}.{name}", value=value, expected="a number above 0")

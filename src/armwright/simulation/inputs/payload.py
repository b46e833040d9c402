"""Payloads over time: bodies that the hand takes up and puts down, each from its time until the next.

A body joins, and leaves, at the hand's velocity: positions and speeds are continuous, momentum and energy jump by those of the
body. The plant takes its ten numbers about the frame's origin, zeros for an empty hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, ScenarioError
from armwright.lint.feasibility import IMPOSSIBLE
from armwright.model import Model
from armwright.model.payload import Payload
from armwright.model.tree import BASE
from armwright.parameters import Batch, check_counts, lane_counts, numbers_by_lane
from armwright.simulation.inputs.input_schedule import LaneRows
from armwright.spatial import TENSOR, displaced_inertia


def carried(payload: Payload) -> str:
    """A body and its time in words, of one lane."""
    body = f"{float(payload.mass):.4g} kg" if float(payload.mass) > 0.0 else "nothing"
    return f"{body} from {float(payload.time):.4g} s on"


def payload_of(arm: Model, payloads: Any) -> tuple[tuple[str, ...], LaneRows]:
    """Frames that bodies hang on, and for each of them the ten numbers over time, side by side.

    Raises:
        ScenarioError: a body that cannot be, times that do not increase; names the place, the lane and the value.
        ModelError: no such frame, or no tip.
    """
    bodies = [payloads] if isinstance(payloads, Payload) else payloads
    if not isinstance(bodies, Sequence) or not bodies or not all(isinstance(each, Payload) for each in bodies):
        expected = "an aw.Payload(time, mass, com, inertia), or a list of them"
        raise ScenarioError(place="payload", value=payloads, expected=expected)
    at = [_frame(arm, k, each) for k, each in enumerate(bodies)]
    times, loads = zip(*(_load(k, each) for k, each in enumerate(bodies)), strict=True)
    lanes, frames = check_counts(lane_counts(bodies, "payload")) or 1, tuple(dict.fromkeys(at))
    time = np.stack([np.broadcast_to(each, lanes) for each in times], axis=1)
    load = np.stack([np.broadcast_to(each, (lanes, 10)) for each in loads], axis=1)
    _check_order(at, time)
    return frames, _rows(time, load, np.array([frames.index(frame) for frame in at]), len(frames))


def _frame(arm: Model, k: int, payload: Payload) -> str:
    name = arm.tip if payload.frame is None else payload.frame
    try:
        body = arm.frame(name).body
    except ArmwrightError as error:
        raise error.within(f"payload[{k}]") from None
    if body == BASE:
        raise ScenarioError(
            "stands still with the base", place=f"payload[{k}].frame", value=name, expected="one that moves"
        )
    assert name is not None
    return name


def _load(k: int, payload: Payload) -> tuple[np.ndarray, np.ndarray]:
    """The time at which it is taken up, (lanes or 1,), and its numbers (lanes or 1, 10)."""
    time = _numbers(k, "time", payload.time, (), "a time of 0 s or more")
    mass = _numbers(k, "mass", payload.mass, (), "a mass of 0 kg or more")
    for name, values, unit in (("time", time, "s"), ("mass", mass, "kg")):
        if (values < 0.0).any():
            lane = int(np.argmax(values < 0.0))
            place = _place(k, name, values, lane)
            raise ScenarioError(place=place, value=float(values[lane]), expected=f"0 {unit} or more")
    if payload.com is None:
        raise ScenarioError(
            "missing", place=f"payload[{k}].com", expected="one beside an inertia; a point mass has none"
        )
    com = _numbers(k, "com", payload.com, (3,), "three numbers [m]")
    tensor = _tensor(k, payload.inertia)
    _check_tensor(k, tensor, mass)
    rows = max(len(mass), len(com), len(tensor))
    mass, com = np.broadcast_to(mass, rows), np.broadcast_to(com, (rows, 3)).T
    about_origin = np.broadcast_to(tensor, (rows, 3, 3)).transpose(1, 2, 0) + displaced_inertia(mass, 0.0 * com, com)
    return time, np.stack([mass, *(mass * com), *(about_origin[place] for place in TENSOR.values())], axis=1)


def _numbers(k: int, name: str, value: Any, shape: tuple[int, ...], expected: str) -> np.ndarray:
    """(lanes or 1, *shape) finite numbers."""
    try:
        numbers = numbers_by_lane(value)
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape[1:] != shape or not numbers.size or not np.isfinite(numbers).all():
        raise ScenarioError(place=f"payload[{k}].{name}", value=value, expected=f"{expected}, or a Batch of such")
    return numbers


def _tensor(k: int, value: Any) -> np.ndarray:
    """(lanes or 1, 3, 3), symmetric."""
    expected = "a symmetric (3, 3) tensor or three moments [kg m²], zeros for a point mass"
    moments = (value.shape if isinstance(value, Batch) else np.shape(value)) == (3,)
    tensor = _numbers(k, "inertia", value, (3,) if moments else (3, 3), expected)
    tensor = tensor[:, None, :] * np.eye(3) if moments else tensor
    turned = tensor.transpose(0, 2, 1)
    if not np.allclose(tensor, turned, rtol=1e-9, atol=0.0):
        raise ScenarioError(place=f"payload[{k}].inertia", value=value, expected=expected)
    return 0.5 * (tensor + turned)


def _check_tensor(k: int, tensor: np.ndarray, mass: np.ndarray) -> None:
    """Refuses tensors about a centre of mass that no body can have: moments a ≤ b ≤ c with a ≥ 0 and c ≤ a + b."""
    moments = np.linalg.eigvalsh(tensor)
    least = -IMPOSSIBLE * np.abs(moments).max(axis=1)
    wrong = (moments[:, 0] < least) | (moments[:, 0] + moments[:, 1] - moments[:, 2] < least)
    if wrong.any():
        lane = int(np.argmax(wrong))
        a, b, c = moments[lane]
        raise ScenarioError(
            f"principal moments {a:.4g}, {b:.4g} and {c:.4g} kg m² are those of no body",
            place=_place(k, "inertia", tensor, lane),
            expected="none below 0, and none above the sum of the other two",
        )
    lanes = max(len(mass), len(tensor))
    empty = np.broadcast_to(mass == 0.0, lanes) & np.broadcast_to(np.abs(moments).max(axis=1) > 0.0, lanes)
    if empty.any():
        lane = int(np.argmax(empty))
        place, expected = _place(k, "mass", empty, lane), "a mass above 0, or no inertia"
        raise ScenarioError("with an inertia", place=place, value=0.0, expected=expected)


def _place(k: int, name: str, values: np.ndarray, lane: int) -> str:
    return f"payload[{k}].{name}" + (f" of lane {lane}" if len(values) > 1 else "")


def _check_order(frames: list[str], times: np.ndarray) -> None:
    """Refuses bodies of one hand whose times (lanes, bodies) do not increase in the order of the list."""
    last: dict[str, int] = {}
    for k, frame in enumerate(frames):
        if frame in last:
            early = times[:, k] <= times[:, last[frame]]
            if early.any():
                lane = int(np.argmax(early))
                expected = f"one after payload[{last[frame]}]'s {times[lane, last[frame]]:g} s"
                raise ScenarioError(place=_place(k, "time", early, lane), value=times[lane, k], expected=expected)
        last[frame] = k


def _rows(times: np.ndarray, loads: np.ndarray, hands: np.ndarray, count: int) -> LaneRows:
    """Contents of all hands, empty in the beginning: a row for every body, in the order in which each lane takes them up.

    Args:
        times: (lanes, bodies) [s].   loads: (lanes, bodies, 10).   hands: (bodies,) numbers of their hands.   count: of hands.
    """
    lanes, order = np.arange(len(times)), np.argsort(times, axis=1, kind="stable")
    now = np.zeros((len(times), count, 10))
    rows = [now.copy()]
    for body in order.T:  # one of every lane
        now[lanes, hands[body]] = loads[lanes, body]
        rows.append(now.copy())
    sorted_times = np.take_along_axis(times, order, axis=1)
    return LaneRows(
        np.concatenate([np.zeros((len(times), 1)), sorted_times], axis=1),
        np.stack(rows, axis=1).reshape(len(times), -1, 10 * count),
    )

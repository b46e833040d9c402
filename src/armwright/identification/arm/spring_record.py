"""Springs and counterbalances of a fit as a joint's spring in the record: linear, or a table over the position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armwright.actuators.springs import spring_torque
from armwright.model import Body, LinearSpring, TableSpring

SPRINGS = ("spring", "sine", "cosine")  # kinds of columns: motor torque  k q + s sin q + c cos q
POINTS = 73  # of a table over a turn: its straight lines are off by 0.1 % of a sine at most


def spring_keys(body: Body, values: Mapping[str, float], key: str) -> tuple[dict[str, Any], str | None]:
    """The joint's spring with the fitted one added.

    A stiffness alone is a line. With a counterbalance, or beside a table, the sum is a table over a turn and the joint's range.
    The fitted spring rests at 0: what it holds there is part of the constant torque in the friction.

    Args:
        body: the joint.   values: fitted parameters by their kind, of `SPRINGS`.   key: of the source.
    Returns:
        keys: of the joint's record; empty where nothing was fitted.
        path: in the spring's table, of the number that is the fitted stiffness itself; None if there is none.
    """
    if not values:
        return {}, None
    key_of = body.kind.units.key
    old, k = body.spring, values.get("spring", 0.0)
    if set(values) == {"spring"} and not isinstance(old, TableSpring):
        stiffness, before = key_of("stiffness", "stiffness"), old or LinearSpring(0.0, 0.0)
        rest = float(before.rest)
        line = {
            stiffness: {"value": k + float(before.stiffness), "source": key},
            key_of("rest", "position"): {"value": rest, "source": "definition"},
            key_of("preload", "torque"): {"value": float(before.preload) - k * rest, "source": key},
        }
        return {"spring": line}, stiffness if old is None else None
    ends = [float(end) for end in body.limits.position or () if np.isfinite(float(end))]
    q = np.linspace(min([-np.pi, *ends]), max([np.pi, *ends]), POINTS)
    if isinstance(old, TableSpring):
        q = np.union1d(q, np.array(old.positions, dtype=float))
    torques = -k * q - values.get("sine", 0.0) * np.sin(q) - values.get("cosine", 0.0) * np.cos(q)
    if old is not None:
        torques = torques + [float(spring_torque(old, float(each))) for each in q]
    points = {
        key_of("positions", "position"): {"value": q.tolist(), "source": "definition"},
        key_of("torques", "torque"): {"value": torques.tolist(), "source": key},
        "outside": "linear",
    }
    return {"spring": points}, None

"""Arguments of runs over a bus, which stay on a bus of this process, and the data sheets (EDS) of foreign drives."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import armwright as aw
from fuzz.case import Case
from fuzz.mutation import mutated
from fuzz.values import built, odd_value

GOOD: dict[str, Any] = {
    "bus": "virtual:fuzz", "nodes": [3, 4], "bitrate": 500_000, "real_time": False, "following_error": 0.5, "heartbeat": 0.1,
    "serial": 7, "eds": None, "missing": 2, "faults": [],
}  # fmt: skip
BUSES = ("", "virtual", "virtual:", "socketcan", "socketcan:can0", "udp_multicast:239.74.163.2", "udp_multicast", "slcan:tty0",
         "virtual:x:y", "\0", "kvaser", "virtual:" + "x" * 300, " virtual", "VIRTUAL", "udp_multicast:::1")  # fmt: skip
NUMBERS = (
    *(0, 1, -1, 2, 3, 127, 128, 65535, 65536, 0.5, 1e-300, 1e300, True, False),
    None,
    [3, 3],
    [0, 1],
    [3, 128],
    [3],
    [3, 4.0],
    "3,4",
)
FIELDS: dict[str, tuple[Any, ...]] = {  # of the scenario, and what stands there in its place
    "period": (4e-3, 8e-3, 1e-3, 1e-4, 1e-6, 0.3, 3.3e-3, 1 / 3, 1e3), "counts": (360_000, 1, 2, 1e9, 0.5, 2**31),
    "duration": (0.02, 4e-3, 0.0), "start": ([-1.2, 0.0], [3.0, 0.0], [1e9, 0.0]),
    "limit": (None, 1.0, 1e-9, 1e9),
}  # fmt: skip
WAIT = 0.02  # [s] for an answer that no node gives


@cache
def _arm() -> aw.Model:
    """Two links behind gears, with the limits that a bus needs."""
    return aw.load(Path(__file__).parent / "seeds" / "bus.toml")


@cache
def _rehearsal(period: float = 4e-3, counts: float = 360_000, duration: float = 0.02, start: tuple[float, ...] = (-1.2, 0.0),
               limit: float | None = None) -> Any:  # fmt: skip
    return aw.bus.rehearse(_scenario(period, counts, duration, start, limit))


def _scenario(period: float, counts: float, duration: float, start: Any, limit: float | None) -> aw.Scenario:
    law = aw.Cascade(
        position_kp=15.0, speed_kp=[700.0, 160.0], speed_ki=[7000.0, 1600.0], speed_feedforward=1.0, delay_ticks=1
    )
    loop = aw.Loop(
        law, aw.trajectories.Quintic([-1.2, 0.0], [-1.15, 0.05], 0.02), period=period, timing=aw.Timing("one-tick"),
        sensors=aw.Sensors(counts=counts, side="link", velocity="difference"),
        command_filter=aw.CommandFilter(limit=limit),
    )  # fmt: skip
    return aw.Scenario(_arm(), duration=duration, loop=loop, start=list(start))


def make_bus(rng: Random) -> Case:
    target = rng.choice(("run",) * 5 + ("rehearse", "Twin", "both"))
    names = [
        *inspect.signature(
            {"rehearse": aw.bus.rehearse, "Twin": aw.bus.Twin}.get(target, aw.bus.run_controller)
        ).parameters
    ]
    arguments = {name: GOOD[name] for name in names if name in GOOD}
    odd = [name for name in names[1:] if name != "permission"]
    for name in rng.sample(odd, min(len(odd), rng.choice((1, 1, 2)))):
        own = BUSES if name == "bus" else NUMBERS
        arguments[name] = rng.choice(own) if rng.random() < 0.6 else odd_value(rng)
    fields = {}
    if target in ("rehearse", "Twin") and rng.random() < 0.5:
        name = rng.choice([*FIELDS])
        fields[name] = rng.choice(FIELDS[name])
    return Case("bus", {"arm.eds": _sheet().encode()}, {"target": target, "arguments": arguments, "fields": fields})


def run_bus(case: Case) -> None:
    """Does it on a bus of this process: any other is refused as by a system without such a bus."""
    import can

    from armwright.twin import master

    arguments = {name: built(value) for name, value in case.call["arguments"].items()}
    target, own = case.call["target"], can.Bus

    def virtual_only(*words: Any, **named: Any) -> Any:
        if named.get("interface") != "virtual":
            raise can.CanInitializationError("there is none here")
        return own(*words, **named)

    with mock.patch.object(can, "Bus", virtual_only), mock.patch.object(master, "ANSWER", WAIT):
        if target == "run":
            aw.bus.run_controller(_rehearsal(), **arguments)
        elif target == "both":
            with aw.bus.Twin(_scenario(4e-3, 360_000, 0.02, (-1.2, 0.0), None), "virtual:fuzz"):
                aw.bus.run_controller(_rehearsal(), **arguments)
        else:
            values = {"period": 4e-3, "counts": 360_000, "duration": 0.02, "start": [-1.2, 0.0], "limit": None}
            scenario = _scenario(**{**values, **case.call["fields"]})
            (aw.bus.rehearse if target == "rehearse" else aw.bus.Twin)(scenario, **arguments)


@cache
def _sheet() -> str:
    """A good data sheet: the twin's."""
    from armwright.twin.objects import eds_text

    return eds_text(3, "drive", {})


def make_eds(rng: Random) -> Case:
    text = mutated(_sheet(), "ini", rng) if rng.random() < 0.95 else _sheet().encode("utf-16")
    name = (
        "arm.eds"
        if rng.random() < 0.95
        else rng.choice(("fifo.eds", "zero.eds", "loop.eds", "gone.eds", "folder.eds", "x" * 300))
    )
    return Case("eds", {"arm.eds": text}, [name] * rng.choice((1, 1, 1, 2, 3)))


def run_eds(case: Case) -> None:
    from armwright.twin.master import Master

    Master(_rehearsal(), "virtual:fuzz", eds=case.call)


def prepare() -> None:
    """Compiles what the cases share, before the limits hold."""
    _rehearsal()


BUSES_AND_SHEETS: dict[str, tuple[float, Callable[[Random], Case], Callable[[Case], Any]]] = {
    # kind: (share of the inputs, what makes one, what is done with it)
    "bus": (1, make_bus, run_bus),
    "eds": (3, make_eds, run_eds),
}

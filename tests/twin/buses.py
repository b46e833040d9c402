"""A small arm, its twin on a bus whose time is counted, and a client of its objects: all in this thread."""

from __future__ import annotations

import contextlib
import tomllib
from functools import cache

import pytest

import armwright as aw
from armwright.description.database import parse
from armwright.model import Model, build_model
from twin.conftest import LIMITS, RECORD, Client
from twin.simulated_bus import simulated


@cache
def small_arm() -> Model:
    """Two links behind gears of 100, driven by torques of at most 300 and 100 N m."""
    text = RECORD.read_text(encoding="utf-8")
    for torque, rotor in ((300.0, 1e-3), (100.0, 3e-4)):
        limits = LIMITS.format(torque=torque, rotor=rotor)
        text = text.replace("axis = [0.0, 0.0, 1.0]\n\n[[links]]", f"axis = [0, 0, 1]\n{limits}\n[[links]]", 1)
    return build_model(parse(tomllib.loads(text), "two-link"))


def to_and_fro(t):
    """Positions of both joints."""
    there = 1.0 - aw.scalar.cos(4.0 * t)
    return aw.scalar.array([-1.2 + 0.1 * there, 0.2 * there])


def small_scenario(duration: float = 0.2, arm: Model | None = None, reference=to_and_fro, **changes) -> aw.Scenario:
    """The arm with a cascade that moves both joints, at 4 ms; `changes` are of its loop."""
    law = aw.Cascade(
        position_kp=15.0, speed_kp=[700.0, 160.0], speed_ki=[7000.0, 1600.0], speed_feedforward=1.0, delay_ticks=1
    )
    sensors = aw.Sensors(counts=360_000, side="link", velocity="difference")
    loop = {"period": 4e-3, "sensors": sensors, "timing": aw.Timing("one-tick"), "controller": law, **changes}
    return aw.Scenario(
        arm or small_arm(), duration=duration, loop=aw.Loop(reference=reference, **loop), start=[-1.2, 0.0]
    )


@contextlib.contextmanager
def counted_bus():
    """A simulated bus in place of all others."""
    with pytest.MonkeyPatch.context() as patch:
        bus = simulated(patch)
        patch.setattr("can.Bus", lambda *arguments, **options: bus.open("client"))
        yield bus


@contextlib.contextmanager
def watched_twin(scenario: aw.Scenario, **options):
    """A twin, a client that reads and writes its objects, and their bus."""
    with counted_bus() as bus, aw.bus.Twin(scenario, **options) as twin, Client(twin) as client:
        yield twin, client, bus

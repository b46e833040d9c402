"""Chaos on the bus: drives that die, fall silent, freeze or have a double; frames that are lost, doubled or late.

Whatever ends a run: every node that still answers has its quick stop within three cycles, stands still after the ramp, and holds
the arm, since the record has no brakes; nothing says that the run was complete.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import RunStopped
from armwright.twin import objects as od
from armwright.twin.rehearsal import rehearse
from armwright.twin.run import run_controller
from armwright.twin.state_machine import HELD, State
from armwright.twin.twin import Twin
from twin.simulated_bus import Chaos, simulated

ENABLE, QUICK_STOP = 0x0F, 0x02
RAMP = 0.1  # [s] from the largest speed to rest
SETTLED = 0.42  # [s] of the position loop at its end, where frames are missing besides
NOTICED = 0.35  # [s] after which a node whose answers repeat has missed three heartbeats
ENDS = ("kill", "silence", "freeze", "second", "unplug")  # these end a run
SAYS = {
    "kill": "has not answered since",
    "silence": "has not answered since",
    "freeze": "heartbeat|repeats its answer|following error|does not come to rest",
    "second": "two devices have number|following error|is in state",
    "unplug": "has not answered since|has started anew",
}


@pytest.fixture(scope="module")
def rehearsal(scenario):
    pytest.importorskip("canopen", reason='buses: pip install "armwright[twin]"')
    gentle = aw.Cascade(position_kp=3.0, speed_kp=[150.0, 40.0], speed_ki=[300.0, 80.0], delay_ticks=1)  # bears losses
    return rehearse(replace(scenario, loop=replace(scenario.loop, controller=gentle)))


def disturbed(rehearsal, monkeypatch, kind, at, node, seed):
    """A run with a disturbance: the run, what ended it or None, the bus and the twin."""
    bus = simulated(monkeypatch)
    bus.disturbance = Chaos(kind, 10**9, node, seed)
    with Twin(rehearsal.source, "virtual") as twin:
        chaos = bus.disturbance

        def enabled():
            return any(drive.state is State.ENABLED for drive in twin.drives)

        def arm(frame, sender, of):  # the moment is counted from the SYNC at which the drives are enabled
            if chaos.at == 10**9 and enabled():
                chaos.at = of.syncs + at
            return chaos(frame, sender, of)

        bus.disturbance = arm
        try:
            run = run_controller(rehearsal, "virtual", real_time=True, following_error=0.3)
        except RunStopped as error:
            return error.run, error, bus, twin
        return run, None, bus, twin


def check(rehearsal, monkeypatch, kind, at, seed):
    node = 3 + seed % 2
    run, error, bus, twin = disturbed(rehearsal, monkeypatch, kind, at, node, seed)
    ticks, period = rehearsal.recording.ticks, rehearsal.stages.period
    if kind in ENDS and (kind != "freeze" or (ticks - at) * period > NOTICED):
        assert error is not None
    if error is None:
        assert run.complete
        assert not run.ending.unknown + run.ending.moving
        return False
    assert not run.complete
    assert not run.counts
    if kind in SAYS:
        assert re.search(SAYS[kind], str(error))
    if kind in ("silence", "unplug"):
        assert f"node {node} of {rehearsal.scenario.arm.names[node - 3]}" in str(error)
    # every node has the command within three cycles of the last row
    words = [(time, data[0]) for time, can_id, data in bus.sent if 0x200 <= can_id < 0x280]
    last = max(time for time, word in words if word == ENABLE)
    assert next(time for time, word in words if word == QUICK_STOP and time >= last) - last <= 3 * period
    deaf = kind == "unplug"
    for number, drive in zip((3, 4), twin.drives, strict=True):
        if deaf and number == node:
            continue
        assert drive.state is State.QUICK_STOP or drive.state in HELD, (drive.state, str(error))
        assert drive.demand_speed == 0.0
        if drive.state is State.QUICK_STOP:
            assert drive.values[od.QUICK_STOP_OPTION] == 6
    if kind != "kill":
        answering = set(rehearsal.scenario.arm.names) - set(run.ending.unknown)
        answering -= {rehearsal.scenario.arm.names[node - 3]} if kind == "freeze" else set()
        assert answering <= set(run.ending.still), str(error)
    if not run.ending.moving:
        assert run.ending.seconds <= RAMP + SETTLED
    assert run.ending.held
    return True


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", Chaos.KINDS)
def test_two_moments(rehearsal, monkeypatch, kind):
    for seed in range(2):
        check(rehearsal, monkeypatch, kind, int(np.random.default_rng(seed).integers(5, 150)), seed)


@pytest.mark.study
@pytest.mark.parametrize("kind", Chaos.KINDS)
def test_many_moments(rehearsal, monkeypatch, kind):
    stopped = 0
    for seed in range(25):
        stopped += check(rehearsal, monkeypatch, kind, int(np.random.default_rng(100 + seed).integers(5, 190)), seed)
    print(f"{kind}: {stopped} of 25 runs ended early")
    if kind in ENDS and kind != "freeze":
        assert stopped == 25
    if kind == "duplicate":
        assert stopped == 0  # a frame that comes twice is one frame

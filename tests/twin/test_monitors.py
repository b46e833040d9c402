"""Monitors of a run over a bus, each where it must trip and where it must not: following error, ramps, devices, speed."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import BusError, RunStopped
from armwright.model import Brake
from armwright.twin import objects as od
from armwright.twin.rehearsal import rehearse
from armwright.twin.run import release_drives, run_controller
from armwright.twin.safety import Permission, joints_without_brake, reduced
from armwright.twin.state_machine import State
from armwright.twin.twin import Twin
from raises_at import raises_at
from twin.conftest import Client, radians


def away(scenario, offset):
    """The scenario with a reference that is constant, and a law that holds the arm `offset` beside it."""
    law = aw.Cascade(position_kp=15.0, speed_kp=[700.0, 160.0], speed_ki=[7000.0, 1600.0], delay_ticks=1)
    beside = Beside(law, offset)
    return replace(scenario, duration=0.2, loop=replace(scenario.loop, controller=beside, reference=[-1.2, 0.0]))


class Beside:
    """A law that follows a reference moved by an offset."""

    def __init__(self, law, offset):
        self.law, self.offset = law, np.asarray(offset)

    def configure(self, arm, period):
        return Beside(self.law.configure(arm, period) if hasattr(self.law, "configure") else self.law, self.offset)

    def init(self, arm, y):
        return self.law.init(arm, y)

    def step(self, t, r, y, s):
        return self.law.step(t, replace(r, q=r.q + self.offset), y, s)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("joint", "sign"), [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)])
def test_the_following_error_is_reference_less_position(scenario, bus, joint, sign):
    """The arm comes to stand 20 mrad from a reference at -1.2 and 0 rad: 19 mrad trip, 25 do not, on either side."""
    offset = np.zeros(2)
    offset[joint] = sign * 0.02
    held = away(scenario, offset)
    with Twin(held, bus):
        run = run_controller(held, bus, following_error=0.025)
    assert run.equal
    assert np.abs(run.errors[-1]) == pytest.approx(np.abs(offset), abs=4e-3)
    with (
        Twin(held, bus),
        pytest.raises(RunStopped, match=f"joint '{held.arm.names[joint]}': following error 0.01") as error,
    ):
        run_controller(held, bus, following_error=[0.019 if k == joint else 0.01 for k in range(2)])
    stopped = error.value.run
    assert not stopped.complete
    assert np.all(np.abs(stopped.errors) <= 0.019)  # the row that was too far is not one of the run
    assert np.abs(stopped.errors[-1, joint]) > 0.01


def test_ramps_take_the_time_that_is_stated(scenario, twin, client):
    """A quarter of a second from rest to the speed limit, a tenth to rest in a quick stop (docs/twin.md)."""
    fastest = 2.0  # rad/s, of the record
    for key, seconds in ((od.ACCELERATION, 0.25), (od.DECELERATION, 0.25), (od.STOP_DECELERATION, 0.1)):
        assert radians(client.get(key)) == pytest.approx(fastest / seconds, rel=1e-4)
    client.enable(9)
    client.put(od.QUICK_STOP_OPTION, 6)
    client.put(od.TARGET_VELOCITY, int(client.get(od.MAX_SPEED) * 0.5))
    client.sync(25)
    client.put(od.CONTROLWORD, 0x02)
    speed = radians(twin.drives[0].demand_speed)
    assert speed > 0.3 * fastest
    cycles = 0
    while twin.drives[0].demand_speed != 0.0:
        client.sync()
        cycles += 1
    assert cycles * 4e-3 == pytest.approx(0.1 * speed / fastest, abs=8e-3)


def test_two_devices_with_one_number(scenario, bus):
    """A twin that was forgotten on the bus: found before anything is written."""
    with Twin(scenario, bus, serial=5) as first, Twin(scenario, bus, serial=6, nodes=[4, 9]) as second:
        with pytest.raises(BusError) as error:
            run_controller(scenario, bus)
        for drive in (*first.drives, *second.drives):
            assert drive.values[od.MODE] == 0
            assert drive.machine.passed == [0, 1]
    assert str(error.value) == "nodes = 4: two devices have number 4; expected one device for each number"


def test_two_devices_with_the_same_serial_number(scenario, bus):
    with Twin(scenario, bus), Twin(scenario, bus), raises_at(BusError, "nodes", value=3):
        run_controller(scenario, bus)


def test_an_arm_that_somebody_else_drives_is_refused(scenario, bus):
    with Twin(scenario, bus) as twin, Client(twin) as client:
        client.enable(8)
        with raises_at(BusError, "nodes", "shoulder.* enabled", value=3):
            run_controller(scenario, bus)
        assert all(drive.state is State.ENABLED for drive in twin.drives)


def test_arms_with_brakes_are_shut_down_and_others_held_until_they_are_released(scenario, bus):
    arm = scenario.arm
    assert joints_without_brake(arm) == ("shoulder", "elbow")
    with Twin(scenario, bus) as twin:
        run = run_controller(scenario, bus)
        assert run.complete
        assert run.ending.held
        assert all(drive.state is State.QUICK_STOP for drive in twin.drives)
        with Client(twin) as client:  # the drives' position loops settle
            client.sync(200)
        here = radians([drive.true for drive in twin.drives])
        assert run_controller(replace(scenario, start=here, loop=replace(scenario.loop, reference=here)), bus).complete
        release_drives(scenario, bus)
        assert all(drive.state is State.SWITCH_ON_DISABLED for drive in twin.drives)


def test_brakes_of_the_record_take_over(scenario, bus, tmp_path, arm_file):
    text = arm_file.read_text(encoding="utf-8")
    brake = '\n[joints.brake]\nside = "joint"\nholding_torque_n_m = 400.0\n\n[joints.limits]'
    path = tmp_path / "braked.toml"
    path.write_text(text.replace("\n[joints.limits]", brake), encoding="utf-8")
    arm = aw.load(path)
    assert all(isinstance(body.brake, Brake) for body in arm.coordinates)
    assert joints_without_brake(arm) == ()
    braked = replace(scenario, arm=arm)
    with Twin(braked, bus) as twin:
        run = run_controller(braked, bus)
        assert all(drive.state is State.SWITCH_ON_DISABLED for drive in twin.drives)
    assert not run.ending.held
    assert str(run.ending).endswith("all joints at rest; the drives are disabled")


@pytest.mark.sample(1)
@pytest.mark.parametrize("reference", ["pose", "step"])
def test_speed_slows_what_has_no_time_to_stretch(scenario, reference):
    goal = np.array([-1.1, 0.1])

    def step(t):
        return np.where(t < 0.05, [-1.2, 0.0], goal)

    loop = replace(scenario.loop, reference=goal if reference == "pose" else step)
    moved = replace(scenario, duration=1.0, loop=loop)
    full, slow = rehearse(moved), rehearse(moved, speed=0.25, torque=0.5)
    plain = rehearse(replace(reduced(moved, 0.25, 0.5)))
    assert np.all(plain.largest_speed > 0.5 * full.largest_speed)  # as it was: hardly slower
    assert np.all(slow.largest_speed < 0.25 * 1.5 * full.largest_speed)
    assert slow.q[-1] == pytest.approx(goal, abs=2e-3)  # it gets there
    assert np.all(slow.largest_command <= 0.5)
    assert slow.full.largest_speed == pytest.approx(full.largest_speed)


def test_a_reference_away_from_the_start_is_slowed_or_refused(scenario):
    """The law itself moves the arm at the start, whatever the reference does: no rehearsal of it is slow."""
    jump = away(replace(scenario), [0.15, 0.0])
    with raises_at(BusError, "joint 'shoulder'", r" at 0\.25 "):
        rehearse(jump, speed=0.25)


def test_a_run_that_missed_too_many_answers_rehearses_nothing(scenario, bus):
    with Twin(scenario, bus):
        run = run_controller(scenario, bus)
    assert run.counts
    few = replace(run.cycles, cycles=1000, incomplete=1)
    assert replace(run, cycles=few).counts
    assert not replace(run, cycles=replace(few, incomplete=2)).counts


def test_a_run_without_a_file_stores_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert Permission(serial=7, speed=0.25, torque=0.5).write_reduced({}) is None
    assert not list(tmp_path.iterdir())

"""An arm behind a servo bus: its motion is that of the goals' schedule, to the bit, however time is cut."""

import random
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import BusError
from armwright.twin.serial.arm_plant import REGISTERS, ArmPlant, Mounting
from armwright.twin.serial.plant import Goal
from armwright.twin.serial.replay import replay, write_goals
from armwright.twin.serial.servo_arm import Line, ServoArm
from armwright.twin.serial.timing import CycleEnd, LockStep
from raises_at import raises_at
from simulation.test_servo import ALL, PLAIN, pendulum
from twin.serial.conftest import Client

JOINTS = ("hip", "knee", "ankle")
START = (0.1, 0.2, 0.3)
MOUNTED = [Mounting(), Mounting(zero=1000.0, direction=-1), Mounting()]


@pytest.fixture(scope="module")
def arm():
    """With dry friction that sticks."""
    dry = {"viscous_n_m_s_per_rad": 0.1, "coulomb_positive_n_m": 0.02, "coulomb_negative_n_m": 0.02}
    return pendulum(ALL, JOINTS, friction=dry)


def goal(value, torque=True, **other):
    return Goal(torque, value=value, **{"gains": (16, 0, 32), "dead_band": (1, 1), "speed": 3400.0, **other})


def driven(arm, seed, cuts, changes=()):
    """A plant after goals at random times, looked at often or seldom; `changes` of goals by number."""
    plant, goals, looks = ArmPlant(arm, MOUNTED, START), random.Random(seed), random.Random(cuts)
    plant.states, now = [], 0.0
    for servo in range(3):
        plant.command(servo, goal(2048.0, torque=False, gains=(32, 4, 16)))
    for k in range(30):
        after = now + goals.random() * 0.01
        for _ in range(looks.randrange(4)):
            now += (after - now) * looks.random()
            plant.advance(now)
            plant.measure(looks.randrange(3))
        now = after
        plant.advance(now)
        servo, value, on = goals.randrange(3), 2048.0 + goals.randrange(-500, 500), goals.random() > 0.2
        plant.command(servo, goal(value, torque=on, **dict(changes).get(k, {})))
    plant.advance(now + 0.2)
    return plant


def test_its_motion_is_that_of_its_schedule_whatever_the_cuts(arm, tmp_path):
    plant, other = driven(arm, 1, 2), driven(arm, 1, 3)
    np.testing.assert_array_equal(plant.states, other.states)
    assert np.ptp(np.array(plant.states), axis=0)[:3].min() > 0.1
    write_goals(plant, tmp_path / "run.scenario.toml")
    run = aw.simulate(tmp_path / "run.scenario.toml")
    np.testing.assert_array_equal(run.q.values, [*np.array(plant.states)[:, :3], plant.state[:3]])
    enabled = {tuple(row.enabled) for row in plant.rows}
    assert len(enabled) > 3


def test_the_schedule_of_a_built_in_arm_names_it_and_one_of_another_folder_stands_beside(arm, tmp_path):
    (tmp_path / "far").mkdir()
    far = aw.load(aw.robotfiles.write_toml(aw.load("so101").record, tmp_path / "far" / "arm.toml"))
    for model, names in ((aw.load("so101"), 1), (far, 2), (arm, 2)):
        folder = tmp_path / f"of {model.file if model is not far else 'far'}".replace("/", "-")
        folder.mkdir()
        plant = ArmPlant(model, [Mounting()] * model.n, [0.0] * model.n)
        plant.advance(0.01)
        write_goals(plant, folder / "run.scenario.toml")
        assert len([each for each in folder.iterdir() if each.suffix == ".toml"]) == names
        assert ('robot = "so101"' in (folder / "run.scenario.toml").read_text("utf-8")) == (names == 1)
        assert len(replay(folder / "run.scenario.toml")) == 1


def test_registers_written_while_a_servo_is_on_are_kept_beside_the_schedule(arm, tmp_path):
    changes = {12: {"gains": (25, 2, 8), "limit": 0.5}, 20: {"speed": 500.0, "acceleration": 3000.0}}
    plant = driven(arm, 4, 5, changes.items())
    assert len(plant.values) > 2
    write_goals(plant, tmp_path / "run.scenario.toml")
    runs = replay(tmp_path / "run.scenario.toml")
    assert len(runs) == len(plant.values)
    rows = np.concatenate([run.q.values[:-1] for run in runs])
    np.testing.assert_array_equal([*rows, runs[-1].q.values[-1]], [*np.array(plant.states)[:, :3], plant.state[:3]])
    alone = aw.simulate(tmp_path / "run.scenario.toml")
    assert alone.time.values[-1] == pytest.approx(plant.values[1][0] * plant.period)


def test_registers_written_before_torque_are_those_of_the_scenario(arm):
    plant = ArmPlant(arm, MOUNTED, START)
    for servo in range(3):
        plant.command(servo, goal(2048.0, torque=False, gains=(32, 4, 16)))
    plant.advance(0.1)
    plant.command(0, goal(2300.0, gains=(8, 0, 0), limit=0.6))
    plant.advance(0.2)
    ((turn, values),) = plant.values
    by_name = dict(zip(plant.names, values, strict=True))
    assert turn == 0
    assert [by_name[f"hip.firmware.{key}"] for key in ("p", "i", "d", "output_limit")] == [8.0, 0.0, 0.0, 0.6]
    assert [by_name[f"knee.firmware.{key}"] for key in ("p", "i", "d", "output_limit")] == [32.0, 4.0, 16.0, 0.97]


def test_what_is_measured_is_of_the_last_turn(arm):
    plant = ArmPlant(arm, MOUNTED, START)
    plant.states = []
    for servo in range(3):
        plant.command(servo, goal(2300.0))
    plant.advance(0.0304)
    found, x = [plant.measure(k) for k in range(3)], plant.state
    assert plant.turn == 30
    np.testing.assert_allclose([MOUNTED[k].position(found[k].position) for k in range(3)], x[:3], rtol=0, atol=1e-12)
    assert found[1].position == pytest.approx(1000.0 - x[1] * 4096 / (2 * np.pi))
    assert found[1].speed == pytest.approx(-x[4] * 4096 / (2 * np.pi))
    assert [each.voltage for each in found] == [7.4] * 3
    run = aw.simulate(plant.scenario(30))
    np.testing.assert_allclose([found[0].current, -found[1].current], run.current.values[-1, :2], rtol=1e-9)
    np.testing.assert_allclose([found[0].load, -found[1].load], run.duty.values[-1, :2], rtol=1e-9)


def test_what_the_model_does_not_have_is_said_once():
    said = []
    plant = ArmPlant(pendulum(PLAIN, JOINTS), MOUNTED, note=said.append)
    for servo in range(3):
        plant.command(servo, goal(2048.0, torque=False))
    for k in range(2):
        plant.advance(0.01 * (k + 1))
        plant.command(0, goal(2048.0, gains=(16, k + 1, 32), acceleration=1000.0))
        plant.command(1, Goal(True, mode="speed", value=100.0))
    plant.advance(0.1)
    assert [text for text in said if "goals of speed" in text] == [
        "joint 'knee': goals of speed are not simulated: the servo is off"
    ]
    assert sum("'hip'" in text and "firmware.i" in text for text in said) == 1
    assert plant.rows[-1].enabled[1] == 0.0


def test_a_dead_band_that_differs_by_direction_is_simulated_by_the_wider():
    assert [REGISTERS["dead_band_counts"](goal(0.0, dead_band=band), None) for band in ((1, 6), (6, 1))] == [6, 6]


def test_a_servos_registers_begin_with_the_records_numbers(arm):
    bus = ServoArm(arm, Line(ids=[4, 5, 6]), start=START).bus
    client = Client(bus, bus.plant)
    names = ("position_p_gain", "position_i_gain", "position_d_gain", "cw_dead_band", "profile_velocity")
    assert [client.get(5, name) for name in names] == [32, 4, 16, 1, 3390]
    assert client.get(4, "present_position") == round(2048 + 0.1 * 4096 / (2 * np.pi))
    assert client.get(4, "goal_position") == client.get(4, "present_position")


@pytest.mark.parametrize("pauses", [1, 2])
def test_lock_step_over_frames_has_the_bits_of_the_scenario(arm, tmp_path, pauses):
    made = ServoArm(arm, Line(), start=START)
    made.plant.states = []
    timing = LockStep(made.bus, 0.02, CycleEnd("sync-write", 42))
    client, rng, read = Client(made.bus, made.plant), random.Random(pauses), []

    def sent(instruction, number, data=b""):
        frame = made.bus.framing.pack(number, client.codes[instruction], data)
        for each in made.bus.feed(frame, 1_000_000):
            timing.reply(each, 1_000_000)
            timing.close(each)

    for number in (1, 2, 3):
        for address, value in ((21, 16), (22, 32), (23, 0), (41, 254), (40, 1)):
            sent("write", number, bytes((address, value)))
    for k in range(8):
        for number in (1, 2, 3)[: rng.randrange(4)]:
            sent("read", number, bytes((56, 2)))
            read.append((made.plant.turn, number, client.get(number, "present_position")))
        if k == 5:
            sent("write", 2, bytes((40, 0)))
        goals = b"".join(
            bytes((n, *(2048 + 60 * k * (-1) ** n).to_bytes(2, "little"))) for n in (1, 2, 3) if n != 2 or k < 5
        )
        sent("sync-write", 254, bytes((42, 2)) + goals)
    write_goals(made.plant, tmp_path / "run.scenario.toml")
    (run,) = replay(tmp_path / "run.scenario.toml")
    np.testing.assert_array_equal(run.q.values[:-1], np.array(made.plant.states)[:, :3])
    counts = np.rint(2048 + run.q.values * 4096 / (2 * np.pi))
    assert all(counts[turn, number - 1] == position for turn, number, position in read)
    assert made.plant.rows[-1].enabled.tolist() == [1.0, 0.0, 1.0]


WRONG = {
    "too few ids": ({"ids": [1, 2]}, r"ids = \[1, 2\]: expected 3 different ones: hip, knee, ankle"),
    "an id twice": ({"ids": [1, 2, 2]}, r"ids = \[1, 2, 2\]"),
    "no such model": ({"model": "sts9"}, r"servo = 'sts9'.*sts3215"),
    "no such rate": ({"baud": 9600}, r"baud = 9600"),
    "zeros": ({"zeros": [1.0]}, r"zeros = \[1\.0\]: expected 3 numbers"),
    "a joint that is none": ({"reversed": ["toe"]}, r"reversed = 'toe'"),
}


@pytest.mark.parametrize(("line", "words"), WRONG.values(), ids=WRONG)
def test_lines_that_do_not_fit_are_refused(arm, line, words):
    with pytest.raises(BusError, match=words):
        ServoArm(arm, Line(**line))


def test_an_arm_without_servos_is_refused():
    with raises_at(BusError, "arm", r"'shoulder' of two-link .* command = \"position\""):
        ServoArm("two-link")


def test_goals_go_into_a_scenario_file(arm):
    plant = ArmPlant(arm, MOUNTED)
    with pytest.raises(BusError, match=r"schedule = .*expected NAME\.scenario\.toml"):
        write_goals(plant, Path("goals.csv"))


def test_a_plant_that_keeps_no_rows_moves_alike_and_does_not_grow(arm):
    kept, forgetful = (ArmPlant(arm, MOUNTED) for _ in range(2))
    forgetful.keeps_rows = False
    for plant in (kept, forgetful):
        for k in range(50):
            plant.command(k % 3, goal(2048.0 + 10.0 * k, gains=(16 + k, 0, 32)))
            plant.advance(0.01 * (k + 1))
    np.testing.assert_array_equal(kept.state, forgetful.state)
    assert (len(forgetful.rows), len(forgetful.values)) == (1, 1)
    assert min(len(kept.rows), len(kept.values)) > 40
    with raises_at(BusError, "schedule"):
        forgetful.scenario(10)

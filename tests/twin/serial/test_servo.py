"""Rules of servos: what their registers do, by model."""

import math
from dataclasses import replace

import pytest

from armwright.twin.serial.bus import ServoBus, make_servo
from armwright.twin.serial.frames import BROADCAST, FEETECH
from armwright.twin.serial.plant import KinematicPlant, Measurement
from armwright.twin.serial.registers import servo_model
from twin.serial.conftest import Client, client


class Loaded(KinematicPlant):
    """Joints that measure what a test says."""

    now = Measurement(0.0)

    def measure(self, servo):
        return replace(self.now, position=self.positions[servo])


def loaded(model, voltage=7.4, **values):
    """A client of one servo whose measurements the test sets, and the plant."""
    plant = Loaded([1000.0])
    plant.now = Measurement(0.0, voltage=voltage)
    return Client(ServoBus([make_servo(servo_model(model), 1, **values)], plant), plant), plant


# Feetech.


def test_sts_goes_to_its_goal_at_its_speed(sts):
    assert sts.put(1, "profile_velocity", 500) == 0
    assert sts.get(1, "torque_enable") == 0
    assert sts.put(1, "goal_position", 1500) == 0
    assert sts.get(1, "torque_enable") == 1  # switched on by the goal
    sts.bus.advance(0.5)
    assert (sts.get(1, "present_position"), sts.get(1, "present_velocity"), sts.get(1, "moving")) == (1250, 500, 1)
    sts.bus.advance(2.0)
    sts.bus.advance(2.1)
    assert (sts.get(1, "present_position"), sts.get(1, "moving"), sts.get(2, "present_position")) == (1500, 0, 2000)


def test_sts_offset_is_subtracted_and_goals_follow_it(sts):
    sts.put(1, "homing_offset", -100)
    assert sts.get(1, "present_position") == 1100
    sts.put(1, "goal_position", 1200)
    assert sts.plant.goals[0].value == 1100.0
    sts.bus.advance(1.0)
    assert (sts.get(1, "present_position"), sts.plant.positions[0]) == (1200, 1100.0)
    sts.put(1, "homing_offset", 2000)
    assert sts.get(1, "present_position") == 1100 - 2000 + 4096  # within one turn


def test_sts_shows_all_turns_if_its_phase_says_so(sts):
    sts.put(1, "homing_offset", 2000)
    assert sts.get(1, "present_position") == 1100 - 100 - 2000 + 4096
    sts.put(1, "phase", sts.get(1, "phase") | 0x10)
    assert sts.get(1, "present_position") == 1000 - 2000


def test_sts_makes_the_present_position_the_middle(sts):
    for number, actual in ((1, 1000), (2, 2000), (3, 3000)):
        assert sts.put(number, "torque_enable", 128) == 0
        assert sts.get(number, "present_position") == 2048
        assert sts.get(number, "homing_offset") == actual - 2048
        assert sts.get(number, "torque_enable") == 0


def test_sts_keeps_the_eeprom_only_when_unlocked(sts):
    (servo, *_), values = sts.bus.servos, {}
    for lock, gain in ((1, 16), (0, 20)):
        sts.put(1, "lock", lock)
        sts.put(1, "position_p_gain", gain)
        assert servo.goal.gains[0] == gain  # locked values act too
        servo.power_up()
        values[lock] = servo["position_p_gain"]
    assert values == {1: 32, 0: 20}
    sts.put(1, "position_d_gain", 5)  # locked
    sts.put(1, "lock", 0)
    sts.put(1, "position_i_gain", 6)
    servo.power_up()
    assert (servo["position_d_gain"], servo["position_i_gain"]) == (32, 6)
    sts.put(1, "max_torque_limit", 500)
    assert servo["torque_limit"] == 1000
    servo.power_up()
    assert servo["torque_limit"] == 1000  # the lock was set again at power-up


def test_sts_limits_goals_and_does_not_take_values_out_of_range(sts):
    sts.put(1, "max_position_limit", 1200)
    sts.put(1, "goal_position", 3000)
    assert (sts.get(1, "goal_position"), sts.plant.goals[0].value) == (3000, 1200.0)
    for name, value in (("torque_enable", 7), ("position_p_gain", 255), ("present_position", 5), ("lock", 2)):
        before = sts.get(1, name)
        assert sts.put(1, name, value) == 0
        assert sts.get(1, name) == before
    sts.put(1, "min_position_limit", 0)
    sts.put(1, "max_position_limit", 0)  # many turns
    assert sts.plant.goals[0].value == 3000.0


@pytest.mark.parametrize(("values", "goal"), [
    ({"operating_mode": 1, "torque_enable": 1, "profile_velocity": -300}, ("speed", -300.0, True)),
    ({"operating_mode": 2, "torque_enable": 1, "goal_pwm": -250}, ("duty", -0.25, True)),
    ({"torque_enable": 2}, ("duty", 0.0, True)),
    ({"operating_mode": 3, "goal_position": -50}, ("position", 950.0, True)),
    ({"torque_enable": 1}, ("position", 1000.0, True)),
    ({"torque_enable": 0}, ("position", 1000.0, False)),
])  # fmt: skip
def test_sts_modes(sts, values, goal):
    sts.put(1, "min_position_limit", 0)
    sts.put(1, "max_position_limit", 0)
    for name, value in values.items():
        sts.put(1, name, value)
    found = sts.bus.servos[0].goal
    assert (found.mode, pytest.approx(found.value), found.torque) == goal


def test_sts_speeds_and_accelerations_have_their_units(sts):
    sts.put(1, "profile_acceleration", 50)
    sts.put(1, "torque_limit", 400)
    goal = sts.bus.servos[0].goal
    assert (goal.speed, goal.acceleration, goal.limit, goal.dead_band) == (3400.0, 5000.0, pytest.approx(0.4), (1, 1))
    sts.put(1, "phase", 8)
    assert sts.bus.servos[0].goal.speed == 50.0 * 3400
    sts.put(1, "profile_velocity", 0)
    assert sts.bus.servos[0].goal.speed == math.inf
    sts.put(1, "phase", 0)
    assert sts.bus.servos[0].goal.speed == 0.0


def test_sts_overload_limits_torque_until_a_goal_leads_away():
    line, plant = loaded("sts3215")
    line.put(1, "goal_position", 1500)
    plant.now = Measurement(0.0, load=0.9)
    line.bus.advance(1.9)
    assert line.get(1, "hardware_error_status") == 0
    line.bus.advance(2.2)  # longer than 200 times 10 ms
    assert line.frames("ping", 1)[0].instruction == 32
    assert plant.goals[0].limit == pytest.approx(0.2)
    assert line.put(1, "goal_position", 1600) == 32
    assert line.put(1, "goal_position", 900) == 0
    assert plant.goals[0].limit == 1.0


@pytest.mark.parametrize(("now", "bit", "off"), [
    (Measurement(0.0, voltage=15.0), 1, False), (Measurement(0.0, temperature=75.0), 4, True),
    (Measurement(0.0, current=4.0), 8, True),
])  # fmt: skip
def test_sts_monitors(now, bit, off):
    line, plant = loaded("sts3215")
    line.put(1, "goal_position", 1500)
    plant.now = now
    line.bus.advance(3.0)
    assert line.frames("ping", 1)[0].instruction == bit
    assert plant.goals[0].torque is not off
    plant.now = Measurement(0.0)
    line.bus.advance(3.1)
    assert line.frames("ping", 1)[0].instruction == (bit if bit == 8 else 0)


def test_sts_moves_from_its_threshold_of_speed_on():
    line, plant = loaded("sts3215")
    assert line.put(1, "moving_threshold", 50) == 0
    for k, (speed, moving) in enumerate(((49.0, 0), (-49.0, 0), (50.0, 1), (-51.0, 1))):
        plant.now = Measurement(0.0, speed=speed)  # counts in a second
        line.bus.advance(0.1 * (k + 1))
        assert line.get(1, "moving") == moving


def test_sts_status_level_and_registered_writes(sts):
    sts.put(1, "status_return_level", 0)
    assert sts.frames("write", 1, b"\x29\x05") == []
    assert sts.get(1, "profile_acceleration") == 5
    assert len(sts.frames("ping", 1)) == 1
    assert sts.status("reg-write", 2, b"\x2a\x00\x04") == (0, b"")
    assert (sts.get(2, "registered_instruction"), sts.get(2, "goal_position")) == (1, 2000)
    assert sts.frames("action", BROADCAST) == []
    assert (sts.get(2, "registered_instruction"), sts.get(2, "goal_position")) == (0, 1024)
    assert sts.status("action", 2) == (0, b"")  # nothing is registered


@pytest.mark.parametrize("code", [0, 6, 8, 0x10, 0x55, 0x92, 0x93, 0x8A, 255])
def test_what_no_software_of_feetech_sends_is_not_answered(sts, code):
    for number in (1, BROADCAST):
        assert [
            a
            for frame in sts.bus.feed(FEETECH.pack(number, code, bytes(8)), 10**6)
            for a in sts.bus.answer(frame, 10**6)
        ] == []
    assert sts.bus.unknown == 2


# Dynamixel.


def test_dynamixel_offset_is_added(dynamixel):
    dynamixel.put(1, "homing_offset", -100)
    assert dynamixel.get(1, "present_position") == 900
    assert dynamixel.put(1, "torque_enable", 1) == 0
    dynamixel.put(1, "goal_position", 1000)
    assert dynamixel.plant.goals[0].value == 1100.0


def test_dynamixel_writes_registers_together_or_none_of_them(dynamixel):
    """A D gain beside an I gain that is none, and beside one that is."""
    first, second = (dynamixel.registers[f"position_{name}_gain"] for name in ("d", "i"))
    assert second.address == first.end
    for gains, error in (((7, 20_000), 0x04), ((20_000, 7), 0x04), ((7, 8), 0)):
        data = first.encode(gains[0]) + second.encode(gains[1])
        assert dynamixel.status("write", 1, dynamixel.words(first.address) + data)[0] == error
        found = [dynamixel.get(1, f"position_{name}_gain") for name in ("d", "i")]
        assert (found == list(gains)) == (error == 0)


def test_dynamixel_reverses(dynamixel):
    dynamixel.put(1, "drive_mode", 1)
    dynamixel.bus.servos[0].power_up()
    dynamixel.bus.advance(0.1)
    assert dynamixel.get(1, "present_position") == 3096  # minus 1000, within one turn
    dynamixel.put(1, "torque_enable", 1)
    dynamixel.put(1, "goal_position", 3196)
    assert dynamixel.plant.goals[0].value == 900.0


@pytest.mark.parametrize(("name", "value", "torque", "error"), [
    ("return_delay_time", 0, 1, 7), ("return_delay_time", 0, 0, 0), ("return_delay_time", 255, 0, 4),
    ("goal_position", 4096, 1, 6), ("goal_pwm", 400, 1, 0), ("goal_pwm", 900, 1, 4), ("present_position", 0, 0, 7),
    ("position_p_gain", 16384, 0, 4), ("operating_mode", 2, 0, 6), ("bus_watchdog", -1, 0, 4), ("goal_velocity", 600, 1, 6),
])  # fmt: skip
def test_dynamixel_refuses_by_number(name, value, torque, error):
    line = client("xl330-m288")
    line.put(1, "torque_enable", torque)
    before = line.get(1, name)
    assert line.put(1, name, value) == error
    assert line.get(1, name) == (before if error else value)


@pytest.mark.parametrize(("address", "data", "error"), [
    (116, bytes(2), 5), (118, bytes(2), 5), (116, bytes(5), 7), (300, b"\0", 7), (0, b"\0", 7), (92, b"\0", 7),
    (112, bytes(8), 0),
])  # fmt: skip
def test_dynamixel_writes_whole_registers_only(dynamixel, address, data, error):
    assert dynamixel.status("write", 1, dynamixel.words(address) + data) == (error, b"")


def test_dynamixel_reads_within_the_table(dynamixel):
    assert dynamixel.status("read", 1, dynamixel.words(140, 20)) == (7, b"")
    assert dynamixel.status("read", 1, dynamixel.words(92, 6)) == (0, bytes(6))  # between registers


def test_dynamixel_current_and_modes():
    line = client("xl330-m288")
    for mode, name, value, goal in (
        (0, "goal_current", -300, ("current", -0.3)),
        (1, "goal_velocity", 100, ("speed", pytest.approx(1562.544))),
        (16, "goal_pwm", -443, ("duty", pytest.approx(-443 / 885, rel=1e-5))),
        (4, "goal_position", 9000, ("position", 9000.0)),
        (5, "goal_position", -9000, ("position", -9000.0)),
    ):
        assert line.put(1, "torque_enable", 0) == 0
        assert line.put(1, "operating_mode", mode) == 0
        assert line.put(1, "torque_enable", 1) == 0
        assert line.put(1, name, value) == 0
        found = line.bus.servos[0].goal
        assert (found.mode, found.value) == goal
    assert line.put(1, "goal_current", 500) == 0
    assert line.bus.servos[0].goal.current == pytest.approx(0.5)
    line = client("xl430-w250")
    assert line.put(1, "operating_mode", 5) == 6
    assert line.bus.servos[0].goal.current == math.inf


@pytest.mark.parametrize(("level", "read", "written"), [(0, 0, 0), (1, 1, 0), (2, 1, 1)])
def test_dynamixel_status_levels(dynamixel, level, read, written):
    register = dynamixel.registers["status_return_level"]
    dynamixel.frames("write", 1, dynamixel.words(register.address) + bytes((level,)))
    assert len(dynamixel.frames("ping", 1)) == 1
    assert len(dynamixel.frames("read", 1, dynamixel.words(132, 4))) == read
    assert len(dynamixel.frames("write", 1, dynamixel.words(65) + b"\x01")) == written


def test_dynamixel_watchdog_stops_and_is_cleared_by_zero():
    line = client("xl330-m288")
    line.put(1, "torque_enable", 1)
    line.put(1, "profile_velocity", 10)
    line.put(1, "bus_watchdog", 5)  # 100 ms
    line.put(1, "goal_position", 4000)
    for k in range(10):
        line.bus.advance(0.05 * k)
        line.frames("ping", 2)  # an instruction to any servo
    assert line.get(1, "bus_watchdog") == 5
    line.bus.advance(0.56)
    assert line.get(1, "bus_watchdog") == -1
    assert line.put(1, "goal_position", 2000) == 4
    at = line.get(1, "present_position")
    assert line.plant.goals[0].value == at
    assert line.put(1, "bus_watchdog", 0) == 0
    assert line.put(1, "goal_position", 2000) == 0


def test_dynamixel_fault_shuts_down_until_reboot():
    line, plant = loaded("xl430-w250", voltage=12.0, baud_rate=3)
    line.put(1, "torque_enable", 1)
    plant.now = Measurement(0.0, voltage=12.0, temperature=80.0)
    line.bus.advance(0.1)
    plant.now = Measurement(0.0, voltage=12.0)
    line.bus.advance(0.2)
    assert line.put(1, "torque_enable", 1) == 0x80
    assert not plant.goals[0].torque
    assert line.status("reboot", 1)[0] == 0
    assert line.put(1, "torque_enable", 1) == 0
    assert line.get(1, "torque_enable") == 1


@pytest.mark.parametrize(("option", "number", "baud"), [(2, 2, 3), (1, 2, 1), (0xFF, 1, 1)])
def test_dynamixel_reset(option, number, baud):
    line = client("xl330-m288", positions=(5000.0,), numbers=(2,), return_delay_time=0)
    assert line.get(2, "present_position") == 5000 - 4096  # after power-up within one turn
    assert line.status("reset", 2, bytes((option,))) == (0, b"")
    servo = line.bus.servos[0]
    assert (servo.number, servo["baud_rate"], servo["return_delay_time"]) == (number, baud, 250)
    assert line.status("reset", number, b"\x07", baud=servo.baud)[0] == 4


def test_dynamixel_broadcast_reset_of_everything_is_ignored(dynamixel):
    assert dynamixel.frames("reset", BROADCAST, b"\xff") == []
    assert [servo.number for servo in dynamixel.bus.servos] == [1, 2, 3]


def test_dynamixel_clears_turns_when_it_stands(dynamixel):
    dynamixel.plant.positions[0] = 9000.0
    dynamixel.bus.advance(0.1)
    assert dynamixel.get(1, "present_position") == 9000
    assert dynamixel.status("clear", 1, b"\x01\x44\x58\x4c\x22") == (0, b"")
    assert dynamixel.get(1, "present_position") == 9000 - 8192
    assert dynamixel.status("clear", 1, b"\x02")[0] == 4
    dynamixel.put(1, "torque_enable", 1)
    dynamixel.put(1, "goal_position", 3000)
    dynamixel.bus.advance(0.2)
    assert dynamixel.status("clear", 1, b"\x01\x44\x58\x4c\x22")[0] == 1


def test_dynamixel_action_without_a_registered_write(dynamixel):
    assert dynamixel.status("action", 1) == (2, b"")


# Both.


@pytest.mark.parametrize("model", ["sts3215", "xl330-m288"])
def test_a_motor_switched_on_holds_where_it_stands(model):
    line = client(model)
    line.plant.positions[0] = 1300.0  # moved by hand
    line.bus.advance(0.1)
    assert line.put(1, "torque_enable", 1) == 0
    assert line.plant.goals[0].value == 1300.0
    line.put(1, "torque_enable", 0)
    line.put(2, "torque_enable", 0)
    line.put(2, "goal_position", 2100)
    line.put(2, "torque_enable", 1)
    assert line.plant.goals[1].value == 2100.0  # a goal that was written meanwhile


@pytest.mark.parametrize("model", ["sts3215", "xl330-m288", "xl430-w250"])
def test_a_new_id_is_answered_with_the_old_one(model):
    line = client(model)
    assert line.put(2, "id", 12) == 0
    assert line.frames("ping", 2) == []
    assert line.frames("ping", 12)[0].number == 12
    assert line.put(12, "return_delay_time", 0) == 0

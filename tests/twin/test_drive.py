"""A drive with an ideal motor: the options by which it slows down, halts, offsets, homing, inputs and outputs of CiA 402."""

import numpy as np
import pytest

from armwright.twin import faults, objects as od
from armwright.twin.drive import TwinDrive
from armwright.twin.state_machine import State

T = 4e-3  # [s]
SPEED = 20_000  # [counts/s] at which the joint moves before it is stopped
SLOW, QUICK, MOST = (
    40_000,
    200_000,
    1_000_000,
)  # [counts/s²]: ramps 6084 and 6085, and the motor at its limit of current
HOMING = 100_000  # [counts/s²] 609A
BY_CODE = {0: QUICK, 1: SLOW, 2: QUICK, 3: MOST}  # a brake stops the joint as fast as the ramp of a quick stop
OBJECTS = {
    od.LOWEST: -50_000,
    od.HIGHEST: 40_000,
    od.MAX_SPEED: 60_000,
    od.PROFILE_SPEED: SPEED,
    od.ACCELERATION: SLOW,
    od.DECELERATION: SLOW,
    od.STOP_DECELERATION: QUICK,
    od.WINDOW: 5_000,
    od.REACHED: 100,
    od.SEARCH_SPEED: 10_000,
    od.HOME_SPEED: 500,
    od.HOMING_ACCELERATION: HOMING,
}


class Joint:
    """A drive whose motor goes where its set-point is, and brakes at its limit where a set-point is beyond all speeds."""

    def __init__(self, mode, start=1000, **values):
        self.drive = TwinDrive("joint", OBJECTS | {od.MODE: mode, od.TARGET_POSITION: start}, T)
        self.drive.values |= {getattr(od, name): value for name, value in values.items()}
        self.q, self.v, self.point = float(start), 0.0, None
        self.drive.measured(start, 0, start)
        for word in (0x06, 0x07, 0x0F):
            self.word(word)
        assert self.drive.state is State.ENABLED

    def word(self, word, ticks=1):
        self.drive.values[od.CONTROLWORD] = word
        self.drive.command(word)
        return self.run(ticks)

    def run(self, ticks=1):
        """Ticks of the drive and of its motor; speeds (ticks,) [counts/s]."""
        speeds = []
        for _ in range(ticks):
            self.point = point = self.drive.tick(received=True)
            if abs(point.speed) > 10 * OBJECTS[od.MAX_SPEED]:
                self.v += float(np.clip(point.speed - self.v, -MOST * T, MOST * T))
            elif point.torque is None:
                self.v = (point.position - self.q) / T
            self.q += self.v * T
            self.drive.measured(round(self.q), 0, round(self.q))
            speeds.append(self.v)
        return np.array(speeds)

    def moving(self):
        """The joint at SPEED, in whatever mode follows positions."""
        mode, values = self.drive.mode, self.drive.values
        if mode == 9:
            values[od.TARGET_VELOCITY] = SPEED
            self.run(20)
        elif mode == 1:
            values[od.TARGET_POSITION] = 35_000
            self.word(0x1F)
            self.word(0x0F, 150)
        elif mode == 7:
            self.word(0x1F)
            for _ in range(30):
                values[od.SET_POINT] = round(self.q + SPEED * T)
                self.run()
        assert self.v == pytest.approx(SPEED, rel=0.02)
        return self

    @property
    def status(self):
        return self.drive.statusword


def rate(speeds):
    """Usual deceleration [counts/s²], and ticks to rest."""
    steps = np.diff(speeds)
    return -np.median(steps[steps < -1.0]) / T, int(np.argmax(np.abs(speeds) < 1.0)) + 1


def near(code):
    """Ticks from SPEED to rest at an option's ramp, which rounding and the last step of a brake make a little longer."""
    ticks = SPEED / BY_CODE[code] / T
    return ticks - 2, ticks + 4


@pytest.mark.parametrize("option", [0, 1, 2, 3, 5, 6, 7])
def test_a_quick_stop_is_that_of_605a(option):
    joint = Joint(9, QUICK_STOP_OPTION=option).moving()
    speeds = joint.word(0x02)
    assert joint.drive.state is (State.QUICK_STOP if option else State.SWITCH_ON_DISABLED)
    assert not joint.status & 1 << 10
    speeds = np.concatenate([[SPEED], speeds, joint.run(200)])
    code = option % 4
    found, ticks = rate(speeds)
    assert found == pytest.approx(BY_CODE[code], rel=0.1)
    assert near(code)[0] <= ticks <= near(code)[1]
    assert joint.drive.state is (State.QUICK_STOP if option >= 5 else State.SWITCH_ON_DISABLED)
    assert bool(joint.status & 1 << 10) is (option >= 5)  # at rest, and still in quick stop active
    assert joint.drive.machine.passed[5:] == ([11] if option >= 5 else [11, 12])
    joint.word(0x0F)
    assert joint.drive.state is (State.ENABLED if option >= 5 else State.SWITCH_ON_DISABLED)  # transition 16


def test_an_option_that_changes_in_the_middle_of_a_stop_goes_on_from_there():
    joint = Joint(9, QUICK_STOP_OPTION=3).moving()
    first = joint.word(0x02, 2)
    joint.drive.values[od.QUICK_STOP_OPTION] = 2
    speeds = np.concatenate([[SPEED], first, joint.run(100)])
    assert np.all(np.diff(speeds) <= 1e-6)
    assert joint.drive.state is State.SWITCH_ON_DISABLED


@pytest.mark.parametrize(
    ("word", "key", "after", "number"),
    [(0x06, "SHUTDOWN_OPTION", State.READY, 8), (0x07, "DISABLE_OPTION", State.SWITCHED_ON, 5)],
)
@pytest.mark.parametrize("option", [0, 1])
def test_shutdown_and_disable_operation_are_those_of_605b_and_605c(word, key, after, number, option):
    joint = Joint(9, **{key: option}).moving()
    speeds = joint.word(word, 3)
    assert joint.drive.state is (State.ENABLED if option else after)
    assert not joint.status & 1 << 12  # it does not follow any more
    speeds = np.concatenate([[SPEED], speeds, joint.word(word, 50), joint.word(0x0F if option else word, 100)])
    found, ticks = rate(speeds)
    assert found == pytest.approx(BY_CODE[option], rel=0.1)
    assert near(option)[0] <= ticks <= near(option)[1]
    assert joint.drive.state is after  # what began is done, whatever is said on the way
    assert joint.drive.machine.passed[5:] == [number]


def test_on_its_way_to_be_disabled_a_drive_obeys_what_is_stricter():
    for word, state in ((0x02, State.QUICK_STOP), (0x00, State.SWITCH_ON_DISABLED)):
        joint = Joint(9).moving()
        joint.word(0x07, 5)
        joint.word(word)
        assert joint.drive.state is state
    joint = Joint(9, SHUTDOWN_OPTION=1).moving()
    joint.word(0x07, 5)
    joint.word(0x06, 200)
    assert joint.drive.state is State.READY
    joint = Joint(9).moving()
    joint.word(0x07, 5)
    joint.drive.values[od.MODE] = 8  # a mode is entered when the joint is at rest
    assert rate(joint.run(200))[0] == pytest.approx(SLOW, rel=0.1)
    assert joint.drive.state is State.SWITCHED_ON
    joint = Joint(9).moving()
    joint.word(0x07, 5)
    joint.drive.fail(faults.OVER_TEMPERATURE)
    joint.run(200)
    assert joint.drive.state is State.FAULT


@pytest.mark.parametrize("option", [0, 1, 2, 3])
def test_a_fault_reaction_is_that_of_605e(option):
    joint = Joint(9, REACTION_OPTION=option).moving()
    joint.drive.fail(faults.OVER_TEMPERATURE)
    assert joint.drive.state is (State.REACTION if option else State.FAULT)
    found, ticks = rate(np.concatenate([[SPEED], joint.run(200)]))
    assert found == pytest.approx(BY_CODE[option], rel=0.1)
    assert near(option)[0] <= ticks <= near(option)[1]
    assert joint.drive.state is State.FAULT


@pytest.mark.parametrize("mode", [1, 7])
@pytest.mark.parametrize("option", [1, 2, 3])
def test_a_halt_is_that_of_605d_and_stays_enabled(mode, option):
    joint = Joint(mode, HALT_OPTION=option).moving()
    word = 0x11F if mode == 7 else 0x10F
    speeds = np.concatenate([[SPEED], joint.word(word, 200)])
    found, ticks = rate(speeds)
    assert found == pytest.approx(BY_CODE[option], rel=0.1)
    assert near(option)[0] <= ticks <= near(option)[1]
    assert joint.drive.state is State.ENABLED
    assert joint.status & 1 << 10  # it stands
    stood = joint.q
    joint.word(word & 0xFF, 600)  # and goes on
    assert joint.q == pytest.approx(35_000, abs=100) if mode == 1 else joint.q == joint.drive.values[od.SET_POINT]
    assert joint.q != pytest.approx(stood, abs=1)


def test_a_halt_with_all_current_that_is_taken_back_goes_on_from_there():
    joint = Joint(1, HALT_OPTION=3).moving()
    speeds = np.concatenate([[SPEED], joint.word(0x10F, 2), joint.word(0x0F, 3)])
    assert np.abs(np.diff(speeds)).max() <= 1.2 * MOST * T
    assert speeds[-1] > speeds[2] == pytest.approx(SPEED - 2 * MOST * T)


@pytest.mark.parametrize("mode", [8, 9, 10])
def test_cyclic_modes_have_no_halt(mode):
    joint = Joint(mode, TARGET_VELOCITY=SPEED, TARGET_TORQUE=100)
    joint.drive.values[od.TARGET_POSITION] = 2000
    joint.word(0x10F, 20)
    assert joint.status & 1 << 12
    assert joint.q == 2000 if mode == 8 else joint.v == pytest.approx(SPEED) if mode == 9 else joint.point.torque == 100


def test_offsets_of_cyclic_modes():
    joint = Joint(8, POSITION_OFFSET=500)
    joint.run(50)
    assert joint.q == 1500
    assert (joint.point.speed, joint.point.feedforward) == (0.0, 0.0)
    joint.drive.values |= {od.VELOCITY_OFFSET: 300, od.TORQUE_OFFSET: -70}
    joint.run(5)
    assert joint.point.position == 1500  # both are fed forward, and move no set-point of position
    assert (joint.point.speed, joint.point.feedforward) == (300.0, -70)
    joint.drive.values[od.VELOCITY_OFFSET] = 2**31 - 1
    joint.run()
    assert joint.point.speed == OBJECTS[od.MAX_SPEED]

    joint = Joint(9, TARGET_VELOCITY=1000, VELOCITY_OFFSET=-400, TORQUE_OFFSET=25)
    joint.run(5)
    assert joint.v == pytest.approx(600)
    assert joint.point.feedforward == 25

    joint = Joint(10, TARGET_TORQUE=100, TORQUE_OFFSET=-30)
    joint.run()
    assert (joint.point.torque, joint.point.feedforward) == (70, 0.0)


# bits 13, 12 and 10 of the statusword in homing, as the canopen package's profile of CiA 402 names them
PROGRESS, INTERRUPTED, ATTAINED, DONE, FAILS, FAILED = 0x0000, 0x0400, 0x1000, 0x1400, 0x2000, 0x2400


def said(joint):
    return joint.status & 0x3400


def seen(joint, word, ticks):
    """The states of homing that were seen, each once, in order."""
    found = [said(joint)]
    joint.word(word)
    for _ in range(ticks):
        if said(joint) != found[-1]:
            found.append(said(joint))
        joint.run()
    return found


def test_the_states_of_homing_are_canopens():
    p402 = pytest.importorskip("canopen.profiles.p402", reason='the independent table: pip install "armwright[twin]"')
    names = ["IN PROGRESS", "INTERRUPTED", "ATTAINED", "TARGET REACHED", "ERROR VELOCITY IS NOT ZERO"]
    names.append("ERROR VELOCITY IS ZERO")
    table = [p402.Homing.STATES[name] for name in names]
    assert table == [(0x3400, bits) for bits in (PROGRESS, INTERRUPTED, ATTAINED, DONE, FAILS, FAILED)]


@pytest.mark.parametrize("method", [35, 37])
def test_homing_here(method):
    joint = Joint(6, HOMING_METHOD=method, HOME_OFFSET=77)
    assert seen(joint, 0x1F, 3) == [INTERRUPTED, DONE]  # not started, completed
    assert joint.drive.read(od.POSITION) == 77
    joint.word(0x0F, 3)
    assert said(joint) == DONE


@pytest.mark.parametrize(
    ("method", "start", "home"),
    [
        (17, 1000, -50_000),
        (17, -50_100, -50_000),
        (18, 1000, 40_000),
        (18, 40_100, 40_000),
        (19, -3000, 0),
        (19, 3000, 0),
        (20, -3000, 0),
        (20, 3000, 0),
    ],
)
def test_homing_finds_the_edge_of_a_switch(method, start, home):
    joint = Joint(6, start, HOMING_METHOD=method, HOME_OFFSET=5)
    assert seen(joint, 0x1F, 4000) == [INTERRUPTED, PROGRESS, ATTAINED, DONE]
    slow = OBJECTS[od.HOME_SPEED] * T
    assert -joint.drive.offset + 5 == pytest.approx(home, abs=slow + 1)  # the edge, to a tick at the slow speed
    assert joint.v == 0.0


def test_homing_moves_at_its_own_speeds_and_acceleration():
    joint = Joint(6, HOMING_METHOD=17)
    speeds = joint.word(0x1F, 3000)
    assert speeds.min() == pytest.approx(-OBJECTS[od.SEARCH_SPEED])
    assert speeds.max() == pytest.approx(OBJECTS[od.HOME_SPEED])
    assert np.abs(np.diff(speeds)).max() / T == pytest.approx(HOMING, rel=1e-6)


def test_homing_that_is_interrupted():
    for word in (0x0F, 0x11F):  # bit 4 taken back, halt
        joint = Joint(6, HOMING_METHOD=17)
        joint.word(0x1F, 200)
        assert said(joint) == PROGRESS
        assert joint.v < 0.0
        speeds = -np.concatenate([[joint.v], joint.word(word, 60)])
        assert rate(speeds)[0] == pytest.approx(HOMING, rel=0.1)
        assert said(joint) == INTERRUPTED
        assert joint.v == 0.0
        assert joint.drive.offset == 0
        joint.word(0x1F, 1 if word == 0x0F else 50)
        # an edge starts it again, the end of a halt does not
        assert said(joint) == (PROGRESS if word == 0x0F else INTERRUPTED)


def test_homing_may_leave_the_limits_that_count_from_the_last_home():
    joint = Joint(6, HOMING_METHOD=17)
    joint.word(0x1F, 2000)
    joint.word(0x0F)
    joint.drive.values[od.HOMING_METHOD] = 18
    joint.word(0x1F, 4000)  # 90,000 counts on, where 607D ends at 40,000
    assert said(joint) == DONE
    assert joint.drive.state is State.ENABLED


def test_homing_that_fails():
    """The home switch is no part of the way: the joint meets the end of its range."""
    joint = Joint(6, 20_000, HOMING_METHOD=19)
    joint.drive._ends = (10_000, 40_000)
    assert seen(joint, 0x1F, 1000) == [INTERRUPTED, PROGRESS, FAILS, FAILED]
    assert joint.v == 0.0
    assert joint.drive.offset == 0
    assert joint.drive.state is State.ENABLED
    joint.drive.values[od.HOMING_METHOD] = 35
    assert seen(joint, 0x0F, 2) == [FAILED]
    assert seen(joint, 0x1F, 2) == [FAILED, DONE]


def test_homing_ends_with_its_mode():
    joint = Joint(6, HOMING_METHOD=17)
    joint.word(0x1F, 200)
    joint.drive.values |= {od.MODE: 8, od.TARGET_POSITION: round(joint.q)}
    joint.run(5)
    assert not joint.drive.homing.running
    joint.drive.values[od.MODE] = 6
    joint.run(5)
    assert said(joint) == INTERRUPTED


def test_digital_inputs_are_the_switches():
    for at, bits in ((-50_000, 0b001), (-49_999, 0), (-1, 0), (0, 0b100), (39_999, 0b100), (40_000, 0b110)):
        joint = Joint(8, at)
        assert joint.drive.read(od.INPUTS) == bits


def test_an_output_sets_the_brake():
    joint = Joint(9, OUTPUT=1).moving()  # not by its mask
    joint.drive.values[od.OUTPUT_MASK] = 1
    speeds = np.concatenate([[SPEED], joint.run(100)])
    assert rate(speeds)[0] == pytest.approx(QUICK, rel=0.1)
    assert joint.v == 0.0
    assert joint.drive.state is State.ENABLED
    assert not joint.status & 1 << 12
    joint.drive.values[od.OUTPUT] = 0
    joint.run(20)
    assert joint.v == pytest.approx(SPEED)
    assert joint.status & 1 << 12


def test_a_disable_goes_on_while_the_brake_is_set():
    joint = Joint(9).moving()
    joint.word(0x07, 2)
    joint.drive.values |= {od.OUTPUT: 1, od.OUTPUT_MASK: 1}
    joint.run(2)
    joint.drive.values[od.OUTPUT] = 0
    joint.run(200)
    assert joint.drive.state is State.SWITCHED_ON


def test_current_is_in_proportion_to_torque():
    joint = Joint(10)
    joint.drive.measured(1000, -321, 1000)
    assert joint.drive.read(od.CURRENT) == joint.drive.read(od.TORQUE) == -321


def ended(joint, code, ticks):
    """Ticks until the drive reports a fault; it is this one, and None has come within `ticks`."""
    for tick in range(ticks):
        joint.run()
        if joint.drive.error:
            assert joint.drive.error == code
            return tick + 1
    return None


@pytest.mark.parametrize("sign", [1, -1])
def test_a_joint_may_be_a_tenth_faster_than_its_limit(sign):
    for share, code in ((1.09, None), (1.11, faults.SPEEDING)):
        joint = Joint(10, 0)
        joint.v = sign * share * OBJECTS[od.MAX_SPEED]
        assert (ended(joint, code, 3) is None) is (code is None)


@pytest.mark.parametrize(("end", "sign"), [(od.LOWEST, -1), (od.HIGHEST, 1)])
def test_a_joint_may_leave_its_range_by_the_window(end, sign):
    for beyond, code in ((0.9, None), (1.1, faults.BEYOND_LIMITS)):
        joint = Joint(1, OBJECTS[end])
        joint.drive.values[end] -= round(sign * beyond * OBJECTS[od.WINDOW])
        assert (ended(joint, code, 3) is None) is (code is None)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_following_error_is_a_fault_after_its_time_out(sign):
    """6065 for longer than 6066, 20 ms of 4; a joint that cannot move follows nothing."""
    for beyond, after in ((0.9, None), (1.1, 6)):
        joint = Joint(8, 0)
        joint.drive.values[od.TARGET_POSITION] = round(sign * beyond * OBJECTS[od.WINDOW])
        run = joint.drive.measured
        joint.drive.measured = lambda *_, run=run: run(0, 0, 0)
        joint.run(21)  # the set-point's way there, at the largest speed
        found = ended(joint, faults.FOLLOWING, 30)
        assert found is None if after is None else abs(found - after) <= 2


def test_an_encoder_that_is_a_degree_off_is_a_fault():
    """A fifth of the window of five degrees."""
    for off, code in ((0.9, 0), (1.1, faults.ENCODER)):
        joint = Joint(10, 0)
        joint.drive.stuck = True
        joint.drive.measured(0, 0, round(off * 0.2 * OBJECTS[od.WINDOW]))
        assert joint.drive.error == code


def test_process_data_that_end_are_a_fault_after_100_ms():
    for silent, code in ((25, 0), (26, faults.NO_DATA)):
        joint = Joint(10, 0)
        joint.run()
        for _ in range(silent):
            joint.drive.tick(received=False)
        assert joint.drive.error == code

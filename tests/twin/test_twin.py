"""The twin by an independent client: states, modes, limits, faults, and what the standard says they end in."""

import struct
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import BusError
from armwright.twin import faults, objects as od
from armwright.twin.faults import Fault, read_fault
from armwright.twin.state_machine import State
from armwright.twin.twin import Twin

from .conftest import Client, radians

TURN = 360_000 / (2.0 * np.pi)  # counts in a radian


def test_every_node_says_what_it_is(twin, client):
    for k, node in enumerate(client.nodes):
        assert node.id == 3 + k
        assert client.get((0x1000, 0), k) == 0x20192
        assert client.get(od.SERIAL, k) == 42
        assert client.get(od.SUPPORTED_MODES, k) == 0b11_1110_0001
        assert client.get((0x608F, 1), k) == 360_000
        assert radians(client.get(od.POSITION, k)) == pytest.approx([-1.2, 0.0][k], abs=2e-5)
    assert client.get(od.RATED_TORQUE) == 300_000
    assert client.get(od.INTERPOLATION) == 4


def test_all_transitions_over_the_bus(twin, client):
    client.put(od.MODE, 8)
    client.put(od.TARGET_POSITION, client.get(od.POSITION))
    up, down = (0x06, 0x07, 0x0F), 0x00
    for word in (*up, 0x07, 0x06, down, *up, 0x06, 0x07, down, *up, down, *up):
        client.word(word)  # 2 3 4 5 6 7, 2 3 4 8 3 10, 2 3 4 9, 2 3 4
    client.put(od.QUICK_STOP_OPTION, 6)  # stays in quick stop
    assert client.word(0x02) & 0x6F == 0x07  # 11
    assert client.word(0x0F) & 0x6F == 0x27  # 16
    client.word(0x02)
    assert client.word(0x00) & 0x4F == 0x40  # 12
    for word in up:
        client.word(word)
    twin.drives[0].fail(faults.FOLLOWING)  # 13
    client.sync(200)  # 14
    assert client.get(od.STATUSWORD) & 0x4F == 0x08
    assert client.get(od.ERROR_CODE) == faults.FOLLOWING
    client.word(0x00)
    assert client.word(0x80) & 0x4F == 0x40  # 15
    assert client.get(od.ERROR_CODE) == 0
    assert set(twin.drives[0].machine.passed) == set(range(17))


def test_nothing_moves_before_it_is_enabled(twin, client):
    client.sync(50)
    assert twin.simulation.tick == 0
    client.enable(8)
    assert twin.simulation.tick > 0


def test_the_scenario_begins_with_the_first_drive_that_is_enabled_and_anew_after_rest(scenario, bus):
    """A push on the tip from 40 to 80 ms after the drive is enabled, however long that takes, and again in the next run."""
    rows = [[0.0] * 6, [0.0, 400.0, 0.0, 0.0, 0.0, 0.0], [0.0] * 6]
    push = aw.Schedule([0.0, 0.04, 0.08], rows, ("fx", "fy", "fz", "mx", "my", "mz"))
    pushed = replace(scenario, inputs=aw.Inputs(wrench=push))
    with Twin(pushed, bus) as twin, Client(twin) as client:
        for waited in (3, 37, 80):  # SYNCs before: at most 50 until the arm stands, and beyond
            client.sync(waited)
            client.put(od.TARGET_POSITION, client.get(od.POSITION))
            client.enable(8, 0)  # its last SYNC is tick 0
            assert twin.simulation.tick == 0
            moved = []
            for _ in range(25):
                before = twin.simulation.plant_state.q
                client.sync()
                moved.append(float(np.abs(twin.simulation.plant_state.qd).max()))
                assert np.abs(twin.simulation.plant_state.q - before).max() < 0.01  # nothing jumps
            assert twin.simulation.tick == 25
            assert np.argmax(np.diff(moved) > 0.05) + 1 == 10  # the first tick of the push
            client.put(od.CONTROLWORD, 0x00)
            client.sync(2)


def test_drives_that_are_enabled_later_go_on_in_the_time_of_the_first(twin, client):
    client.enable(8, 0)
    client.sync(20)
    assert twin.simulation.tick == 20
    client.enable(8, 1)
    assert twin.simulation.tick == 23
    client.put(od.QUICK_STOP_OPTION, 6)
    client.word(0x02)
    client.word(0x0F)  # transition 16
    assert twin.simulation.tick == 25


def test_profile_position(twin, client):
    client.enable(1)
    start = client.get(od.POSITION)
    target = start + round(0.2 * TURN)
    client.put(od.TARGET_POSITION, target)
    client.put(od.CONTROLWORD, 0x1F)
    client.sync()
    assert client.get(od.STATUSWORD) & 1 << 12  # set-point acknowledged
    client.put(od.CONTROLWORD, 0x0F)
    speeds = []
    for _ in range(200):
        client.sync()
        speeds.append(client.get(od.VELOCITY))
        if client.get(od.STATUSWORD) & 1 << 10:
            break
    assert client.get(od.STATUSWORD) & 1 << 10
    assert abs(client.get(od.POSITION) - target) <= client.get(od.REACHED)
    assert max(speeds) < 1.3 * client.get(od.PROFILE_SPEED)  # its servo overshoots, the profile does not
    assert client.get(od.POSITION, 1) == pytest.approx(0, abs=300)  # the other joint stays


def test_relative_and_beyond_the_limit(twin, client):
    client.enable(1)
    client.put(od.TARGET_POSITION, -round(5.0 * TURN))
    client.put(od.PROFILE_SPEED, client.get(od.MAX_SPEED))
    client.word(0x5F)
    assert client.get(od.STATUSWORD) & 1 << 11  # internal limit
    client.sync(400)
    assert radians(client.get(od.POSITION)) == pytest.approx(-2.0, abs=2e-3)


def test_homing_where_it_stands(twin, client):
    client.enable(6)
    client.put(od.HOME_OFFSET, 1234)
    before = client.get(od.POSITION)
    status = client.word(0x1F)
    assert status & 0x3400 == 0x1400
    assert client.get(od.POSITION) == pytest.approx(1234, abs=100)
    assert before != client.get(od.POSITION)
    client.word(0x0F)
    assert client.get(od.STATUSWORD) & 0x3400 == 0x1400


def test_homing_on_a_switch(twin, client):
    """The elbow stands where its home switch closes, at 0: it goes off the switch, and comes back slowly."""
    client.put(od.HOMING_METHOD, 20, 1)
    client.put(od.SEARCH_SPEED, round(0.2 * TURN), 1)
    client.put(od.HOMING_ACCELERATION, round(2.0 * TURN), 1)
    client.put(od.HOME_SPEED, round(0.05 * TURN), 1)
    client.put(od.HOME_OFFSET, 500, 1)
    client.enable(6, 1)
    assert client.get(od.STATUSWORD, 1) & 0x3400 == 0x0400  # not started
    assert client.get(od.INPUTS, 1) == od.HOME
    client.put(od.CONTROLWORD, 0x1F, 1)
    seen = []
    for _ in range(400):
        client.sync()
        seen.append((client.get(od.STATUSWORD, 1) & 0x3400, client.get(od.INPUTS, 1)))
        if seen[-1][0] == 0x1400:
            break
    assert [word for k, (word, _) in enumerate(seen) if k == 0 or seen[k - 1][0] != word] == [0, 0x1000, 0x1400]
    assert {inputs for _, inputs in seen} == {0, od.HOME}
    assert twin.drives[1].offset == pytest.approx(500, abs=0.05 * TURN * twin.period + 1)  # home is the edge, at 0


def test_torque_is_fed_forward_in_cyclic_modes(twin, client):
    for mode in (8, 9):
        client.put(od.TARGET_POSITION, client.get(od.POSITION))
        client.put(od.TORQUE_OFFSET, 0)
        client.enable(mode, 0)
        client.sync(100)
        before = client.get(od.TORQUE_DEMAND)
        client.put(od.TORQUE_OFFSET, -60)
        client.sync()
        assert client.get(od.TORQUE_DEMAND) == pytest.approx(before - 60, abs=5)
        assert client.get(od.CURRENT) == client.get(od.TORQUE)
        client.sync(200)
        assert client.get(od.TORQUE_DEMAND) == pytest.approx(before, abs=5)  # which the integrator has taken away again
        client.word(0x00)


def test_offsets_of_position_and_speed(twin, client):
    start = client.get(od.POSITION)
    client.put(od.TARGET_POSITION, start)
    client.put(od.POSITION_OFFSET, 3000)
    client.enable(8, 0)
    client.sync(200)
    assert client.get(od.POSITION) == pytest.approx(start + 3000, abs=30)
    client.put(od.VELOCITY_OFFSET, 2000)
    client.sync(20)
    assert client.get(od.POSITION) > start + 3000 + 60  # pushed ahead of a set-point that stands
    client.word(0x00)
    client.enable(9, 0)
    client.sync(100)
    assert client.get(od.VELOCITY) == pytest.approx(2000, abs=500)


def test_a_stop_with_all_current(twin, client):
    client.put(od.QUICK_STOP_OPTION, 7)
    client.enable(9, 0)
    client.put(od.TARGET_VELOCITY, round(1.0 * TURN))
    client.sync(80)
    client.word(0x02)
    torques = []
    while client.get(od.STATUSWORD) & 1 << 10 == 0:
        client.sync()
        torques.append(client.get(od.TORQUE_DEMAND))
        assert len(torques) < 40
    assert torques[:8] == [-1000] * 8
    assert abs(client.get(od.VELOCITY)) < 0.1 * TURN
    client.sync(50)
    assert client.get(od.STATUSWORD) & 0x6F == 0x07
    assert client.get(od.VELOCITY) == pytest.approx(0, abs=0.02 * TURN)


def test_the_brake_of_an_enabled_drive(twin, client):
    client.enable(9, 0)
    client.put(od.TARGET_VELOCITY, round(0.5 * TURN))
    client.put(od.OUTPUT, od.BRAKE)
    client.put(od.OUTPUT_MASK, od.BRAKE)
    client.sync(50)
    assert client.get(od.STATUSWORD) & 0x106F == 0x27  # enabled, and not following
    assert client.get(od.VELOCITY) == pytest.approx(0, abs=0.02 * TURN)


def test_rated_currents_are_the_records(bus, scenario):
    tuned = aw.read_scenario(Path(__file__).parents[2] / "examples" / "bus-4ms.scenario.toml")
    twin = Twin(replace(tuned, lanes=None, vary={}), bus)
    for drive, body, limit in zip(twin.drives, twin.arm.coordinates, twin.units.limit, strict=True):
        assert body.drive.command == "current"
        assert drive.values[od.RATED_CURRENT] == round(1e3 * limit)
    assert {drive.values[od.RATED_CURRENT] for drive in Twin(scenario, bus).drives} == {0}  # the record has no constant


@pytest.mark.parametrize(("mode", "key"), [(8, od.TARGET_POSITION), (7, od.SET_POINT)])
def test_cyclic_positions(twin, client, mode, key):
    client.put(od.TARGET_POSITION, client.get(od.POSITION))
    client.enable(mode)
    start, word = client.get(od.POSITION), 0x1F if mode == 7 else 0x0F
    client.put(od.CONTROLWORD, word)
    for k in range(100):
        client.put(key, start + round(0.05 * TURN * np.sin(0.05 * k)))
        client.sync()
    assert client.get(od.STATUSWORD) & 0x6F == 0x27
    assert abs(client.get(od.FOLLOWING_ERROR)) < 0.02 * TURN


def test_cyclic_velocity(twin, client):
    client.enable(9, 0)
    start = client.get(od.POSITION)
    client.put(od.TARGET_VELOCITY, round(0.5 * TURN))
    client.sync(100)
    assert radians(client.get(od.POSITION) - start) == pytest.approx(0.5 * 0.4, rel=0.1)
    assert radians(client.get(od.VELOCITY)) == pytest.approx(0.5, rel=0.1)


def test_cyclic_torque_is_clipped_by_max_torque(twin, client):
    client.put(od.MAX_TORQUE, 500)
    client.enable(10, 0)
    client.put(od.TARGET_TORQUE, 900)
    client.sync(3)
    assert client.get(od.TORQUE_DEMAND) == 500
    assert client.get(od.STATUSWORD) & 1 << 11


def test_a_quick_stop_brakes_along_its_ramp(twin, client):
    client.enable(9, 0)
    client.put(od.TARGET_VELOCITY, round(1.0 * TURN))
    client.sync(80)
    status = client.word(0x02)
    assert status & 0x6F == 0x07
    for _ in range(100):
        if status & 0x6F == 0x07:
            client.sync()
            status = client.get(od.STATUSWORD)
    assert status & 0x4F == 0x40  # option 2: switch on disabled, when the joint itself is at rest
    assert client.get(od.VELOCITY) == pytest.approx(0, abs=0.1 * TURN)
    client.sync(100)
    assert client.get(od.VELOCITY) == pytest.approx(0, abs=0.02 * TURN)


def test_process_data_flows_with_sync_when_operational(twin, client):
    seen = []
    client.network.subscribe(0x183, lambda cob, data, stamp: seen.append(bytes(data)))
    client.sync(3)
    assert not seen
    client.network.send_message(0, [1, 0])
    client.sync(3)
    time.sleep(0.2)
    assert len(seen) == 3
    status, torque, position = struct.unpack("<Hhi", seen[-1])
    assert status & 0x4F == 0x40
    assert torque == client.get(od.TORQUE)
    assert position == client.get(od.POSITION)


def test_its_heart_beats_with_its_state(twin, client):
    beats = []
    client.network.subscribe(0x703, lambda cob, data, stamp: beats.append(data[0]))
    client.put(od.PRODUCER, 20)
    deadline = time.monotonic() + 20.0
    while 127 not in beats and time.monotonic() < deadline:
        time.sleep(0.01)
    client.network.send_message(0, [1, 3])
    while 5 not in beats and time.monotonic() < deadline:
        time.sleep(0.01)
    assert {127, 5} <= set(beats)  # pre-operational, then operational


def test_a_scenario_without_a_controller_has_a_twin(scenario, bus):
    bare = replace(scenario, duration=None, loop=replace(scenario.loop, controller=None, reference=None))
    with Twin(bare, bus) as twin, Client(twin) as client:
        client.enable(9, 0)
        client.put(od.TARGET_VELOCITY, 1000)
        client.sync(20)
        assert client.get(od.VELOCITY) > 0


def test_another_mapping(twin, client):
    node = client.nodes[0]
    node.tpdo.read()
    node.tpdo[1].clear()
    node.tpdo[1].add_variable(0x6041)
    node.tpdo[1].add_variable(0x606C)
    node.tpdo[1].save()
    seen = []
    client.network.subscribe(0x183, lambda cob, data, stamp: seen.append(bytes(data)))
    client.network.send_message(0, [1, 0])
    client.sync(2)
    time.sleep(0.2)
    assert [len(each) for each in seen] == [6, 6]


def test_mappings_that_no_frame_holds_are_refused(twin, client):
    import canopen

    client.put((0x1A00, 0), 0)
    with pytest.raises(canopen.SdoAbortedError, match="0x06040041"):
        client.put((0x1A00, 1), 0x10180420)  # the serial number
    for sub in (1, 2):
        client.put((0x1A00, sub), 0x60640020)
    with pytest.raises(canopen.SdoAbortedError, match="0x06040042"):
        client.put((0x1A00, 3), 0x60410010)


def test_values_out_of_range_are_refused(twin, client):
    import canopen

    refused = [(od.MODE, (-1, 3, 5)), (od.MAX_TORQUE, (1001,)), (od.ABORT_OPTION, (-1, 4))]
    refused += [(od.QUICK_STOP_OPTION, (-1, 4, 8, 9)), (od.SHUTDOWN_OPTION, (-1, 2)), (od.DISABLE_OPTION, (-1, 2))]
    refused += [
        (od.HALT_OPTION, (-1, 0, 4)),
        (od.REACTION_OPTION, (-1, 4)),
        (od.HOMING_METHOD, (-1, 0, 1, 16, 21, 34, 36)),
    ]
    refused += [(od.OUTPUT, (2, 1 << 16)), (od.OUTPUT_MASK, (2, 1 << 16))]
    refused += [(key, (0,)) for key in (od.ACCELERATION, od.DECELERATION, od.STOP_DECELERATION)]
    refused += [(key, (0,)) for key in (od.SEARCH_SPEED, od.HOME_SPEED, od.HOMING_ACCELERATION)]
    for key, values in refused:
        before = client.get(key)
        for value in values:
            with pytest.raises(canopen.SdoAbortedError, match="0x06090030"):
                client.put(key, value)
        assert client.get(key) == before
    taken = [(od.QUICK_STOP_OPTION, (0, 1, 2, 3, 5, 6, 7)), (od.SHUTDOWN_OPTION, (0, 1)), (od.DISABLE_OPTION, (0, 1))]
    taken += [(od.HALT_OPTION, (1, 2, 3)), (od.REACTION_OPTION, (0, 1, 2, 3)), (od.ABORT_OPTION, (0, 1, 2, 3))]
    taken += [(od.HOMING_METHOD, (17, 18, 19, 20, 35, 37)), (od.MODE, (0, 1, 6, 7, 8, 9, 10))]
    taken += [(od.OUTPUT, (0, 1)), (od.OUTPUT_MASK, (0, 1))]
    for key, values in taken:
        for value in values:
            client.put(key, value)
            assert client.get(key) == value


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("stuck-encoder:shoulder@0.1", faults.ENCODER),
        ("over-temperature:shoulder@0.1", faults.OVER_TEMPERATURE),
        ("supply-sag:shoulder@0.1", faults.UNDERVOLTAGE),
        ("late-sync:shoulder=0.01@0.1", faults.LATE_SYNC),
        ("lost-frames:shoulder=40@0.1", faults.NO_DATA),
    ],
)
def test_faults_end_in_fault(scenario, bus, text, code):
    fault = read_fault(text, scenario.arm.names)
    with Twin(scenario, bus, faults=[fault]) as twin, Client(twin) as client:
        emergencies = []
        client.nodes[0].emcy.add_callback(lambda error: emergencies.append(error.code))
        client.enable(9, 0)
        rpdo = struct.Struct("<Hhi")
        client.put(od.TARGET_VELOCITY, round(0.5 * TURN))
        for _ in range(200):
            client.network.send_message(0x203, rpdo.pack(0x0F, 0, 0))
            client.sync()
        assert client.get(od.STATUSWORD) & 0x4F == 0x08  # fault, by transitions 13 and 14
        assert twin.drives[0].machine.passed[-2:] == [13, 14]
        assert client.get(od.ERROR_CODE) == code
        assert client.get(od.ERROR_REGISTER) & 1
        assert client.get(od.VELOCITY) == pytest.approx(0, abs=0.05 * TURN)
        deadline = time.monotonic() + 10.0
        while not emergencies and time.monotonic() < deadline:
            time.sleep(0.01)
        assert emergencies == [code]
        client.word(0x00)
        assert client.word(0x80) & 0x4F == 0x40  # the cause is gone: it can be reset


def test_few_lost_frames_are_no_fault(scenario, bus):
    with Twin(scenario, bus, faults=[Fault("lost-frames", None, 0.1, 5)]) as twin, Client(twin) as client:
        client.enable(9)
        for _ in range(60):
            for number in (0x203, 0x204):
                client.network.send_message(number, struct.pack("<Hhi", 0x0F, 0, 0))
            client.sync()
        assert all(drive.state is State.ENABLED for drive in twin.drives)
        assert twin.cycles.report.incomplete >= 5


def test_a_fault_stays_while_its_cause_does(scenario, bus):
    with Twin(scenario, bus, faults=[Fault("over-temperature", "shoulder", 0.0, 1.0)]) as twin, Client(twin) as client:
        client.enable(9, 1)
        client.sync(20)
        client.word(0x00)
        client.word(0x80)
        assert twin.drives[0].state is State.FAULT
        assert twin.drives[1].state is State.ENABLED


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("option", "state"), [(1, State.FAULT), (2, State.SWITCH_ON_DISABLED), (3, State.SWITCH_ON_DISABLED)]
)
def test_a_client_that_dies_stops_the_motors(twin, client, option, state):
    """No heartbeat and no SYNC any more: the drives come to rest by themselves."""
    for k in range(2):
        client.put(od.CONSUMER, 1 << 16 | 200, k)
        client.put(od.ABORT_OPTION, option, k)
    client.network.send_message(0x701, [5])
    client.enable(9)
    client.put(od.TARGET_VELOCITY, round(0.3 * TURN))
    client.sync(30)
    client.network.send_message(0x701, [5])  # the last beat
    deadline = time.monotonic() + 20.0
    while any(d.state is not state or d.moves for d in twin.drives) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert all(drive.state is state for drive in twin.drives)
    assert all(drive.demand_speed == 0.0 for drive in twin.drives)
    while twin._runs and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not twin._runs


def test_a_node_that_is_stopped_or_reset_stops_its_motor(twin, client):
    client.enable(9)
    client.network.send_message(0, [2, 3])
    client.get(od.STATUSWORD, 1)
    client.sync(100)
    assert twin.drives[0].state is State.SWITCH_ON_DISABLED
    assert twin.drives[1].state is State.ENABLED


def test_the_bus_is_closed_whatever_happens(scenario, bus, monkeypatch):
    import can

    buses, make = [], can.Bus

    def kept(*arguments, **options):
        buses.append(make(*arguments, **options))
        return buses[-1]

    monkeypatch.setattr(can, "Bus", kept)
    with pytest.raises(RuntimeError, match="the user"), Twin(scenario, bus):
        raise RuntimeError("of the user")
    monkeypatch.setattr("armwright.twin.node.TwinNode.connect", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        Twin(scenario, bus).open()
    assert len(buses) == 2
    assert all(each._is_shutdown for each in buses)


@pytest.mark.parametrize(
    ("nodes", "shown"), [([3], "[3]"), ([3, 3], "[3, 3]"), ([3, 128], "[3, 128]"), ([0, 1], "[0, 1]")]
)
def test_wrong_numbers_of_nodes(scenario, nodes, shown):
    with pytest.raises(BusError) as error:
        Twin(scenario, "virtual", nodes=nodes)
    assert (
        str(error.value) == f"nodes = {shown}: expected 2 different numbers from 1 to 127, one for each joint (--nodes)"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("stuck", "fault = 'stuck': did you mean stuck-encoder?"),
        ("stuck-encoder:wrist", "fault = 'wrist': there is elbow, shoulder"),
        ("stuck-encoder@soon", "fault = 'stuck-encoder@soon': expected KIND[:JOINT][=AMOUNT][@SECONDS]"),
        ("stuck-encoder@-1", "fault = 'stuck-encoder=0.5@-1': expected a time and an amount of 0 or more"),
    ],
)
def test_faults_that_are_none(text, message):
    with pytest.raises(BusError) as error:
        read_fault(text, ("shoulder", "elbow"))
    assert str(error.value) == message

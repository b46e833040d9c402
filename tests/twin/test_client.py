"""canopen's own client of CiA 402 drives enables, homes, moves, stops and resets the twin, in real time on the virtual bus."""

import time

import numpy as np
import pytest

from armwright.twin import faults, objects as od
from armwright.twin.state_machine import State
from armwright.twin.twin import Twin

PATIENCE = 30.0  # [s] on a machine that does other work


@pytest.fixture
def drive(scenario, bus):
    """The twin, and canopen's client of its first drive; SYNC and process data come by canopen's own threads."""
    import canopen
    from canopen.profiles.p402 import BaseNode402

    class Patient(BaseNode402):
        TIMEOUT_RESET_FAULT = TIMEOUT_SWITCH_OP_MODE = TIMEOUT_SWITCH_STATE_FINAL = PATIENCE
        TIMEOUT_SWITCH_STATE_SINGLE = TIMEOUT_CHECK_TPDO = PATIENCE

    with Twin(scenario, bus) as twin:
        network = canopen.Network()
        network.NOTIFIER_CYCLE = 0.05
        try:
            network.connect(interface="virtual", channel=bus.partition(":")[2])
            node = Patient(3, od.dictionary(twin.nodes[0].eds, 3))
            node.sdo.RESPONSE_TIMEOUT = PATIENCE
            network.add_node(node)
            node.nmt.state = "PRE-OPERATIONAL"
            node.setup_402_state_machine()
            node.rpdo[1].trans_type = 255  # the client sends what it sets at once, before the next SYNC
            node.nmt.state = "OPERATIONAL"
            network.sync.start(0.01)
            yield twin, node
        finally:
            network.sync.stop()
            network.disconnect()


def waited_for(what):
    deadline = time.monotonic() + PATIENCE
    while not what() and time.monotonic() < deadline:
        time.sleep(0.01)
    return what()


def test_the_tour(drive):
    twin, node = drive
    assert waited_for(lambda: node.state == "SWITCH ON DISABLED")
    assert node.homing(timeout=PATIENCE)  # enables, and takes where it stands for home
    assert node.state == "OPERATION ENABLED"
    assert waited_for(lambda: abs(node.sdo[0x6064].raw) < 200)

    node.op_mode = "PROFILED POSITION"
    node.controlword = 0x0F
    assert waited_for(lambda: not node.statusword & 1 << 12)  # which said that it is at home
    target = round(0.05 * 360_000 / (2.0 * np.pi))
    node.sdo[0x607A].raw = target
    node.controlword = 0x1F
    assert waited_for(lambda: node.statusword & 1 << 12)
    node.controlword = 0x0F
    assert waited_for(lambda: node.statusword & 1 << 10)
    assert abs(node.sdo[0x6064].raw - target) <= node.sdo[0x6067].raw

    node.sdo[0x605A].raw = 6  # to stay in it, so that the client sees it however slow it is
    node.state = "QUICK STOP ACTIVE"
    node.state = "SWITCH ON DISABLED"

    node.state = "OPERATION ENABLED"
    with twin._lock:
        twin.drives[0].fail(faults.OVER_TEMPERATURE)
    assert waited_for(node.is_faulted)
    assert waited_for(lambda: [each.code for each in node.emcy.log] == [faults.OVER_TEMPERATURE])
    node.controlword = 0x00
    node.controlword = 0x80
    assert waited_for(lambda: node.state == "SWITCH ON DISABLED")
    assert set(twin.drives[0].machine.passed) >= {0, 1, 2, 3, 4, 11, 12, 13, 14, 15}
    assert twin.drives[1].state is State.SWITCH_ON_DISABLED


@pytest.mark.study
def test_stops_halts_and_homing_over_sdo(drive):
    """Objects by their names in the data sheet: shutdown along a ramp, halt, homing speeds, switches, and what is refused."""
    import canopen

    twin, node = drive
    sdo = node.sdo
    assert sdo["Shutdown option code"].raw == 0
    assert sdo["Homing speeds"]["Speed during search for switch"].raw == sdo["Max profile velocity"].raw // 10
    assert sdo["Digital inputs"].raw == 0  # the joint stands between its ends, below 0
    assert sdo["Digital outputs"]["Bit mask"].raw == 0
    for name, value in (("Quick stop option code", 8), ("Halt option code", 4), ("Homing method", 1)):
        with pytest.raises(canopen.SdoAbortedError, match="0x06090030"):
            sdo[name].raw = value
    sdo["Homing method"].raw = 19  # from below 0 up to the home switch, and back
    sdo["Homing speeds"]["Speed during search for switch"].raw = 90_000
    sdo["Homing speeds"]["Speed during search for zero"].raw = 30_000
    assert node.homing(timeout=PATIENCE)
    assert waited_for(lambda: node._homing_status() == "TARGET REACHED")
    assert np.abs(twin.drives[0].offset) < 30_000 * twin.period + 10

    sdo["Shutdown option code"].raw = 1
    sdo["Profile deceleration"].raw = 50_000
    node.op_mode = "PROFILED POSITION"
    sdo["Target position"].raw = -100_000
    node.controlword = 0x0F
    assert waited_for(lambda: not node.statusword & 1 << 12)
    node.controlword = 0x1F
    assert waited_for(lambda: sdo["Velocity actual value"].raw < -40_000)
    node.controlword = 0x11F
    assert waited_for(lambda: node.statusword & 1 << 10)
    assert sdo["Position actual value"].raw > -90_000
    node.controlword = 0x1F
    assert waited_for(lambda: sdo["Velocity actual value"].raw < -20_000)
    node.controlword = 0x06
    words = 0
    while node.state == "OPERATION ENABLED" and words < 2000:
        node.check_statusword()
        words += 1
    assert node.state == "READY TO SWITCH ON"
    assert words > 0.25 * 20_000 / 50_000 / twin.period  # enabled until it had come to rest
    assert abs(sdo["Velocity actual value"].raw) < 5_000

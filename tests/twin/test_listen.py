"""A shadow that listens to a bus: frames as rows, and a payload that the twin's arm has and its model has not."""

from __future__ import annotations

import struct
import threading
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import BusError
from armwright.twin.listen import BusListener, shadow_bus
from armwright.twin.run import run_controller
from armwright.twin.twin import Twin
from raises_at import raises_at

PERIOD = 4e-3


def frames(bus, cycles, *, lost=()):
    """SYNCs with the answers of nodes 3 and 4: thousandths 10 k and counts 1000 k, and other traffic between."""
    import can

    for k in range(cycles):
        bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
        bus.send(can.Message(arbitration_id=0x703, data=[5], is_extended_id=False))
        for node in (3, 4):
            if (k, node) not in lost:
                data = struct.pack("<Hhi", 0x27, 10 * k, (node - 2) * 1000 * k)
                bus.send(can.Message(arbitration_id=0x180 + node, data=data, is_extended_id=False))


def test_rows_are_what_the_frames_say(arm, bus):
    import can

    with BusListener(arm, bus, period=PERIOD) as listener, can.Bus(interface="virtual", channel=bus[8:]) as sender:
        frames(sender, 6, lost={(2, 4)})
        rows = list(listener.rows(0.5))
    assert [t for t, *_ in rows] == pytest.approx([PERIOD * k for k in (0, 1, 3, 4, 5)])
    assert listener.incomplete == 1
    _, q, tau = rows[-1]
    assert q == pytest.approx(2 * np.pi / 360_000 * np.array([5000, 10000]))
    assert tau == pytest.approx([0.05 * 300.0, 0.05 * 100.0])  # 50 thousandths of the rated torques


def test_a_drive_that_no_longer_answers_is_no_clean_verdict(arm, bus):
    """Of 200 cycles node 4 answers the first 120."""
    import can

    shadow = aw.shadow.ArmShadow(arm, deviation=1e3)
    with BusListener(arm, bus, period=PERIOD) as listener, can.Bus(interface="virtual", channel=bus[8:]) as sender:
        for k in range(200):
            sender.send(can.Message(arbitration_id=0x80, is_extended_id=False))
            for node in (3, 4) if k < 120 else (3,):
                data = struct.pack("<Hhi", 0x27, 0, 1000)
                sender.send(can.Message(arbitration_id=0x180 + node, data=data, is_extended_id=False))
        rows = list(shadow_bus(shadow, listener, silence=0.2))
    assert len(rows) == 120
    assert shadow.judged.unjudged == pytest.approx(80 / 170, abs=0.01)  # 30 cycles pass while the filter settles
    assert shadow.verdict.lines[0] == "no verdict: too much was not judged"


def test_a_payload_of_the_twin_is_noticed_over_the_bus(scenario, arm, bus):
    """The drives' own controller does not know of the payload either; torques come in thousandths, positions in counts."""
    heavy = replace(scenario, inputs=aw.Inputs(payload=aw.Payload(0.4, 2.0, np.zeros(3), np.zeros((3, 3)))))
    shadow, heard = aw.shadow.ArmShadow(arm, deviation=[1.0, 0.3]), []
    with BusListener(arm, bus, period=PERIOD) as listener:

        def listen():
            for _, alarms in shadow_bus(shadow, listener, silence=120.0):
                heard.extend(alarms)

        thread = threading.Thread(target=listen)
        with Twin(heavy, bus):
            thread.start()
            run_controller(heavy, bus)
        listener.stop()
        thread.join(60.0)
    assert not thread.is_alive()
    assert heard, shadow.last
    assert heard[0].kind in ("payload", "contact")
    assert shadow.alarms[0].kind == "payload"
    assert shadow.alarms[0].mass == pytest.approx(2.0, abs=0.4)


def test_the_command_listens_and_records(arm_file, arm, bus, tmp_path):
    """Traffic of a bus as MCAP, read by another library."""
    import can
    from typer.testing import CliRunner

    from armwright.cli.app import app

    decoder = pytest.importorskip("mcap_ros2.decoder")
    reader = pytest.importorskip("mcap.reader")
    done = threading.Event()

    def talk():
        with can.Bus(interface="virtual", channel=bus[8:]) as sender:
            while not done.wait(0.02):
                frames(sender, 5)

    thread = threading.Thread(target=talk)
    thread.start()
    path = tmp_path / "bus.mcap"
    options = ["--duration", "2", "--period", "0.004", "-o", str(path)]
    result = CliRunner().invoke(app, ["shadow", str(arm_file), bus, *options])
    done.set()
    thread.join(20.0)
    assert result.exit_code == 1, result.output
    assert "no verdict: no joint was judged" in result.output  # nothing is known of the record's deviations
    assert "no alarm" not in result.output
    assert "rows, " in result.output
    with path.open("rb") as file:
        read = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        rows = [each.decoded_message for each in read.iter_decoded_messages(topics=["/joint_states"])]
    assert rows[0].name == list(arm.names)
    positions = {round(row.position[0] * 360_000 / (2 * np.pi)) for row in rows}
    assert positions <= {0, 1000, 2000, 3000, 4000}
    assert len(rows) >= 5


def test_what_is_refused(arm, bus):
    with (
        BusListener(arm, bus) as listener,
        raises_at(BusError, "bus", r"SYNC .* 0\.05 s"),
    ):
        list(listener.rows(0.05))
    with raises_at(BusError, "bus", "virtual, socketcan", value="serial:1"):
        BusListener(arm, "serial:1")
    with pytest.raises(BusError, match=r"nodes"):
        BusListener(arm, bus, nodes=[3])
    with pytest.raises(BusError, match="period = 0"):
        BusListener(arm, bus, period=0)
    with pytest.raises(BusError, match="limit of torque"):
        BusListener(aw.load("two-link"), bus)

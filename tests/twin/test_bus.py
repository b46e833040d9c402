"""Time on the bus: the figures of the issue from lengths of frames; and buses that are not there."""

import logging

import pytest

from armwright.errors import BusError
from armwright.twin.bus import BusLoad, check_bus, frame_bits, open_bus
from raises_at import raises_at


def test_what_the_bus_packages_log_does_not_go_to_the_terminal():
    for package in ("can", "canopen"):
        logging.getLogger(package).handlers.clear()
    open_bus("virtual:logged").shutdown()
    for package in ("can", "canopen"):
        assert [type(each) for each in logging.getLogger(package).handlers] == [logging.NullHandler]


def test_lengths_of_frames():
    # 1 start, 11 + 1 identifier, 6 control, 15 + 1 check, 2 acknowledge, 7 end, 3 pause: 47; 34 of them may be stuffed
    assert frame_bits(0, stuffed=False) == 47
    assert frame_bits(8, stuffed=False) == 111
    assert frame_bits(8, stuffed=True) == 135  # the bound for 8 bytes that DavisEtAl2007 gives


def test_six_nodes_at_4_ms():
    load = BusLoad(6, 4e-3)
    assert load.load(stuffed=False) == pytest.approx(0.69, abs=0.005)
    assert load.load(stuffed=True) == pytest.approx(0.84, abs=0.005)
    assert load.answered(stuffed=False) == pytest.approx(1.4e-3, abs=0.05e-3)
    assert load.interpolation() == (4, -3)


@pytest.mark.parametrize(
    ("nodes", "period", "message"),
    [
        (6, 2e-3, "loop.period = 0.002: 6 nodes load a bus of 500 kbit/s to 167%; expected a period above 3.35 ms"),
        (1, 1.2345678e-2, "loop.period = 0.012345678: expected a whole number up to 255"),
    ],
)
def test_periods_that_do_not_fit(nodes, period, message):
    with pytest.raises(BusError) as error:
        BusLoad(nodes, period).check()
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("profibus:0", "bus = 'profibus:0': expected virtual, socketcan:CHANNEL or udp_multicast:ADDRESS"),
        ("socketcan", "bus = 'socketcan': no channel; expected socketcan:can0"),
    ],
)
def test_names_of_buses(name, message):
    with pytest.raises(BusError) as error:
        check_bus(name)
    assert str(error.value) == message


@pytest.mark.parametrize("name", ["socketcan:nocan7", "udp_multicast:nowhere"])
def test_buses_that_are_not_there(name):
    pytest.importorskip("can", reason='pip install "armwright[twin]"')
    with raises_at(BusError, "bus", "opened", value=name):
        open_bus(name)


def test_without_the_packages(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "canopen", None)
    with pytest.raises(BusError) as error:
        check_bus("virtual")
    assert str(error.value) == 'canopen and python-can are not installed; expected pip install "armwright[twin]"'

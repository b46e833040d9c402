"""Tables of registers: consistent in themselves, and as in the maker's package."""

import importlib.util
import itertools
from pathlib import Path

import pytest

from armwright.errors import BusError
from armwright.twin.serial.bus import make_servo
from armwright.twin.serial.registers import model_names, servo_model

MODELS = pytest.mark.parametrize("name", model_names())
OURS = {  # our name where the meaning is another maker's too, by the maker's
    "secondary(shadow) id": "secondary_id",
    "present input voltage": "present_voltage",
}
NOT_SERVED = ("indirect",)


@MODELS
def test_registers_do_not_overlap_and_hold_their_values(name):
    model = servo_model(name)
    ends = [(each.address, each.end) for each in model.registers]
    assert all(before[1] <= after[0] for before, after in itertools.pairwise(ends))
    assert len(model.by_name) == len(model.registers)
    for register in model.registers:
        values = {register.default, register.low, register.high, register.largest} - {None}
        assert all(register.decode(register.encode(value)) == value for value in values), register
        assert register.default is None or not register.writable or register.allows(register.default), register


@pytest.mark.parametrize(("form", "size", "value", "sent"), [
    ("m11", 2, -100, "6408"), ("m15", 2, -1, "0180"), ("s", 4, -48, "d0ffffff"), ("s", 1, -1, "ff"), ("u", 2, 70000, "ffff"),
])  # fmt: skip
def test_signs(form, size, value, sent):
    register = servo_model("sts3215").registers[0].__class__(0, size, "any", True, 0, None, None, "-", form)
    assert register.encode(value).hex() == sent
    assert register.decode(bytes.fromhex(sent)) == min(value, register.largest)


@MODELS
def test_dynamixel_tables_are_those_of_the_maker(name):
    model = servo_model(name)
    spec = importlib.util.find_spec("dynamixel_easy_sdk")
    if model.framing.word == 1 or spec is None:
        pytest.skip("a table of Feetech" if model.framing.word == 1 else "needs dynamixel-sdk")
    assert spec.submodule_search_locations
    file = Path(spec.submodule_search_locations[0]) / "control_table" / f"{name.replace('-', '_')}.model"
    rows = file.read_text(encoding="utf-8").partition("[control table]")[2].splitlines()[2:]
    table = [row.split("\t") for row in rows if row.strip()]
    theirs = {(int(a), int(n), text.strip().lower()) for a, n, text in table}
    theirs = {
        (a, n, OURS.get(text, text.replace(" ", "_"))) for a, n, text in theirs if not text.startswith(NOT_SERVED)
    }
    ours = {(each.address, each.size, each.name) for each in model.registers}
    assert theirs <= ours
    assert {each[2] for each in ours - theirs} == {"startup_configuration", "backup_ready"}  # of the manual alone


@pytest.mark.parametrize(("values", "message"), [
    ({"baud_rate": 9}, "sts3215 baud_rate = 9: expected 0 to 7"),
    ({"goal_position": 9}, "sts3215 registers = 'goal_position': no EEPROM register"),
    ({"homing_offset": -3000}, "sts3215 homing_offset = -3000: expected -2047 to 2047"),
])  # fmt: skip
def test_values_of_no_servo(values, message):
    with pytest.raises(BusError) as error:
        make_servo(servo_model("sts3215"), 1, **values)
    assert str(error.value).startswith(message)


def test_an_unknown_model_names_those_there_are():
    with pytest.raises(BusError, match="sts3215"):
        servo_model("sts3216")

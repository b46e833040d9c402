"""Several servos on one line: groups, the time answers take, collisions, lost bytes, other baud rates."""

import random

import pytest

from armwright.errors import BusError
from armwright.twin.serial.bus import Losses, ServoBus, collide, make_servo, wire_time
from armwright.twin.serial.frames import BROADCAST, FRAMINGS, Parser
from armwright.twin.serial.plant import KinematicPlant
from armwright.twin.serial.registers import servo_model
from twin.serial.conftest import BAUD, VOLTAGES, Client, client

MODELS = pytest.mark.parametrize("model", list(VOLTAGES))


def numbers(frames):
    return [frame.number for frame in frames]


def reads(line, *servos, instruction="sync-read"):
    register = line.registers["present_position"]
    return line.frames(instruction, BROADCAST, line.words(register.address, register.size) + bytes(servos))


@MODELS
def test_groups(model):
    line = client(model)
    assert numbers(line.frames("ping", BROADCAST)) == [1, 2, 3]
    assert numbers(reads(line, 3, 1)) == [3, 1]  # in the order asked
    assert numbers(reads(line, 1, 9, 2)) == [1, 2]
    goal = line.registers["goal_position"]
    data = line.words(goal.address, goal.size) + b"".join(bytes((k,)) + goal.encode(1000 + k) for k in (2, 3, 9))
    assert line.frames("sync-write", BROADCAST, data[:-1]) == []
    assert [line.get(k, "goal_position") for k in (1, 2, 3)] == [1000, 1002, 1003]
    for name in ("read", "write", "reg-write"):
        assert line.frames(name, BROADCAST, line.words(goal.address) + goal.encode(7)) == []
    assert line.frames("action", BROADCAST) == []
    assert line.frames("sync-read", 1, line.words(goal.address, goal.size) + b"\x01") == []  # groups are broadcast


def test_bulk_read_and_write(dynamixel):
    data = bytes((3,)) + dynamixel.words(132, 4) + bytes((1,)) + dynamixel.words(0, 2)
    third, first = dynamixel.frames("bulk-read", BROADCAST, data)
    assert (third.number, third.data[1:]) == (3, (3000).to_bytes(4, "little"))
    assert (first.number, first.data[1:]) == (1, dynamixel.bus.servos[0]["model_number"].to_bytes(2, "little"))
    data = (
        bytes((1,))
        + dynamixel.words(65, 1)
        + b"\x01"
        + bytes((2,))
        + dynamixel.words(116, 4)
        + (7).to_bytes(4, "little")
    )
    assert dynamixel.frames("bulk-write", BROADCAST, data + b"\x03\x41\x00\x01\x00") == []  # the last one has no data
    assert (dynamixel.get(1, "led"), dynamixel.get(2, "goal_position"), dynamixel.get(3, "led")) == (1, 7, 0)


def test_fast_reads_are_one_frame(dynamixel):
    (frame,) = reads(dynamixel, 1, 2, instruction="fast-sync-read")
    assert (frame.number, frame.data[1:6], frame.data[9:14]) == (BROADCAST, b"\x01\xe8\x03\0\0", b"\x02\xd0\x07\0\0")
    data = bytes((2,)) + dynamixel.words(132, 4) + bytes((1,)) + dynamixel.words(65, 1)
    (frame,) = dynamixel.frames("fast-bulk-read", BROADCAST, data)
    assert (frame.data[1:6], frame.data[9:11]) == (b"\x02\xd0\x07\0\0", b"\x01\0")
    assert reads(dynamixel, 1, 9, 2, instruction="fast-sync-read") == []  # a servo that is silent breaks the frame
    assert reads(dynamixel, *[1] * 200, instruction="fast-sync-read") == []  # longer than a frame can be


@MODELS
def test_two_servos_with_one_id_answer_over_each_other(model):
    for same in (True, False):
        line = client(model, positions=(1000.0, 1000.0 if same else 1700.0, 3000.0), numbers=(1, 1, 2))
        assert line.frames("ping", 1) == []
        assert reads(line, 1) == []
        assert numbers(reads(line, 2)) == [2]
        assert numbers(line.frames("ping", BROADCAST)) == [2]
        line.frames(
            "write", 1, line.words(line.registers["led" if "led" in line.registers else "lock"].address) + b"\0"
        )
        assert numbers(line.frames("ping", 2)) == [2]


def test_few_collisions_look_like_frames():
    rng = random.Random(5)
    for framing in FRAMINGS.values():
        found = 0
        for _ in range(3000):
            data = [rng.randbytes(4) for _ in range(2)]
            found += len(Parser(framing).feed(collide([framing.status(5, 0, each) for each in data])))
        assert found <= 30


def test_one_answer_collides_with_nothing():
    assert collide([b"\x01\x02\xff"]) == b"\x01\x02\xff"
    assert collide([b"\xff\x00"] * 2)[0] == 0xFE  # the second one's start bit is in the first data bit


@MODELS
def test_answers_wait_for_the_return_delay(model):
    line = client(model, return_delay_time=100)
    line.put(2, "return_delay_time", 0)
    register = line.registers["present_position"]
    data = line.words(register.address, register.size) + bytes((1, 2))
    (frame,) = line.bus.feed(line.bus.framing.pack(BROADCAST, 0x82, data), BAUD)
    assert [answer.delay for answer in line.bus.answer(frame, BAUD)] == [pytest.approx(200e-6), 0.0]
    assert wire_time(8, 1_000_000) == pytest.approx(80e-6)


@MODELS
def test_nobody_answers_at_another_baud_rate(model):
    line = client(model)
    assert line.frames("ping", 1, baud=115_200) == []
    assert numbers(line.frames("ping", 1)) == [1]
    code = servo_model(model).bauds.index(115_200)
    assert line.put(1, "baud_rate", code) == 0  # answered at the old rate
    assert line.frames("ping", 1) == []
    assert numbers(line.frames("ping", BROADCAST, baud=115_200)) == [1]
    assert numbers(line.frames("ping", BROADCAST)) == [2, 3]


def test_lost_bytes_are_lost_again_with_the_same_seed():
    def answered(seed):
        model = servo_model("sts3215")
        plant = KinematicPlant([1000.0])
        line = Client(ServoBus([make_servo(model, 1)], plant, Losses(0.02, seed)), plant)
        return [len(line.frames("ping", 1)) for _ in range(300)]

    first = answered(1)
    assert first == answered(1) != answered(2)
    assert 0.6 < sum(first) / 300 < 0.95  # 12 bytes each, 0.98**12 = 0.78


def test_servos_of_two_protocols_share_no_line():
    servos = [make_servo(servo_model(name), 1) for name in ("sts3215", "xl330-m288")]
    for each in (servos, []):
        with pytest.raises(BusError, match="same protocol"):
            ServoBus(each, KinematicPlant([0.0, 0.0]))


def garbage(line, rng):
    """Data of an instruction that is nearly right."""
    kind = rng.randrange(4)
    if kind == 0:
        return rng.randbytes(rng.randrange(12))
    register = rng.choice(line.bus.servos[0].model.registers)
    words = line.words(register.address + rng.randrange(3), rng.choice((register.size, 1, 255)))
    if kind == 1:
        return line.words(register.address) + rng.randbytes(rng.randrange(9))
    return words + bytes(rng.choices((1, 2, 3, 9, 254, 255), k=rng.randrange(8)))


@MODELS
@pytest.mark.parametrize("count", [2_000, pytest.param(20_000, marks=pytest.mark.study)])
def test_no_instruction_breaks_a_servo(model, count):
    """Any instruction with any data: no exception, and afterwards servos that were set up again answer."""
    line, rng = client(model), random.Random(7)
    codes = [*line.bus.framing.instructions, 0, 0x55, 0x77]
    for k in range(count):
        sent = line.bus.framing.pack(rng.choice((1, 2, 3, BROADCAST, 9)), rng.choice(codes), garbage(line, rng))
        for baud in {servo.baud for servo in line.bus.servos} if k % 50 == 0 else {BAUD}:
            for frame in line.bus.feed(sent, baud):
                line.bus.answer(frame, baud)
        line.bus.advance(1e-3 * k)
    for number, servo in enumerate(line.bus.servos, 1):
        servo.factory()
        servo["id"], servo["baud_rate"] = number, servo.model.bauds.index(BAUD)
        servo._kept[:] = servo.memory[: servo.model.eeprom]
        servo.power_up()
    assert numbers(line.frames("ping", BROADCAST)) == [1, 2, 3]

"""Frames: published examples, and streams of any bytes, in any pieces."""

import random
import time

import pytest
from hypothesis import given, settings, strategies as st

from armwright.twin.serial.frames import DYNAMIXEL, FEETECH, FRAMINGS, Parser, crc16

KINDS = pytest.mark.parametrize("framing", FRAMINGS.values(), ids=list(FRAMINGS))
PIECES = (b"\xff", b"\xff\xff", b"\xfd", b"\xff\xff\xfd", b"\xff\xff\xfd\x00", b"\xff\xff\x01\x02", b"\x00", b"\xfe")
NOISE = st.lists(st.one_of(st.binary(max_size=8), st.sampled_from(PIECES)), max_size=30).map(b"".join)
FRAMES = st.lists(st.tuples(st.integers(0, 0xFE), st.integers(0, 255), NOISE), max_size=8)


@pytest.mark.parametrize(
    ("number", "instruction", "data", "sent"),
    [  # of the manual's page on protocol 2.0 [Robotis2024]
        (1, 0x01, "", "FFFFFD0001030001194E"),
        (0xFE, 0x01, "", "FFFFFD00FE0300013142"),
        (1, 0x55, "00060426", "FFFFFD000107005500060426655D"),
        (1, 0x02, "84000400", "FFFFFD000107000284000400 1D15"),
        (1, 0x03, "740000020000", "FFFFFD00010900037400 00020000CA89"),
        (1, 0x06, "01", "FFFFFD000104000601A1E6"),
        (0xFE, 0x83, "740004000196000000 02AA000000", "FFFFFD00FE110083740004000196000000 02AA0000008287"),
        (0xFE, 0x92, "0190000200 0292000100", "FFFFFD00FE0D009201900002000292000100 1A05"),
    ],
)
def test_published_frames_of_dynamixel(number, instruction, data, sent):
    sent = bytes.fromhex(sent)
    assert DYNAMIXEL.pack(number, instruction, bytes.fromhex(data)) == sent
    (frame,) = Parser(DYNAMIXEL).feed(sent)
    assert (frame.number, frame.instruction, frame.data) == (number, instruction, bytes.fromhex(data))


@pytest.mark.parametrize(
    ("number", "instruction", "data", "sent"),
    [  # ping, read of the position, write of the id, action; checksums worked out by hand
        (1, 1, "", "FFFF010201FB"),
        (1, 2, "3802", "FFFF0104023802BE"),
        (0xFE, 3, "0501", "FFFFFE04030501F4"),
        (0xFE, 5, "", "FFFFFE0205FA"),
    ],
)
def test_frames_of_feetech(number, instruction, data, sent):
    sent = bytes.fromhex(sent)
    assert FEETECH.pack(number, instruction, bytes.fromhex(data)) == sent
    (frame,) = Parser(FEETECH).feed(sent)
    assert (frame.number, frame.instruction, frame.data, frame.size) == (
        number,
        instruction,
        bytes.fromhex(data),
        len(sent),
    )


def test_fast_read_is_one_frame_whose_parts_end_with_the_crc_so_far():
    parts = DYNAMIXEL.fast([(1, 0, b"\x01\x02"), (2, 0x80, b"\xff\xff\xfd")])
    # 14 bytes behind the length: 55, and 2 and 3 bytes with 4 more each
    assert parts[0][:7] == bytes.fromhex("FFFFFD00FE0E00")
    assert parts[1][:-2] == bytes.fromhex("8002FFFFFD")  # not stuffed: the maker's software would not take it out
    for k in (1, 2):
        whole = b"".join(parts[:k])
        assert crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little")


@KINDS
@given(frames=FRAMES, noise=st.binary(max_size=40).filter(lambda b: b"\xff" not in b), seed=st.integers(0, 2**32))
@settings(max_examples=150, deadline=None)
def test_frames_come_out_as_they_went_in(framing, frames, noise, seed):
    """Noise between frames is skipped, and it makes no difference in which pieces the bytes come."""
    frames = [each for each in frames if each[0] != 0xFD]
    stream = b"".join(noise + framing.pack(*each) for each in frames)
    parser, rng, found, at = Parser(framing), random.Random(seed), [], 0
    while at < len(stream):
        count = rng.randrange(1, 20)
        found += parser.feed(stream[at : at + count])
        at += count
    assert [(each.number, each.instruction, each.data) for each in found] == frames
    assert parser.skipped == len(noise) * len(frames)


@KINDS
@given(stream=NOISE, cuts=st.lists(st.integers(1, 9), min_size=1))
@settings(max_examples=150, deadline=None)
def test_any_bytes_in_any_pieces_are_the_same_frames(framing, stream, cuts):
    whole, pieces, at, k = Parser(framing).feed(stream), [], 0, 0
    parser = Parser(framing)
    while at < len(stream):
        pieces += parser.feed(stream[at : at + cuts[k % len(cuts)]])
        at, k = at + cuts[k % len(cuts)], k + 1
    assert pieces == whole
    good = framing.pack(7, 1)
    rest = parser.drop() + parser.feed(good)
    assert (rest[-1].number, rest[-1].instruction) == (7, 1)  # after a pause on the line


@KINDS
def test_a_frame_that_was_cut_off_swallows_nothing_after_a_pause(framing):
    parser, good = Parser(framing), framing.pack(3, 1)
    assert parser.feed(framing.pack(1, 3, bytes(20))[:-4]) == []
    assert [each.number for each in parser.feed(good) + parser.drop()] == [3]


def test_a_cut_frame_of_dynamixel_ends_at_the_next_header():
    parser = Parser(DYNAMIXEL)
    cut = DYNAMIXEL.pack(1, 3, bytes(200))[:30]
    assert [each.number for each in parser.feed(cut + DYNAMIXEL.pack(3, 1))] == [3]


def streams(framing, count, seed):
    """Pieces of a stream of `count` frames: a tenth with a wrong byte, a tenth cut off, a tenth with noise before them."""
    rng = random.Random(seed)
    codes, alphabet = list(framing.instructions), (0xFF, 0xFF, 0xFD, 0x00, 0x01, 0xFE)
    for _ in range(count):
        data = bytes(rng.choices(alphabet, k=rng.randrange(9)))
        frame = bytearray(framing.pack(rng.randrange(0xFD), rng.choice(codes), data))
        kind = rng.randrange(10)
        if kind == 0:
            frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
        elif kind == 1:
            del frame[rng.randrange(len(frame)) :]
        elif kind == 2:
            frame[:0] = rng.choices(alphabet, k=rng.randrange(6))
        yield bytes(frame), kind > 2


def check_streams(framing, count, seed):
    """Parses such a stream; nearly all whole frames are found, and a whole one behind three whole ones always."""
    parser, found, whole, began = Parser(framing), 0, 0, time.process_time()
    for piece, good in streams(framing, count, seed):
        found += len(parser.feed(piece))
        whole += good
    assert len(parser._buffer) <= framing.longest + 7
    assert 0.97 * whole <= found <= count
    return time.process_time() - began


@KINDS
def test_ten_thousand_frames_among_damaged_ones(framing):
    check_streams(framing, 10_000, seed=1)


@pytest.mark.study
@KINDS
def test_half_a_million_frames_among_damaged_ones(framing):
    assert check_streams(framing, 500_000, seed=2) < 60.0  # [s]

"""Frames of bus servos: Feetech STS and Dynamixel protocol 2, written and parsed byte by byte.

    Feetech      FF FF       id  length     instruction  data …  ~(id + length + … )       [Feetech2024]
    Dynamixel 2  FF FF FD 00 id  length(2)  instruction  data …  CRC-16, polynomial 8005   [Robotis2024]

`length` counts the bytes behind it. A status frame has the error in the place of the instruction (Feetech) or behind
instruction 55 (Dynamixel). Dynamixel writes FD behind every FF FF FD of instruction and data, so a header never occurs within
a frame; a Feetech frame may contain FF FF.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

BROADCAST = 0xFE
COMMON = {1: "ping", 2: "read", 3: "write", 4: "reg-write", 5: "action", 0x82: "sync-read", 0x83: "sync-write"}


def _crc_table() -> tuple[int, ...]:
    """CRC-16 of each byte value, polynomial 0x8005."""
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x8005 if crc & 0x8000 else 0)
        table.append(crc & 0xFFFF)
    return tuple(table)


CRC = _crc_table()


def crc16(data: bytes | bytearray) -> int:
    """CRC-16 of Dynamixel protocol 2: polynomial 0x8005, initial value 0."""
    crc = 0
    for byte in data:
        crc = ((crc << 8) & 0xFF00) ^ CRC[(crc >> 8) ^ byte]
    return crc


@dataclass(frozen=True, slots=True)
class Frame:
    """A whole frame with a right checksum.

    Attributes:
        number: id of the servo, or BROADCAST.   instruction: its code; in a Feetech status the error.
        data: parameters, without stuffing.   size: bytes on the wire.
    """

    number: int
    instruction: int
    data: bytes
    size: int


class Framing(ABC):
    """A maker's form of frames; `FEETECH` and `DYNAMIXEL` are the two there are.

    Attributes:
        header: first bytes of every frame.   word: bytes of an address or a count in a frame's data.
        longest: value of `length`.   instructions: names by code; others are not answered.
    """

    header: bytes
    word: int
    longest: int
    instructions: Mapping[int, str]

    @abstractmethod
    def pack(self, number: int, instruction: int, data: bytes = b"") -> bytes:
        """The bytes of a frame."""

    @abstractmethod
    def status(self, number: int, error: int, data: bytes = b"") -> bytes:
        """The bytes of a servo's answer."""

    @abstractmethod
    def cut(self, buffer: bytearray, at: int) -> Frame | int:
        """The frame whose header begins at `at`; 0 if bytes are missing, or how many bytes to skip if it is none."""

    def integers(self, data: bytes, count: int) -> tuple[int, ...]:
        """The first `count` addresses or sizes of a frame's data; the data must be long enough."""
        return tuple(int.from_bytes(data[k * self.word : (k + 1) * self.word], "little") for k in range(count))


class Feetech(Framing):
    """Frames of Feetech's STS and SMS servos. [Feetech2024]"""

    header, word, longest = b"\xff\xff", 1, 250
    instructions = COMMON

    def pack(self, number: int, instruction: int, data: bytes = b"") -> bytes:
        """The bytes of a frame."""
        body = bytes((number, len(data) + 2, instruction)) + data
        return self.header + body + bytes((~sum(body) & 0xFF,))

    def status(self, number: int, error: int, data: bytes = b"") -> bytes:
        """The bytes of a servo's answer."""
        return self.pack(number, error, data)

    def cut(self, buffer: bytearray, at: int) -> Frame | int:
        """The frame whose header begins at `at`; 0 if bytes are missing, or how many bytes to skip if it is none."""
        there = len(buffer) - at
        if there > 2 and buffer[at + 2] == 0xFF:
            return 1
        if there < 4:
            return 0
        length = buffer[at + 3]
        if not 2 <= length <= self.longest:
            return 1
        if there < 4 + length:
            return 0
        end = at + 4 + length
        if sum(buffer[at + 2 : end]) & 0xFF != 0xFF:
            return 1
        return Frame(buffer[at + 2], buffer[at + 4], bytes(buffer[at + 5 : end - 1]), 4 + length)


class Dynamixel(Framing):
    """Frames of Dynamixel protocol 2. [Robotis2024]"""

    header, word, longest = b"\xff\xff\xfd\x00", 2, 1017
    mark, stuffed = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
    instructions = COMMON | {
        0x06: "reset",
        0x08: "reboot",
        0x10: "clear",
        0x8A: "fast-sync-read",
        0x92: "bulk-read",
        0x93: "bulk-write",
        0x9A: "fast-bulk-read",
    }
    reply = 0x55

    def pack(self, number: int, instruction: int, data: bytes = b"") -> bytes:
        """The bytes of a frame."""
        body = (bytes((instruction,)) + data).replace(self.mark, self.stuffed)
        frame = self.header + bytes((number,)) + (len(body) + 2).to_bytes(2, "little") + body
        return frame + crc16(frame).to_bytes(2, "little")

    def status(self, number: int, error: int, data: bytes = b"") -> bytes:
        """The bytes of a servo's answer."""
        return self.pack(number, self.reply, bytes((error,)) + data)

    def fast(self, answers: Sequence[tuple[int, int, bytes]]) -> list[bytes]:
        """Parts of the one status frame of a fast read, one for each servo: (id, error, data), without stuffing.

        Every part ends with the CRC of all bytes up to there, so the last one's is that of the frame.
        """
        length = 1 + sum(len(data) + 4 for _, _, data in answers)
        frame, parts = self.header + bytes((BROADCAST,)) + length.to_bytes(2, "little") + bytes((self.reply,)), []
        begin = 0
        for number, error, data in answers:
            frame += bytes((error, number)) + data
            frame += crc16(frame).to_bytes(2, "little")
            parts.append(frame[begin:])
            begin = len(frame)
        return parts

    def cut(self, buffer: bytearray, at: int) -> Frame | int:
        """The frame whose header begins at `at`; 0 if bytes are missing, or how many bytes to skip if it is none."""
        there = len(buffer) - at
        if there < 7:
            return 0
        number, length = buffer[at + 4], buffer[at + 5] | buffer[at + 6] << 8
        if number in (0xFD, 0xFF) or not 3 <= length <= self.longest:
            return 1
        end = at + 7 + length
        last = min(len(buffer), end - 2)
        inner = buffer.find(self.header, at + 7, last)
        if inner >= 0:
            return inner - at  # a header within a frame: the frame before it was cut off
        if there < 7 + length:
            return 0
        if crc16(buffer[at : end - 2]) != buffer[end - 2] | buffer[end - 1] << 8:
            return 1
        body = bytes(buffer[at + 7 : end - 2]).replace(self.stuffed, self.mark)
        return Frame(number, body[0], body[1:], 7 + length)


FEETECH, DYNAMIXEL = Feetech(), Dynamixel()
FRAMINGS: dict[str, Framing] = {"feetech": FEETECH, "dynamixel-2": DYNAMIXEL}


class Parser:
    """Frames out of a stream of bytes, in whatever pieces it comes; what belongs to none is skipped.

    Attributes:
        skipped: bytes that belonged to no frame.
    """

    def __init__(self, framing: Framing):
        self.framing, self.skipped = framing, 0
        self._buffer = bytearray()

    def feed(self, data: bytes) -> list[Frame]:
        """Frames that are complete with these bytes."""
        self._buffer += data
        return self._take()

    def drop(self) -> list[Frame]:
        """Gives up the frame that has begun, after a pause on the line; returns whole frames that it swallowed."""
        frames: list[Frame] = []
        while self._buffer:
            self.skipped += 1
            del self._buffer[0]
            frames += self._take()
        return frames

    def _take(self) -> list[Frame]:
        buffer, header, at, frames = self._buffer, self.framing.header, 0, []
        while True:
            begin = buffer.find(header, at)
            if begin < 0:
                begin = len(buffer) - next((k for k in range(len(header) - 1, 0, -1) if buffer.endswith(header[:k])), 0)
                begin = max(begin, at)
            self.skipped += begin - at
            at = begin
            found = self.framing.cut(buffer, at) if at < len(buffer) else 0
            if isinstance(found, Frame):
                frames.append(found)
                at += found.size
            elif found:
                self.skipped += found
                at += found
            else:
                del buffer[:at]
                return frames

"""dynamixel-sdk against an arm of servos 1 to 3, run as `python client_arm.py PORT SEED`; prints the positions it read."""

import json
import random
import sys
import time
from typing import Any

import dynamixel_sdk as sdk

sdk.port_handler.LATENCY_TIMER = 250  # [ms] instead of 16, for machines that do other work
port: Any = sdk.PortHandler(sys.argv[1])
packet: Any = sdk.PacketHandler(2.0)
IDS, rng = range(1, 4), random.Random(sys.argv[2])
CYCLES, OFF = 12, range(6, 9)


def put(number, address, size, value):
    found = getattr(packet, f"write{size}ByteTxRx")(port, number, address, value)
    assert found == (0, 0), (number, address, value, found)


assert port.openPort()
assert port.setBaudRate(1_000_000)
assert [packet.ping(port, number) for number in IDS] == [(1200, 0, 0)] * 3
for number in IDS:
    put(number, 84, 2, 64)  # P
    put(number, 64, 1, 1)
positions = []
for k in range(CYCLES):
    reader = sdk.GroupSyncRead(port, packet, 132, 4)
    assert all(reader.addParam(number) for number in IDS)
    assert reader.txRxPacket() == 0
    positions.append([reader.getData(number, 132, 4) for number in IDS])
    if k in (OFF.start, OFF.stop):
        put(2, 64, 1, int(k == OFF.stop))
    time.sleep(rng.choice((0.0, 0.01, 0.05)))
    writer = sdk.GroupSyncWrite(port, packet, 116, 4)
    for number in IDS:
        assert writer.addParam(number, list((2048 + 40 * k * (-1) ** number).to_bytes(4, "little")))
    assert writer.txPacket() == 0
print(json.dumps(positions))

"""dynamixel-sdk against servos 1 to 3, run as `python client_dynamixel.py PORT`; prints "done"."""

import sys
import time
from typing import Any

import dynamixel_sdk as sdk

sdk.port_handler.LATENCY_TIMER = 250  # [ms] instead of 16, for machines that do other work
port: Any = sdk.PortHandler(sys.argv[1])
packet: Any = sdk.PacketHandler(2.0)
IDS = range(1, 4)
MODEL = int(sys.argv[2])
GROUPS = (  # of reads: class, the call, and what a servo is added with
    (lambda: sdk.GroupSyncRead(port, packet, 132, 4), "txRxPacket", ()),
    (lambda: sdk.GroupSyncRead(port, packet, 132, 4), "fastSyncRead", ()),
    (lambda: sdk.GroupBulkRead(port, packet), "txRxPacket", (132, 4)),
    (lambda: sdk.GroupBulkRead(port, packet), "fastBulkRead", (132, 4)),
)


def get(number, address, size):
    value, result, error = getattr(packet, f"read{size}ByteTxRx")(port, number, address)
    assert (result, error) == (0, 0), (number, address, result, error)
    return value


def put(number, address, size, value, error=0):
    found = getattr(packet, f"write{size}ByteTxRx")(port, number, address, value)
    assert found == (0, error), (number, address, value, found)


assert port.openPort()
assert port.setBaudRate(1_000_000)
assert [packet.ping(port, number) for number in IDS] == [(MODEL, 0, 0)] * 3
found, result = packet.broadcastPing(port)
assert (result, list(found), {each[0] for each in found.values()}) == (0, list(IDS), {MODEL})
assert packet.ping(port, 9)[1] == -3001
put(1, 20, 4, 2**32 - 48)  # homing offset -48
assert get(1, 132, 4) == 2000
put(1, 20, 4, 0xFFFDFFFF)  # FF FF FD FF in the frame, which is stuffed both ways
assert get(1, 20, 4) == 0xFFFDFFFF
put(1, 20, 4, 0)
put(1, 64, 1, 1)
put(1, 9, 1, 0, error=7)  # EEPROM while torque is on
put(1, 116, 4, 5000, error=6)  # beyond the limits
put(1, 84, 2, 20000, error=4)  # beyond the table's range
put(1, 116, 2, 100, error=5)  # half a register
put(1, 132, 4, 100, error=7)  # read only
put(1, 116, 4, 3000)
for number in (2, 3):
    put(number, 64, 1, 1)
group = sdk.GroupSyncWrite(port, packet, 116, 4)
for number in IDS:
    assert group.addParam(number, [0, 4, 0, 0])
assert group.txPacket() == 0
group = sdk.GroupBulkWrite(port, packet)
for number in IDS:
    assert group.addParam(number, 116, 4, [208 + number, 7, 0, 0])
assert group.txPacket() == 0
time.sleep(1.0)
for make, call, arguments in GROUPS:
    group = make()
    assert all(group.addParam(number, *arguments) for number in IDS)
    results = [getattr(group, call)() for _ in range(25)]
    assert results == [0] * 25, (call, results)
    assert [group.getData(number, 132, 4) for number in IDS] == [2000 + number for number in IDS], call
assert packet.regWriteTxRx(port, 2, 65, 1, [1]) == (0, 0)
assert (get(2, 69, 1), get(2, 65, 1)) == (1, 0)
assert packet.action(port, sdk.BROADCAST_ID) == 0
assert (get(2, 69, 1), get(2, 65, 1)) == (0, 1)
assert packet.clearMultiTurn(port, 2) == (0, 0)
assert packet.reboot(port, 1) == (0, 0)
assert get(1, 64, 1) == 0
assert packet.factoryReset(port, 3, 2) == (0, 0)  # all but id and baud rate
put(3, 7, 1, 13)
assert packet.ping(port, 13) == (MODEL, 0, 0)
assert port.setBaudRate(57_600)
assert packet.ping(port, 1)[1] == -3001  # nobody at this rate
assert port.setBaudRate(1_000_000)
put(1, 8, 1, 1)
assert port.setBaudRate(57_600)
assert packet.ping(port, 1) == (MODEL, 0, 0)
print("done")

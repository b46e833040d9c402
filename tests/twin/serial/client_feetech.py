"""feetech-servo-sdk against servos 1 to 6, run as `python client_feetech.py PORT`; prints "done"."""

import sys
import time

import scservo_sdk as sdk  # type: ignore[import-not-found]

sdk.port_handler.LATENCY_TIMER = 250  # [ms] instead of 16, for machines that do other work
port, packet = sdk.PortHandler(sys.argv[1]), sdk.PacketHandler(0)
IDS = range(1, 7)


def word(number, address):
    value, result, error = packet.read2ByteTxRx(port, number, address)
    assert (result, error) == (0, 0), (number, address, result, error)
    return value


assert port.openPort()
assert port.setBaudRate(1_000_000)
assert [packet.ping(port, number) for number in IDS] == [(777, 0, 0)] * 6
assert packet.ping(port, 9)[1] == -6  # nobody
for address, size, value in ((55, 1, 0), (21, 1, 16), (7, 1, 0), (85, 1, 254), (41, 1, 254), (31, 2, 100 | 1 << 11)):
    put, get = (getattr(packet, f"{kind}{size}ByteTxRx") for kind in ("write", "read"))
    assert put(port, 1, address, value) == (0, 0)
    assert get(port, 1, address) == (value, 0, 0), address
assert word(1, 56) == 2148  # the encoder's 2048 less an offset of -100
assert packet.regWriteTxRx(port, 2, 42, 2, [0, 4]) == (0, 0)
assert packet.read1ByteTxRx(port, 2, 64) == (1, 0, 0)
assert packet.action(port, sdk.BROADCAST_ID) == 0
assert packet.read1ByteTxRx(port, 2, 40) == (1, 0, 0)  # a goal switches torque on
assert word(2, 42) == 1024

group = sdk.GroupSyncWrite(port, packet, 42, 2)
for number in IDS:
    assert group.addParam(number, [sdk.SCS_LOBYTE(2000 + number), sdk.SCS_HIBYTE(2000 + number)])
assert group.txPacket() == 0
time.sleep(0.6)
reader = sdk.GroupSyncRead(port, packet, 56, 2)
assert all(reader.addParam(number) for number in IDS)
results = [reader.txRxPacket() for _ in range(100)]
assert results == [0] * 100, results
assert [reader.getData(number, 56, 2) for number in IDS] == [2000 + number for number in IDS]

assert packet.write1ByteTxRx(port, 6, 5, 16) == (0, 0)  # a new id is answered with the old one
assert packet.ping(port, 16) == (777, 0, 0)
assert packet.ping(port, 6)[1] == -6
assert port.setBaudRate(500_000)
assert packet.ping(port, 1)[1] == -6  # nobody at this rate
assert port.setBaudRate(1_000_000)
assert packet.write1ByteTxRx(port, 1, 6, 1) == (0, 0)
assert port.setBaudRate(500_000)
assert packet.ping(port, 1) == (777, 0, 0)
print("done")

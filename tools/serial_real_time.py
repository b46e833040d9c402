"""Lost transactions of the serial twin in real time: six servos of an SO-101, read and commanded 50 times a second.

    python tools/serial_real_time.py [SECONDS]

The twin runs in a process of its own. A transaction is a reading of all servos; it is lost if an answer is missing after
34 ms, when the makers' software gives up.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from armwright.twin import clock
from armwright.twin.serial.client import SerialPort, ServoClient
from armwright.twin.serial.registers import servo_model

RATE, PATIENCE, AMPLITUDE = 50.0, 0.034, 300.0
REGISTERS = ("present_position", "present_velocity", "present_load", "present_voltage")


def main(seconds: float = 60.0) -> int:
    """Prints what was counted; returns the exit code."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "port")
        command = [sys.executable, "-m", "armwright", "twin", "so101", "--serial", path]
        twin = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        assert twin.stdout is not None
        while "servos on" not in (line := twin.stdout.readline()):
            assert line, "the twin did not start"
        with SerialPort(path, 1_000_000) as port:
            lost, waits, cycles = _counted(ServoClient(port, servo_model("sts3215"), PATIENCE), seconds)
        twin.send_signal(signal.SIGTERM)
        print(twin.communicate(timeout=60)[0])
    load, cores = os.getloadavg()[0], os.cpu_count()
    print(f"{lost} of {cycles} transactions lost; the longest took {1e3 * max(waits):.1f} ms")
    print(f"median {1e3 * sorted(waits)[len(waits) // 2]:.1f} ms; load {load:.1f} on {cores} cores")
    return 0


def _counted(client: ServoClient, seconds: float) -> tuple[int, list[float], int]:
    """Lost transactions, durations of all [s], and their number."""
    ids, cycles, lost, waits = range(1, 7), round(seconds * RATE), 0, []
    client.sync_write("torque_enable", dict.fromkeys(ids, 1))
    start = clock.now()
    for k in range(cycles):
        clock.sleep_until(start + k / RATE)
        began = time.monotonic()
        lost += len(client.sync_read(list(ids), REGISTERS)) < len(ids)
        waits.append(time.monotonic() - began)
        way = AMPLITUDE * abs((k / RATE) % 2.0 - 1.0)
        client.sync_write("goal_position", dict.fromkeys(ids, 2048 + round(way)))
    return lost, waits, cycles


if __name__ == "__main__":
    sys.exit(main(*map(float, sys.argv[1:])))

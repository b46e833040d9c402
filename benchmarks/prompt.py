"""Time to the prompt of `armwright sim`: typed at a pseudo-terminal, as a user would.

python benchmarks/prompt.py [TIMES]
"""

from __future__ import annotations

import os
import re
import select
import sys
import time

COMMAND = (sys.executable, "-m", "armwright", "sim")
PATIENCE = 60.0  # [s]
ESCAPES = re.compile(rb"\x1b\[[0-9;?]*[a-zA-Z]|\x1b[=>]|\r")


def prompted() -> tuple[float, bool]:
    """Seconds from the command to its prompt, Python's own start in it; and whether a line typed there is answered."""
    import pty

    start = time.perf_counter()
    pid, terminal = pty.fork()
    if pid == 0:
        os.execve(COMMAND[0], COMMAND, os.environ | {"TERM": "xterm-256color", "PROMPT_TOOLKIT_NO_CPR": "1"})
    try:
        read = _until(terminal, b"sim>")
        seconds = time.perf_counter() - start
        os.write(terminal, b"theta[1]\r")
        answered = b"theta[joint1] = 0 rad" in _until(terminal, b"0 deg")
        os.write(terminal, b"\x04")
        return seconds, answered and b"cmu-dd: 6 joints" in read
    finally:
        os.close(terminal)
        os.waitpid(pid, 0)


def _until(terminal: int, words: bytes) -> bytes:
    """Text up to those words; it gives up after a minute without any."""
    read, end = b"", time.monotonic() + PATIENCE
    while words not in ESCAPES.sub(b"", read) and select.select([terminal], [], [], max(end - time.monotonic(), 0))[0]:
        read += os.read(terminal, 65536)
    return ESCAPES.sub(b"", read)


if __name__ == "__main__":
    found = [prompted() for _ in range(int(sys.argv[1]) if len(sys.argv) > 1 else 5)]
    assert all(right for _, right in found)
    print(f"{1e3 * min(seconds for seconds, _ in found):.0f} ms, best of {len(found)}")

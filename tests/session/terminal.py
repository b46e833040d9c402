"""A session at a pseudo-terminal, typed into key by key."""

from __future__ import annotations

import os
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest

from foreground import FOREGROUND

SIM = (sys.executable, "-m", "armwright", "sim")
WIDTH = 130  # characters of the terminal
ESCAPES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]|\x1b[=>]|\r")
needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals of this kind")


class Terminal:
    """A session at the other end of a pseudo-terminal, typed into key by key."""

    def __init__(self, folder: Path, command: tuple[str, ...] = SIM, width: int = WIDTH):
        import pty
        import termios

        self.fd, other = pty.openpty()
        termios.tcsetwinsize(other, (60, width))
        keep = {
            name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "COLUMNS", "LINES"))
        }
        self.process = subprocess.Popen(
            [*FOREGROUND, *command], cwd=folder, stdin=other, stdout=other, stderr=other, start_new_session=True,
            env={**keep, "TERM": "xterm-256color", "PROMPT_TOOLKIT_NO_CPR": "1"},
        )  # fmt: skip
        os.close(other)
        self.raw, self.gone = "", False

    @property
    def text(self) -> str:
        return ESCAPES.sub("", self.raw)

    def wait(self, there, seconds: float = 30.0) -> None:
        """Reads until `there()` holds of what was read."""
        end = time.monotonic() + seconds
        while not there():
            assert time.monotonic() < end, self.text[-2000:]
            if select.select([self.fd], [], [], 0.1)[0]:
                try:
                    self.raw += os.read(self.fd, 65536).decode(errors="replace")
                except OSError:  # the other end is gone
                    self.gone = True
                    return

    def send(self, keys: str) -> None:
        """Types."""
        os.write(self.fd, keys.encode())

    def soon(self, seconds: float = 0.2) -> str:
        """Text that is printed within that time."""
        since, end = len(self.raw), time.monotonic() + seconds
        self.wait(lambda: time.monotonic() > end)
        return ESCAPES.sub("", self.raw[since:])

    def type(self, keys: str, until: str) -> str:
        """Types, and comes back with what was said until those words."""
        since = len(self.raw)
        self.send(keys)
        self.wait(lambda: until in ESCAPES.sub("", self.raw[since:]))
        return ESCAPES.sub("", self.raw[since:])

    def enter(self, line: str) -> str:
        """Types a line, and comes back with what was said until the next prompt."""
        since = len(self.raw)
        self.type(f"{line}\r", until="\n")
        self.wait(lambda: ESCAPES.sub("", self.raw[since:]).rstrip().endswith("sim>"))
        return ESCAPES.sub("", self.raw[since:])

    def close(self) -> int:
        os.close(self.fd)
        return self.process.wait()

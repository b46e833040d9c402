"""The command line: `armwright --help`. Thin: each command parses, calls public functions and shows what they return."""

from __future__ import annotations

import gc
import sys

ALLOCATED = 50_000  # objects between two searches for unreachable cycles, in place of 700


def main() -> None:
    """Runs the command that `sys.argv` names. Exit code 0: done; 2: an error, shown in one line; 130: interrupted;
    141: the reader of a pipe left early.
    """
    gc.set_threshold(ALLOCATED)  # a command's imports stay: to look for cycles among them took a tenth of its time
    try:
        from armwright.cli.app import app

        app(prog_name="armwright")
    except KeyboardInterrupt:  # before a command runs: Python would end with a traceback
        sys.exit(130)

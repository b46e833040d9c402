"""The command line: `armwright --help`. Thin: each command parses, calls public functions and shows what they return."""

from __future__ import annotations


def main() -> None:
    """Runs the command that `sys.argv` names. Exit code 0: done; 2: an error, shown in one line; 130: interrupted;
    141: the reader of a pipe left early.
    """
    from armwright.cli.app import app

    app(prog_name="armwright")

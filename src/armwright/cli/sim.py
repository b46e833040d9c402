"""`armwright sim`: the interactive arm."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from armwright.cli.arguments import argument, flag, option
from armwright.errors import SessionError

PIPE = "standard input"


def sim(
    robot: str = argument("ROBOT", "Name of a built-in arm, or path of a robot's file.", "cmu-dd", show_default=True),
    script: Path | None = option("FILE", "Do the lines of a file, in place of asking."),
    echo: bool = flag("--echo", "Show each line of a script before what it does."),
) -> None:
    """Start an interactive session: set variables, compute dynamics, simulate, plot.

    At a terminal it has prompts with completion, `help` and a `tour`. Lines from a pipe, or from --script, are a script: it
    ends at the first line that fails, with exit code 2.

    \b
    Examples:
      armwright sim
      armwright sim panda
      armwright sim < my.sim
      printf 'theta[2] = 30 deg\\ninverse-arm\\n' | armwright sim two-link
    """
    from armwright.session import Session
    from armwright.session.files import read_script
    from armwright.session.listing import Screen

    screen = Screen()
    session = Session(robot)
    session.show = screen
    if script is not None:
        session.run_lines(read_script(str(script)), str(script), screen, echo=echo)
    elif sys.stdin is None:
        raise SessionError("is closed", file=PIPE, expected="a terminal, a script on it, or --script FILE")
    elif not sys.stdin.isatty():
        session.run_lines(_piped(), PIPE, screen, echo=echo)
    else:
        from armwright.session.terminal import interact

        interact(session, screen)


def _piped() -> Iterator[str]:
    """Lines from standard input as they come; what was shown before is sent off first, for a program that waits for it."""
    k = 0
    while line := sys.stdin.buffer.readline():
        k += 1
        try:
            yield line.decode("utf-8-sig")
        except UnicodeDecodeError:
            expected = "a script in UTF-8, one line a command"
            raise SessionError("not UTF-8", value=line[:40], expected=expected, file=f"{PIPE}:{k}") from None
        sys.stdout.flush()

"""Files of a session: the output file, scripts, and the record of what was typed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from armwright.errors import SessionError
from armwright.output import check_destination
from armwright.session.listing import Line, Output, Shown

if TYPE_CHECKING:
    from armwright.session.session import Session

OFF = "off"
LONGEST = 1_000_000  # characters of a script


def open_output_file(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`open-output-file FILE`: where print-simulation and inverse-arm FILE go from now on."""
    state = session.state
    if state.output is not None:
        raise SessionError(f"open-output-file: {state.output.path} is open; expected close-output-file first")
    path = check_destination(given["file"])
    session.state = state.replace(output=Output(path))
    kind = "CSV" if session.state.output.is_csv else "text"  # type: ignore[union-attr]
    return [Line(f"results go to {path} as {kind}, written whole with each of them", "good")]


def close_output_file(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`close-output-file`: results come to the screen again."""
    output = session.state.output
    if output is None:
        raise SessionError("close-output-file: no output file is open")
    session.state = session.state.replace(output=None)
    told = (
        f"closed {output.path}"
        if output.text
        else f"closed {output.path}; nothing was printed, so there is no such file"
    )
    return [Line(told, "good")]


def read_script(command: str, file: str) -> list[str]:
    """The lines of a script.

    Raises:
        SessionError: no such file, or none in UTF-8.
    """
    path = Path(file)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise SessionError(f"{command}: {file}: no such file") from None
    except UnicodeDecodeError:
        raise SessionError(f"{command}: {file}: is no text in UTF-8; expected a script, one line a command") from None
    except OSError as error:
        raise SessionError(f"{command}: {file}: cannot be read: {error.strerror}") from None
    if len(text) > LONGEST:
        raise SessionError(f"{command}: {file}: {len(text)} characters; expected a script of at most {LONGEST}")
    return text.splitlines()


def run_script(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`run-script FILE`: its lines as if they were typed; the first one that fails ends it, what came before it stays."""
    shown: list[Shown] = []
    session.run_lines(read_script("run-script", given["file"]), given["file"], session.tell or shown.append)
    session.ended = False  # `quit` in a script ends the script
    return shown


def record(session: Session, given: dict[str, Any]) -> list[Shown]:
    """`record FILE`: all that was done so far and will be, as a script that replays to the same numbers; `record off`."""
    if given["file"] == OFF:
        if session.recording is None:
            raise SessionError("record off: nothing is being recorded")
        path, session.recording = session.recording, None
        return [Line(f"recorded in {path}", "good")]
    session.recording = check_destination(given["file"])
    session.write_record()
    return [Line(f"recording into {session.recording}, from the session's first line", "good")]

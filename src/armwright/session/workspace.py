"""Session data for its commands: state, undo, recording, and functions for prompts and output."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.errors import SessionError
from armwright.output import write_whole
from armwright.session.arguments import YES_NO, Argument, quoted
from armwright.session.listing import Listing, Output, TextLine
from armwright.session.state import SessionState, initial_state, load_arm

if TYPE_CHECKING:
    import xarray as xr

    from armwright.pictures.live import LiveArm

MAX_UNDO = 100  # changes
UNSAVED = "the simulation is not saved; save-simulation FILE.nc saves it"
LEAVE = Argument(
    "leave", "choice", "leave all the same", YES_NO, "The simulation is not saved. Leave without it?", "no"
)

Ask = Callable[[Argument, str | None], str]
"""(argument, meaning of an empty answer; None: it must be given) → the answer. EOFError: no more; the command is dropped."""


class Workspace(ABC):
    """State of a session with its history.

    Attributes:
        state: the present one.   undo_stack: the states before each change.   recording: file that holds all lines so far.
        commands: all there are, by the names that `same` gives.   ask: answers prompts; None in scripts, which give arguments.
        show: called with output along the way.   progress: called with (steps done, all steps) of long runs.
        ended: True once `quit` was typed.   saved: the simulation that was last saved or restored.
        live: page that shows theta; None where `watch` is off.
        inner_scripts: how many scripts that `run-script` began are being done, whose `quit` ends only them.
    """

    def __init__(self, robot: str, commands: Mapping[str, SessionCommand], ask: Ask | None):
        """Starts with an arm, everything at zero.

        Raises:
            ArmwrightError: no such robot, or an invalid file.
        """
        self.state = initial_state(load_arm(robot)).replace(lines=(f"database-read robot={quoted(robot)}",))
        self.undo_stack: list[SessionState] = []
        self.recording: Path | None = None
        self.commands = commands
        self.ask = ask
        self.show: Callable[[Output], None] | None = None
        self.progress: Callable[[int, int], None] | None = None
        self.ended = False
        self.saved: Any = None
        self.live: LiveArm | None = None
        self.inner_scripts = 0
        self.recorded_line = ""

    @abstractmethod
    def run(self, line: str) -> list[Output]:
        """Executes one line; returns its output."""

    @abstractmethod
    def run_lines(self, lines: Iterable[str], file: str, show: Callable[[Output], None], *, echo: bool = False) -> None:
        """Executes the lines of a script, until one fails or `quit` is reached."""

    def change(self, state: SessionState) -> None:
        """Replaces the state and pushes the old one onto the undo stack."""
        self.undo_stack = [*self.undo_stack[-MAX_UNDO + 1 :], self.state]
        self.state = state
        self.write_recording()
        self.follow()

    def undo(self, count: int) -> list[Output]:
        """Goes back to the state before the last `count` changes. Files stay as they are.

        Raises:
            SessionError: fewer changes are remembered.
        """
        if count > len(self.undo_stack):
            raise SessionError(
                place="undo steps", value=count, expected=f"at most {len(self.undo_stack)}, the changes so far"
            )
        before = self.undo_stack[-count]
        undone = self.state.lines[len(before.lines) :]
        self.state, self.undo_stack = before, self.undo_stack[:-count]
        self.write_recording()
        self.follow()
        return [TextLine(f"undone: {'; '.join(undone)}" if undone else "undone", "good")]

    def quit(self) -> list[Output]:
        """Ends the session after this line; for an unsaved simulation it asks first, or warns in a script."""
        unsaved = self.state.run is not None and self.state.run is not self.saved and not self.inner_scripts
        if unsaved and self.ask is not None:
            try:
                answer = self.ask(LEAVE, LEAVE.default).strip() or LEAVE.default
            except EOFError:  # Ctrl-D at the question
                answer = "yes"
            if LEAVE.read("quit", answer or "") == "no":
                return [TextLine(UNSAVED, "note")]
            unsaved = False
        self.ended = True
        return [TextLine(UNSAVED, "note")] if unsaved else []

    def follow(self) -> None:
        """Shows the arm at theta in the page of `watch`, unless a simulation just played there."""
        arm, q = self.state.arm, self.state.q
        if self.live is not None and not (arm is self.live.arm and np.array_equal(q, self.live.q)):
            self.live.show(arm, q)

    def stop_watching(self) -> None:
        """Closes the page of `watch`, if it is open."""
        if self.live is not None:
            self.live.close()
            self.live = None

    def play(self, run: xr.Dataset) -> None:
        """Plays a simulation in the page of `watch`."""
        if self.live is not None:
            self.live.play(run)

    def emit(self, listing: Listing) -> list[Output]:
        """Shows a listing on the screen, or prints it into the open output file."""
        file = self.state.output_file
        if file is None:
            return list(listing.sheets)
        self.state = self.state.replace(output_file=file.printed(listing))
        rows = max((len(values) for values in listing.columns.values()), default=0)
        return [TextLine(f"printed {rows} row{'s' * (rows != 1)} into {file.path}", "good")]

    def write_recording(self) -> None:
        """Writes all lines so far into the file that `record` named, whole or not at all."""
        if self.recording is not None:
            text = "".join(f"{line}\n" for line in self.state.lines)
            write_whole(self.recording, text)


@dataclass(frozen=True)
class SessionCommand:
    """A command of the session.

    Attributes:
        name, summary: as `help` has them.   run: does it; (workspace, values by argument) → its output.
        arguments: in the order of its prompts.   pairs: True if it takes further name=value.
        equation, source: of its result.
        example: a line that works.   report: True if the report's `sim` has it.
        recorded: True if it is a line of a script, which undo takes back and record keeps.
        check: refuses the impossible, before the first question and after each answer.
    """

    name: str
    summary: str
    run: Callable[[Workspace, dict[str, Any]], list[Output]]
    arguments: tuple[Argument, ...] = ()
    equation: str = ""
    source: str = ""
    example: str = ""
    report: bool = False
    recorded: bool = True
    pairs: bool = False
    check: Callable[[Workspace, dict[str, Any]], None] | None = None

"""A session: reads a line, does it, keeps what was before. Whoever asks and shows stands outside."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, SessionError
from armwright.output import whole_file
from armwright.session.arguments import Argument, quoted, read_words, uncommented, words
from armwright.session.commands import COMMANDS, Command
from armwright.session.listing import Line, Listing, Shown
from armwright.session.shown import shown_variable
from armwright.session.state import State, load_arm, rest
from armwright.session.variables import VARIABLES, assigned, joint_number, near, same

ASSIGNMENT = re.compile(r"^(?P<name>[A-Za-z][\w-]*)\s*(?:\[(?P<index>[^\]]*)\])?\s*=(?!=)(?P<value>.*)$", re.DOTALL)
SHOWN = re.compile(r"^(?P<name>[A-Za-z][\w-]*)\s*(?:\[(?P<index>[^\]]*)\])?$")
MOST_STEPS_BACK = 100  # that undo can take
NOTHING = "none"  # what may be typed for an argument that is left out
DEEPEST = 20  # scripts that call scripts

Ask = Callable[[Argument, str | None], str]
"""(argument, what an empty answer stands for; None: it must be given) → the answer. EOFError: no more; the command is dropped."""


class Session:
    """The report's `sim` over one arm, line by line; the command line is a thin shell around it.

    Attributes:
        state: all that it knows now.   past: what it knew before each change.   recording: file that holds all lines so far.
        ask: who answers prompts; None in scripts, which give arguments in their place.
        tell: called with what is shown along the way.   progress: called with (steps done, steps there are) of long runs.
        ended: whether `quit` was said.
    """

    def __init__(self, robot: str = "cmu-dd", *, ask: Ask | None = None):
        """Begins with an arm, everything at zero.

        Args:
            robot: name of a built-in arm, or path of a file.   ask: who answers prompts; None: nobody.
        Raises:
            ArmwrightError: no such robot, or a file that cannot be believed.
        """
        self.state = rest(load_arm(robot)).replace(lines=(f"database-read robot={quoted(robot)}",))
        self.past: list[State] = []
        self.recording: Path | None = None
        self.ask = ask
        self.tell: Callable[[Shown], None] | None = None
        self.progress: Callable[[int, int], None] | None = None
        self.ended = False
        self.depth = 0
        self._line = ""

    def run(self, line: str) -> list[Shown]:
        """Does one line.

        Args:
            line: `theta = 0 30 deg …`, `theta`, or a command with its arguments; # begins a comment.
        Returns:
            shown: what it has to say.
        Raises:
            ArmwrightError: what is wrong with it, in one line; the session is as it was before.
            KeyboardInterrupt: it was interrupted; the session is as it was before.
        """
        text = uncommented(line)
        if not text:
            return []
        with np.errstate(all="ignore"):  # what is not finite is told in words where it matters
            return self._run(text)

    def _run(self, text: str) -> list[Shown]:
        assignment = ASSIGNMENT.match(text)
        if assignment and same(assignment["name"]) not in COMMANDS:
            return self._assign(assignment["name"], assignment["index"], assignment["value"], text)
        alone = SHOWN.match(text)
        if alone and same(alone["name"]) in VARIABLES:
            return self._show(alone["name"], alone["index"])
        first, *given = self._words(text)
        command = self._command(first)
        return self._do(command, text.partition(first)[2].strip(), given)

    def run_lines(self, lines: Iterable[str], place: str, show: Callable[[Shown], None], *, echo: bool = False) -> None:
        """Does the lines of a script, until one fails or `quit` is said.

        Args:
            lines: the script.   place: what errors call it.   show: takes what the lines have to say.
            echo: whether each line is shown before what it does.
        Raises:
            SessionError: place, number of the line and what is wrong with it.
        """
        if self.depth >= DEEPEST:
            raise SessionError(f"{place}: scripts call each other more than {DEEPEST} deep; expected one to end")
        self.depth += 1
        ask, self.ask = self.ask, None
        try:
            for k, line in enumerate(lines, 1):
                if echo and line.strip():
                    show(Line(f"sim> {line.strip()}", "dim"))
                try:
                    for shown in self.run(line):
                        show(shown)
                except ArmwrightError as error:
                    here = f"{place}: line {k}: "
                    if here in str(error):  # a script that calls itself; once is enough
                        raise
                    raise SessionError(f"{here}{error}") from error
                if self.ended:
                    return
        finally:
            self.ask = ask
            self.depth -= 1

    def change(self, state: State) -> None:
        """Goes on from another state, which undo comes back from."""
        self.past = [*self.past[-MOST_STEPS_BACK + 1 :], self.state]
        self.state = state
        self.write_record()

    def told_as(self, line: str) -> None:
        """What the command that is being done is recorded as, where that is not what was typed."""
        self._line = line

    def emit(self, listing: Listing) -> list[Shown]:
        """Shows a listing on the screen, or prints it into the open output file."""
        output = self.state.output
        if output is None:
            return list(listing.sheets)
        self.state = self.state.replace(output=output.printed(listing))
        rows = max((len(values) for values in listing.columns.values()), default=0)
        return [Line(f"printed {rows} row{'s' * (rows != 1)} into {output.path}", "good")]

    def write_record(self) -> None:
        """Writes all lines so far into the file that `record` named, whole or not at all."""
        if self.recording is not None:
            text = "".join(f"{line}\n" for line in self.state.lines)
            with whole_file(self.recording) as temporary:
                temporary.write_bytes(text.encode("utf-8"))

    def _words(self, text: str) -> list[str]:
        first = re.split(r"[\s(\[]", text, maxsplit=1)[0]
        command = COMMANDS.get(same(first))
        if command is not None and any(argument.kind == "rest" for argument in command.arguments):
            return [first]
        return words(text)

    def _command(self, name: str) -> Command:
        if same(name) in COMMANDS:
            return COMMANDS[same(name)]
        if same(name) in VARIABLES:
            raise SessionError(f"{name} is a variable; expected {name} = … to set it, or {name} alone to see it")
        known = [command.name for command in COMMANDS.values()] + [variable.name for variable in VARIABLES.values()]
        raise SessionError(f"no command or variable {name!r}; {near(name, known)}")

    def _assign(self, name: str, index: str | None, value: str, text: str) -> list[Shown]:
        if same(name) not in VARIABLES:
            known = [variable.name for variable in VARIABLES.values()]
            raise SessionError(f"no variable {name!r}; {near(name, known)}")
        index = None if index is None else index.strip()
        after = assigned(self.state, name, index, value)
        self.change(after.replace(lines=(*self.state.lines, text)))
        return []

    def _show(self, name: str, index: str | None) -> list[Shown]:
        if index is None:
            return shown_variable(self.state, VARIABLES[same(name)])
        variable = VARIABLES[same(name)]
        if variable.quantity is None:
            raise SessionError(f"{variable.name} is one number; expected {variable.name}, without [{index}]")
        return shown_variable(self.state, variable, joint_number(self.state.arm, variable.name, index.strip()))

    def _do(self, command: Command, rest_of_line: str, given: list[str]) -> list[Shown]:
        values, self._line = self._arguments(command, rest_of_line, given)
        if not command.recorded:
            return command.run(self, values)
        before, past = self.state, self.past
        try:
            shown = command.run(self, values)
            after, self.state = self.state, before
            lines = (*after.lines, self._line)
            if after is before:
                self.state = before.replace(lines=lines)
                self.write_record()
            else:
                self.change(after.replace(lines=lines))
        except BaseException:
            self.state, self.past = before, past
            raise
        return shown

    def _arguments(self, command: Command, rest_of_line: str, given: list[str]) -> tuple[dict[str, Any], str]:
        """The values of a command's arguments, asked for where someone answers, and the line that says all of them."""
        if command.arguments and command.arguments[0].kind == "rest":
            return {command.arguments[0].name: rest_of_line}, f"{command.name} {rest_of_line}".strip()
        texts = read_words(command.name, command.arguments, given, pairs=command.pairs)
        pairs = {name: texts.pop(name) for name in list(texts) if name not in {a.name for a in command.arguments}}
        values: dict[str, Any] = {"pairs": pairs} if command.pairs else {}
        told = []
        for argument in command.arguments:
            if command.ready is not None:
                command.ready(self, values)
            if not argument.wanted(values):
                if argument.name in texts:
                    raise SessionError(
                        f"{command.name}: {argument.name} = {texts[argument.name]!r} does not go with the rest"
                    )
                values[argument.name] = None
                continue
            text, value = self._one(command, argument, texts.get(argument.name), values, asked=not given)
            values[argument.name] = value
            if text and text != argument.default:
                told.append(f"{argument.name}={quoted(text)}")
        told += [f"{name}={quoted(text)}" for name, text in pairs.items()]
        return values, " ".join([command.name, *told])

    def _one(
        self, command: Command, argument: Argument, text: str | None, values: dict[str, Any], *, asked: bool
    ) -> tuple[str, Any]:
        default = argument.default_beside(values)
        if text is None and self.ask is not None and argument.prompt and (asked or default is None):
            return self._answer(command, argument, default)
        if text is None or (text == NOTHING and argument.prompt and default == ""):
            text = default
        if text is None:
            expected = " or ".join(argument.choices) or f"{argument.name}=…"
            raise SessionError(f"{command.name}: {argument.name} is missing: {argument.help}; expected {expected}")
        return text, argument.read(command.name, text) if text else None

    def _answer(self, command: Command, argument: Argument, default: str | None) -> tuple[str, Any]:
        """The answer to a prompt; asked again until there is one that can be read."""
        assert self.ask is not None
        while True:
            try:
                text = self.ask(argument, default).strip()
            except EOFError:
                raise SessionError(f"{command.name}: not done") from None
            if text in ("", NOTHING) and default is not None:
                text = default
            try:
                if not text and default is None:
                    raise SessionError(f"{argument.name} is needed: {argument.help}")
                return text, argument.read(command.name, text) if text else None
            except SessionError as error:
                if self.tell is not None:
                    self.tell(Line(str(error), "bad"))

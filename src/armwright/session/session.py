"""A session: reads a line, executes it, and stores the state before it. Prompts and output belong to its caller."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError, SessionError
from armwright.session.arguments import Argument, quoted, read_words, same, uncommented, unknown, words
from armwright.session.commands import COMMANDS
from armwright.session.listing import Output, TextLine
from armwright.session.variables import VARIABLES, assigned, joint_number, remarks, variable_output
from armwright.session.workspace import Ask, SessionCommand, Workspace

ASSIGNMENT = re.compile(r"^(?P<name>[A-Za-z][\w-]*)\s*(?:\[(?P<index>[^\]]*)\])?\s*=(?!=)(?P<value>.*)$", re.DOTALL)
NAME = re.compile(r"^(?P<name>[A-Za-z][\w-]*)\s*(?:\[(?P<index>[^\]]*)\])?$")
NOTHING = "none"  # may be typed for an argument that is left out
LEAVING = ("exit", "quit")  # as an answer: back to the prompt of the session; ./exit is a file of that name
MAX_DEPTH = 20  # scripts that call scripts


class Session(Workspace):
    """The report's `sim` over one arm, line by line; the command line is a thin layer around it."""

    def __init__(self, robot: str = "cmu-dd", *, ask: Ask | None = None):
        """Starts with an arm, everything at zero.

        Args:
            robot: name of a built-in arm, or path of a file.   ask: answers prompts; None: nobody does.
        Raises:
            ArmwrightError: no such robot, or an invalid file.
        """
        super().__init__(robot, COMMANDS, ask)
        self.depth = 0

    def run(self, line: str) -> list[Output]:
        """Does one line.

        Args:
            line: `theta = 0 30 deg …`, `theta`, or a command with its arguments; # begins a comment.
        Returns:
            output: lines, tables and drawings.
        Raises:
            ArmwrightError: what is wrong with it; the session is as it was before.
            KeyboardInterrupt: it was interrupted; the session is as it was before.
        """
        text = uncommented(line)
        if not text:
            return []
        with np.errstate(all="ignore"):  # numbers that are not finite are refused where they matter
            assignment, name = ASSIGNMENT.match(text), NAME.match(text)
            if assignment and same(assignment["name"]) not in COMMANDS:
                return self._assign(assignment["name"], assignment["index"], assignment["value"], text)
            if name and same(name["name"]) in VARIABLES:
                return self._variable(name["name"], name["index"])
            first = re.split(r"[\s(\[]", text, maxsplit=1)[0]
            command = COMMANDS.get(same(first))
            if command is not None and any(argument.kind == "rest" for argument in command.arguments):
                line_words = [first]
            else:
                first, *line_words = words(text)
                command = self._command(first)
            return self._do(command, text.partition(first)[2].strip(), line_words)

    def run_lines(self, lines: Iterable[str], file: str, show: Callable[[Output], None], *, echo: bool = False) -> None:
        """Does the lines of a script, until one fails or `quit` is reached.

        Args:
            lines: the script.   file: its name in errors.   show: takes the output of the lines.
            echo: True to show each line before its output.
        Raises:
            SessionError: with `file:line` before the file, if any, of the error itself.
        """
        if self.depth >= MAX_DEPTH:
            raise SessionError(f"scripts call each other more than {MAX_DEPTH} deep", file=file, expected="one to end")
        self.depth += 1
        ask, self.ask = self.ask, None
        try:
            for k, line in enumerate(lines, 1):
                if echo and line.strip():
                    show(TextLine(f"sim> {line.strip()}", "dim"))
                try:
                    for output in self.run(line):
                        show(output)
                except ArmwrightError as error:
                    raise _in_script(error, f"{file}:{k}") from error
                if self.ended:
                    return
        finally:
            self.ask = ask
            self.depth -= 1

    def _command(self, name: str) -> SessionCommand:
        if same(name) in COMMANDS:
            return COMMANDS[same(name)]
        if same(name) in VARIABLES:
            raise SessionError("a variable", value=name, expected=f"{name} = … to set it, or {name} alone to see it")
        known = [entry.name for entry in (*COMMANDS.values(), *VARIABLES.values())]
        raise unknown("no such command or variable", name, known)

    def _assign(self, name: str, index: str | None, value: str, text: str) -> list[Output]:
        if same(name) not in VARIABLES:
            raise unknown("no such variable", name, [variable.name for variable in VARIABLES.values()])
        after = assigned(self.state, name, None if index is None else index.strip(), value)
        self.change(after.replace(lines=(*self.state.lines, text)))
        return remarks(self.state, VARIABLES[same(name)], value)

    def _variable(self, name: str, index: str | None) -> list[Output]:
        variable = VARIABLES[same(name)]
        if index is None:
            return variable_output(self.state, variable)
        variable.check_index(index)
        return variable_output(self.state, variable, joint_number(self.state.arm, variable.name, index.strip()))

    def _do(self, command: SessionCommand, behind: str, line_words: list[str]) -> list[Output]:
        values, self.recorded_line = self._arguments(command, behind, line_words)
        if not command.recorded:
            return command.run(self, values)
        before, undo_stack = self.state, self.undo_stack
        try:
            output = command.run(self, values)
            after, self.state = self.state, before
            lines = (*after.lines, self.recorded_line)
            if after is before:
                self.state = before.replace(lines=lines)
                self.write_recording()
            else:
                self.change(after.replace(lines=lines))
        except BaseException:
            self.state, self.undo_stack = before, undo_stack
            raise
        return output

    def _arguments(self, command: SessionCommand, behind: str, line_words: list[str]) -> tuple[dict[str, Any], str]:
        """Values of a command's arguments, with prompts if possible, and the line with all of them."""
        if command.arguments and command.arguments[0].kind == "rest":
            return {command.arguments[0].name: behind}, f"{command.name} {behind}".strip()
        texts = read_words(command.name, command.arguments, line_words, pairs=command.pairs)
        pairs = {name: texts.pop(name) for name in list(texts) if name not in {a.name for a in command.arguments}}
        values: dict[str, Any] = {"pairs": pairs} if command.pairs else {}
        recorded = {}
        for argument in command.arguments:
            if command.check is not None:
                command.check(self, values)
            if not argument.wanted(values):
                if argument.name in texts:
                    place, text = f"{command.name} {argument.name}", texts[argument.name]
                    raise SessionError("does not go with the rest", place=place, value=text)
                values[argument.name] = None
                continue
            text, value = self._one(command, argument, texts.get(argument.name), values, asked=not line_words)
            values[argument.name] = value
            if text and text != argument.default:
                recorded[argument.name] = text
        return values, " ".join(
            [command.name, *(f"{name}={quoted(text)}" for name, text in {**recorded, **pairs}.items())]
        )

    def _one(
        self,
        command: SessionCommand,
        argument: Argument,
        text: str | None,
        values: dict[str, Any],
        *,
        asked: bool,
    ) -> tuple[str, Any]:
        """Text and value of one argument."""
        default = argument.default_for(values)
        if text is None and self.ask is not None and argument.prompt and (asked or default is None):
            return self._answer(self.ask, command, argument, default)
        if text is None or (text == NOTHING and argument.prompt and default == ""):
            text = default
        if text is None or (not text and default is None):
            expected = " or ".join(argument.choices) or f"{argument.name}=…, {argument.help}"
            raise SessionError("missing", place=f"{command.name} {argument.name}", expected=expected)
        return text, argument.read(command.name, text) if text else None

    def _answer(self, ask: Ask, command: SessionCommand, argument: Argument, default: str | None) -> tuple[str, Any]:
        """The answer to a prompt; repeated until valid."""
        while True:
            try:
                text = ask(argument, default).strip()
            except EOFError:
                raise SessionError("not done", place=command.name) from None
            if same(text) in LEAVING:
                raise SessionError("not done", place=command.name)
            if text in ("", NOTHING) and default is not None:
                text = default
            try:
                if not text and default is None:
                    raise SessionError("missing", place=f"{command.name} {argument.name}", expected=argument.help)
                return text, argument.read(command.name, text) if text else None
            except SessionError as error:
                if self.show is not None:
                    self.show(TextLine(str(error), "bad"))


def _in_script(error: ArmwrightError, place: str) -> ArmwrightError:
    """The error with the line of a script before the files that it names; a script that calls itself is named once."""
    problems = []
    for problem in error.problems:
        files = problem.file.split(": ") if problem.file else []
        problems.append(replace(problem, file=": ".join([*([place] if place not in files else []), *files])))
    return SessionError.of(*problems)

"""A session at a terminal: a prompt with history and completion, errors in one line, Ctrl-C back to the prompt."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any

from prompt_toolkit import PromptSession
from prompt_toolkit.completion import CompleteEvent, Completer, Completion, PathCompleter
from prompt_toolkit.document import Document
from prompt_toolkit.enums import EditingMode
from prompt_toolkit.history import FileHistory, History, InMemoryHistory

import armwright as aw
from armwright.errors import ArmwrightError, SessionError
from armwright.session.arguments import Argument, read_words, same
from armwright.session.controllers import gain_names, laws
from armwright.session.formulas import ACCEPTED
from armwright.session.listing import Output, Screen, TextLine
from armwright.session.variables import TABLE as VARIABLE_TABLE, VARIABLES
from armwright.session.workspace import Ask, SessionCommand, Workspace

HISTORY = "sim.history"  # file of earlier lines
INDEX = re.compile(r"(?P<name>[A-Za-z][\w-]*)\[(?P<typed>[^\]\s]*)$")
VALUE = re.compile(r"^\s*(?P<name>[A-Za-z][\w-]*)\s*(?:\[[^\]]*\])?\s*=.*?(?P<typed>[A-Za-z_]*)$", re.DOTALL)
WELCOME = "help lists all commands, tour is for newcomers, Tab completes, Ctrl-D leaves"


def interact(session: Workspace, screen: Screen, **options: Any) -> None:
    """Asks for lines and does them, until `quit` or the end of input.

    Args:
        session: does them.   screen: shows their output.   options: of prompt_toolkit's PromptSession: input, output.
    """
    prompt: PromptSession[str] = PromptSession(
        history=LineHistory(), completer=SessionCompleter(session), complete_while_typing=False,
        editing_mode=EditingMode.EMACS, **options,
    )  # fmt: skip
    session.ask = _asking(session, options)
    session.show = screen
    arm = session.state.arm
    screen(TextLine(f"{arm.name}: {arm.n} joints {', '.join(arm.names)}", "head"))
    screen(TextLine(WELCOME, "dim"))
    while not session.ended:
        try:
            line = prompt.prompt("sim> ")
        except KeyboardInterrupt:
            continue
        except EOFError:
            line = "quit"
        with _reporting(screen), _progress(session, screen):
            for output in session.run(line):
                screen(output)


@contextlib.contextmanager
def _reporting(screen: Screen) -> Iterator[None]:
    """Shows whatever goes wrong with a line; the session continues."""
    try:
        yield
    except ArmwrightError as error:
        screen.error(error)
    except KeyboardInterrupt:
        screen(TextLine("interrupted; nothing has changed", "note"))
    except MemoryError:
        screen.error("not enough memory")


@contextlib.contextmanager
def _progress(session: Workspace, screen: Screen) -> Iterator[None]:
    """A bar for runs that take longer than a moment."""
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    columns = (TextColumn("simulating"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=screen.console, transient=True, disable=not screen.console.is_terminal)
    task = bar.add_task("simulating", total=None)

    def progress(done: int, steps: int) -> None:
        if not bar.live.is_started and done < steps:
            bar.start()
        bar.update(task, completed=done, total=steps)
        if done >= steps:
            bar.stop()

    def show(output: Output) -> None:
        bar.stop()
        screen(output)

    session.progress, session.show = progress, show
    try:
        yield
    finally:
        bar.stop()
        session.progress, session.show = None, screen


def _asking(session: Workspace, options: dict[str, Any]) -> Ask:
    """A function that prompts for an argument, with completion of its values and without history."""

    def ask(argument: Argument, default: str | None) -> str:
        prompt: PromptSession[str] = PromptSession(
            completer=AnswerCompleter(session, argument), complete_while_typing=False, **options
        )
        choices = f" {'/'.join(argument.choices)}" if argument.choices else ""
        enter = (
            f" [{default}]" if default else f" (Enter: {argument.enter})" if default == "" and argument.enter else ""
        )
        return prompt.prompt(f"  {argument.prompt}{choices}{enter} ")

    return ask


class SessionCompleter(Completer):
    """Completions at the cursor of the prompt."""

    def __init__(self, session: Workspace):
        """Args:
        session: whose arm and variables are offered.
        """
        self.session = session
        self.paths = PathCompleter(expanduser=True)

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        """Completions of the text before the cursor."""
        text = document.text_before_cursor
        index = INDEX.search(text)
        if index and same(index["name"]) in VARIABLES:
            yield from _matching(self.session.state.arm.names, index["typed"], "joint", "]")
            return
        head, blank, behind = text.lstrip().partition(" ")
        if not blank:
            yield from self._names(head)
            return
        command = self.session.commands.get(same(head))
        value = VALUE.match(text)
        if command is None:
            if value and same(value["name"]) in VARIABLES:
                yield from self._in_values(value["name"], value["typed"])
            return
        yield from self._arguments(command, behind, complete_event)

    def _in_values(self, name: str, typed: str) -> Iterator[Completion]:
        """Units that fit, and variables."""
        units = dict.fromkeys(VARIABLES[same(name)].units(self.session.state.arm))
        yield from _matching([u for unit in units for u in ACCEPTED.get(unit, {}) if u.isascii()], typed, "unit")
        yield from _matching([*(variable.name for variable in VARIABLE_TABLE), "pi"], typed, "variable")

    def _arguments(self, command: SessionCommand, behind: str, event: CompleteEvent) -> Iterator[Completion]:
        typed = behind.rsplit(" ", 1)[-1]
        before = behind.split()[: len(behind.split()) - (1 if typed else 0)]
        head, sign, value = typed.partition("=")
        if sign:
            named = [argument for argument in command.arguments if same(argument.name) == same(head)]
            for argument in named:
                yield from self.values(argument, value.lstrip('"'), event)
            return
        try:
            typed_names = {
                same(name) for name in read_words(command.name, command.arguments, before, pairs=command.pairs)
            }
        except SessionError:  # nothing can be added to a wrong line
            return
        free = [a for a in command.arguments if same(a.name) not in typed_names and a.kind != "rest"]
        if free:
            yield from self.values(free[0], typed, event)
        if typed or before or len(free) > 1:
            names = [argument.name for argument in free]
            names += [name for name in self._pairs(command, before) if same(name) not in typed_names]
            yield from _matching([f"{name}=" for name in names], typed, "argument")

    def _pairs(self, command: SessionCommand, before: list[str]) -> list[str]:
        """Further names that a command takes: the gains of a controller."""
        kinds = {same(name): kind for name, kind in laws().items()} if command.pairs else {}
        return next((gain_names(kinds[same(word)]) for word in before if same(word) in kinds), [])

    def values(self, argument: Argument, typed: str, event: CompleteEvent) -> Iterator[Completion]:
        """Values of an argument."""
        arm = self.session.state.arm
        choices: dict[str, list[str]] = {
            "choice": list(argument.choices), "frame": list(arm.frames), "robot": aw.builtin_names(),
            "text": self._texts(argument.name),
        }  # fmt: skip
        yield from _matching(choices.get(argument.kind, []), typed, argument.name)
        if argument.kind in ("file", "robot"):
            for path in self.paths.get_completions(Document(typed), event):
                yield Completion(path.text, path.start_position, display=path.display, display_meta="file")

    def _texts(self, name: str) -> list[str]:
        """Words that free arguments may take."""
        variables = [variable.name for variable in VARIABLE_TABLE]
        if name == "topic":
            return [*(command.name for command in self.session.commands.values()), *variables, "symbols"]
        return variables if name == "name" else [*laws(), "none"] if name == "kind" else []

    def _names(self, typed: str) -> Iterator[Completion]:
        """Variables and commands."""
        meanings = {variable.name: variable.meaning for variable in VARIABLE_TABLE}
        meanings |= {command.name: command.summary for command in self.session.commands.values()}
        for name, meaning in meanings.items():
            if same(name).startswith(same(typed)):
                yield Completion(name, -len(typed), display_meta=meaning)


class AnswerCompleter(Completer):
    """Completions of the answer to a prompt."""

    def __init__(self, session: Workspace, argument: Argument):
        """Args:
        session: as above.   argument: that is asked for.
        """
        self.of_line, self.argument = SessionCompleter(session), argument

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        """Completions of the answer before the cursor."""
        yield from self.of_line.values(self.argument, document.text_before_cursor, complete_event)


def _matching(names: Iterable[str], typed: str, meta: str, end: str = "") -> Iterator[Completion]:
    for name in names:
        if name.lower().startswith(typed.lower()):
            yield Completion(name + end, -len(typed), display=name, display_meta=meta)


class LineHistory(History):
    """Lines of earlier sessions for the arrow keys, stored beside the cache of compiled code; without a cache in memory only."""

    @cached_property
    def kept(self) -> History:
        """Storage of the lines, opened when the prompt appears."""
        from armwright.kernels.cache import cache_folder  # late: it loads LLVM

        folder = cache_folder()
        return InMemoryHistory() if folder is None else FileHistory(str(folder / HISTORY))

    def load_history_strings(self) -> Iterable[str]:
        """Lines of earlier sessions, the last one first."""
        try:
            return list(self.kept.load_history_strings())
        except OSError:
            self.kept = InMemoryHistory()
            return []

    def store_string(self, string: str) -> None:
        """Stores a line; a full disk does not end the session."""
        try:
            self.kept.store_string(string)
        except OSError:
            self.kept = InMemoryHistory()

"""A session at a terminal: a prompt with history and completion, errors in one line, Ctrl-C back to the prompt."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from armwright.errors import ArmwrightError
from armwright.session.arguments import Argument
from armwright.session.listing import Line, Shown
from armwright.session.screen import Screen

if TYPE_CHECKING:
    from prompt_toolkit import PromptSession

    from armwright.session.session import Session

WELCOME = "help lists all commands, tour is for newcomers, Tab completes, Ctrl-D leaves"


def interact(session: Session, screen: Screen, **options: Any) -> None:
    """Asks for lines and does them, until `quit` or the end of input.

    Args:
        session: what does them.   screen: what shows them.   options: of prompt_toolkit's PromptSession: input, output.
    """
    from prompt_toolkit import PromptSession
    from prompt_toolkit.enums import EditingMode

    from armwright.session.completion import SessionCompleter
    from armwright.session.history import Lines

    prompt: PromptSession[str] = PromptSession(
        history=Lines(), completer=SessionCompleter(session), complete_while_typing=False,
        editing_mode=EditingMode.EMACS, **options,
    )  # fmt: skip
    session.ask = _asking(session, screen, options)
    session.tell = screen
    arm = session.state.arm
    screen(Line(f"{arm.name}: {arm.n} joints {', '.join(arm.names)}", "head"))
    screen(Line(WELCOME, "dim"))
    while not session.ended:
        try:
            line = prompt.prompt("sim> ")
        except KeyboardInterrupt:
            continue
        except EOFError:
            break
        with _told(screen), _progress(session, screen):
            for shown in session.run(line):
                screen(shown)


@contextlib.contextmanager
def _told(screen: Screen) -> Iterator[None]:
    """Whatever goes wrong with a line is told, and the session goes on."""
    try:
        yield
    except ArmwrightError as error:
        screen.error(str(error))
    except KeyboardInterrupt:
        screen(Line("interrupted; nothing has changed", "note"))
    except MemoryError:
        screen.error("not enough memory")


@contextlib.contextmanager
def _progress(session: Session, screen: Screen) -> Iterator[None]:
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

    def tell(shown: Shown) -> None:
        bar.stop()
        screen(shown)

    session.progress, session.tell = progress, tell
    try:
        yield
    finally:
        bar.stop()
        session.progress, session.tell = None, screen


def _asking(session: Session, screen: Screen, options: dict[str, Any]) -> Any:
    """Prompts for arguments, with completion of their own and without history."""
    from prompt_toolkit import PromptSession

    from armwright.session.completion import AnswerCompleter

    def ask(argument: Argument, default: str | None) -> str:
        prompt: PromptSession[str] = PromptSession(
            completer=AnswerCompleter(session, argument), complete_while_typing=False, **options
        )
        choices = f" {'/'.join(argument.choices)}" if argument.choices else ""
        told = f" [{default}]" if default else f" (Enter: {argument.enter})" if default == "" and argument.enter else ""
        return prompt.prompt(f"  {argument.prompt}{choices}{told} ")

    return ask

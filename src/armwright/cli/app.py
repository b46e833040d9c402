"""The list of commands. Errors end as one line on stderr and exit code 2, never as a traceback."""

from __future__ import annotations

import contextlib
import contextvars
import errno
import functools
import importlib
import inspect
import os
import sys
import traceback
from collections.abc import Callable
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from armwright import __version__
from armwright.cli.json_output import with_json
from armwright.cli.spelling import Spelled, UsageError, global_first, without_types
from armwright.errors import ArmwrightError, RunStopped
from armwright.other_names import HERE_IT_IS
from armwright.terminal import be_quiet, note, say

_with_traceback = contextvars.ContextVar("traceback", default=False)
NARROW = 76  # columns of an example
LONGEST = 2500  # characters of an error: a word that was typed may have any length


PANELS = {
    "Describe an arm": "robots servos info new check show diff convert parts assemble",
    "Compute": "inverse-dynamics forward-dynamics ik workspace plan",
    "Simulate": "simulate sim plot animate step-study reproduce",
    "Identify": "excite log identify calibrate measure validate",
    "Control": "design loops tune sweep compare-controllers",
    "Deploy": "export twin run-controller capture shadow",
    "Learn": "examples",
}
PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names.split()}
OPTION_PANELS = {  # of commands for both kinds of arms
    "On a CAN bus": "--bus --nodes --bitrate --eds --write-eds --real-time --missing --serial-number --fault",
    "On a line of servos": "--serial --calibration --servo --ids --baud --zero --reverse --goal-distance --approach "
    "--patience --period --tick --start --write-schedule --output",
}
MODULES = {
    "inverse-dynamics": "dynamics",
    "forward-dynamics": "dynamics",
    "run-controller": "twin",
}  # others: as their name
OTHER_WORDS = {  # what other programs have as commands, and functions of Python whose commands have other names
    "version": "--version",
    "help": "--help",
    "inverse_kinematics": "ik",
    "manipulability": "workspace",
}
DRAWN = ("show", "plot", "animate", "sim")  # these draw, or converse: --json would have nothing to write


class Commands(TyperGroup):
    """Command group that shows errors in one line, or several mistakes of a file in one line each.

    A command is imported and its options are built when it is asked for.
    """

    @property
    def commands(self) -> dict[str, Any]:
        """Every command by its name."""
        return {name: self.get_command(None, name) for name in PANEL_OF}

    @commands.setter
    def commands(self, none: dict[str, Any]) -> None:
        """Typer has none to give."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of `PANELS`."""
        return list(PANEL_OF)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command or group of that name; None where there is none."""
        return made(cmd_name) if cmd_name in PANEL_OF else None

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Lists the commands by what is said of them, without their options."""
        listed: Any = {name: TyperCommand(name, help=about(name), rich_help_panel=PANEL_OF[name]) for name in PANEL_OF}
        listing = TyperGroup(
            name=self.name, commands=listed, params=self.params, help=self.help, rich_markup_mode="rich"
        )
        listing.list_commands = self.list_commands  # type: ignore[method-assign]
        without_types(self.get_params(ctx))
        listing.format_help(ctx, formatter)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that the first word names; words that other programs have as commands are answered with ours."""
        if args and args[0] not in PANEL_OF and (meant := _meant(args[0])):
            raise UsageError(f"No such command {args[0]!r}. {meant}", ctx=ctx)
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Runs the command; Ctrl-C outside of work that keeps what it has found is said, exit code 130."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as stop:  # of ours with what it means
            note(f"stopped by Ctrl-C {stop}".rstrip())
            raise typer.Exit(130) from None

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Reads options of the whole program wherever they stand, and the name of a command."""
        return super().parse_args(ctx, global_first(list(args)))

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Runs a command; ends the process with its exit code. What --quiet and --traceback set ends with it."""
        return contextvars.copy_context().run(self._run, *args, standalone_mode=standalone_mode, **extra)

    def _run(self, *args: Any, standalone_mode: bool, **extra: Any) -> Any:
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):
                stream.reconfigure(errors="replace")  # a console without τ and ² shows ? for them
        try:
            code = super().main(*args, standalone_mode=False, **extra)
            sys.stdout.flush()  # here, where a full disk can still be reported
        except ArmwrightError as error:
            code = _fail(str(error), 1 if isinstance(error, RunStopped) else 2)
        except UsageError as error:
            where = error.ctx.command_path if error.ctx is not None else "armwright"
            code = _fail(f"{_usage_text(error)} (see {where} --help)")
        except typer.Abort:
            code = 130
        except SystemExit as stop:  # typer and rich end the process like that where a pipe's reader has gone
            if not isinstance(stop.__context__, BrokenPipeError):
                raise
            code = _reader_gone()
        except BrokenPipeError:
            code = _reader_gone()
        except MemoryError as error:
            code = _fail(f"not enough memory{': ' if str(error) else ''}{error}")
        except OSError as error:
            code = _fail(_os_error_text(error))
        if standalone_mode:
            sys.exit(code if isinstance(code, int) else 0)
        return code


def _meant(word: str) -> str:
    """A sentence with the commands that a word may mean, else with the function of Python; "" if it means neither."""
    import armwright as aw

    here = word.replace("-", "_")
    if here not in dir(aw):
        try:
            getattr(aw, here)
        except AttributeError as error:  # which knows the names of other toolboxes
            here = str(error).partition(HERE_IT_IS)[2]
    name = here.rpartition(".")[2]
    command = OTHER_WORDS.get(word, OTHER_WORDS.get(name, name.replace("_", "-")))
    commands = [command] if command in PANEL_OF or word in OTHER_WORDS else []
    commands = commands or [each for each in PANEL_OF if word in each.split("-")]
    if commands:
        return f"Did you mean {', '.join(map(repr, commands))}?"
    return f"In Python it is aw.{here}" if here else ""


def _usage_text(error: Any) -> str:
    """The error of a command line; of a group without a command with the commands that there are."""
    text, commands = error.format_message(), getattr(error.ctx and error.ctx.command, "commands", {})
    return f"{text[:-1]}; expected one of {', '.join(commands)}" if text == "Missing command." else text


def _os_error_text(error: OSError) -> str:
    """An error of the operating system; files have their own errors, so without a name it was standard output."""
    if error.errno == errno.ENOMEM:
        return "not enough memory"
    if error.filename is None:
        _silence()
        return f"standard output: cannot be written: {error.strerror or error}"
    return f"{error.filename}: {error.strerror}"


def _reader_gone() -> int:
    """Ends `armwright … | head` quietly, with the exit code of a command that SIGPIPE ends."""
    _silence()
    return 141


def _silence() -> None:
    """Discards the rest of standard output's buffer, on which Python would fail again at its end."""
    with contextlib.suppress(OSError, ValueError):  # ValueError: a stand-in without a file, as in tests
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _fail(message: str, code: int = 2) -> int:
    """Shows an error, further mistakes of a file on lines of their own, and gives the exit code."""
    if _with_traceback.get():
        traceback.print_exc()
    lines = [" ".join(line.split()) for line in message.split("\n  ")]
    shown = [line if len(line) <= LONGEST else f"{line[:LONGEST]}…" for line in lines]
    say("\n  ".join([f"armwright: error: {shown[0]}", *shown[1:]]), err=True)
    return code


app = typer.Typer(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        say(f"armwright {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _commands(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and stop.")
    ] = False,
    quiet: Annotated[
        bool,
        typer.Option("--quiet", help="Only errors, and the result that was asked for: a file, else what is shown."),
    ] = False,
    with_traceback: Annotated[
        bool, typer.Option("--traceback", help="With an error its traceback, for a report.")
    ] = False,
) -> None:
    """Models, simulates, identifies and controls robot arms with their motors.

    ROBOT is the name of a built-in arm (see `armwright robots`) or the path of its TOML, URDF or MJCF file.

    \b
    Try:
      armwright robots
      armwright simulate cmu-dd --voltage 5 --duration 1 --plot run.png
      armwright new robot my-arm.toml --from my-arm.urdf
      armwright examples copy examples
    """
    if quiet:
        be_quiet()
    _with_traceback.set(with_traceback)
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def entry(name: str) -> Callable[..., None] | typer.Typer:
    """The function of a command, or the commands of a group."""
    identifier = name.replace("-", "_")
    return getattr(importlib.import_module(f"armwright.cli.{MODULES.get(name, identifier)}"), identifier)


def about(name: str) -> str:
    """Help text of a command or a group."""
    said = entry(name)
    if isinstance(said, typer.Typer):
        said = said.registered_callback.callback if said.registered_callback is not None else said.info.help
    return _unwrapped(said if isinstance(said, str) else said.__doc__ or "")


@functools.cache
def made(name: str) -> Any:
    """The command or the group of that name with its options."""
    found = entry(name)
    if not isinstance(found, typer.Typer):
        alone = typer.Typer(add_completion=False, rich_markup_mode="rich")
        callback = found if name in DRAWN else with_json(found, name)
        alone.command(name, cls=Spelled, help=about(name), rich_help_panel=PANEL_OF[name])(callback)
        command = typer.main.get_command(alone)
        if name in ("twin", "run-controller"):
            panels = {option: panel for panel, options in OPTION_PANELS.items() for option in options.split()}
            for each in (each for each in command.params if each.param_type_name == "option"):
                each.rich_help_panel = panels.get(each.opts[0])  # type: ignore[attr-defined]
        return command
    for command in found.registered_commands:
        assert command.callback is not None
        command.cls = Spelled
        command.help = _unwrapped(command.callback.__doc__ or "")
        command.name = command.name or command.callback.__name__.replace("_", "-")
        command.callback = with_json(command.callback, f"{name} {command.name}")
    group = typer.main.get_group(found)
    group.rich_help_panel = PANEL_OF[name]
    return group


def _unwrapped(text: str) -> str:
    """Paragraphs without the source's line breaks, so that they fill the terminal; those marked \\b stay as they are."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(_folded(part) if part.startswith("\b") else " ".join(part.split()) for part in paragraphs)


def _folded(examples: str) -> str:
    """Command lines that go on in a further line where a terminal of 80 columns would break them."""
    lines = []
    for line in examples.splitlines():
        while len(line) > NARROW and (place := line.rfind(" -", 4, NARROW - 2)) > 0:
            lines.append(f"{line[:place]} \\")
            line = f"      {line[place:].strip()}"
        lines.append(line)
    return "\n".join(lines)

"""The list of commands. Errors end as one line on stderr and exit code 2, never as a traceback."""

from __future__ import annotations

import contextlib
import errno
import inspect
import os
import sys
from collections.abc import Callable
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from armwright import __version__
from armwright.cli.animate import animate
from armwright.cli.assemble import assemble
from armwright.cli.calibrate import calibrate
from armwright.cli.capture import capture
from armwright.cli.check import check
from armwright.cli.compare_controllers import compare_controllers
from armwright.cli.convert import convert
from armwright.cli.design import design
from armwright.cli.diff import diff
from armwright.cli.dynamics import forward_dynamics, inverse_dynamics
from armwright.cli.examples import examples
from armwright.cli.excite import excite
from armwright.cli.export import export
from armwright.cli.identify import identify
from armwright.cli.ik import ik
from armwright.cli.info import info
from armwright.cli.json_output import with_json
from armwright.cli.log import log
from armwright.cli.loops import loops
from armwright.cli.measure import measure
from armwright.cli.new import new
from armwright.cli.parts import parts
from armwright.cli.plan import plan
from armwright.cli.plot import plot
from armwright.cli.reproduce import reproduce
from armwright.cli.robots import robots
from armwright.cli.servos import servos
from armwright.cli.shadow import shadow
from armwright.cli.show import show
from armwright.cli.sim import sim
from armwright.cli.simulate import simulate
from armwright.cli.step_study import step_study
from armwright.cli.sweep import sweep
from armwright.cli.tune import tune
from armwright.cli.twin import run_controller, twin
from armwright.cli.validate import validate
from armwright.cli.workspace import workspace
from armwright.errors import ArmwrightError, RunStopped
from armwright.terminal import say

LONGEST = 2500  # characters of an error: a word that was typed may have any length
UsageError: Any = typer.BadParameter.__mro__[1]  # typer keeps it to itself


class Commands(TyperGroup):
    """Command group that shows errors in one line, or several mistakes of a file in one line each."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names in the order of `PANELS`; typer would put the groups behind all commands."""
        known = super().list_commands(ctx)
        return sorted(known, key=ORDER.index)

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Runs a command; ends the process with its exit code."""
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
            code = _fail(f"{error.format_message()} (see {where} --help)")
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
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


PANELS: dict[str, tuple[Callable[..., None] | typer.Typer, ...]] = {
    "Describe an arm": (robots, servos, info, new, check, show, diff, convert, parts, assemble),
    "Compute": (inverse_dynamics, forward_dynamics, ik, workspace, plan),
    "Simulate": (simulate, sim, plot, animate, step_study, reproduce),
    "Identify": (excite, log, identify, calibrate, measure, validate),
    "Control": (design, loops, tune, sweep, compare_controllers),
    "Deploy": (export, twin, run_controller, capture, shadow),
    "Learn": (examples,),
}
ORDER: list[str] = []
DRAWN = (show, plot, animate, sim)  # these draw, or converse: --json would have nothing to write
WRITTEN = (new, examples)  # these write or list files


def _unwrapped(text: str) -> str:
    """Paragraphs without the source's line breaks, so that they fill the terminal; those marked \\b stay as they are."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(part if part.startswith("\b") else " ".join(part.split()) for part in paragraphs)


for panel, entries in PANELS.items():
    for entry in entries:
        if isinstance(entry, typer.Typer):
            app.add_typer(entry, rich_help_panel=panel)
            ORDER.append(str(entry.info.name))
        else:
            app.command(rich_help_panel=panel)(entry)
            ORDER.append(entry.__name__.replace("_", "-"))
for commands in (app, examples, excite, export, identify, measure, new, parts):
    for command in commands.registered_commands:
        assert command.callback is not None
        command.help = _unwrapped(command.callback.__doc__ or "")
        command.name = command.name or command.callback.__name__.replace("_", "-")
        if command.callback not in DRAWN and commands not in WRITTEN:
            group = "" if commands is app else f"{commands.info.name} "
            command.callback = with_json(command.callback, group + command.name)

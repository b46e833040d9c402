"""The list of commands, and how errors end: one line on stderr and exit code 2, never a traceback."""

from __future__ import annotations

import sys
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from armwright import __version__
from armwright.cli.export import export
from armwright.cli.forward import forward
from armwright.cli.info import info
from armwright.cli.inverse import inverse
from armwright.cli.robots import robots
from armwright.cli.simulate import simulate
from armwright.errors import ArmwrightError

UsageError: Any = typer.BadParameter.__mro__[1]  # typer keeps it to itself


class Commands(TyperGroup):
    """Commands whose errors are told in one line."""

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Runs a command; ends the process with its exit code."""
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, TextIOWrapper):
                stream.reconfigure(errors="replace")  # a console without τ and ² shows ? for them
        try:
            code = super().main(*args, standalone_mode=False, **extra)
        except ArmwrightError as error:
            code = _tell(str(error))
        except UsageError as error:
            where = error.ctx.command_path if error.ctx is not None else "armwright"
            code = _tell(f"{error.format_message()} (see {where} --help)")
        except typer.Abort:
            code = 130
        if standalone_mode:
            sys.exit(code if isinstance(code, int) else 0)
        return code


def _tell(message: str) -> int:
    print(f"armwright: error: {' '.join(message.split())}", file=sys.stderr)
    return 2


app = typer.Typer(cls=Commands, add_completion=False, rich_markup_mode="rich", pretty_exceptions_enable=False)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"armwright {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def _commands(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and stop.")
    ] = False,
) -> None:
    """Models and simulates robot arms, from the parts of an arm to the code that runs it.

    ROBOT is the name of a built-in arm (see `armwright robots`) or the path of its TOML file.

    \b
    Try:
      armwright robots
      armwright info cmu-dd
      armwright simulate cmu-dd --voltage 5 --duration 1 --plot run.png
    """
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


for command in (robots, info, inverse, forward, simulate):
    app.command()(command)
app.add_typer(export, name="export")

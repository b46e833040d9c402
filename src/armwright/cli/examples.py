"""`armwright examples`: the example programs, listed and copied."""

from __future__ import annotations

from pathlib import Path

import typer

from armwright.cli.arguments import argument
from armwright.terminal import say

HEADS = ("file", "what it is")
examples = typer.Typer(name="examples")


@examples.callback()
def _about() -> None:
    """List and copy the example programs, robots, scenarios and motions."""


@examples.command("list")
def list_examples() -> None:
    """List the examples that come with Armwright, each with its title.

    \b
    Example:
      armwright examples list
    """
    from armwright.cli.tables import console_for_tables, table
    from armwright.examples import example_files, example_title

    rows = [[name, example_title(path)] for name, path in example_files().items()]
    console_for_tables().print(table(None, HEADS, rows, HEADS))


@examples.command("copy")
def copy(folder: Path = argument("DIR", "Where the copies go; made if it is not there.")) -> None:
    """Copy all examples into a folder, to run and change. Existing files are not overwritten.

    \b
    Examples:
      armwright examples copy examples
      python examples/01_first_motion.py
    """
    from armwright.examples import copy_examples

    copied = copy_examples(folder)
    say(f"copied {len(copied)} files into {folder}")
    say(f"try: python {copied[0]}")

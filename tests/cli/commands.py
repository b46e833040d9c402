"""Every command of the command line by its full name."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer

from armwright.cli.app import app

ROOT = typer.main.get_command(app)


def _single(command: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    for name, inner in command.commands.items():
        whole = f"{path} {name}".strip()
        yield from _single(inner, whole) if hasattr(inner, "commands") else [(whole, inner)]


COMMANDS: dict[str, Any] = dict(_single(ROOT))

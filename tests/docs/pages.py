"""README and tutorial taken apart: files, console sessions and Python that they show, and what they say comes out."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILE = re.compile(r"^\*\*`(?P<name>\S+)`\*\*\n\n```\w+\n(?P<text>.*?)^```", re.DOTALL | re.MULTILINE)
BLOCK = re.compile(r"(?<!`\*\*\n\n)^```(?P<kind>sh|console|python|text)\n(?P<text>.*?)^```", re.DOTALL | re.MULTILINE)
TIME = re.compile(r"in \d+(\.\d+)? s$")  # how long something took
LONG = re.compile(r"\d+\.\d{9,}(e-?\d+)?")  # a number in all its digits


def page(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(name: str) -> list[tuple[str, str]]:
    """Kind and text of every code block, in the page's order."""
    return [(match["kind"], match["text"]) for match in BLOCK.finditer(page(name))]


def write_files(name: str, folder: Path) -> None:
    """The files that a page shows, written where its commands expect them."""
    for match in FILE.finditer(page(name)):
        (folder / match["name"]).write_text(match["text"], encoding="utf-8")


def sessions(text: str) -> list[tuple[str, list[str]]]:
    """Every command of a console block, with the lines that it is said to print."""
    found: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return found


def shell(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command of a page in that folder, with this environment's programs first."""
    if os.name == "nt":
        pytest.skip("the pages show a POSIX shell")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    return subprocess.run(
        command, shell=True, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, timeout=120
    )


def python(code: str, folder: Path) -> str:
    """What a page's Python prints."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=120, encoding="utf-8"
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def comparable(lines: list[str]) -> list[str]:
    """Lines without what differs from run to run and from processor to processor: times, and the last digits."""
    shorter = [TIME.sub("in … s", line.rstrip()) for line in lines if line.strip()]
    return [LONG.sub(lambda number: f"{float(number[0]):.9g}", line) for line in shorter]

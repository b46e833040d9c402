"""README and tutorial taken apart: files, console sessions and Python that they show, and what they say comes out."""

from __future__ import annotations

import contextlib
import io
import os
import re
import runpy
import shlex
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest

from armwright.cli import main

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


def blocks_in_order(name: str, folder: Path) -> Iterator[tuple[str, str]]:
    """Kind and text of every code block; files that the page shows are written when it comes to them."""
    text = page(name)
    matches = sorted([*FILE.finditer(text), *BLOCK.finditer(text)], key=lambda match: match.start())
    for match in matches:
        if "name" in match.groupdict():
            (folder / match["name"]).write_text(match["text"], encoding="utf-8")
        else:
            yield match["kind"], match["text"]


def sessions(text: str) -> list[tuple[str, list[str]]]:
    """Every command of a console block, with the lines that it is said to print."""
    found: list[tuple[str, list[str]]] = []
    for line in text.replace("\\\n", " ").splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return found


def run_here(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Output and exit code of `armwright …` or `python FILE …` in that folder, run in this process, which has its imports."""
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    argv, path, modules = sys.argv, [*sys.path], {*sys.modules}
    code: object = 0
    with contextlib.ExitStack() as stack:
        for context in (contextlib.chdir(folder), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)):
            stack.enter_context(context)
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("default")  # printed, as in a process of its own; here they are errors
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            if words[0] == "armwright":
                sys.argv = words
                main()
            else:
                sys.argv, sys.path[:0] = words[1:], [str(folder)]
                runpy.run_path(words[1], run_name="__main__")
        except SystemExit as end:
            code = end.code or 0
        finally:
            sys.argv, sys.path[:] = argv, path
    for name in {*sys.modules} - modules:  # the next page may have a file of the same name
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(folder)):
            del sys.modules[name]
    written = [stream.buffer.getvalue().decode() for stream in (out, err)]  # type: ignore[attr-defined]
    return subprocess.CompletedProcess(words, code if isinstance(code, int) else 1, *written)


def shell(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command of a page in that folder; in a shell, with this environment's programs first, where it takes one."""
    if re.match(r"(armwright|python \S+\.py) [^|&;<>$*`~(]*$", command):
        return run_here(shlex.split(command), folder)
    if os.name == "nt":
        pytest.skip("the pages show a POSIX shell")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    return subprocess.run(
        command, shell=True, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True, timeout=120
    )


def python(code: str, folder: Path) -> str:
    """Output of a page's Python."""
    with tempfile.TemporaryDirectory() as elsewhere:
        program = Path(elsewhere) / "program.py"
        program.write_text(code, encoding="utf-8")
        done = run_here(["python", str(program)], folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def comparable(lines: list[str]) -> list[str]:
    """Lines without what differs from run to run and from processor to processor: times, and the last digits."""
    shorter = [TIME.sub("in … s", line.rstrip()) for line in lines if line.strip()]
    return [LONG.sub(lambda number: f"{float(number[0]):.9g}", line) for line in shorter]

"""Every command line of the pages, README and examples is one that the program understands; none is run."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from armwright.cli.app import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXAMPLES = sorted(path for path in (ROOT / "examples").rglob("*") if path.suffix in (".py", ".toml", ".md"))
FENCE = re.compile(r"^ *```(?P<kind>\w*)[^\n]*\n(?P<text>.*?)^ *```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"`(?P<text>armwright [^`]+)`")
IN_COMMENT = re.compile(r"^(?:#|    ) *(?P<text>armwright [\w-]+ .*)$", re.MULTILINE)
SHELL = ("sh", "bash", "console")
ENDS = {"|", "||", "&&", ";", "&", ">", ">>", "2>", "2>&1", "<"}  # of a command within a line
OPEN = re.compile(r"…|\.\.\.|\[options\]")  # a command that a sentence shows in part
COMMAND = typer.main.get_command(app)
PARTLY = (
    "MissingParameter",
    "BadOptionUsage",
)  # a sentence may name a command without its arguments, an option without its value
Error = typer.BadParameter.__mro__[1]  # UsageError, which typer keeps to itself


def commands(text: str) -> Iterator[list[str]]:
    """Words of every `armwright …` in lines of a shell, continued lines joined."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line.removeprefix("$ ").strip(), comments=True) if "armwright" in line else []
        while "armwright" in words:
            words = words[words.index("armwright") + 1 :]
            end = next((k for k, word in enumerate(words) if word in ENDS), len(words))
            yield words[:end]
            words = words[end:]


def understood(words: list[str], is_whole: bool) -> None:
    """Raises what the program says of the words, as far as it can without running a command.

    Args:
        words: behind `armwright`.   is_whole: whether all that a command needs must be there.
    """
    command, context = COMMAND, None
    name, rest = "armwright", words
    while True:
        try:
            context = command.make_context(name, list(rest), parent=context)
        except (typer.Exit, SystemExit):
            return  # --help, --version
        except Error as error:
            if type(error).__name__ in PARTLY and not is_whole:
                return
            raise
        rest = [*getattr(context, "_protected_args", ()), *context.args]
        if not hasattr(command, "commands") or not rest:
            assert not is_whole or not hasattr(command, "commands") or command.invoke_without_command
            return
        name, command, rest = command.resolve_command(context, rest)


def found_in(path: Path) -> list[tuple[list[str], bool]]:
    """Words of each command of a file, and True where it must be whole."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".md":
        return [(words, False) for each in IN_COMMENT.finditer(text) for words in commands(each["text"])]
    blocks = [each["text"] for each in FENCE.finditer(text) if each["kind"] in SHELL]
    prose = FENCE.sub("", text)
    inline = [" ".join(each["text"].split()) for each in INLINE.finditer(prose)]
    whole = [(words, True) for block in blocks for words in commands(block)]
    return whole + [(words, False) for each in inline if not OPEN.search(each) for words in commands(each)]


@pytest.mark.parametrize("path", [*PAGES, *EXAMPLES], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_its_command_lines_are_understood(path, capsys):
    wrong = []
    for words, is_whole in found_in(path):
        try:
            understood(words, is_whole)
        except Error as error:
            wrong.append(f"armwright {shlex.join(words)}: {error.format_message()}")
        # old names
        wrong += [f"armwright {shlex.join(words)}: {note}" for note in capsys.readouterr().err.splitlines()]
    assert not wrong, "\n".join(wrong)


def test_many_are_found_and_wrong_ones_are_seen():
    assert sum(len(found_in(path)) for path in PAGES) > 300
    for words in (["check"], ["check", "a", "b"], ["check", "a", "--strikt"], ["chek", "a"], ["new", "rabbit"]):
        with pytest.raises(Error):
            understood(words, is_whole=True)
    understood(["check"], is_whole=False)
    for words in (["check", "a", "b"], ["simulate", "a", "--step", "x"]):
        with pytest.raises(Error):
            understood(words, is_whole=False)

"""Words that pages, help and docstrings do not use, each with the plain words to write instead."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from cli.commands import COMMANDS
from docs.pages import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "how-to").glob("*.md"))]
SOURCE = sorted((ROOT / "src" / "armwright").rglob("*.py"))
CODE = re.compile(r"^ *```.*?^ *```|<!-- generated.*?<!-- end|`[^`\n]+`", re.DOTALL | re.MULTILINE)

EVERYWHERE = {  # pattern → what to write instead
    r"\b(control|controller's|inner|library's) laws?\b(?! of friction)": "controller",
    r"\barms? of metal\b|\bdrives? of metal\b": "real arm, real hardware",
    r"\b(one|a number) a joint\b|\ba joint each\b": "one per joint",
    r"\bcannot be believed\b": "invalid, implausible",
    r"\bthe record's own arm\b": "the nominal arm",
    r"\bone behind the other\b": "concatenated, one after the other",
    r"\bturns? on and on\b": "keeps turning",
    r"\bnothing stops it\b": "the model has no end stop",
    r"\b(tells?|told) (\w+ )?apart\b|\btold from\b|\btells? \w+ from\b": "distinguish, separate",
    r"\b(is|are) told\b": "receives, is explained in",
    r"\bno one'?s\b|\bnobody'?s\b": "no",
    r"\ba hint and no answer\b": "approximate",
    r"\bnothing of its own\b": "no",
    r"\bhow the arm is told\b": "the model",
    r"\b(left|leaves?) the finite numbers\b": "diverged, diverges",
    r"\b(remarks?|sentence) (that )?says? so\b": "with a remark, a remark warns of it",
    r"\bsays? nothing new\b": "adds no information",
    r"\bnone that are\b": "the subject, and what it is",
}
PAGES_ONLY = {
    r"\btells?\b|\btold\b": "shows, determines, states, explains",
    r"\bapart\b": "at a distance, separately, differ by",
    r"\bof (its|their|your|our) own\b": "its own, a separate",
    r"\bhunts?\b": "oscillates, causes a limit cycle",
    r"\bbeside ours\b": "compared with Armwright's",
    r"\bcannot know\b": "does not determine",
    r"\banew\b": "again",
}
ALLOWED = {  # quoted or literal: the table of errors shows a message, a force pushes two points apart, a figure's fingers
    r"\bapart\b": ("docs/robots.md", "docs/springs.md", "docs/time-optimal.md"),
    r"\btells?\b|\btold\b": ("docs/how-fast.md",),
}


def found(text: str, patterns: dict[str, str], place: str, first: int = 1) -> Iterator[str]:
    for pattern, instead in patterns.items():
        if place not in ALLOWED.get(pattern, ()):
            for match in re.finditer(pattern.replace(" ", r"\s+"), text, re.IGNORECASE):
                line = first + text.count("\n", 0, match.start())
                yield f"{place}:{line}: {match[0]!r}; expected {instead}"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_page_uses_plain_words(path: Path) -> None:
    prose = CODE.sub(lambda code: re.sub(r"[^\n]", " ", code[0]), path.read_text(encoding="utf-8"))
    wrong = list(found(prose, EVERYWHERE | PAGES_ONLY, path.relative_to(ROOT).as_posix()))
    assert not wrong, "\n".join(wrong)


def test_docstrings_help_and_messages_use_plain_words() -> None:
    wrong = []
    for path in SOURCE:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
                wrong += found(node.value, EVERYWHERE, path.relative_to(ROOT).as_posix(), node.lineno)
    assert not wrong, "\n".join(wrong)


def test_examples_use_plain_words() -> None:
    wrong = []
    for path in sorted((ROOT / "examples").glob("*.py")):
        wrong += found(path.read_text(encoding="utf-8"), EVERYWHERE | PAGES_ONLY, path.relative_to(ROOT).as_posix())
    assert not wrong, "\n".join(wrong)


def test_the_help_of_commands_uses_plain_words() -> None:
    """As strictly as pages: it is what most users read."""
    wrong = []
    for path, command in COMMANDS.items():
        texts = [command.help, *(getattr(each, "help", "") or "" for each in command.params)]
        wrong += found("\n".join(texts), EVERYWHERE | PAGES_ONLY, f"armwright {path} --help")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "sentence",
    [
        "An arm of metal",
        "one number or one a joint each",
        "colours that readers can tell apart",
        "a file that cannot be believed",
        "the control law of a scenario",
        "a lag cannot be told from a delay",
        "and a remark says so",
        "rows between say nothing new",
    ],
)
def test_a_bad_sentence_is_found(sentence: str) -> None:
    assert list(found(sentence, EVERYWHERE, "page.md"))

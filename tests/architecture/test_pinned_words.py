"""Tests look at the place, value and file of an error; of its sentence they match a name, a number or a unit: `raises_at`."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

TESTS = Path(__file__).parents[1]
WORD = re.compile(r"(?<![\w.\\[-])[a-z]{2,}\b(?![.\\(=\]-])")
QUOTED = re.compile(r"'[^']*'|\"[^\"]*\"|`[^`]*`")
MOST = 3  # plain words of a pattern, of two letters or more; more of them are a sentence


def texts(node: ast.expr) -> str:
    """The characters of a pattern that stand in the test itself, not those of its variables."""
    return " ".join(
        each.value for each in ast.walk(node) if isinstance(each, ast.Constant) and isinstance(each.value, str)
    )


def patterns(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of what `pytest.raises(…, match=…)` and `raises_at(…, …, match)` look for in a sentence."""
    for call in ast.walk(tree):
        if isinstance(call, ast.Call):
            third = call.args[2:3] if isinstance(call.func, ast.Name) and call.func.id == "raises_at" else []
            for found in [*third, *(each.value for each in call.keywords if each.arg == "match")]:
                yield found.lineno, texts(found)


def plain_words(text: str) -> list[str]:
    """Its English: words in lower case that are no part of a name, of a key or of a quotation."""
    return WORD.findall(QUOTED.sub(" ", text))


def test_no_test_matches_the_sentence_of_an_error():
    sources = {path: path.read_text(encoding="utf-8") for path in sorted(TESTS.rglob("*.py"))}
    sentences = [
        f"{path.relative_to(TESTS)}:{line}: {text}"
        for path, source in sources.items()
        if "match=" in source or "raises_at" in source
        for line, text in patterns(ast.parse(source))
        if len(plain_words(text)) > MOST
    ]
    assert not sentences, "look at its place, value or file, as raises_at does"


def test_words_are_found():
    code = """
pytest.raises(E, match=rf"{name} = .*: the run was refused, as 'it is wrong' by `armwright run FILE`")
raises_at(E, "limits.torque", r"no torque_n_m of joint 'the first one' \\(motor\\.resistance_ohm\\)")
"""
    assert [plain_words(text) for _, text in patterns(ast.parse(code))] == [
        ["the", "run", "was", "refused", "as", "by"],
        ["no", "of", "joint"],
    ]

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


def texts(node: ast.AST) -> str:
    """The characters of a pattern that stand in the test itself, not those of its variables."""
    return " ".join(
        each.value for each in ast.walk(node) if isinstance(each, ast.Constant) and isinstance(each.value, str)
    )


def named(node: ast.AST) -> set[str]:
    """The variables of an expression."""
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}


def matches(function: ast.AST) -> Iterator[ast.expr]:
    """Patterns of `pytest.raises(…, match=…)` and of `raises_at(…, …, match)`."""
    for call in ast.walk(function):
        if isinstance(call, ast.Call):
            yield from call.args[2:3] if named(call.func) == {"raises_at"} else ()
            yield from (each.value for each in call.keywords if each.arg == "match")


def rows(function: ast.FunctionDef, tables: dict[str, ast.expr], wanted: set[str]) -> Iterator[ast.expr]:
    """Values of the arguments by these names in `pytest.mark.parametrize`."""
    for mark in function.decorator_list:
        if not isinstance(mark, ast.Call) or "parametrize" not in ast.unparse(mark.func):
            continue
        first, table = mark.args[:2]
        names = texts(first).replace(",", " ").split()
        table = tables.get(table.id, table) if isinstance(table, ast.Name) else table
        for row in getattr(table, "elts", ()):
            values = [row] if len(names) == 1 else getattr(row, "elts", None) or getattr(row, "args", ())
            yield from (value for name, value in zip(names, values, strict=False) if name in wanted)


def patterns(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and text of all that the tests of a file look for in a sentence, with the rows of their tables."""
    tables = {next(iter(named(each.targets[0])), ""): each.value for each in tree.body if isinstance(each, ast.Assign)}
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            found = list(matches(function))
            for each in [*found, *rows(function, tables, set().union(*map(named, found)))]:
                yield each.lineno, texts(each)


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
TABLE = [("a", "of another arm than the log"), pytest.param("b", r"7 joints")]
@pytest.mark.parametrize(("name", "said"), TABLE)
def test_it(name, said):
    with pytest.raises(E, match=said): ...
    with pytest.raises(E, match=rf"{name} = .*: the run was refused, as 'it is wrong' by `armwright run FILE`"): ...
    with raises_at(E, "limits.torque", r"no torque_n_m of joint 'the first one' \\(motor\\.resistance_ohm\\)"): ...
"""
    found = [plain_words(text) for _, text in patterns(ast.parse(code))]
    assert sorted(filter(None, found)) == [
        ["joints"],
        ["no", "of", "joint"],
        ["of", "another", "arm", "than", "the", "log"],
        ["the", "run", "was", "refused", "as", "by"],
    ]

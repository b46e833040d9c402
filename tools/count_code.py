"""Prints how many lines of code there are, in all and by room.

    .venv/bin/python tools/count_code.py [folder …]

A line counts if it holds a token other than a comment, a line end or an indent, and is no part of a docstring; imports count.
"""

from __future__ import annotations

import ast
import sys
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SPACE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
ENDS = {tokenize.ENCODING, tokenize.ENDMARKER}


def code_lines(path: Path) -> int:
    """Lines of code of a file."""
    with tokenize.open(path) as file:
        text = file.read()
    with path.open("rb") as file:
        tokens = [each for each in tokenize.tokenize(file.readline) if each.type not in SPACE | ENDS]
    lines = {line for each in tokens for line in range(each.start[0], each.end[0] + 1)}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and node.body:
            first = node.body[0]
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                lines -= set(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return len(lines)


def rooms(folder: Path) -> Counter[str]:
    """Lines of code by the rooms of a folder: its folders, and "." for its own files."""
    found: Counter[str] = Counter()
    for path in sorted([*folder.rglob("*.py"), *folder.rglob("*.pyi")]):
        inner = path.relative_to(folder).parts
        found[inner[0] if len(inner) > 1 else "."] += code_lines(path)
    return found


def main() -> None:
    """Prints the table of every folder that is named; by default the package's."""
    for name in sys.argv[1:] or ["src/armwright"]:
        found = rooms(ROOT / name)
        print(f"{name}: {found.total():,} lines of code")
        for room, lines in found.most_common():
            print(f"  {lines:7,}  {room}")


if __name__ == "__main__":
    main()

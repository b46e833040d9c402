"""Parts of the pages that are made from the source, so that they cannot drift: kernels' signatures, record types, robots' files,
the command line, docstrings.

They are committed as plain Markdown, between two comments: `<!-- generated: NAME -->` and `<!-- end of NAME -->`.
`make reference` writes them anew; `python docs/ext/armwright_pages.py --check` only names the pages that are out of date.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
os.environ["COLUMNS"] = "80"  # no text may depend on the terminal

DOCS = Path(__file__).parents[1]
MARK = re.compile(
    r"<!-- generated: (?P<name>[\w-]+)(?P<words>[^>]*?)\s*-->(?:\n.*?<!-- end of (?P=name) -->)?", re.DOTALL
)


def generators() -> dict[str, Callable[..., str]]:
    """Functions that write a part of a page, by the name in its mark."""
    import armwright_api
    import armwright_record
    import armwright_session
    import armwright_tables

    modules = (armwright_api, armwright_record, armwright_session, armwright_tables)
    return {name: function for module in modules for name, function in module.GENERATORS.items()}


def pages() -> Iterator[tuple[Path, str, str]]:
    """Every page that has generated parts: its path, its text, and what the text should be."""
    made = generators()
    for path in sorted(DOCS.rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        if MARK.search(text):
            yield path, text, MARK.sub(lambda mark, path=path: part(mark, path, made), text)


def part(mark: re.Match[str], path: Path, made: dict[str, Callable[..., str]]) -> str:
    """A mark with the text that belongs below it. A list of names stands on lines of its own, other words beside the name."""
    words = mark["words"].strip("\n").split("\n") if "\n" in mark["words"] else mark["words"].split()
    text = made[mark["name"]](*words)
    relative = "../" * (len(path.relative_to(DOCS).parts) - 1) + "references.md"
    end = "\n" if "\n" in mark["words"] else " "
    head = f"<!-- generated: {mark['name']}{mark['words'].rstrip()}{end}-->"
    return f"{head}\n\n{text.replace('@references.md', relative)}\n\n<!-- end of {mark['name']} -->"


def main(arguments: list[str]) -> int:
    """Exit code: 1 if a page is out of date and only checked."""
    outdated = [(path, new) for path, text, new in pages() if text != new]
    for path, new in outdated:
        print(f"{path.relative_to(DOCS.parent)} {'is out of date: run make reference' if arguments else 'written'}")
        if not arguments:
            path.write_text(new, encoding="utf-8", newline="\n")
    return int(bool(arguments) and bool(outdated))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Parts of the site generated from the source, so that they cannot drift: `<!-- generated: NAME -->` in a page becomes a table
made from the kernels' signatures, the record types, the robots' files or the command line. Docstrings become reST here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import armwright_record
import armwright_session
import armwright_tables

GENERATORS = {**armwright_tables.GENERATORS, **armwright_record.GENERATORS, **armwright_session.GENERATORS}
MARK = re.compile(r"<!-- generated: ([\w-]+)(?: ([\w-]+))? -->")
KEY = re.compile(r"\[([A-Z][A-Za-z]+(?:\d{4})?)\]")  # a citation: [WalkerOrin1982]
SECTION = re.compile(r"^(Args|Attributes|Returns|Raises):$")
SEVERAL = re.compile(r" {3}(?=\w+: )")  # between two arguments on one line


def fill(app, name: str, content: list[str]) -> None:
    """Replaces marks by generated text."""
    content[0] = MARK.sub(lambda mark: GENERATORS[mark[1]](*filter(None, [mark[2]])), content[0])


def outdated(app, env, added: set[str], changed: set[str], removed: set[str]) -> list[str]:
    """All pages: generated text may change although the page does not."""
    return sorted(env.found_docs)


def docstring(app, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Rewrites a docstring as reST: code in backticks, equations as they are, one argument in each line, keys as links."""
    lines[:] = list(_rewritten(lines))


def _rewritten(lines: Sequence[str]) -> Iterable[str]:
    section = ""
    for line in lines:
        found = SECTION.match(line)
        if found:
            section = found[1]
            yield from ("",) if section == "Returns" else ("", line)
        elif section in ("Args", "Attributes") and line.startswith("    "):
            more = line.startswith("     ")  # goes on with the argument above
            for part in [line.strip()] if more else SEVERAL.split(line.strip()):
                yield ("        " if more else "    ") + _escaped(part)
        elif section == "Returns" and line.startswith("    "):
            name, _, what = line.strip().partition(": ")
            more = line.startswith("     ")
            yield f"    {_escaped(line.strip())}" if more else f":returns: **{name}** – {_escaped(what)}"
        else:
            yield _escaped(line)


def _escaped(line: str) -> str:
    """A line with backticks as literals and everything else escaped, since our docstrings have no other markup."""
    parts = line.split("`")
    for k, part in enumerate(parts):
        if k % 2:
            parts[k] = f"``{part}``"
        else:
            part = re.sub(r"([*|\\])", r"\\\1", part)
            part = re.sub(r"(?<=\w)_(?=\W|$)", r"\\_", part)
            parts[k] = KEY.sub(lambda key: rf":ref:`[{key[1]}] <{key[1].lower()}>`", part)
    return "".join(parts)


def setup(app) -> dict[str, bool]:
    """Connects the functions above to Sphinx."""
    app.connect("env-get-outdated", outdated)
    app.connect("source-read", fill)
    app.connect("autodoc-process-docstring", docstring, priority=100)  # before napoleon, which has 500
    return {"parallel_read_safe": True}

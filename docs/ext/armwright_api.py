"""Python reference as Markdown: signature and docstring of every name that a page lists."""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import armwright as aw

PAGES = Path(__file__).parents[1] / "reference" / "python"
ENTRY = re.compile(r"^([\w.]+)(\([^)]*\))?(?:: (.*))?$")  # NAME, NAME(what the signature shows), NAME: members
LISTED = re.compile(r"<!-- generated: api\n(.*?)-->", re.DOTALL)
SECTION = re.compile(r"^(Args|Attributes|Returns|Raises|Yields|Example):$")
SEVERAL = re.compile(r" {3}(?=[\w, ]+: )")  # between two arguments on one line
CITATION = re.compile(r"\[([A-Z][A-Za-z]+(?:\d{4}[a-z]?)?)\](?!\()")
WIDTH = 100  # of a signature
LONGEST = 40  # characters of a default that is shown; also left out: a repr that is no Python, such as <factory>
REFERENCES = "@references.md"  # the page's own way to it stands instead of it in the end
HEADS = {"Args": "Arguments", "Attributes": "Attributes", "Returns": "Returns", "Raises": "Raises", "Yields": "Yields"}


def api(*lines: str) -> str:
    """Entries for names of `armwright`, one on each line, with the members of classes after a colon."""
    return "\n\n".join(part for line in lines if line.strip() for part in _entry(line.strip()))


def others(group: str) -> str:
    """Entries for the public names of a group, or of those at the "top", that no list of the pages has."""
    return api(*names_of_others(group))


def names_of_others(group: str) -> list[str]:
    """Public names of a group, or of those at the "top", that no list of the pages has."""
    pages = [path.read_text(encoding="utf-8") for path in PAGES.glob("*.md")]
    listed = {
        re.split(r"[:(]", line)[0] for page in pages for text in LISTED.findall(page) for line in text.splitlines()
    }
    here = aw.__all__ if group == "top" else [f"{group}.{name}" for name in getattr(aw, group).__all__]
    names = [name for name in here if name not in listed and not inspect.ismodule(found(name))]
    return [name for name in names if group == "top" or name.partition(".")[2] not in aw.__all__]


def parsed(line: str) -> tuple[str, str | None, list[str]]:
    """Name, what its signature shows if not its arguments, and names of the members that are shown with it."""
    match = ENTRY.match(line)
    assert match is not None, f"docs/reference/python: {line!r} is no name"
    path, shown, members = match.groups()
    return path, shown, _documented(found(path)) if members == "*" else (members or "").split()


def _entry(line: str) -> Iterator[str]:
    path, shown, members = parsed(line)
    thing = found(path)
    name = f"aw.{path}" if _public(path) else f"armwright.{path}"
    yield f"### `{name}`"
    yield from _call(name, thing, shown)
    yield from body(thing)
    for member in members:
        assert hasattr(thing, member), f"docs/reference/python: {path} has no {member!r}"
        yield f"#### `{path.rpartition('.')[2]}.{member}`"
        value = function_of(inspect.getattr_static(thing, member, None))
        yield from _call(member, value, None)
        yield from body(value)


def _documented(thing: type) -> list[str]:
    """Public methods and properties of a class that have a docstring."""
    members = {name: getattr(value, "func", value) for name, value in vars(thing).items() if not name.startswith("_")}
    kinds = (property, classmethod, staticmethod)
    return [
        n for n, value in members.items() if (inspect.isfunction(value) or isinstance(value, kinds)) and value.__doc__
    ]


def _public(path: str) -> bool:
    """True of a name at the top, or of a group."""
    group, _, name = path.rpartition(".")
    return path in aw.__all__ or (group in aw.__all__ and name in getattr(aw, group).__all__)


def found(path: str) -> Any:
    """Object by its path within the package."""
    if _public(path):
        return functools.reduce(getattr, path.split("."), aw)
    module, _, name = path.rpartition(".")
    try:
        return getattr(importlib.import_module(f"armwright.{module}"), name)
    except AttributeError:
        return importlib.import_module(f"armwright.{path}")


def function_of(value: Any) -> Any:
    """The function of a member that Python wraps, or a kernel's method."""
    for name in ("__func__", "func", "function"):
        value = value if inspect.isclass(value) else getattr(value, name, value)
    return value


def _call(name: str, thing: Any, shown: str | None) -> Iterator[str]:
    signature = shown if shown is not None else _signature(thing)
    if signature not in ("", "()") or inspect.isfunction(thing):
        call = textwrap.fill(f"{name}{signature}", WIDTH, subsequent_indent="    ", break_long_words=False)
        yield f"```python\n{call}\n```"


def body(thing: Any) -> Iterator[str]:
    """Docstring of a thing, or of a member's function, as Markdown."""
    thing = function_of(thing)
    text = inspect.getdoc(thing) if callable(thing) or inspect.ismodule(thing) or isinstance(thing, property) else ""
    yield from markdown(text or "")


def _signature(thing: Any) -> str:
    """Arguments with their defaults and without their types, of which the docstring says more."""
    protocol = getattr(thing, "_is_protocol", False)
    if not callable(thing) or protocol:
        return ""
    parameters = [p.replace(annotation=p.empty) for p in inspect.signature(thing).parameters.values()]
    return str(inspect.Signature([shown_default(p) for p in parameters if p.name not in ("self", "cls")]))


def shown_default(parameter: inspect.Parameter) -> inspect.Parameter:
    """The parameter with its default as it is typed."""
    default = parameter.default
    return parameter if default is parameter.empty else parameter.replace(default=_Shown(default))


class _Shown:
    """A default as it is typed."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __repr__(self) -> str:
        text = repr(self.value).replace("'", '"')
        return "..." if text.startswith("<") or len(text) > LONGEST else text


def markdown(text: str) -> Iterator[str]:
    """Paragraphs, indented blocks and sections of a docstring as Markdown."""
    section, lines = "", []
    for line in [*text.splitlines(), "Raises:"]:
        found = SECTION.match(line)
        if found:
            yield from _section(section, lines)
            section, lines = found[1], []
        else:
            lines.append(line)


def _section(name: str, lines: list[str]) -> Iterator[str]:
    if name == "Example":
        example = textwrap.dedent("\n".join(lines)).strip("\n")
        yield from ["**Example**", f"```pycon\n{example}\n```"]
    elif name:
        items = list(_items(lines))
        yield from [f"**{HEADS[name]}**", "\n".join(f"- {item}" for item in items)] if items else []
    else:
        for paragraph in re.split(r"\n\s*\n", "\n".join(lines).strip("\n")):
            if paragraph.startswith("    "):
                text = textwrap.dedent(paragraph)
                yield f"```{_language(text)}\n{text}\n```"
            elif paragraph:
                yield "\n".join(escaped(line.strip()) for line in paragraph.splitlines())


def _language(block: str) -> str:
    """Language of an indented block of a docstring: Python if it parses as such, else equations if it has a relation."""
    try:
        ast.parse(block)
    except SyntaxError:
        return "equation" if re.search("[=≤≥]", block) else "text"
    return "python"


def entries_of(text: str, section: str) -> list[str]:
    """Entries of a section of a docstring, `name: text` or `name, name: text`."""
    lines: list[str] = []
    found = ""
    for line in text.splitlines():
        heading = SECTION.match(line)
        found = heading[1] if heading else found
        lines += [line] if found == section and not heading else []
    return _entries(lines)


def _entries(lines: Iterable[str]) -> list[str]:
    entries: list[str] = []
    for line in filter(None, map(str.rstrip, lines)):
        if line.startswith("     ") and entries:
            entries[-1] += f" {line.strip()}"
        else:
            entries += SEVERAL.split(line.strip())
    return entries


def _items(lines: Iterable[str]) -> Iterator[str]:
    """Entries of a section, one for each name; a line indented further goes on with the entry above."""
    for entry in _entries(lines):
        name, colon, rest = entry.partition(": ")
        named = colon and re.fullmatch(r"[\w*,. ]+", name)
        yield f"`{name}`: {escaped(rest)}" if named else escaped(entry)


def escaped(line: str) -> str:
    """A line of a docstring: text between backticks as it is, signs of Markdown escaped, keys of sources as links."""
    parts = line.split("`")
    for k in range(0, len(parts), 2):
        part = re.sub(r"(\*(?=\S)|(?<=\S)\*|[\\~]|<(?=\w))", r"\\\1", parts[k])
        part = re.sub(r"(?<![\w\u0300-\u036f])_|_(?!\w)", r"\\_", part)
        part = re.sub(r"\]\(", r"]\\(", part)
        parts[k] = CITATION.sub(lambda key: rf"[\[{key[1]}\]]({REFERENCES}#{key[1].lower()})", part)
    return "`".join(parts)


GENERATORS = {"api": api, "api-others": others}

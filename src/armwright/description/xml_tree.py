"""XML as a tree whose elements know their line, read so that no file can attack its reader."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import isfinite
from typing import Any
from xml.sax import SAXException, SAXParseException
from xml.sax.handler import ContentHandler

from armwright.errors import ABSENT, UNKNOWN_KEY, DescriptionError
from armwright.reading import read_file

LARGEST = 64 * 2**20  # [bytes]; the largest robot files known are below 1 MiB
MOST = 1_000_000  # elements
DEEPEST = 100  # elements within elements
# what C's strtod and a person both read; no nan, no 1_000
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass(slots=True)
class Element:
    """One element: its tag, attributes, text and children, and where it begins."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def error(
        self, what: str = "", *, place: str = "", value: Any = ABSENT, expected: str = "", choices: Iterable[str] = ()
    ) -> DescriptionError:
        """An error with file and line for the caller to raise; `place` is this element by default."""
        file, place = f"{self.file}:{self.line}", place or f"<{self.tag}>"
        return DescriptionError(what, place=place, value=value, expected=expected, choices=choices, file=file)

    def wrong(self, name: str, expected: str) -> DescriptionError:
        """The error of an attribute whose value is not what was expected."""
        return self.error(place=f"<{self.tag} {name}>", value=self.attributes[name], expected=expected)

    def all(self, tag: str) -> list[Element]:
        """The children of that tag."""
        return [child for child in self.children if child.tag == tag]

    def one(self, tag: str) -> Element | None:
        """The only child of that tag, or None.

        Raises:
            DescriptionError: there are two.
        """
        elements = self.all(tag)
        if len(elements) > 1:
            raise elements[1].error(f"a second one in one <{self.tag}>", expected="one at most")
        return elements[0] if elements else None

    def needed(self, tag: str, what: str = "") -> Element:
        """The only child of that tag.

        Raises:
            DescriptionError: there is none, or there are two.
        """
        element = self.one(tag)
        if element is None:
            raise self.error("missing", place=f"{what or f'<{self.tag}>'} <{tag}>")
        return element

    def word(self, name: str, what: str = "") -> str:
        """An attribute that must be there and not be empty.

        Raises:
            DescriptionError: it is not.
        """
        value = self.attributes.get(name, "").strip()
        if not value:
            raise self.error("missing", place=f"{what or f'<{self.tag}>'} {name}", expected=f'{name}="…"')
        return value

    def numbers(self, name: str, count: int, default: Iterable[float] | None = None) -> list[float]:
        """An attribute of `count` finite numbers; `default` where the format says what its absence means.

        Raises:
            DescriptionError: it is absent without a default, holds another count, or something that is no finite number.
        """
        if name not in self.attributes and default is not None:
            return list(default)
        text = self.word(name)
        words = text.split()
        values = [float(word) if NUMBER.fullmatch(word) else float("nan") for word in words]
        if len(words) != count or not all(isfinite(value) for value in values):
            raise self.wrong(name, "a finite number" if count == 1 else f"{count} finite numbers")
        return values

    def number(self, name: str, default: float | None = None) -> float:
        """An attribute of one finite number; see `numbers`."""
        return self.numbers(name, 1, None if default is None else [default])[0]

    def only_attributes(self, *known: str) -> None:
        """Refuses attributes that nobody would read.

        Raises:
            DescriptionError: names the attribute and the nearest known one.
        """
        wrong = [
            problem
            for name, value in self.attributes.items()
            if name not in known
            for problem in self.error(UNKNOWN_KEY, place=f"<{self.tag}> {name}", value=value, choices=known).problems
        ]
        if wrong:
            raise DescriptionError.of(*wrong)


class _Builder(ContentHandler):
    """Grows the tree from the parser's events."""

    def __init__(self, file: str, line: Callable[[], int]):
        super().__init__()
        self.file, self.line, self.count = file, line, 0
        self.open: list[Element] = []
        self.root: Element | None = None

    def startElement(self, name, attrs) -> None:
        element = Element(name, dict(attrs), self.file, self.line())
        self.count += 1
        if self.count > MOST or len(self.open) >= DEEPEST:
            limit = f"{MOST} elements" if self.count > MOST else f"{DEEPEST} elements within each other"
            raise element.error(f"more than {limit}", expected="the description of a robot")
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def characters(self, content) -> None:
        if not content.isspace():
            self.open[-1].text += content

    def endElement(self, name) -> None:
        self.open.pop()


def parse_xml(data: bytes, file: str) -> Element:
    """The root element of an XML document; `file` is what errors call it.

    Raises:
        DescriptionError: not XML, with the line; a document type (entities are never read), or more than any robot holds.
    """
    from defusedxml import DefusedXmlException
    from defusedxml.expatreader import create_parser

    if len(data) > LARGEST:
        raise DescriptionError("too large", value=len(data), expected=f"{LARGEST} bytes at most", file=file)
    parser = create_parser(forbid_dtd=True)
    builder = _Builder(file, parser.getLineNumber)
    parser.setContentHandler(builder)
    try:
        parser.feed(data)
        parser.close()
    except DefusedXmlException:
        line = f"{file}:{parser.getLineNumber()}"
        raise DescriptionError("declares a document type or entities", expected="plain XML", file=line) from None
    except SAXParseException as error:
        line = f"{file}:{error.getLineNumber()}" if error.getLineNumber() else file
        raise DescriptionError(f"not XML: {error.getMessage()}", file=line) from None
    except (SAXException, LookupError, ValueError) as error:  # an encoding nobody knows, or of several bytes a letter
        raise DescriptionError(f"not XML that can be read: {' '.join(str(error).split())}", file=file) from None
    if builder.root is None:
        raise DescriptionError("not XML: no element found", file=file)
    return builder.root


def read_xml(path: str | os.PathLike[str]) -> Element:
    """The root element of an XML file.

    Raises:
        DescriptionError: no such file, or as `parse_xml`.
    """
    return parse_xml(read_file(path, "an XML file", DescriptionError, LARGEST), os.fspath(path))

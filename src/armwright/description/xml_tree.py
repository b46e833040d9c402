"""XML as a tree whose elements know their line, read so that no file can attack its reader."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from xml.sax import SAXException, SAXParseException
from xml.sax.handler import ContentHandler

from armwright.errors import DescriptionError, nearest

LARGEST = 64 * 2**20  # [bytes]; the largest robot files known are below 1 MiB
MOST = 1_000_000  # elements
DEEPEST = 100  # elements within elements
NUMBER = re.compile(
    r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?"
)  # what C's strtod and a person both read; no nan, no 1_000


@dataclass(slots=True)
class Element:
    """One element: its tag, attributes, text and children, and where it begins."""

    tag: str
    attributes: dict[str, str]
    file: str
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def error(self, told: str) -> DescriptionError:
        """What is wrong here, with file and line; for the caller to raise."""
        return DescriptionError(f"{self.file}:{self.line}: {told}")

    def all(self, tag: str) -> list[Element]:
        """The children of that tag."""
        return [child for child in self.children if child.tag == tag]

    def one(self, tag: str) -> Element | None:
        """The only child of that tag, or None.

        Raises:
            DescriptionError: there are two.
        """
        found = self.all(tag)
        if len(found) > 1:
            raise found[1].error(f"a second <{tag}> in one <{self.tag}>: expected one at most")
        return found[0] if found else None

    def needed(self, tag: str, what: str = "") -> Element:
        """The only child of that tag.

        Raises:
            DescriptionError: there is none, or there are two.
        """
        found = self.one(tag)
        if found is None:
            raise self.error(f"{what or f'<{self.tag}>'} has no <{tag}>; expected one")
        return found

    def word(self, name: str, what: str = "") -> str:
        """An attribute that must be there and not be empty.

        Raises:
            DescriptionError: it is not.
        """
        value = self.attributes.get(name, "").strip()
        if not value:
            raise self.error(f'{what or f"<{self.tag}>"} has no {name}; expected {name}="…"')
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
            shown = text if len(text) <= 60 else f"{text[:60]}…"
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            raise self.error(f"<{self.tag} {name}={shown!r}>: expected {wanted}")
        return values

    def number(self, name: str, default: float | None = None) -> float:
        """An attribute of one finite number; see `numbers`."""
        return self.numbers(name, 1, None if default is None else [default])[0]

    def only_attributes(self, *known: str) -> None:
        """Refuses attributes that nobody would read.

        Raises:
            DescriptionError: names the attribute and the nearest known one.
        """
        for name in self.attributes:
            if name not in known:
                raise self.error(f"<{self.tag} {name}={self.attributes[name]!r}>: unknown; {nearest(name, known)}")


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
            raise element.error(f"more than {limit}: no robot is described so")
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
        raise DescriptionError(f"{file}: {len(data)} bytes: expected a robot's XML, {LARGEST} bytes at most")
    parser = create_parser(forbid_dtd=True)
    builder = _Builder(file, parser.getLineNumber)
    parser.setContentHandler(builder)
    try:
        parser.feed(data)
        parser.close()
    except DefusedXmlException:
        place = f"{file}:{parser.getLineNumber()}"
        raise DescriptionError(f"{place}: declares a document type or entities: expected plain XML") from None
    except SAXParseException as error:
        place = f"{file}:{error.getLineNumber()}" if error.getLineNumber() else file
        raise DescriptionError(f"{place}: not XML: {error.getMessage()}") from None
    except (SAXException, LookupError, ValueError) as error:  # an encoding nobody knows, or of several bytes a letter
        raise DescriptionError(f"{file}: not XML that can be read: {' '.join(str(error).split())}") from None
    if builder.root is None:
        raise DescriptionError(f"{file}: not XML: no element found")
    return builder.root


def read_xml(path: str | os.PathLike[str]) -> Element:
    """The root element of an XML file.

    Raises:
        DescriptionError: no such file, or as `parse_xml`.
    """
    try:
        with open(path, "rb") as file:
            data = file.read(LARGEST + 1)
    except FileNotFoundError:
        raise DescriptionError(f"{Path(path)}: no such file") from None
    except IsADirectoryError:
        raise DescriptionError(f"{Path(path)}: a folder, expected an XML file") from None
    except OSError as error:
        raise DescriptionError(f"{Path(path)}: cannot be read: {error.strerror}") from None
    return parse_xml(data, os.fspath(path))

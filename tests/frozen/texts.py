"""Texts of written files without what differs from machine to machine: versions, dates, and the last digits of numbers."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

VERSION = re.compile(
    r"\b\d+\.\d+\.\d+[\w.+]*|\b\d{4}-\d\d-\d\d\b|(?<=\.py, )line \d+"
)  # and a place in a test's own file
TOKEN = re.compile(
    r"\{[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}\}|SHA256 [0-9a-f]+"
)  # checksums of texts with all digits
NUMBER = re.compile(r"-?\b\d+(?:\.\d*(?:e[-+]?\d+)?|e[-+]?\d+)\b")
DIGITS = 9  # that are compared
NOISE = 1e-12  # a number below it is 0


def rounded(text: str) -> str:
    """A text with its fractional numbers to nine digits."""

    def near(found: re.Match[str]) -> str:
        value = float(found[0])
        return f"{value:.{DIGITS}g}" if abs(value) > NOISE else "0"

    return NUMBER.sub(near, TOKEN.sub("TOKEN", VERSION.sub("VERSION", text)))


def texts(folder: Path) -> dict[str, str]:
    """Texts of all files below a folder, by path; of an archive those of its members."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".fmu":
            with zipfile.ZipFile(path) as archive:
                found |= {f"{name}/{each}": rounded(archive.read(each).decode()) for each in archive.namelist()}
        elif path.is_file():
            content = path.read_bytes()
            found[name] = content.hex() if b"\0" in content else rounded(content.decode())
    return found

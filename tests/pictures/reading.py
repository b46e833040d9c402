"""Contents of a page, read with the standard library."""

from __future__ import annotations

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np


class Page:
    """A page that was written: its data, unpacked."""

    def __init__(self, path: Path) -> None:
        self.text = path.read_text(encoding="utf-8")
        self.plot: dict[str, Any] = json.loads(self.element("plot"))
        raw = np.frombuffer(self.unpacked("numbers"), dtype=np.uint8)
        self.numbers = raw.reshape(4, -1).T.copy().view("<f4").ravel()

    def element(self, name: str) -> str:
        """The text of a script element."""
        (found,) = re.findall(rf'<script type="[^"]*" id="{name}">(.*?)</script>', self.text, re.DOTALL)
        return found

    def unpacked(self, name: str) -> bytes:
        """The bytes in a script element."""
        return zlib.decompress(base64.b64decode(self.element(name), validate=True))

    def values(self, place: list[int]) -> np.ndarray:
        """The numbers at a place."""
        return self.numbers[place[0] : place[0] + place[1]]

    def fetched(self) -> list[str]:
        """Whatever the page would ask the network or the disk for."""
        asked = re.findall(
            r"""(?:src|href)\s*=\s*["'][^"']*|@import|url\(|fetch\(|XMLHttpRequest|import\s*\(""", self.text
        )
        return asked + re.findall(r"https?://[^\s\"'<]*", self.text)

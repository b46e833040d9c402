"""Case: one input of the campaign, files and a call, as data that is kept as JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Case:
    """An input of one kind.

    Attributes:
        kind: key of `kinds.KINDS`.   files: contents by name, beside each other in one folder.
        call: what is done with them, plain JSON data that the kind understands.
    """

    kind: str
    files: Mapping[str, bytes] = field(default_factory=dict)
    call: Any = None

    def to_json(self) -> str:
        """The case as text; files that are UTF-8 stay readable."""
        files = {name: _readable(content) for name, content in self.files.items()}
        return json.dumps({"kind": self.kind, "call": self.call, "files": files}, indent=1, ensure_ascii=True) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Case:
        """The case that `to_json` wrote."""
        data = json.loads(text)
        return cls(data["kind"], {name: _content(file) for name, file in data["files"].items()}, data["call"])


def _readable(content: bytes) -> Any:
    try:
        return content.decode("utf-8").split("\n")
    except UnicodeDecodeError:
        return base64.b64encode(content).decode("ascii")


def _content(file: Any) -> bytes:
    return base64.b64decode(file) if isinstance(file, str) else "\n".join(file).encode("utf-8")

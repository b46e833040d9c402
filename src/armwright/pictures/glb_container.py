"""Container of glTF 2.0: arrays in one binary chunk, and the JSON chunk that says what they are.  [Khronos2021]"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

MAGIC, VERSION = 0x46546C67, 2
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
FLOAT, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5123, 5125  # types of components
VERTICES, INDICES = 34962, 34963  # what a view is for: ARRAY_BUFFER and ELEMENT_ARRAY_BUFFER
TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
ALIGNMENT = 4  # [byte] of every array and chunk


class Arrays:
    """Binary chunk, with a view and an accessor for each array."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def vertices(self, values: np.ndarray, bounds: bool = False) -> int:
        """Index of the accessor of (v, 3) floats of a mesh. Positions need `bounds`."""
        return self._add(np.asarray(values, dtype="<f4"), FLOAT, VERTICES, bounds)

    def triangles(self, values: np.ndarray) -> int:
        """Index of the accessor of (f, 3) vertex indices; the largest 16-bit number is no index."""
        small = values.max(initial=0) < 0xFFFF
        flat = values.reshape(-1).astype("<u2" if small else "<u4")
        return self._add(flat, UNSIGNED_SHORT if small else UNSIGNED_INT, INDICES, False)

    def samples(self, values: np.ndarray, bounds: bool = False) -> int:
        """Index of the accessor of (k,) or (k, m) floats of an animation. Times need `bounds`."""
        return self._add(np.asarray(values, dtype="<f4"), FLOAT, None, bounds)

    def _add(self, values: np.ndarray, component: int, target: int | None, bounds: bool) -> int:
        self.data += b"\0" * (-len(self.data) % ALIGNMENT)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": values.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        self.data += values.tobytes()
        columns = values.reshape(len(values), -1)
        accessor: dict[str, Any] = {"bufferView": len(self.views) - 1, "componentType": component}
        accessor |= {"count": len(values), "type": TYPES[columns.shape[1]]}
        if bounds:
            accessor |= {"min": columns.min(axis=0).tolist(), "max": columns.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def container(document: dict[str, Any], arrays: Arrays) -> bytes:
    """The whole file: header, JSON chunk filled up with spaces, binary chunk filled up with zeros.

    Args:
        document: everything but buffers, views and accessors, which `arrays` knows.
    """
    lists = {"buffers": [{"byteLength": len(arrays.data)}], "bufferViews": arrays.views, "accessors": arrays.accessors}
    text = json.dumps({**document, **lists}, separators=(",", ":"), allow_nan=False).encode("utf-8")
    text += b" " * (-len(text) % ALIGNMENT)
    data = bytes(arrays.data) + b"\0" * (-len(arrays.data) % ALIGNMENT)
    chunks = b"".join(
        struct.pack("<II", len(chunk), kind) + chunk for chunk, kind in ((text, JSON_CHUNK), (data, BINARY_CHUNK))
    )
    return struct.pack("<III", MAGIC, VERSION, 12 + len(chunks)) + chunks

"""What a case answers with beside the tables of a result: fields of it, files that it writes, and how a call is refused."""

from __future__ import annotations

import re
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from armwright.errors import ArmwrightError

_FOLDERS = tempfile.TemporaryDirectory(prefix="frozen-")  # of logs that several cases share; gone when the process ends


def real(values: Any) -> np.ndarray:
    """Real and imaginary parts of an array; of one of real numbers itself, whatever type a library gives them."""
    values = np.asarray(values)
    return np.stack([values.real, values.imag]) if np.iscomplexobj(values) and values.imag.any() else values.real


def beside(result: Any, *names: str, **more: Any) -> dict[str, Any]:
    """A result with some of its fields, and with more."""
    found = {name: getattr(result, name) for name in names}
    return (
        {"result": result} | {key: real(each) if np.iscomplexobj(each) else each for key, each in found.items()} | more
    )


def table(path: Path) -> dict[str, Any]:
    """Heads and numbers of a CSV file with one line of heads."""
    heads = path.read_text(encoding="utf-8").splitlines()[0]
    return {"heads": heads, "rows": np.loadtxt(path, delimiter=",", skiprows=1)}


def record(path: Path) -> dict[str, Any]:
    """Keys and numbers of a TOML file."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def refused(call: Callable[[], Any], folder: Path | None = None) -> dict[str, Any]:
    """Class, place and words of the error that a call ends in, without the name of a folder."""
    try:
        found = call()
    except ArmwrightError as error:
        text = str(error).replace(_FOLDERS.name, "FOLDERS")
        text = text if folder is None else text.replace(str(folder), "FOLDER")
        return {"error": type(error).__name__, "place": str(error.place), "text": text}
    return {"answer": str(type(found).__name__)}


def all_refused(calls: Mapping[str, Callable[[], Any]], folder: Path | None = None) -> dict[str, Any]:
    """How each of some calls is refused."""
    return {name: refused(call, folder) for name, call in calls.items()}


def shared_folder(name: str) -> Path:
    """A folder that lasts as long as the process."""
    path = Path(_FOLDERS.name) / name
    path.mkdir(parents=True)
    return path


def words_of(page: Path) -> list[str]:
    """Words of a page without its pictures, styles, checksums and dates, a text for each element."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"(?s)<(svg|style|script|head)\b.*?</\1>", "", text)
    text = re.sub(
        r"\b[0-9a-f]{8,64}\b|\d{4}-\d\d-\d\d|T\d\d:\d\d:\d\d\+00:00|\d+\.\d+\.\d+(\.dev\d+)?",
        "",
        text.replace(_FOLDERS.name, ""),
    )
    return [" ".join(each.split()) for each in re.split(r"<[^>]*>", text) if each.strip()]

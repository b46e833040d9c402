"""The Manipulator Database: one TOML file a robot. [SwartzReport] calls its own by that name."""

from __future__ import annotations

import os
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import pydantic

from armwright.description.robot import RobotDescription
from armwright.errors import DescriptionError, nearest


def builtin_names() -> list[str]:
    """Names of the arms that come with Armwright."""
    folder = resources.files("armwright.robots")
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def read_description(name_or_path: str | os.PathLike[str]) -> RobotDescription:
    """The description of a built-in arm (by name) or of a TOML database (by path).

    Raises:
        DescriptionError: no such robot, no such file, or a file that cannot be believed; one line that names file,
            place, value and what was expected.
    """
    text = os.fspath(name_or_path)
    path = Path(text)
    if path.suffix == ".toml" or path.exists():
        return read_toml(path)
    names = builtin_names()
    if text in names:
        with resources.as_file(resources.files("armwright.robots") / f"{text}.toml") as builtin:
            return read_toml(builtin)
    raise DescriptionError(f"no robot {text!r}: not a built-in arm and not a file; {nearest(text, names)}")


def read_toml(path: Path) -> RobotDescription:
    """The description in a TOML database."""
    try:
        with open(path, "rb") as file:
            data = tomllib.load(file)
    except FileNotFoundError:
        raise DescriptionError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise DescriptionError(f"{path}: a folder, expected a TOML file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DescriptionError(f"{path}: cannot be read: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise DescriptionError(f"{path}: not TOML: {error}") from None
    return parse(data, str(path))


def parse(data: dict[str, Any], place: str) -> RobotDescription:
    """The description in a parsed TOML document; `place` is what errors call it."""
    try:
        return RobotDescription.model_validate(data)
    except pydantic.ValidationError as error:
        raise DescriptionError(f"{place}: {_first_line(error, data)}") from None


def _first_line(error: pydantic.ValidationError, data: dict[str, Any]) -> str:
    """The most telling of pydantic's errors, in one line: where, what value, what was expected."""
    errors = error.errors()
    unknown = [e for e in errors if e["type"] == "extra_forbidden"]
    first = (unknown or errors)[0]
    where, record = _place(first["loc"], data)
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    if first["type"] == "extra_forbidden":
        return f"{where}: unknown key; {nearest(str(first['loc'][-1]), _allowed_keys(first['loc'], data))}{more}"
    if first["type"] == "missing":
        return f"{where}: missing{more}"
    if first["type"] in ("union_tag_invalid", "union_tag_not_found"):
        return f"{where}: type = {record.get('type')!r}: expected revolute, prismatic or fixed{more}"
    message = first["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    if first["type"] != "value_error":
        message = f"expected {message[0].lower()}{message[1:]}"
    value = first["input"]
    shown = f" = {value!r}" if isinstance(value, (str, int, float, bool)) or _is_plain(value) else ""
    return f"{where}{shown}: {message}{more}" if where else f"{message}{more}"


def _is_plain(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and all(isinstance(v, (str, int, float, bool)) for v in value)


UNION_TAGS = {"revolute", "prismatic", "fixed", "LinearFriction", "RotaryFriction"}  # pydantic puts them into places


def _place(location: tuple[int | str, ...], data: Any) -> tuple[str, dict[str, Any]]:
    """A place in the file in its reader's words: `joint "elbow" motor.resistance_ohm`, and the innermost table there."""
    words: list[str] = []
    at, record, collection = data, data if isinstance(data, dict) else {}, ""
    for key in location:
        if isinstance(key, int) and isinstance(at, (list, tuple)) and key < len(at) and collection in ("joints", "links", "frames"):
            at = at[key]
            name = at.get("name") if isinstance(at, dict) else None
            words = [f'{collection.removesuffix("s")} "{name}"' if name else f"{collection}[{key}]"]
            record = at if isinstance(at, dict) else record
            collection = ""
            continue
        if key in UNION_TAGS and not (isinstance(at, dict) and key in at):
            continue
        if isinstance(key, str):
            collection = key
            words.append(key)
            at = at.get(key) if isinstance(at, dict) else None
            record = at if isinstance(at, dict) else record
    head, tail = (words[0], words[1:]) if words and " " in words[0] else ("", words)
    return " ".join(part for part in (head, ".".join(tail)) if part), record


def _allowed_keys(location: tuple[int | str, ...], data: Any) -> list[str]:
    """Keys that the table at that place may have, found by walking the record types."""
    model: Any = RobotDescription
    for key in location[:-1]:
        if isinstance(key, int):
            continue
        options = _records_in(model)
        if key in UNION_TAGS:
            tagged = [o for o in options if _tag(o) == key or o.__name__ == key]
            model = tagged[0] if tagged else model
            continue
        fields = [o.model_fields[key].annotation for o in options if key in o.model_fields]
        if fields:
            model = fields[0]
    return [name for record in _records_in(model) for name in record.model_fields]


def _tag(record: Any) -> str | None:
    field = record.model_fields.get("type")
    return field.annotation.__args__[0] if field is not None and hasattr(field.annotation, "__args__") else None


def _records_in(annotation: Any) -> list[Any]:
    if isinstance(annotation, type):
        return [annotation] if issubclass(annotation, pydantic.BaseModel) else []
    return [record for part in getattr(annotation, "__args__", ()) for record in _records_in(part)]

"""Why a record is refused, in one line for whoever wrote it: the place, the value, what was expected."""

from __future__ import annotations

from typing import Any

import pydantic

from armwright.errors import nearest
from armwright.lazy_schema import Later

Location = tuple[int | str, ...]
LISTS = {  # whose tables are called by their names, not by their numbers
    "joints": "joint",
    "links": "link",
    "frames": "frame",
    "modules": "module",
    "bodies": "body",
    "connectors": "connector",
    "poses": "pose",
    "parts": "part",
    "sections": "section",
}
TAGS = ("type", "shape")  # the keys that tell kinds of a table apart
SCALAR = ("float_type", "float_parsing", "int_type", "int_parsing", "string_type", "bool_type")  # no list, no table
LONGEST = 60  # characters of a value that an error repeats


def refusal(error: pydantic.ValidationError, data: dict[str, Any], record: type[pydantic.BaseModel]) -> str:
    """The most telling of pydantic's errors as a sentence: `link 'link2' mass_kg = -1.0: expected a number of 0 or more`.

    Args:
        error: what validating `data` as a `record` raised.
    """
    errors = error.errors()
    unknown = [e for e in errors if e["type"] == "extra_forbidden"]  # a wrong key is why another one is missing
    first = (unknown or errors)[0]
    places = [_place(e["loc"], data, is_missing=e["type"] == "missing") for e in errors]
    where = _place(first["loc"], data, is_missing=first["type"] == "missing")
    if first["type"] in SCALAR and isinstance(
        first["input"], (list, tuple, dict)
    ):  # the way that goes further was meant
        deeper = [(p, e) for p, e in zip(places, errors, strict=True) if p != where and p.startswith(where)]
        where, first = deeper[0] if deeper else (where, first)
    shown = _shown(first["input"])
    told = f"{where} = {shown}" if where and shown and first["type"] != "missing" else where
    sentence = _sentence(first, data, record)
    others = (
        len({p for p in places if not p.startswith(where) and not where.startswith(p)}) if where else len(errors) - 1
    )
    more = f" (and {others} more)" if others else ""
    return f"{told}: {sentence}{more}" if told else f"{sentence}{more}"


def _sentence(error: Any, data: dict[str, Any], record: type[pydantic.BaseModel]) -> str:
    kind, location = error["type"], error["loc"]
    if kind == "extra_forbidden":
        return f"unknown key; {nearest(str(location[-1]), _fields_at(location, record))}"
    if kind == "missing" and isinstance(location[-1], int):  # of a list whose length is fixed
        return f"expected more numbers than {len(error['input'])}"
    if kind == "missing":
        name = str(location[-1])
        return f"missing; expected {_expected(name, _fields_at(location, record).get(name))}"
    if kind == "value_error":
        return error["msg"].removeprefix("Value error, ")
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        return _wrong_tag(error, record)
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return "expected a table"
    if kind == "tuple_type":
        return f"expected [[{location[-1]}]] tables" if location[-1] in LISTS else "expected a list"
    if kind == "string_pattern_mismatch":
        return "expected a name without spaces, dots and brackets"
    if kind in ("string_type", "string_too_short"):
        return "expected text" if kind == "string_type" else "expected text that is not empty"
    if kind == "too_short":
        least = error["ctx"]["min_length"]
        return f"expected {least} or more, not {error['ctx']['actual_length']}"
    if kind in ("int_type", "int_parsing", "int_from_float"):
        return "expected a whole number"
    if kind in ("float_type", "float_parsing", "finite_number"):
        return "expected a finite number"
    message = error["msg"].removeprefix("Input should be ")
    return f"expected {message[0].lower()}{message[1:]}"


def _wrong_tag(error: Any, record: type[pydantic.BaseModel]) -> str:
    """Which kinds of a table there are: joints by `type`, solids by `shape`."""
    key = error["ctx"]["discriminator"].strip("'")
    kinds = [tag for tag in map(_tag, _records_at((*error["loc"], key), record)) if tag]
    expected = f"expected {', '.join(kinds[:-1])} or {kinds[-1]}"
    if error["type"] == "union_tag_not_found":
        return f"{key} is missing; {expected}"
    return f"{key} = {_shown(error['input'].get(key)) or 'a table'}; {expected}"


def _shown(value: Any) -> str:
    """A plain value as the file has it, shortened; nothing for a table, whose `value` is shown where it has one."""
    if isinstance(value, dict):
        value = value.get("value")
    if isinstance(value, tuple):
        value = list(value)
    plain = (str, int, float, bool)
    if not (isinstance(value, plain) or (isinstance(value, list) and all(isinstance(v, plain) for v in value))):
        return ""
    try:
        text = repr(value)
    except ValueError:  # an integer of more digits than Python prints
        return "a number too long to print"
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


def _place(location: Location, data: Any, *, is_missing: bool) -> str:
    """A place in the file in its reader's words: `joint 'elbow' motor.resistance_ohm`.

    Pydantic puts names of its own into a location (the branch of a union, a validator): what is no key there is left out.
    """
    head, words, at, collection = "", [], data, ""
    for k, key in enumerate(location):
        if isinstance(key, int) and isinstance(at, (list, tuple)) and key < len(at):
            at = at[key]
            name = at.get("name") if isinstance(at, dict) else getattr(at, "name", None)
            if collection in LISTS and len(words) == 1:
                called = f"{LISTS[collection]} {name!r}" if isinstance(name, str) and name else f"{collection}[{key}]"
                head, words = f"{head} {called}".strip(), []
            elif words:
                words[-1] += f"[{key}]"
        elif isinstance(key, str) and isinstance(at, dict) and (key in at or (is_missing and k == len(location) - 1)):
            words.append(key if key.replace("-", "_").isidentifier() else repr(key))
            at, collection = at.get(key), key
    return " ".join(part for part in (head, ".".join(words)) if part)


def _fields_at(location: Location, record: type[pydantic.BaseModel]) -> dict[str, Any]:
    """The fields that the table at the end of a location may have."""
    return {
        name: field for option in reversed(_records_at(location, record)) for name, field in option.model_fields.items()
    }


def _records_at(location: Location, record: type[pydantic.BaseModel]) -> list[Any]:
    """What the table at the end of a location may be, found by walking the record types."""
    options: list[Any] = [record]
    for key in location[:-1]:
        if isinstance(key, int):
            continue
        fields = [option.model_fields[key].annotation for option in options if key in option.model_fields]
        if fields:
            options = _records_in(fields[0])
        else:  # not a field: the branch of a union, by its tag or by its name
            options = [option for option in options if key in (_tag(option), option.__name__)] or options
    return options


def _expected(name: str, field: Any) -> str:
    """What a missing field should be, from what its type says of itself."""
    if name in LISTS:
        return f"[[{name}]] tables"
    told = [note.expected for note in field.metadata if hasattr(note, "expected")]
    if told:
        return told[0]
    if getattr(field.annotation, "__origin__", None) is dict:
        return "a table, by name"
    records = _records_in(field.annotation)
    if records:
        fields = records[0].model_fields
        needed = [key for key, inner in fields.items() if inner.is_required()]
        return f"a table of {', '.join(needed)}" if needed else f"a table of some of {', '.join(fields)}"
    return "text" if field.annotation is str else "a value"


def _tag(record: Any) -> str | None:
    """What a record's `type` or `shape` says in a file."""
    for key in TAGS:
        field = record.model_fields.get(key)
        if field is not None and hasattr(field.annotation, "__args__"):
            return field.annotation.__args__[0]
    return None


def _records_in(annotation: Any) -> list[Any]:
    for note in getattr(annotation, "__metadata__", ()):
        if isinstance(note, Later):
            return _records_in(note.kind)
    if isinstance(annotation, type) and not hasattr(annotation, "__args__"):
        return [annotation] if issubclass(annotation, pydantic.BaseModel) else []
    return [record for part in getattr(annotation, "__args__", ()) for record in _records_in(part)]

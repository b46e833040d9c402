"""Data as records: a file's tables are checked, and what is wrong is reported with place, value and expectation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from armwright.errors import ABSENT, UNKNOWN_KEY, ArmwrightError, DescriptionError, Problem
from armwright.lazy_schema import Later

Location = tuple[int | str, ...]
AnyRecord = TypeVar("AnyRecord", bound=pydantic.BaseModel)
LISTS = {  # whose tables are called by their names, not by their numbers
    "joints": "joint",
    "links": "link",
    "frames": "frame",
    "cylinders": "cylinder",
    "modules": "module",
    "bodies": "body",
    "connectors": "connector",
    "poses": "pose",
    "parts": "part",
    "sections": "section",
}
TAGS = ("type", "shape", "kind")  # keys that name the kind of a table
SCALAR = ("float_type", "float_parsing", "int_type", "int_parsing", "string_type", "bool_type")  # no list, no table
EXPECTED = {  # by pydantic's kinds of errors
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "a table"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    **dict.fromkeys(("float_type", "float_parsing", "finite_number"), "a finite number"),
    "string_pattern_mismatch": "a name without spaces, dots and brackets",
    "string_type": "text",
    "string_too_short": "text that is not empty",
}


class Invalid(ValueError):
    """Error that a record's validator raises; `place` is seen from the record, and empty for the validated field itself."""

    def __init__(
        self,
        what: str = "",
        *,
        place: str = "",
        value: Any = ABSENT,
        expected: str = "",
        choices: Iterable[str] = (),
    ):
        self.problem = Problem(what, place, value, expected, tuple(choices))
        super().__init__(str(self.problem))

    @classmethod
    def of(cls, problem: Problem) -> Invalid:
        """One that reports this problem."""
        return cls(
            problem.what, place=problem.place, value=problem.value, expected=problem.expected, choices=problem.choices
        )


def validated(
    record: type[AnyRecord],
    data: Mapping[str, Any],
    *,
    place: str = "",
    file: Any = "",
    folder: Path | None = None,
    error: type[ArmwrightError] = DescriptionError,
) -> AnyRecord:
    """`data` as a record.

    Args:
        record: its type.   data: a table of a file, or fields made in Python.
        place: of the table in the file.   file: its path.   folder: where the paths of meshes start, and stay.
        error: what is raised.
    Raises:
        error: with all problems, the most telling first.
    """
    try:
        return record.model_validate(data, context={"folder": folder})
    except pydantic.ValidationError as invalid:
        raise error.of(*problems(invalid, data, record)).within(place, file) from None


def problems(error: pydantic.ValidationError, data: Any, record: type[pydantic.BaseModel]) -> list[Problem]:
    """Everything wrong that pydantic found, the most telling first, one problem for each place.

    Args:
        error: what validating `data` as a `record` raised.
    """
    errors = error.errors()
    places = [_place(e["loc"], data, is_missing=e["type"] == "missing") for e in errors]
    first = next((k for k, e in enumerate(errors) if e["type"] == "extra_forbidden"), 0)  # why another key is missing
    if errors[first]["type"] in SCALAR and isinstance(errors[first]["input"], (list, tuple, dict)):
        # of several kinds that a value may have, the one that was recognised further down was meant
        first = next((k for k, at in enumerate(places) if at != places[first] and at.startswith(places[first])), first)
    chosen = {places[first]: first}
    for k, at in enumerate(places):
        if not places[first] or not (at.startswith(places[first]) or places[first].startswith(at)):
            chosen.setdefault(at, k)
    return [_problem(errors[k], data, record).within(at) for at, k in chosen.items()]


def _problem(error: Any, data: Any, record: type[pydantic.BaseModel]) -> Problem:
    """One of pydantic's errors, seen from its place."""
    kind, location = error["type"], error["loc"]
    value = _plain(error["input"])
    if kind == "extra_forbidden":
        return Problem(UNKNOWN_KEY, value=value, choices=tuple(_fields_at(location, record)))
    if kind == "missing" and isinstance(location[-1], int):  # of a list whose length is fixed
        return Problem(value=value, expected=f"more numbers than {len(error['input'])}")
    if kind == "missing":
        name = str(location[-1])
        return Problem("missing", expected=_expected(name, _fields_at(location, record).get(name)))
    if kind == "value_error":
        raised = error["ctx"]["error"]
        problem = raised.problem if isinstance(raised, Invalid) else Problem(str(raised))
        return problem if problem.place or problem.value is not ABSENT else Problem(**{**vars(problem), "value": value})
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        return _wrong_tag(error, record)
    if kind == "tuple_type":
        return Problem(value=value, expected=f"[[{location[-1]}]] tables" if location[-1] in LISTS else "a list")
    if kind == "too_short":
        least, length = error["ctx"]["min_length"], error["ctx"]["actual_length"]
        return Problem(value=value, expected=f"{least} or more, not {length}")
    if kind == "literal_error":
        return Problem(value=value, expected=error["ctx"]["expected"])
    message = error["msg"].removeprefix("Input should be ")  # pydantic's own words, which end in what it expects
    return Problem(value=value, expected=EXPECTED.get(kind, f"{message[0].lower()}{message[1:]}"))


def _wrong_tag(error: Any, record: type[pydantic.BaseModel]) -> Problem:
    """An unknown kind of a table: joints have a `type`, solids a `shape`."""
    key = error["ctx"]["discriminator"].strip("'")
    kinds = [tag for tag in map(_tag, _records_at((*error["loc"], key), record)) if tag]
    expected = f"{', '.join(kinds[:-1])} or {kinds[-1]}"
    if error["type"] == "union_tag_not_found":
        return Problem("missing", place=key, expected=expected)
    return Problem(place=key, value=_plain(error["input"].get(key)), expected=expected)


def _plain(value: Any) -> Any:
    """A value as a problem shows it: a number, text or a list of them; of a table its `value`, else nothing."""
    if isinstance(value, dict):
        value = value.get("value")
    items = value if isinstance(value, (list, tuple)) else [value]
    return value if all(isinstance(item, (str, int, float, bool)) for item in items) else ABSENT


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
    """The types that the table at the end of a location may have, found by walking the records."""
    options: list[Any] = [record]
    is_name = False  # of a table among others, such as materials: no field
    for key in location[:-1]:
        if isinstance(key, int) or is_name:
            is_name = False
            continue
        fields = [option.model_fields[key].annotation for option in options if key in option.model_fields]
        if fields:
            options, is_name = _records_in(fields[0]), getattr(fields[0], "__origin__", None) is dict
        else:  # not a field: the branch of a union, by its tag or by its name
            options = [option for option in options if key in (_tag(option), option.__name__)] or options
    return options


def _expected(name: str, field: Any) -> str:
    """A description of what a missing field should hold, from its type."""
    if name in LISTS or field is None:
        return f"[[{name}]] tables" if name in LISTS else "a value"
    notes = [note.expected for note in field.metadata if hasattr(note, "expected")]
    if notes:
        return notes[0]
    if getattr(field.annotation, "__origin__", None) is dict:
        return "a table, by name"
    records = _records_in(field.annotation)
    if records:
        fields = records[0].model_fields
        needed = [key for key, inner in fields.items() if inner.is_required()]
        return f"a table of {', '.join(needed)}" if needed else f"a table of some of {', '.join(fields)}"
    return "text" if field.annotation is str else "a value"


def _tag(record: Any) -> str | None:
    """The word that a record's `type` or `shape` has in a file."""
    for key in TAGS:
        field = record.model_fields.get(key)
        if field is not None and hasattr(field.annotation, "__args__"):
            return field.annotation.__args__[0]
    return None


def _records_in(annotation: Any) -> list[Any]:
    """The record types that an annotation names."""
    for note in getattr(annotation, "__metadata__", ()):
        if isinstance(note, Later):
            return _records_in(note.kind)
    if isinstance(annotation, type) and not hasattr(annotation, "__args__"):
        return [annotation] if issubclass(annotation, pydantic.BaseModel) else []
    return [record for part in getattr(annotation, "__args__", ()) for record in _records_in(part)]

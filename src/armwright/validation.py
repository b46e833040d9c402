"""Tables of a file checked against records; each mistake is reported with place, value and expectation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import pydantic

from armwright.errors import ABSENT, MISSING, UNKNOWN_KEY, ArmwrightError, DescriptionError, Problem
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
# controls, line separators, invisible letters and those that turn the text's direction
UNSEEN = r"\p{Cc}\p{Cf}\p{Zl}\p{Zp}"
NAME = rf"^[^\s.\[\]{UNSEEN}]+$"  # of modules and parts
CONNECTOR = rf"^[^\s.\[\]{UNSEEN}]+\.[^\s.\[\]{UNSEEN}]+$"
NAMEABLE = rf'^[^\s"\[\]{UNSEEN}]([^"\[\]{UNSEEN}]*[^\s"\[\]{UNSEEN}])?$'  # of joints, links and frames
SEEN = rf"^[^{UNSEEN}]+$"  # of runs and obstacles
PATTERNS = {
    NAME: "a name without brackets, spaces, dots and invisible characters",
    CONNECTOR: "MODULE.CONNECTOR, two names without brackets, spaces and invisible characters",
    NAMEABLE: "a name without brackets, quotation marks, control or invisible characters, and spaces at its ends",
    SEEN: "a name without control or invisible characters",
}
MOST_ROUNDS = 4  # in which a table is read again without the keys that are wrong
TAGS = ("type", "shape", "kind")  # keys that name the kind of a table
SCALAR = ("float_type", "float_parsing", "int_type", "int_parsing", "string_type", "bool_type")  # no list, no table
EXPECTED = {  # by pydantic's kinds of errors
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "a table"),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "a whole number"),
    **dict.fromkeys(("float_type", "float_parsing", "finite_number"), "a finite number"),
    "string_type": "text",
    "string_too_short": "text that is not empty",
}


class Invalid(ValueError):
    """Error that a record's validator raises; `place` is seen from the record, and empty for the validated field itself.

    Attributes:
        problems: all that the validator found.
    """

    def __init__(
        self, what: str = "", *, place: str = "", value: Any = ABSENT, expected: str = "", choices: Iterable[str] = ()
    ):
        self.problems: tuple[Problem, ...] = (Problem(what, place, value, expected, tuple(choices)),)
        super().__init__(str(self.problems[0]))

    @classmethod
    def of(cls, *problems: Problem) -> Invalid:
        """One that reports these problems, one at least."""
        error = cls(problems[0].what)
        error.problems = problems
        return error


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
        found = problems(invalid, data, record)
        found += _hidden(invalid, data, record, folder, found)
        raise error.of(*found).within(place, file) from None


def readable(record: type[AnyRecord], data: Mapping[str, Any], folder: Path | None = None) -> AnyRecord | None:
    """The record without its wrong keys, so that further mistakes can be found; None if those keys are needed.

    Args:
        record: its type.   data: what `validated` refuses.   folder: as there.
    """
    for _ in range(MOST_ROUNDS):
        try:
            return record.model_validate(data, context={"folder": folder})
        except pydantic.ValidationError as invalid:
            errors = invalid.errors()
            tables = [each["loc"][:-1] for each in errors if each["type"] in ("missing", "union_tag_invalid")]
            data = _without(data, [at for each in errors for at in _wrong_keys(each)])
            data = _without(data, tables, tables=True)
    return None


def legible(
    record: type[AnyRecord], data: Mapping[str, Any], least: Mapping[str, Any], stand_ins: Mapping[str, Any]
) -> AnyRecord | None:
    """As `readable`, where tables that cannot be read have others in their place, so that those of lists keep their numbers.

    Args:
        record: its type.   data: what `validated` refuses.   least: a document that is right, with as little as possible.
        stand_ins: by the key of a table one that is right, by the key of a list of tables a list of one.
    """
    rows: dict[str, tuple[Any, ...]] = {}
    for key in stand_ins.keys() & data.keys():
        given, stand_in = data[key], stand_ins[key]
        if isinstance(stand_in, Mapping):
            data = data if readable(record, {**least, key: given}) else {**data, key: stand_in}
            continue
        alone = [readable(record, {**least, key: [each]}) for each in (given if isinstance(given, list) else stand_in)]
        (right,) = getattr(record.model_validate({**least, key: stand_in}), key)
        read = [() if each is None else getattr(each, key) for each in alone]
        rows[key] = tuple(each[0] if each else right for each in read)
    others = readable(record, {**data, **{key: stand_ins[key] for key in rows}})
    return None if others is None else others.model_copy(update=rows)


def _hidden(
    invalid: pydantic.ValidationError,
    data: Mapping[str, Any],
    record: type[pydantic.BaseModel],
    folder: Path | None,
    known: list[Problem],
) -> list[Problem]:
    """Problems that pydantic looks for only where a table has no other ones: those of its keys together.

    They show when the table is read again without the keys that are wrong; what then lacks one of these keys is not reported.
    """
    found: list[Problem] = []
    left_out: set[str] = set()
    for _ in range(MOST_ROUNDS):
        locations = [location for each in invalid.errors() for location in _wrong_keys(each)]
        pruned = _without(data, locations)
        if pruned is data:
            break
        left_out |= {str(key) for location in locations for key in location[-1:]}
        left_out |= {name for each in (*known, *found) for at in _meant(each.place, each) for name in [_last(at)]}
        data = pruned
        try:
            record.model_validate(data, context={"folder": folder})
            break
        except pydantic.ValidationError as error:
            invalid = error
        places = {each.place for each in (*known, *found)}
        found += [
            each
            for each in problems(invalid, data, record)
            if each.what != MISSING
            and not left_out & _words(each)
            and not (each.place and any(at.startswith(each.place) for at in places))  # which lacks what was left out
            and each.place not in places
        ]
    return found


def _words(problem: Problem) -> set[str]:
    """The keys that a problem may be about: the words of its sentence, and the last one of its place."""
    return {*re.findall(r"\w+", f"{problem.what} {problem.expected}"), _last(problem.place)}


def _last(place: str) -> str:
    """The last key of a place."""
    return place.replace(" ", ".").rpartition(".")[2]


def _wrong_keys(error: Any) -> list[Location]:
    """Locations of the keys that one of pydantic's errors is about."""
    location, raised = error["loc"], error["ctx"]["error"] if error["type"] == "value_error" else None
    if isinstance(raised, Invalid) and isinstance(error["input"], Mapping):
        keys = [re.split(r"[.\[ ]", each.place)[0] for each in raised.problems]
        return [(*location, key) for key in keys if key in error["input"]]
    return [] if error["type"] == "missing" or _counts_only_good_items(error) else [location]


def _without(data: Any, locations: Iterable[Location], *, tables: bool = False) -> Any:
    """The data without the last keys of locations, and without what is not there; tables of a list stay unless they are meant."""
    steps = dict.fromkeys(_steps_to(data, location, tables) for location in locations)
    for each in sorted(steps, key=lambda keys: [str(key).zfill(9) for key in keys], reverse=True):  # last items first
        data = _removed(data, each) if each else data
    return data


def _steps_to(data: Any, location: Location, tables: bool) -> Location:
    """The keys of a location that are the data's, not pydantic's own, to the last key of a table; () for a table of a list."""
    steps: list[Any] = []
    at: Any = data
    key: Any
    for key in location:
        is_item = isinstance(at, list) and isinstance(key, int) and key < len(at)
        if is_item or (isinstance(at, Mapping) and key in at):
            steps.append(key)
            at = at[key]
    if isinstance(at, Mapping) and steps and isinstance(steps[-1], int):
        return tuple(steps) if tables else ()
    while steps and isinstance(steps[-1], int):  # one of several numbers: all of them
        steps.pop()
    return tuple(steps)


def _removed(data: Any, steps: Location) -> Any:
    """A copy of the data, as far as it changes, without what is at the end of the steps."""
    first, rest = steps[0], steps[1:]
    if not isinstance(data, (list, Mapping)):
        return data
    if isinstance(data, list):
        return [_removed(item, rest) if k == first else item for k, item in enumerate(data) if rest or k != first]
    return {key: _removed(item, rest) if key == first else item for key, item in data.items() if rest or key != first}


def problems(error: pydantic.ValidationError, data: Any, record: type[pydantic.BaseModel]) -> list[Problem]:
    """Everything wrong that pydantic found, the most telling first, one problem for each place.

    Args:
        error: what validating `data` as a `record` raised.
    """
    errors = [each for each in error.errors() if not _counts_only_good_items(each)]
    places = [place_of(e["loc"], data, is_missing=e["type"] == "missing") for e in errors]
    first = next((k for k, e in enumerate(errors) if e["type"] == "extra_forbidden"), 0)  # why another key is missing
    if errors[first]["type"] in SCALAR and isinstance(errors[first]["input"], (list, tuple, dict)):
        # of several kinds that a value may have, the one that was recognised further down was meant
        first = next((k for k, at in enumerate(places) if at != places[first] and at.startswith(places[first])), first)
    chosen = {places[first]: first}
    for k, at in enumerate(places):
        if not places[first] or not (at.startswith(places[first]) or places[first].startswith(at)):
            chosen.setdefault(at, k)
    found = {at: _problems(errors[k], record) for at, k in chosen.items()}
    misspelt = [key for at in found for key in _meant(at, found[at][0])]
    return [
        each.within(at)
        for at, each_at in found.items()
        for each in each_at
        if each.what != MISSING or at not in misspelt
    ]


def _counts_only_good_items(error: Any) -> bool:
    """True where pydantic calls a list too short because its items are wrong, which it reports for each of them."""
    return error["type"] == "too_short" and len(error["input"]) >= error["ctx"]["min_length"]


def _meant(place: str, problem: Problem) -> list[str]:
    """The places that a misspelt key was probably meant for, whose absence is not worth another problem."""
    if problem.what != UNKNOWN_KEY:
        return []
    import difflib  # only those who err need it

    table, dot, key = place.rpartition("." if "." in place else " ")
    return [f"{table}{dot}{near}" for near in difflib.get_close_matches(key, problem.choices, n=3, cutoff=0.6)]


def _problems(error: Any, record: type[pydantic.BaseModel]) -> list[Problem]:
    """Problems of one of pydantic's errors, seen from its place: a validator of ours may report several."""
    raised = error["ctx"]["error"] if error["type"] == "value_error" else None
    if not isinstance(raised, Invalid):
        return [_problem(error, record)]
    value = _plain(error["input"])
    return [each if each.place or each.value is not ABSENT else replace(each, value=value) for each in raised.problems]


def _problem(error: Any, record: type[pydantic.BaseModel]) -> Problem:
    """One of pydantic's own errors, seen from its place."""
    kind, location = error["type"], error["loc"]
    value = _plain(error["input"])
    if kind == "extra_forbidden":
        return Problem(UNKNOWN_KEY, value=value, choices=tuple(_fields_at(location, record)))
    if kind == "missing" and isinstance(location[-1], int):  # of a list whose length is fixed
        return Problem(value=value, expected=f"more numbers than {len(error['input'])}")
    if kind == "missing":
        name = str(location[-1])
        return Problem(MISSING, expected=_expected(name, _fields_at(location, record).get(name)))
    if kind == "value_error":
        return Problem(str(error["ctx"]["error"]), value=value)
    if kind in ("union_tag_not_found", "union_tag_invalid"):
        return _wrong_tag(error, record)
    if kind == "tuple_type":
        return Problem(value=value, expected=f"[[{location[-1]}]] tables" if location[-1] in LISTS else "a list")
    if kind == "too_short":
        least, length = error["ctx"]["min_length"], error["ctx"]["actual_length"]
        return Problem(value=value, expected=f"{least} or more, not {length}")
    if kind == "string_pattern_mismatch":
        pattern = error["ctx"]["pattern"]
        return Problem(value=value, expected=PATTERNS.get(pattern, f"text of the form {pattern}"))
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
        return Problem(MISSING, place=key, expected=expected)
    return Problem(place=key, value=_plain(error["input"].get(key)), expected=expected)


def _plain(value: Any) -> Any:
    """A value as a problem shows it: a number, text or a list of them; of a table its `value`, else nothing."""
    if isinstance(value, dict):
        value = value.get("value")
    items = value if isinstance(value, (list, tuple)) else [value]
    return value if all(isinstance(item, (str, int, float, bool)) for item in items) else ABSENT


def place_of(location: Location, data: Any, *, is_missing: bool = False) -> str:
    """A place in the file in the reader's words: `joint 'elbow' motor.resistance_ohm`.

    Pydantic puts names of its own into a location (the branch of a union, a validator): what is no key there is left out.

    Args:
        location: keys and numbers of list items, from the document on.   data: the document.
        is_missing: whether the last key may be absent there.
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


def described_field(location: Location, record: type[pydantic.BaseModel]) -> tuple[str, str]:
    """Expected type and description of the field at a location; those of the table around it if the field has none."""
    while location:
        key = location[-1]
        field = _fields_at(location, record).get(key) if isinstance(key, str) else None
        if field is not None and (field.description or len(location) == 1):
            return _expected(str(key), field), field.description or ""
        location = location[:-1]
    return "a value", ""


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
    kinds = (field.metadata, *(getattr(kind, "__metadata__", ()) for kind in getattr(field.annotation, "__args__", ())))
    notes = [note.expected for notes in kinds for note in notes if hasattr(note, "expected")]
    if notes:
        return notes[0]
    if getattr(field.annotation, "__origin__", None) is dict:
        return "a table, by name"
    records = _records_in(field.annotation)
    if records:
        fields = records[0].model_fields
        needed = [key for key, inner in fields.items() if inner.is_required()]
        return f"a table with {', '.join(needed)}" if needed else f"a table with some of {', '.join(fields)}"
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

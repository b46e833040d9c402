"""Scenario → `*.scenario.toml`, which `read_scenario` reads back to an equal scenario.

A scenario that was read from a file is written into that file's text: what changed since is replaced, and comments, order and
everything else stay. What was written is read again before it takes its place, so that no file differs from its scenario.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import AoT, InlineTable, Table

from armwright.description import builtin_names
from armwright.description.writer import to_toml
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import ArmwrightError, OutputError, ScenarioError
from armwright.model import Model
from armwright.model.joint_signals import joint_units
from armwright.output import check_destination, write_whole
from armwright.results.csv_tables import write_table
from armwright.scenarios.file import parse_scenario
from armwright.scenarios.files import Document, FolderFiles, KeptFiles
from armwright.scenarios.tables import Tables, difference, tables_of
from armwright.simulation.inputs.input_schedule import WRENCH
from armwright.simulation.inputs.schedule import Schedule
from armwright.simulation.scenario import Scenario
from armwright.trajectory.motion import Motion

ENDING = ".scenario.toml"
WIDE = 130  # characters of a list in one line
NAMED = (  # places of the names of other files
    ("robot",),
    ("commands", "schedule"),
    ("loop", "reference"),
    ("recording", "reference"),
    ("inputs", "wrench"),
    ("inputs", "brake"),
    ("inputs", "supply_v"),
    ("inputs", "enabled"),
)


def write_scenario(
    scenario: AnyScenario,
    path: str | os.PathLike[str],
    *,
    robot: str | os.PathLike[str] | None = None,
    allow: Iterable[str | os.PathLike[str]] = (),
    comments: Sequence[str] = (),
) -> tuple[Path, ...]:
    """Writes a scenario as a file that `read_scenario` reads back to an equal one, whose simulation has the same bits.

    Of a scenario that was read from a file, comments, order and what did not change stay as they are in it, its table [tuning]
    too. An arm that is neither built in nor from a file becomes a robot file beside the scenario, and a schedule that is not from
    the scenario's file becomes a CSV file beside it; both are named after the scenario.

    Args:
        scenario: read from a file, or made in Python.   path: of the new `*.scenario.toml`.
        robot: name of a built-in arm or path of a robot file that has the scenario's arm, to be named in place of its own.
        allow: further folders that the file may name files in.   comments: lines to be put before [loop.controller].
    Returns:
        paths: of what was written, the scenario first.
    Raises:
        ScenarioError: what no scenario file can express, such as a controller or a function of Python; names the field and what
            would do. A file that it names which is not below its folder, or has other contents now.
        OutputError: it cannot be written.
    Example:
        >>> scenario = aw.Scenario("two-link", 0.2, command=[0.0, 0.0])
        >>> [path.name for path in aw.write_scenario(scenario, "fall.scenario.toml")]
        ['fall.scenario.toml']
    """
    scenario = as_scenario(scenario)
    path, allow = Path(path), [Path(each) for each in allow]
    check_destination(path, (".toml",))
    names = _Names(path, None if robot is None else os.fspath(robot))
    tables, lanes = tables_of(scenario)
    base = _origin(scenario)
    if base is None:
        text = tomlkit.dumps(_fresh(tables, lanes, names))
    else:
        text = tomlkit.dumps(_merged(base, tables, lanes, names))
    text = _with_comments(text, comments)
    with _written(names.beside, replacing=path.exists()):
        again = parse_scenario(text, str(path), FolderFiles(path.parent, allow))
        _check_same(again, tables, lanes, path)
    write_whole(path, text, (".toml",))
    return (path, *names.beside)


@contextmanager
def _written(files: Mapping[Path, Callable[[Path], Any]], *, replacing: bool) -> Iterator[None]:
    """Writes files beside a scenario; if the block fails, those that were not there are removed.

    Args:
        files: each with the function that writes it.   replacing: whether the scenario's file is there already.
    Raises:
        OutputError: a file of that name that belongs to no such scenario, or one that cannot be written.
    """
    new = [each for each in files if not each.exists()]
    for file in files:
        check_destination(file)
        if file not in new and not replacing:
            expected = "another name for the scenario, or robot= for its robot"
            raise OutputError("is there already, and would be replaced", file=file, expected=expected)
    try:
        for file, write in files.items():
            write(file)
        yield
    except BaseException:
        for file in new:
            file.unlink(missing_ok=True)
        raise


def _check_same(again: Scenario, tables: Tables, lanes: Mapping[str, np.ndarray], path: Path) -> None:
    """Refuses a file that does not read back to the scenario.

    Raises:
        ScenarioError: names the place.
    """
    found, found_lanes = tables_of(again)
    place = difference(tables, found) or difference(dict(lanes), found_lanes, "lanes.vary")
    if place is None:
        return
    what, expected = "the file would not give this back", "values that a scenario file has"
    if place.startswith("robot"):
        what, place = f"the file {found['robot'].file} does not have the scenario's arm", "robot"
        expected = "robot=NAME or PATH of a file that has it, as aw.robotfiles.write_toml makes one"
    elif place.endswith(".file"):
        what, expected = "the file that it names has other contents now", "the file as it was read"
    raise ScenarioError(what, place=place, expected=expected, file=path)


@dataclass
class _Names:
    """Names of other files in the scenario's, relative to its folder.

    Attributes:
        path: of the scenario's file.   robot: to be named in place of the arm's own; None: that.
        beside: files that are written beside it, each by its function.
    """

    path: Path
    robot: str | None
    beside: dict[Path, Callable[[Path], Any]] = field(default_factory=dict)

    def of_file(self, path: str) -> str:
        """A file's path as the scenario's file names it."""
        try:
            return Path(os.path.relpath(path, self.path.parent)).as_posix()
        except ValueError:  # another drive of Windows
            return Path(path).as_posix()

    def of_robot(self, arm: Model) -> str:
        """The name of an arm's file, which is written where there is none."""
        name = self.robot or arm.file
        if name is None:
            if arm.description is None:
                raise ScenarioError("was not made from a record", place="arm", value=arm.name, expected="a loaded arm")
            companion = self._companion("robot.toml")
            text = to_toml(arm.description, companion.parent)
            self.beside[companion] = lambda path: write_whole(path, text)
            return companion.name
        return name if name in builtin_names() else self.of_file(name)

    def of_motion(self, motion: Motion) -> str:
        """The name of a motion's file."""
        return self.of_file(motion.file)

    def of_schedule(self, place: str, schedule: Schedule, units: Sequence[str] | None) -> str:
        """The name of a schedule's file, which is written."""
        companion = self._companion(f"{place}.csv")
        heads = (
            [f"{name} [{unit}]" for name, unit in zip(schedule.names, units, strict=True)] if units else schedule.names
        )
        columns = {"t [s]": schedule.times, **dict(zip(heads, schedule.commands.T, strict=True))}
        self.beside[companion] = lambda path: write_table(path, columns)
        return companion.name

    def _companion(self, ending: str) -> Path:
        name = self.path.name
        stem = name.removesuffix(ENDING) if name.endswith(ENDING) else self.path.stem
        return self.path.with_name(f"{stem}.{ending}")


@dataclass(frozen=True)
class _Origin:
    """The file that a scenario was read from: its text, its folder, and its tables as they were."""

    text: str
    folder: Path
    tables: Tables
    lanes: Mapping[str, np.ndarray]


def _origin(scenario: Scenario) -> _Origin | None:
    """The scenario's file as it was read; None of a scenario made in Python, or of files too large to be kept."""
    source = scenario.source
    if source is None:
        return None
    kept = Document.model_validate(json.loads(source.document))
    path = Path(source.path)
    try:
        text = kept.scenario.checked("content of the scenario", path)
        read = parse_scenario(text, str(path), KeptFiles(path, kept))
    except ArmwrightError:
        return None
    return _Origin(text, path.parent, *tables_of(read))


def _merged(base: _Origin, tables: Tables, lanes: Mapping[str, np.ndarray], names: _Names) -> Any:
    """The file's document with what changed since it was read."""
    document = tomlkit.parse(base.text)
    arm = tables["robot"]
    kept = _kept_names(base, document, tables)
    _merge(document, base.tables, tables, (), arm, names)
    for place, name in kept.items():
        _rename(document, place, names.of_file(os.path.join(base.folder, name)))
    if names.robot is not None:
        document["robot"] = names.of_robot(arm)
    if difference(dict(base.lanes), dict(lanes)) is not None:
        _merge_lanes(document, base.lanes, lanes)
    return document


def _kept_names(base: _Origin, document: Any, tables: Tables) -> dict[tuple[str, ...], str]:
    """Names of files that stay, by their places."""
    found: dict[tuple[str, ...], str] = {}
    for place in NAMED:
        raw, old, new = (_at(each, place) for each in (document, base.tables, tables))
        if None not in (raw, old, new) and difference(old, new) is None:
            found |= _file_names(place, document)
    return {place: name for place, name in found.items() if name not in builtin_names() or place != ("robot",)}


def _at(tables: Any, place: tuple[str, ...]) -> Any:
    """The value at a place of tables; None where there is none."""
    for key in place:
        tables = tables.get(key) if isinstance(tables, Mapping) else None
    return tables


def _file_names(place: tuple[str, ...], document: Any) -> dict[tuple[str, ...], str]:
    """The names of files at a place of a document and, of a reference, in those that it shapes."""
    value = _at(document, place)
    if isinstance(value, str):
        return {place: str(value)}
    if not isinstance(value, Mapping):
        return {}
    found = {(*place, "file"): str(value["file"])} if isinstance(value.get("file"), str) else {}
    return found | (_file_names((*place, "reference"), document) if "reference" in value else {})


def _rename(document: Any, place: tuple[str, ...], name: str) -> None:
    for key in place[:-1]:
        document = document[key]
    if str(document[place[-1]]) != name:
        document[place[-1]] = name


def _merge(raw: Any, old: Tables, new: Tables, place: tuple[str, ...], arm: Model, names: _Names) -> None:
    """Replaces in a table of the document what differs between the tables as read and as they are to be."""
    for key in [key for key in old if key not in new and key in raw]:
        del raw[key]
    for key, value in new.items():
        before: Any = old.get(key)
        if key in old and difference(before, value) is None:
            continue
        here = (*place, key)
        inside = raw.get(key)
        tables = all(isinstance(each, Mapping) for each in (value, before, inside))
        if tables and value.get("kind") == before.get("kind"):
            _merge(inside, before, value, here, arm, names)
        else:
            _put(raw, key, _item(_named(value, here, arm, names), here, isinstance(raw, InlineTable)))


def _put(raw: Any, key: str, item: Any) -> None:
    """Sets a key; the comment behind a value stays."""
    if key in raw and not isinstance(item, (Table, AoT)) and not isinstance(raw[key], (Table, AoT)):
        old = raw[key]
        if hasattr(old, "trivia") and hasattr(item, "trivia"):
            item.trivia.comment_ws, item.trivia.comment = old.trivia.comment_ws, old.trivia.comment
    elif key in raw:
        del raw[key]
    raw[key] = item


def _merge_lanes(document: Any, old: Mapping[str, np.ndarray], new: Mapping[str, np.ndarray]) -> None:
    """[lanes] with other values: single lists beside those that stay, or all of them as lists."""
    if not new:
        del document["lanes"]
        return
    raw = document.get("lanes")
    same_count = bool(old) and len(next(iter(old.values()))) == len(next(iter(new.values())))
    if raw is None or raw["kind"] == "grid" or not same_count:
        if raw is not None:
            del document["lanes"]
        document["lanes"] = _lanes(new)
        return
    for name in [name for name in raw["vary"] if name in old and name not in new]:
        del raw["vary"][name]
    for name, values in new.items():
        if name not in old or not np.array_equal(old[name], values):
            raw["vary"][name] = _item({"values": values.tolist()}, ("lanes", "vary", name), True)


def _lanes(lanes: Mapping[str, np.ndarray]) -> Any:
    vary = {name: {"values": values.tolist()} for name, values in lanes.items()}
    return _item({"kind": "list", "vary": vary}, ("lanes",), False)


def _fresh(tables: Tables, lanes: Mapping[str, np.ndarray], names: _Names) -> Any:
    """A document of its own."""
    document = tomlkit.document()
    arm = tables["robot"]
    for key, value in tables.items():
        if not (key == "seed" and value == 0):
            document[key] = _item(_named(value, (key,), arm, names), (key,), False)
    if lanes:
        document["lanes"] = _lanes(lanes)
    return document


def _named(value: Any, place: tuple[str, ...], arm: Model, names: _Names) -> Any:
    """A value of tables with the names of files in place of robots, motions and schedules."""
    if isinstance(value, Model):
        return names.of_robot(value)
    if isinstance(value, Motion):
        return names.of_motion(value)
    if isinstance(value, Schedule):
        of = place[-1] if place[-1] != "file" else "reference"
        units: dict[str, Sequence[str]] = {
            "schedule": joint_units(arm, "u"),
            "reference": joint_units(arm, "q"),
            "wrench": ["N"] * 3 + ["N m"] * 3,
            "supply_v": ["V"],
        }
        names_of: dict[str, list[str]] = {"wrench": list(WRENCH), "supply_v": ["supply"]}
        listed = names_of.get(of, list(arm.names))
        by_name = dict(zip(listed, units[of], strict=True)) if of in units else {}  # switches have no unit
        stated = [by_name[name] for name in value.names] if by_name else None
        return names.of_schedule("commands" if of == "schedule" else of, value, stated)
    if isinstance(value, dict):
        return {key: _named(each, (*place, key), arm, names) for key, each in value.items()}
    return value


def _item(value: Any, place: tuple[str, ...], inline: bool) -> Any:
    """A value as an item of TOML: tables at the places where files have them, others in one line."""
    if isinstance(value, dict):
        if inline or not _has_heading(place):
            item = tomlkit.inline_table()
            for key, each in value.items():
                item[key] = _item(each, (*place, key), True)
            return item
        table = tomlkit.table()
        ordered = sorted(value.items(), key=lambda pair: isinstance(pair[1], dict) and _has_heading((*place, pair[0])))
        for key, each in ordered:
            table[key] = _item(each, (*place, key), False)
        return table
    if place == ("inputs", "payload") and not inline:
        tables = tomlkit.aot()
        for each in value:
            tables.append(_item(each, place, False))
        return tables
    if isinstance(value, (list, tuple)):
        array = tomlkit.array()
        for each in value:
            array.append(_item(each, place, True))
        return array.multiline(len(array.as_string()) > WIDE and not inline)
    return tomlkit.item(value)


def _has_heading(place: tuple[str, ...]) -> bool:
    """True for tables with a heading of their own: the parts, those of a loop, and controllers within controllers."""
    if place[0] in ("lanes", "inputs"):
        return place in (("lanes",), ("lanes", "vary"), ("inputs",), ("inputs", "payload"))
    if place[-1] == "inner":
        return _has_heading(place[:-1])
    return len(place) == 1 or (len(place) == 2 and (place[0] == "loop" or place[1] == "reference"))


def _with_comments(text: str, comments: Sequence[str]) -> str:
    """The text with lines before the heading of [loop.controller], or before the text."""
    if not comments:
        return text
    begun = {comment.partition(":")[0] for comment in comments if ":" in comment}
    for begin in begun:  # those that the same command wrote before
        text = re.sub(rf"^# {re.escape(begin)}: .*\n", "", text, flags=re.MULTILINE)
    lines = "".join(f"# {line}\n" for line in comments)
    heading = re.search(r"^[ \t]*\[\s*loop\s*\.\s*controller\s*\]", text, re.MULTILINE)
    at = 0 if heading is None else heading.start()
    return text[:at] + lines + text[at:]

"""Controllers, filters and trajectories that a scenario file names by their kind, from their fields."""

from __future__ import annotations

import dataclasses
import importlib
import re
from collections.abc import Mapping
from functools import partial
from typing import Any

from armwright.errors import Problem, ScenarioError
from armwright.model import Model
from armwright.scenarios.records import KindTable
from armwright.scenarios.values import VALUE
from armwright.trajectory.limits import QUANTITIES, MotionLimits
from armwright.trajectory.motion import Motion

HOMES = {"controller": "armwright.control", "filter": "armwright.control", "reference": "armwright.trajectory"}
CONFIGURED = {
    "controller": ("arm", "model", "signs", "period", "sections"),
    "filter": (),
    "reference": ("arm", "model", "limits"),
}  # what no file tells
FILE_KEYS = {"cycle": "period", "cycles": "periods"}  # by field; in Python a period is that of samples
OF_FILES = ("PiecewisePolynomial", "Joined", "CartesianMotion", "PathMotion")  # motions that files of motions make


def controller_of(place: str, fields: Mapping[str, Any], arm: Model) -> Any:
    """A controller, with the controller and the filters that it holds.

    Args:
        place: of its table in the file.   fields: its values and its kind.   arm: that it drives.
    Raises:
        ScenarioError: as `from_fields`.
    """
    inside: dict[str, Any] = {}
    if "inner" in fields:
        inside["inner"] = controller_of(f"{place}.inner", fields["inner"], arm)
    if isinstance(fields.get("filters"), list):
        rows = enumerate(fields["filters"])
        inside["filters"] = [from_fields("filter", f"{place}.filters[{k}]", row, arm) for k, row in rows]
    return from_fields("controller", place, {**fields, **inside}, arm)


def from_fields(home: str, place: str, fields: Mapping[str, Any], arm: Model) -> Any:
    """A controller, filter or trajectory from its fields.

    Args:
        home: "controller", "filter" or "reference".   place: of its table in the file.   fields: its values and its kind.
        arm: that it is for.
    Raises:
        ScenarioError: no such kind, a field that it has not or lacks, or a value that cannot be.
    """
    kinds, kind = kinds_of(home), fields["kind"]
    if kind not in kinds:
        extra = VALUE if home == "reference" else ()
        raise ScenarioError("unknown", place=f"{place}.kind", value=kind, choices=[*kinds, *extra])
    accepted = [each for each in dataclasses.fields(kinds[kind]) if each.init]
    names = [each.name for each in accepted]
    fields_of = {key: field.name for key, field in keys_of(home, kinds[kind]).items()}
    limited = QUANTITIES if home == "reference" and "limits" in names else ()
    given = {name: value for name, value in fields.items() if name != "kind"}
    unknown = [name for name in given if name not in fields_of and name not in limited]
    if unknown:
        what, choices = f"no key of a {kind}", tuple(sorted((*fields_of, *limited)))
        raise ScenarioError.of(
            *(Problem(what, place, name, expected=_around(name, kind, kinds), choices=choices) for name in unknown)
        )
    values: dict[str, Any] = {name: arm for name in ("arm", "model") if name in names}
    values |= {fields_of.get(name, name): value for name, value in given.items()}
    overrides = {name: values.pop(name) for name in limited if name in values}
    try:
        if limited and (overrides or values.get("duration") is None):
            values["limits"] = MotionLimits.of(arm, **overrides)
        return kinds[kind](**values)
    except TypeError as error:
        missing = [
            FILE_KEYS.get(each.name, each.name) for each in accepted if _is_needed(each) and each.name not in values
        ]
        what = f"{kind} needs {', '.join(missing)}" if missing else str(error)
        raise ScenarioError(what, place=place) from None
    except ScenarioError as error:  # which names the class: Step.time
        own = rf"^(?:{kinds[kind].__name__}|limits)\.(\w+)"
        raise error.renamed(partial(re.sub, own, lambda at: f"{place}.{FILE_KEYS.get(at[1], at[1])}")) from None


def keys_of(home: str, kind: type) -> dict[str, dataclasses.Field]:
    """The keys that a file may give a controller, filter or trajectory, with the fields that they set.

    Args:
        home: "controller", "filter" or "reference".   kind: the class.
    """
    fields = [each for each in dataclasses.fields(kind) if each.init and each.name not in CONFIGURED[home]]
    return {FILE_KEYS.get(each.name, each.name): each for each in fields}


def controller_tables(place: str, controller: KindTable) -> dict[str, str]:
    """The tables of a controller and of those that it holds, by the names of their classes.

    Args:
        place: of the controller's table in the file.   controller: the table.
    """
    known, inner = kinds_of("controller").get(controller.kind), controller.fields().get("inner")
    below = (
        controller_tables(f"{place}.inner", KindTable(**inner)) if isinstance(inner, dict) and "kind" in inner else {}
    )
    return below | ({} if known is None else {known.__name__: place})


def kinds_of(home: str) -> dict[str, type]:
    """Controllers, filters or trajectories by the name a file gives them: JointPID is joint_pid."""
    module = importlib.import_module(HOMES[home])
    found = {name: getattr(module, name) for name in module.__all__ if name not in OF_FILES}
    method = {"controller": "step", "filter": "polynomials"}.get(home)
    return {
        re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower(): kind
        for name, kind in found.items()
        if isinstance(kind, type) and dataclasses.is_dataclass(kind)
        if (hasattr(kind, method) if method else issubclass(kind, Motion))
    }


def kind_of(home: str, value: Any) -> str | None:
    """The name that a file gives a controller, filter or trajectory; None of one that no file can name.

    Args:
        home: "controller", "filter" or "reference".   value: that may be one.
    """
    return next((name for name, kind in kinds_of(home).items() if type(value) is kind), None)


def _around(name: str, kind: str, kinds: Mapping[str, type]) -> str:
    """The controller that has a key and may stand around one that has not: `gravity` of a feed_forward around a cascade."""
    fields = {each: {field.name for field in dataclasses.fields(kinds[each])} for each in kinds}
    around = [each for each, names in fields.items() if {name, "inner"} <= names]
    if not around or "inner" in fields[kind]:
        return ""
    return f'{{ kind = "{around[0]}", {name} = …, inner = {{ kind = "{kind}", … }} }}, or its own keys'


def _is_needed(field: dataclasses.Field) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING

"""Difference of two robot files, number by number, and its effect on the dynamics."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from armwright.description import RobotDescription
from armwright.description.paths import below, path_name, split_path
from armwright.errors import ModelError
from armwright.features import Support
from armwright.model import Model, build_model
from armwright.model.load import load
from armwright.model.variants.edits import tip_of
from armwright.quantity import Quantity, Record, Source
from armwright.results.result import Result
from armwright.results.table import Cell, Table, number
from armwright.robotfiles.dynamic_effect import DynamicEffect, dynamic_effect

SUPPORT = Support("diff")

Arm = str | os.PathLike[str] | Model | RobotDescription
WHOLE = ("joints", "links", "frames", "cylinders")  # whose items come and go as a whole
# of the description itself
NOT_PHYSICAL = ("sources", "built_from", "fits", "remarks", "without_masses", "notes", "title", "name", "source")


@dataclass(frozen=True)
class Change:
    """One parameter that differs; None stands for an absent one.

    Attributes:
        path: such as `link3.mass_kg`; the name alone for a joint, link, frame or cylinder that is in only one of the two.
        before, after: the values.   std_before, std_after: their standard deviations.
        source_before, source_after: where they come from.
    """

    path: str
    before: Any
    after: Any
    std_before: Any = None
    std_after: Any = None
    source_before: Source | None = None
    source_after: Source | None = None

    @property
    def is_source_only(self) -> bool:
        """True if the value is the same and only its source or standard deviation differs."""
        return self.before == self.after


@dataclass(frozen=True, eq=False)
class Difference(Result):
    """Result of `diff`.

    Attributes:
        a, b: names of the two.   changes: in the order of the first, then those that only the second has.
        effect: on the dynamics; None where they have no joint in common.
    """

    a: str
    b: str
    changes: tuple[Change, ...]
    effect: DynamicEffect | None

    def __bool__(self) -> bool:
        return bool(self.changes)

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.a} → {self.b}"

    def sentences(self) -> list[str]:
        """A sentence if nothing differs, or if the dynamics cannot be compared."""
        if not self:
            return [f"{self.a} and {self.b}: every parameter and every source is the same"]
        return [] if self.effect is not None else ["no joint is in both: gravity torques and inertias are not compared"]

    def tables(self) -> list[Table]:
        """Parameters with their change in percent, sources of equal values, and the effect on the dynamics."""
        rows = [_row(change) for change in self.changes if not change.is_source_only]
        heads = ("parameter", "A", "B", "change [%]", "source")
        sources = _sources([change for change in self.changes if change.is_source_only])
        effect = [] if self.effect is None or not self else [_effect(self.effect)]
        return [Table("Parameters", heads, rows, ("A", "B", "source")), sources, *effect]


def diff(a: Arm, b: Arm) -> Difference:
    """Compares two robots parameter by parameter, with sources, and computes the effect on the dynamics.

    Args:
        a: the first: a name, a path, an arm or a description.   b: the second.
    Returns:
        difference: its `changes`, and as `effect` total mass, and gravity torques and inertias over sample poses.
    Raises:
        DescriptionError: an invalid file.   ModelError: an arm without a description.
    Example:
        >>> arm = aw.load("two-link")
        >>> heavy = arm.with_values({"forearm.mass_kg": 2.0})
        >>> [change.path for change in aw.robotfiles.diff(arm, heavy).changes]
        ['forearm.mass_kg']
    """
    one, other = _model(a), _model(b)
    first, second = one.description, other.description
    assert first is not None
    assert second is not None
    order = Change("order of the joints", _order(one, other), _order(other, one))
    changes = (*([] if order.before == order.after else [order]), *changed_parameters(first, second))
    return Difference(_name(a), _name(b), changes, dynamic_effect(one, other))


def changed_parameters(first: RobotDescription, second: RobotDescription) -> list[Change]:
    """Parameters that differ between two descriptions, in the order of the first, then those that only the second has."""
    before, after = flattened(first), flattened(second)
    rows = [(path, before.get(path), after.get(path)) for path in dict.fromkeys((*before, *after))]
    lone = {path for path, old, new in rows if not split_path(path)[1] and (old is None or new is None)}
    return [
        _change(path, old, new, first, second)
        for path, old, new in rows
        if (path in lone or path_name(split_path(path)[0]) not in lone) and not _same(old, new, first, second)
    ]


def _model(arm: Arm) -> Model:
    if isinstance(arm, RobotDescription):
        return build_model(arm, on_impossible="warn")
    model = arm if isinstance(arm, Model) else load(arm, on_impossible="warn")
    if model.description is None:
        raise ModelError("this model has no description to compare", value=model.name)
    return model


def _name(arm: Arm) -> str:
    return arm.name if isinstance(arm, (Model, RobotDescription)) else os.fspath(arm)


def _order(arm: Model, other: Model) -> str:
    """Of the joints that both have."""
    return ", ".join(name for name in arm.names if name in other.names)


def _same(old: Leaf | None, new: Leaf | None, first: RobotDescription, second: RobotDescription) -> bool:
    if old is None or new is None:
        return (old or new or Leaf(None)).value is None
    if old.is_whole and new.is_whole:
        return True
    return (old.value, old.std) == (new.value, new.std) and _source(first, old) == _source(second, new)


def _source(robot: RobotDescription, leaf: Leaf | None) -> Source | None:
    return None if leaf is None or leaf.source is None else robot.source_of(leaf.source)


def _change(path: str, old: Leaf | None, new: Leaf | None, first: RobotDescription, second: RobotDescription) -> Change:
    before, after = old or Leaf(None), new or Leaf(None)
    pictures = path.endswith(".visuals")  # of which the deviation holds the solids
    std_before, std_after = (None if pictures else leaf.std for leaf in (before, after))
    return Change(path, before.value, after.value, std_before, std_after, _source(first, old), _source(second, new))


@dataclass(frozen=True)
class Leaf:
    """Value at a path: a number with standard deviation and source, or a word."""

    value: Any
    std: Any = None
    source: str | None = None
    is_whole: bool = False  # a joint, link, frame or cylinder: its fields have leaves of their own


def flattened(robot: RobotDescription) -> dict[str, Leaf]:
    """Every number and word of a description by its dotted path, in its order.

    A joint, link, frame or cylinder also has a leaf under its name alone, for one that the other description has not;
    pictures are one leaf a link. Titles, notes and the list of sources are left out.
    """
    flat: dict[str, Leaf] = {}
    for name in type(robot).model_fields:
        if name in WHOLE:
            for item in getattr(robot, name):
                flat[path_name(item.name)] = Leaf(_summary(item, name), is_whole=True)
                flat.update(_of_item(item, robot.source))
        elif name == "tip":
            flat[name] = Leaf(tip_of(robot))
        elif name not in NOT_PHYSICAL:
            flat.update(_walk(getattr(robot, name), name, robot.source))
    return flat


def _of_item(item: Any, source: str | None) -> Iterator[tuple[str, Leaf]]:
    for path, value in below(item, path_name(item.name)):
        key = path.rsplit(".", 1)[-1]
        if key == "visuals":
            yield path, Leaf(f"{len(value)} solids" if value else None, value)
        elif key not in ("name", "source"):
            yield from _walk(value, path, item.source or source)


def _walk(value: Any, path: str, source: str | None) -> Iterator[tuple[str, Leaf]]:
    if isinstance(value, Quantity):
        yield path, Leaf(value.value, value.std, value.source or source)
    elif isinstance(value, (Record, tuple)):
        source = getattr(value, "source", None) or source
        for inner, item in below(value, path):
            if not inner.endswith(".source"):
                yield from _walk(item, inner, source)
    elif value is not None:
        yield path, Leaf(value)


def _summary(item: Any, kind: str) -> str:
    if kind == "links":
        return f"link of {float(item.mass_kg):g} kg"
    if kind == "cylinders":
        return f"cylinder from {item.link_a} to {item.link_b}"
    return f"{item.type} joint" if kind == "joints" else f"frame on {item.link}"


def _row(change: Change) -> list[str]:
    sources = [_source_text(source) for source in (change.source_before, change.source_after) if source is not None]
    origins = " → ".join(dict.fromkeys(sources))
    values = [
        Cell(_value(value, std), value) if _is_number(value) else _value(value, std)
        for value, std in ((change.before, change.std_before), (change.after, change.std_after))
    ]
    return [change.path, *values, _relative(change.before, change.after), origins]


def _source_text(source: Source) -> str:
    return source.kind if source.kind == source.text else f"{source.kind}: {_short(source.text)}"


def _short(text: str, most: int = 36) -> str:
    return text if len(text) <= most else f"{text[: most - 1].rstrip()}…"


def _value(value: Any, std: Any) -> str:
    """A number, several numbers or a word; with its standard deviation."""
    if value is None:
        return "absent"
    if isinstance(value, tuple):
        text = f"[{', '.join(_value(item, None) for item in value)}]"
    else:
        text = f"{value + 0.0:.7g}".replace("-", "−") if _is_number(value) else str(value)
    return text if std is None else f"{text} ± {_value(std, None)}"


def _relative(before: Any, after: Any) -> str:
    """Of one number, in percent, without the unit."""
    share = _percent(before, after) if _is_number(before) and _is_number(after) else ""
    return Cell(share.removesuffix(" %"), share.value) if isinstance(share, Cell) else share


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _percent(before: float, after: float) -> str:
    if before == 0:
        return ""
    share = (after - before) / abs(before)
    percent = 100 * share if abs(share) > 1e-12 else 0.0
    return Cell(f"{percent:+.3g} %".replace("-", "−").replace("+0 ", "0 "), percent)


def _sources(changes: list[Change]) -> Table:
    """Numbers that stayed, and come from elsewhere now: one row for each pair of sources."""
    groups: dict[tuple[str, str], list[str]] = {}
    for change in changes:
        groups.setdefault((_origin(change, "before"), _origin(change, "after")), []).append(change.path)
    rows = [[_named(paths), *pair] for pair, paths in groups.items()]
    return Table("Same value, other source or deviation", ("parameters", "A", "B"), rows, ("A", "B"))


def _named(paths: list[str], most: int = 3) -> str:
    rest = f" and {len(paths) - most} more" if len(paths) > most else ""
    return f"{', '.join(paths[:most])}{rest}"


def _origin(change: Change, which: str) -> str:
    source, std = getattr(change, f"source_{which}"), getattr(change, f"std_{which}")
    spread = "" if std is None else f"± {_value(std, None)}, "
    return spread + ("" if source is None else _source_text(source))


def _effect(effect: DynamicEffect) -> Table:
    heads = ("joint", "gravity A [N m | N]", "gravity B", "change", "inertia A [kg m² | kg]", "inertia B", "change ")
    least = 1e-12 * max(float(abs(effect.gravity).max()), 1.0)
    rows = []
    for k, joint in enumerate(effect.joints):
        gravity = [float(abs(effect.gravity[arm, :, k]).max()) for arm in (0, 1)]
        gravity = [
            number(value if value > least else 0.0) for value in (*gravity, abs(float(effect.gravity_change[k])))
        ]
        inertia = [number(effect.inertia[arm, :, k].max()) for arm in (0, 1)]
        share = float(effect.inertia_change[k])
        percent = "—" if share != share else _percent(1.0, 1.0 + share)
        rows.append([joint, *gravity, *inertia, percent])
    one, other = effect.mass
    mass = f"mass {number(one)} → {number(other)} kg{f' ({_percent(one, other)})' if one else ''}"
    return Table(f"What it does, the largest of {len(effect.poses)} poses; {mass}", heads, rows)

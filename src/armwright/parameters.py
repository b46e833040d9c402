"""Values that differ by lane: a `Batch` or a `Draw`, in place of any number or array of a scenario."""

from __future__ import annotations

import copy
import math
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError, check_known

if TYPE_CHECKING:
    from collections.abc import Sequence

    Number = float | np.number[Any]

    class Numbers:
        """A field that is written as one number, one for each joint, or a value for each lane, and read as code needs it.

        Type checkers take the constructor's parameter from `__set__`, and what an instance has from `__get__`.
        """

        def __get__(self, instance: Any, owner: Any = None) -> Any: ...

        def __set__(
            self,
            instance: Any,
            value: Number | Sequence[Number] | Sequence[Sequence[Number]] | np.ndarray | Batch | Draw,
        ) -> None: ...

    class NumbersOrNone:
        """The same, or None."""

        def __get__(self, instance: Any, owner: Any = None) -> Any: ...

        def __set__(
            self,
            instance: Any,
            value: Number | Sequence[Number] | Sequence[Sequence[Number]] | np.ndarray | Batch | Draw | None,
        ) -> None: ...

else:
    Numbers = NumbersOrNone = Any

ZERO: Any = 0.0  # defaults of such fields
ONE: Any = 1.0
UNSET: Any = None


@dataclass(frozen=True, eq=False)
class Batch:
    """One value for each lane: lane k takes `values[k]`.

    Everything else, arrays of any shape included, is one value that all lanes share.

    Args:
        values: (lanes, …) numbers, or a sequence of other values such as schedules.
    Raises:
        ScenarioError: no lanes, rows of unequal shape, or a batch inside.
    Example:
        >>> q = aw.Batch([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]])  # three starts
        >>> run = aw.simulate(aw.Scenario("two-link", 0.1, command=[0.0, 0.0], start=q))
        >>> run.q.sel(time=0.1, joint="shoulder").values.round(3)
        array([-0.065,  0.442,  0.964])
    """

    values: Any

    def __post_init__(self) -> None:
        values = self.values
        if isinstance(values, (Batch, str, bytes)):
            raise ScenarioError(place="Batch", value=values, expected="one value for each lane")
        if isinstance(values, (list, tuple)) and any(isinstance(each, Batch) for each in values):
            raise ScenarioError("holds a Batch", place="Batch", value=values, expected="one value for each lane")
        if np.ma.isMaskedArray(values) and np.ma.getmaskarray(values).any():
            raise ScenarioError("masked entries", place="Batch", value=values, expected="one value for each lane")
        try:
            array = np.array(values)
        except (ValueError, TypeError):
            expected = "one shape for all lanes"
            raise ScenarioError("rows of unequal shape", place="Batch", value=values, expected=expected) from None
        if array.ndim == 0 or not len(array):
            expected = "one value for each lane, and at least one lane"
            raise ScenarioError(place="Batch", value=values, expected=expected)
        object.__setattr__(self, "values", array if array.dtype.kind in "iufb" else tuple(values))

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        return f"<batch of {len(self)} lanes: {self.values[0]!r:.40}, …>"

    @property
    def shape(self) -> tuple[int, ...] | None:
        """Shape of one lane's value; None if values are not numbers."""
        return self.values.shape[1:] if isinstance(self.values, np.ndarray) else None

    def __array__(self, *args: Any, **kwargs: Any) -> Any:
        raise ScenarioError("used as one array", value=self, expected="code that takes one lane's value")


@dataclass(frozen=True, eq=False)
class Draw:
    """A random value for each lane, in place of a `Batch`; lane k's value depends on seed, place and k alone.

    `Draw()` follows the standard deviation that the robot's record gives, for numbers in `vary`. Others are made by
    `Draw.normal`, `Draw.uniform` and `Draw.lognormal`. Values are drawn by inverting the distribution, one uniform number of a
    counter-based generator each, so that a run of some of the lanes has the same values.

    Attributes:
        kind: "record", "normal", "uniform" or "lognormal".   centre: mean, median or lower bound, a number or an array.
        spread: standard deviation, that of the logarithm, or the upper bound.   low, high: bounds that values stay between.
    Example:
        >>> mass = {"forearm.mass_kg": aw.Draw.uniform(1.0, 2.0)}
        >>> scenario = aw.Scenario("two-link", 0.1, command=[20.0, 5.0], vary=mass, lanes=4)
        >>> aw.simulate(scenario).q.sizes["lane"]
        4
    """

    kind: str = "record"
    centre: Any = None
    spread: Any = None
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        check_known(ScenarioError, self.kind, ("record", *EXPECTED), "unknown", place="Draw.kind")
        if self.kind == "record":
            return
        centre, spread, low, high = (self._numbers(name) for name in ("centre", "spread", "low", "high"))
        object.__setattr__(self, "low", float(low))
        object.__setattr__(self, "high", float(high))
        wrong = spread < centre if self.kind == "uniform" else spread < 0.0
        if np.any(wrong) or np.any(low >= high) or (self.kind == "lognormal" and np.any(centre <= 0.0)):
            raise ScenarioError(value=self, expected=f"{EXPECTED[self.kind]}, and low below high")
        if not np.isfinite(centre).all() or not np.isfinite(spread).all():
            raise ScenarioError(value=self, expected="finite numbers")

    @classmethod
    def normal(cls, mean: Any, std: Any, low: float = -np.inf, high: float = np.inf) -> Draw:
        """Normally distributed values, truncated to [low, high]."""
        return cls("normal", mean, std, low, high)

    @classmethod
    def uniform(cls, low: Any, high: Any) -> Draw:
        """Values between two bounds, all equally likely."""
        return cls("uniform", low, high)

    @classmethod
    def lognormal(cls, median: Any, sigma: Any) -> Draw:
        """Values whose logarithm is normal: `median`, and the standard deviation `sigma` of the logarithm."""
        return cls("lognormal", median, sigma)

    def _numbers(self, name: str) -> np.ndarray:
        """A field as numbers; a bound is one number."""
        value = getattr(self, name)
        numbers = scalar.numbers_or_nan(value)
        if np.isnan(numbers).any() or (name in ("low", "high") and numbers.ndim):
            raise ScenarioError(place=f"Draw.{name}", value=value, expected="a number" if numbers.ndim else "numbers")
        return numbers

    def __repr__(self) -> str:
        bounds = "" if np.isinf(self.low) and np.isinf(self.high) else f" within [{self.low:g}, {self.high:g}]"
        return (
            "<draw by the record>"
            if self.kind == "record"
            else f"<{self.kind} draw {self.centre}, {self.spread}{bounds}>"
        )

    def batch(self, seed: int, path: str, lanes: range) -> Batch:
        """The values of some lanes.

        Args:
            seed: of all draws.   path: of the value, which sets draws apart.   lanes: numbers of the lanes.
        Raises:
            ScenarioError: a draw by the record, which only `vary` knows.
        """
        if self.kind == "record":
            what, expected = "a Draw() follows the robot's record, in vary alone", "Draw.normal(…) or another"
            raise ScenarioError(what, place=path, expected=expected)
        shape = np.broadcast_shapes(np.shape(self.centre), np.shape(self.spread))
        u = uniform_numbers(seed, path, lanes, math.prod(shape)).reshape(len(lanes), *shape)
        centre, spread = np.asarray(self.centre, dtype=float), np.asarray(self.spread, dtype=float)
        if self.kind == "uniform":
            return Batch(centre + u * (spread - centre))
        from scipy.special import ndtr, ndtri  # SciPy takes a while to import

        if self.kind == "lognormal":
            return Batch(centre * np.exp(spread * ndtri(u)))
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = [
                np.where(spread > 0.0, ndtr((end - centre) / spread), edge)
                for end, edge in ((self.low, 0.0), (self.high, 1.0))
            ]
        values = centre + spread * ndtri(ends[0] + u * (ends[1] - ends[0]))
        return Batch(np.clip(values, self.low, self.high))


EXPECTED = {
    "normal": "a mean and a standard deviation of 0 or more",
    "uniform": "a lower and an upper bound",
    "lognormal": "a median above 0 and a standard deviation of 0 or more",
}


def uniform_numbers(seed: int, path: str, lanes: range, entries: int) -> np.ndarray:
    """Numbers in (0, 1), (lanes, entries), that depend on seed, path and the number of the lane alone.

    Those of lane k are the numbers k · entries and on of one sequence, which may begin anywhere. [SalmonEtAl2011]
    """
    stream = np.random.Philox(key=[seed, zlib.crc32(path.encode())])
    first, count = lanes.start * entries, len(lanes) * entries
    stream.advance(first // 4)  # blocks of four numbers
    numbers = np.random.Generator(stream).integers(0, 2**52, size=first % 4 + count)[first % 4 :]
    return ((numbers + 0.5) * 2.0**-52).reshape(len(lanes), entries)


def resolved(value: Any, path: str, seed: int, lanes: range) -> Any:
    """A value with batches cut to some lanes, and batches in place of its draws.

    Args:
        value: what may hold batches and draws.   path: what errors call it.   seed: of draws.   lanes: numbers of the lanes.
    Raises:
        ScenarioError: a batch that has fewer lanes.
    """

    def of_lanes(part: Any, place: str) -> Any:
        if isinstance(part, Draw):
            return part.batch(seed, place, lanes)
        if isinstance(part, Batch) and len(part) < lanes.stop:
            what, expected = f"a Batch of {len(part)} lanes", f"one that holds lane {lanes.stop - 1}"
            raise ScenarioError(what, place=place, expected=expected)
        return Batch(part.values[lanes.start : lanes.stop]) if isinstance(part, Batch) else part

    return with_parts(value, path, of_lanes, check=True)


def with_parts(value: Any, path: str, change: Callable[[Any, str], Any], *, check: bool) -> Any:
    """A value with other parts, as far as they change; dataclasses, mappings and sequences are searched.

    Args:
        value: whose parts change.   path: what errors call it.
        change: (part, its path) → another one, or the same, whose own parts are then changed.
        check: whether a changed dataclass checks itself anew.
    """
    changed = change(value, path)
    if changed is not value or isinstance(value, Batch):
        return changed
    if is_dataclass(value) and not isinstance(value, type):
        parts = {each.name: getattr(value, each.name) for each in fields(value)}
        changes = {name: with_parts(part, f"{path}.{name}", change, check=check) for name, part in parts.items()}
        if all(changes[name] is part for name, part in parts.items()):
            return value
        copied: Any = copy.copy(value)
        for name, part in changes.items():
            object.__setattr__(copied, name, part)
        if check and hasattr(copied, "__post_init__"):
            copied.__post_init__()  # draws are checked now that they are values
        return copied
    if isinstance(value, Mapping):
        return {name: with_parts(each, f"{path}[{name!r}]", change, check=check) for name, each in value.items()}
    if isinstance(value, (list, tuple)):
        parts = [
            each if isinstance(each, (int, float)) else with_parts(each, f"{path}[{k}]", change, check=check)
            for k, each in enumerate(value)
        ]
        return value if all(a is b for a, b in zip(parts, value, strict=True)) else type(value)(parts)
    return value


def has_draws(value: Any) -> bool:
    """True for a value that holds a draw."""
    return any(True for _ in _found(Draw, value, ""))


def lane_values(value: Any) -> Any:
    """(lanes or 1, …): the values of a batch, or the only value of all lanes."""
    return value.values if isinstance(value, Batch) else np.asarray(value)[None]


def numbers_by_lane(value: Any) -> np.ndarray:
    """(lanes or 1, …) floats: those of a batch, or the only ones of all lanes.

    Raises:
        ValueError: something else than real numbers, as `scalar.real_numbers`.
    """
    return scalar.real_numbers(value.values) if isinstance(value, Batch) else scalar.real_numbers(value)[None]


def lane_counts(value: Any, path: str) -> dict[str, int]:
    """Number of lanes of every batch in a value, by its path; dataclasses, mappings and sequences are searched.

    Args:
        value: what may hold batches.   path: what errors call it.
    """
    return {place: len(batch) for place, batch in batches(value, path)}


def batches(value: Any, path: str) -> Iterator[tuple[str, Batch]]:
    """Every batch in a value, with its path such as `controller.kp` or `payload[1].mass`."""
    return _found(Batch, value, path)


def _found(kind: type, value: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Every object of a kind in a value, with its path; dataclasses, mappings and sequences are searched."""
    if isinstance(value, kind):
        yield path, value
    elif isinstance(value, Batch):
        return  # its values are those of lanes: with_parts changes nothing in them either
    elif is_dataclass(value) and not isinstance(value, type):
        for each in fields(value):
            yield from _found(kind, getattr(value, each.name), f"{path}.{each.name}")
    elif isinstance(value, Mapping):
        for name, each in value.items():
            yield from _found(kind, each, f"{path}[{name!r}]")
    elif isinstance(value, (list, tuple)):
        for k, each in enumerate(value):
            if not isinstance(each, (int, float)):
                yield from _found(kind, each, f"{path}[{k}]")


def check_counts(counts: Mapping[str, int]) -> int | None:
    """The number of lanes that all batches share; None without batches.

    Args:
        counts: lanes by path, as `lane_counts` gives them.
    Raises:
        ScenarioError: different numbers of lanes; names two that differ.
    """
    first, number = next(iter(counts.items()), ("", None))
    for place, other in counts.items():
        if other != number:
            raise ScenarioError(f"{other} lanes", place=place, expected=f"{number}, as {first} has")
    return number


@dataclass(frozen=True, eq=False)
class LaneFields:
    """An object with fields that may be batches: the fields that vary, and their values side by side.

    Attributes:
        owner: the object, such as a controller.
        names: of fields that are batches, its own or those of the dataclasses in its fields, as `kp` and `inner.kp`.
        shapes: of one lane's value of each.
        values: (lanes, k) of them, side by side; (1, 0) where nothing varies.
    """

    owner: Any
    names: tuple[str, ...] = ()
    shapes: tuple[tuple[int, ...], ...] = ()
    values: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)))

    @classmethod
    def of(cls, owner: Any, place: str) -> LaneFields:
        """The batches of a dataclass; of anything else, none.

        Args:
            owner: the object.   place: what errors call it.
        Raises:
            ScenarioError: a batch of no numbers, or batches of different numbers of lanes.
        """
        if not is_dataclass(owner) or isinstance(owner, type):
            return cls(owner)
        rows: dict[str, np.ndarray] = {}
        for path, value in batches(owner, place):
            if "[" in path:
                raise ScenarioError("a Batch", place=path, expected="it as a field, not in a list or a mapping")
            if value.shape is None:
                raise ScenarioError(place=path, value=value, expected="a batch of numbers")
            rows[path.removeprefix(f"{place}.")] = value.values.astype(float)
        if not rows:
            return cls(owner)
        check_counts({f"{place}.{name}": len(value) for name, value in rows.items()})
        flat = [value.reshape(len(value), -1) for value in rows.values()]
        shapes = tuple(value.shape[1:] for value in rows.values())
        return cls(owner, tuple(rows), shapes, np.concatenate(flat, axis=1))

    @property
    def lanes(self) -> int | None:
        """Number of lanes; None where nothing varies."""
        return len(self.values) if self.names else None

    def with_values(self, rows: Any) -> Any:
        """The object with (…, k) values, numbers or symbols, in place of its batches; its own checks are not made again."""
        if not self.names:
            return self.owner
        rows = np.asarray(rows)
        ends = np.cumsum([math.prod(shape) for shape in self.shapes])
        changed = self.owner
        for name, part, shape in zip(self.names, np.split(rows, ends[:-1], axis=-1), self.shapes, strict=True):
            value = scalar.array(part.reshape((*rows.shape[:-1], *shape)))
            changed = _with_field(changed, name.split("."), value if value.ndim else value[()])
        return changed


def _with_field(owner: Any, path: list[str], value: Any) -> Any:
    """A copy of an object with another value of one field, its own or one of an object in its fields; unchecked."""
    changed, (name, *inner) = copy.copy(owner), path
    object.__setattr__(changed, name, _with_field(getattr(owner, name), inner, value) if inner else value)
    return changed

"""Signals: named quantities side by side in one vector, for every vector that enters or leaves a part of the simulation.

The state x of a plant, its inputs u, measurements y, references r: each is one flat vector in the compiled loop, and a
`Layout` says what stands where. Datasets, recordings and readers of measurements are made from layouts, so that no slice is
written twice.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from armwright import scalar
from armwright.errors import ScenarioError, ShapeError, check_known, nearest
from armwright.printable import is_seen
from armwright.scalar import Array

LARGEST = 10**6  # entries of a signal, which has a unit for each


@dataclass(frozen=True)
class Signal:
    """One quantity of a vector.

    Attributes:
        name: such as "q" or "force".
        units: of every entry, in row-major order; a single text stands for all of them.
        shape: of the array; () of one number.
        joints: numbers of the joints that the entries belong to, one each; None: they belong to no joint.
        labels: names of the entries along the last axis, where these are no joints: ("x", "y", "z").
        about: what it is, in a few words.
    """

    name: str
    units: tuple[str, ...] | str
    shape: tuple[int, ...] = ()
    joints: tuple[int, ...] | None = None
    labels: tuple[str, ...] | None = None
    about: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name.isidentifier():
            raise ShapeError(place="signal", value=self.name, expected="a name of letters, digits and _")
        for name, kind in (("shape", int), ("joints", int), ("labels", str), ("units", str)):
            self._check_list(name, kind)
        if self.size > LARGEST:
            raise ShapeError(
                place=f"signal {self.name!r} shape", value=self.shape, expected=f"at most {LARGEST} entries"
            )
        units = (self.units,) * self.size if isinstance(self.units, str) else tuple(self.units)
        object.__setattr__(self, "units", units)
        for name, entries in (("units", units), ("joints", self.joints)):
            if entries is not None and len(entries) != self.size:
                expected = f"one for each of {self.size} entries"
                raise ShapeError(f"has {len(entries)}", place=f"signal {self.name!r} {name}", expected=expected)
        if not all(map(is_seen, self.labels or ())):
            expected = "texts without control or invisible characters"
            raise ShapeError(place=f"signal {self.name!r} labels", value=self.labels, expected=expected)
        if self.labels is not None and len(self.labels) != (self.shape or (1,))[-1]:
            expected = f"one for each entry along the last axis of shape {self.shape}"
            raise ShapeError(f"has {len(self.labels)}", place=f"signal {self.name!r} labels", expected=expected)

    def _check_list(self, name: str, kind: type) -> None:
        """Refuses a field that is no list of texts or of whole numbers from 0 on."""
        value = getattr(self, name)
        if (value is None and name in ("joints", "labels")) or (name == "units" and isinstance(value, str)):
            return
        is_list = isinstance(value, (list, tuple))
        if not is_list or not all(isinstance(each, kind) and (kind is str or each >= 0) for each in value):
            expected = "a tuple of texts" if kind is str else "a tuple of whole numbers, 0 or more"
            raise ShapeError(place=f"signal {self.name!r} {name}", value=value, expected=expected)

    @property
    def size(self) -> int:
        """Number of entries."""
        return math.prod(self.shape)

    @property
    def unit(self) -> str:
        """The units that occur, as `rad | m`."""
        return " | ".join(dict.fromkeys(self.units))


class SignalValues(Mapping[str, Any]):
    """Values of signals by name, `values.force` or `values["force"]`."""

    def __init__(self, parts: Mapping[str, Any]):
        self._parts = dict(parts)

    def __getitem__(self, name: str) -> Any:
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def __getattr__(self, name: str) -> Any:
        parts = self.__dict__.get("_parts", {})
        if name in parts:
            return parts[name]
        raise AttributeError(f"no signal {name!r}; {nearest(name, parts)}")


@dataclass(frozen=True)
class Layout:
    """Concatenation of signals into one vector.

    Attributes:
        signals: in order; no name comes twice.
    """

    signals: tuple[Signal, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.signals, Iterable) or not all(isinstance(each, Signal) for each in self.signals):
            raise ScenarioError(place="Layout.signals", value=self.signals, expected="signals")
        names = [signal.name for signal in self.signals]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ShapeError("occurs twice", place="signal", value=twice[0], expected="another name")

    @classmethod
    def of(cls, signals: Iterable[Signal]) -> Layout:
        """The layout of some signals in their order."""
        return cls(tuple(signals))

    def __add__(self, other: Layout) -> Layout:
        return Layout((*self.signals, *other.signals))

    def __iter__(self) -> Iterator[Signal]:
        return iter(self.signals)

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __getitem__(self, name: str) -> Signal:
        return self.signals[self.names.index(self._known(name))]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the signals in order."""
        return tuple(signal.name for signal in self.signals)

    @cached_property
    def size(self) -> int:
        """Entries of the vector."""
        return sum(signal.size for signal in self.signals)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Unit of every entry."""
        return tuple(unit for signal in self.signals for unit in signal.units)

    @cached_property
    def _places(self) -> dict[str, slice]:
        ends = np.cumsum([0, *(signal.size for signal in self.signals)])
        return {s.name: slice(int(a), int(b)) for s, a, b in zip(self.signals, ends, ends[1:], strict=False)}

    def entry_names(self, joints: Sequence[str]) -> tuple[str, ...]:
        """A name for every entry: `q elbow`, `force x`, `bus_voltage`.

        Args:
            joints: names of the arm's joints.
        """
        names = []
        for signal in self.signals:
            labels = signal.labels if signal.joints is None else [joints[j] for j in signal.joints]
            if labels is None or len(labels) != signal.size:
                labels = [str(k) if signal.size > 1 else "" for k in range(signal.size)]
            names += [f"{signal.name} {each}".strip() for each in labels]
        return tuple(names)

    def place(self, name: str) -> slice:
        """Place of a signal in the vector.

        Raises:
            ShapeError: no signal has that name.
        """
        return self._places[self._known(name)]

    def part(self, vector: Array, name: str) -> Array:
        """A signal's values (…, *shape) in vectors (…, size)."""
        values = vector[..., self.place(name)]
        shape = self[name].shape
        return values if len(shape) == 1 else values.reshape(*values.shape[:-1], *shape)

    def parts(self, vector: Array) -> dict[str, Array]:
        """Every signal's values (…, *shape) by name."""
        return {signal.name: self.part(vector, signal.name) for signal in self.signals}

    def vector(self, values: Mapping[str, Any]) -> np.ndarray:
        """The vector (size,) of one value for each signal, numbers or symbols.

        Raises:
            ShapeError: a signal is missing, has another shape, or is not in the layout.
        """
        for name in values:
            self._known(name)
        rows = []
        for signal in self.signals:
            if signal.name not in values:
                raise ShapeError("has no value", place=f"signal {signal.name!r}", expected=", ".join(self.names))
            row = scalar.array(values[signal.name])
            if row.shape != signal.shape:
                expected = f"shape {signal.shape}"
                raise ShapeError(f"has shape {row.shape}", place=f"signal {signal.name!r}", expected=expected)
            rows.append(row.ravel())
        return scalar.array(np.concatenate(rows)) if rows else np.zeros(0)

    def _known(self, name: str) -> str:
        check_known(ShapeError, name, self._places, "no such signal", place="signal")
        return name

"""Joints that follow others: from the coordinates q to all joints of the tree, and back by virtual work.

With q_all = G q + o, rates and accelerations follow as q̇_all = G q̇ and q̈_all = G q̈, powers agree for tau = Gᵀ tau_all, and so
M = Gᵀ M_all G. Physics is written once, for a tree of joints of which each moves by itself. [Featherstone2008] chapter 3
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from armwright import scalar
from armwright.scalar import Array, Scalar

POSITIONS = ("q",)
RATES = ("qd", "qdd", "nudge")  # what moves with q to first order

Function = TypeVar("Function", bound=Callable[..., Any])


@dataclass(frozen=True, eq=False)
class Mimics:
    """Dependence of every joint of a tree on the coordinates:  q_i = factor_i · q[coordinate_i] + offset_i.

    Attributes:
        drivers: (n,) the joints that are coordinates, by index, in the order of q.
        coordinate: for every joint which coordinate moves it.
        factor: for every joint [-, or rad/m, m/rad], 1 for a driver.   offset: for every joint [rad | m], 0 for a driver.
    """

    drivers: tuple[int, ...]
    coordinate: tuple[int, ...]
    factor: tuple[Scalar, ...]
    offset: tuple[Scalar, ...]

    @classmethod
    def of(cls, names: Sequence[str], mimic_of: Mapping[str, Any]) -> Mimics | None:
        """From the names of all joints and the records of those that follow, by name; None where none does."""
        if not mimic_of:
            return None
        drivers = tuple(i for i, name in enumerate(names) if name not in mimic_of)
        place = {names[i]: k for k, i in enumerate(drivers)}
        rows = []
        for name in names:
            factor, offset = 1.0, 0.0
            while name in mimic_of:
                mimic = mimic_of[name]
                factor, offset = factor * mimic.multiplier.number, offset + factor * mimic.offset
                name = mimic.joint
            rows.append((place[name], factor, offset))
        return cls(drivers, *zip(*rows, strict=True))

    def positions(self, q: Array) -> Array:
        """G q + o: positions of all joints (N,) [rad | m]."""
        return scalar.array([f * q[k] + o for k, f, o in zip(self.coordinate, self.factor, self.offset, strict=True)])

    def rates(self, qd: Array) -> Array:
        """G q̇: speeds or accelerations of all joints (N,)."""
        return scalar.array([f * qd[k] for k, f in zip(self.coordinate, self.factor, strict=True)])

    def torques(self, each: Array) -> Array:
        """Gᵀ tau_all: torques at all joints (N, …), as those at the coordinates (n, …)."""
        total = scalar.zeros(len(self.drivers), *each.shape[1:])
        for i, (k, f) in enumerate(zip(self.coordinate, self.factor, strict=True)):
            total[k] = total[k] + f * each[i]
        return scalar.array(total)

    def moved(self, each: Sequence[float]) -> list[float]:
        """Sums over the joints that each coordinate moves (n,), of what all joints (N,) have."""
        total = [0.0] * len(self.drivers)
        for k, value in zip(self.coordinate, each, strict=True):
            total[k] += value
        return total

    def columns(self, each: Array) -> Array:
        """J_all G: columns for all joints (…, N), as those for the coordinates (…, n)."""
        return self.torques(each.T).T

    def inertia(self, each: Array) -> Array:
        """Gᵀ M_all G: a symmetric (N, N) as (n, n), each pair of mirrored entries computed once."""
        n = len(self.drivers)
        rows = self.torques(each)
        total = scalar.zeros(n, n)
        for i, (k, f) in enumerate(zip(self.coordinate, self.factor, strict=True)):
            for a in range(k + 1):
                total[a, k] = total[a, k] + f * rows[a, i]
        for k in range(n):
            for a in range(k):
                total[k, a] = total[a, k]
        return scalar.array(total)


def on_tree(project: Callable[[Mimics, Any], Any] | None = None) -> Callable[[Function], Function]:
    """A function of an arm, (model, q, …), that is written for a tree whose joints all move by themselves.

    Where joints follow others, it is given their own positions and rates, and its result is projected on the coordinates.
    Where none does, it is called as it is.

    Args:
        project: `Mimics.torques`, `Mimics.columns` or `Mimics.inertia`; None: the result is no matter of joints.
    """

    def decorated(function: Function) -> Function:
        names = list(inspect.signature(function).parameters)[1:]

        @functools.wraps(function)
        def on_all_joints(model: Any, *arrays: Any, **named: Any) -> Any:
            mimics = model.mimics
            if mimics is None:
                return function(model, *arrays, **named)
            values = {**dict(zip(names, arrays, strict=False)), **named}
            for name, value in values.items():
                if value is not None and name in (*POSITIONS, *RATES):
                    values[name] = (mimics.positions if name in POSITIONS else mimics.rates)(value)
            result = function(model.tree, **values)
            return result if project is None else project(mimics, result)

        return on_all_joints  # type: ignore[return-value]

    return decorated

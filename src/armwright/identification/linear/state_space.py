"""State-space form of a black-box model: simulation, conversion, and a block of a simulated loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter

from armwright.entry import expect
from armwright.errors import ScenarioError
from armwright.scalar import Array
from armwright.signals import Signal

LARGEST_CONDITION = 1e7  # condition of the eigenvectors above which modes are no longer simulated one by one


@dataclass(frozen=True, eq=False)
class StateSpace:
    """x(k+1) = A x(k) + B u(k),  y(k) = C x(k) + D u(k) + offset, k counted in periods.

    Attributes:
        a: (n, n).   b: (n, inputs).   c: (outputs, n).   d: (outputs, inputs).   offset: (outputs,).   period: [s].
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    offset: np.ndarray
    period: float

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues (n,) of A."""
        return np.linalg.eigvals(self.a)

    @property
    def gain(self) -> np.ndarray:
        """Outputs by inputs at rest (outputs, inputs):  C (1 - A)⁻¹ B + D; infinite for an integrator."""
        n = len(self.a)
        try:
            return self.c @ np.linalg.solve(np.eye(n) - self.a, self.b) + self.d
        except np.linalg.LinAlgError:
            return np.full(self.d.shape, np.inf)

    def simulate(self, u: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
        """Outputs (rows, outputs) of the free simulation.

        Args:
            u: (rows, inputs).   start: (n,) state at the first row; None: 0.
        """
        return states(self.a, self.b, u, start) @ self.c.T + u @ self.d.T + self.offset

    def response(self, frequency: np.ndarray) -> np.ndarray:
        """Frequency response (k, outputs, inputs) at frequencies (k,) in Hz:  C (z - A)⁻¹ B + D,  z = exp(2πj f T)."""
        z = np.exp(2j * np.pi * np.asarray(frequency) * self.period)
        inner = np.linalg.solve(
            z[:, None, None] * np.eye(len(self.a)) - self.a, np.broadcast_to(self.b, (len(z), *self.b.shape))
        )
        return self.c @ inner + self.d


def states(a: np.ndarray, b: np.ndarray, u: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """States (rows, n) of x(k+1) = A x(k) + B u(k): mode by mode as filters, where the eigenvectors are well conditioned.

    Args:
        a: (n, n).   b: (n, inputs).   u: (rows, inputs).   start: (n,); None: 0.
    """
    n, rows = len(a), len(u)
    start = np.zeros(n) if start is None else np.asarray(start, dtype=float)
    values, vectors = np.linalg.eig(a)
    if n and np.linalg.cond(vectors) < LARGEST_CONDITION:
        inverse = np.linalg.inv(vectors)
        driven, first = u @ (inverse @ b).T, inverse @ start
        modes = np.empty((rows, n), dtype=complex)
        for k, value in enumerate(values):
            before = np.concatenate([[first[k]], driven[:-1, k]])
            modes[:, k] = lfilter([1.0], [1.0, -value], before)
        return np.real(modes @ vectors.T)
    x = np.empty((rows, n))
    now, driven = start, u @ b.T
    for k in range(rows):
        x[k] = now
        now = a @ now + driven[k]
    return x


def realised(a: np.ndarray, b: np.ndarray, offset: float, period: float) -> StateSpace:
    """Observer canonical form of B(q)/A(q).

    Args:
        a: (na + 1,) coefficients of q⁻¹, the first 1.   b: (nb,) with as many leading zeros as the delay.
        offset: of the output.   period: [s].
    """
    n = max(len(a), len(b)) - 1
    a, b = (np.concatenate([each, np.zeros(n + 1 - len(each))]) for each in (a, b))
    matrix = np.zeros((n, n))
    matrix[:, :1] = -a[1:, None]
    matrix[:-1, 1:] = np.eye(max(n - 1, 0))
    column = b[1:] - a[1:] * b[0]
    return StateSpace(matrix, column[:, None], np.eye(1, n), b[:1, None], np.array([offset]), period)


@dataclass(frozen=True, eq=False)
class FilteredSensor:
    """A sensor whose signal is the output of an identified model: y = C x + D u + offset, with u a signal of the plant.

    One model serves all joints, each with a state of its own. The loop's period must be the model's, and the model has one input.

    Args:
        model: the model.   of: what it is fed with: a signal of the plant, such as "qd", "current" or "tau".
        name, unit: of what it gives.
    Raises:
        ScenarioError: the model has several inputs or outputs.
    Example:
        >>> u = np.repeat(np.random.default_rng(0).standard_normal(60), 10)
        >>> y = np.concatenate([[0.0], 0.5 * u[:-1]])  # half of the speed, a row later
        >>> model = aw.identification.fit_arx(u, y, 0.002, order=1, delay=1).state_space
        >>> sensor = aw.identification.FilteredSensor(model, of="qd", name="tacho", unit="V")
        >>> sensor.name
        'tacho'
    """

    model: StateSpace
    of: str
    name: str
    unit: str = ""

    def __post_init__(self) -> None:
        expect(self.model, StateSpace, "model", "a StateSpace, as LinearModel.state_space gives", ScenarioError)
        check_single(self.model)

    def signals(self, arm: Any) -> Sequence[Signal]:
        """The signal (n,), one for each joint."""
        return [
            Signal(self.name, self.unit, (arm.n,), tuple(range(arm.n)), about=f"{self.of} through an identified model")
        ]

    def init(self, plant: Any) -> Array:
        """States (order × n,) at rest with the first value of the signal as input; 0 for a model without a rest state."""
        order, u = len(self.model.a), _signal(plant, self.of)
        rest = np.linalg.lstsq(np.eye(order) - self.model.a, self.model.b[:, 0], rcond=None)[0]
        return (rest[:, None] * u).ravel()

    def measure(self, plant: Any, s: Array, w: Array) -> tuple[dict[str, Array], Array]:
        """Outputs (n,) now, and states (order × n,) at the next tick."""
        u = _signal(plant, self.of)
        x = s.reshape(len(self.model.a), len(u))
        y = self.model.c[0] @ x + self.model.d[0, 0] * u + self.model.offset[0]
        return {self.name: y}, (self.model.a @ x + self.model.b * u).ravel()


def check_single(model: StateSpace) -> None:
    """Refuses a model with several inputs or outputs.

    Raises:
        ScenarioError: says how many.
    """
    if model.d.shape != (1, 1):
        what = f"{model.d.shape[1]} inputs, {model.d.shape[0]} outputs"
        raise ScenarioError(what, place="model", expected="one of each")


def _signal(plant: Any, name: str) -> Array:
    """A signal (n,) of the plant by name."""
    return getattr(plant, name) if hasattr(plant, name) else plant.outputs[name]

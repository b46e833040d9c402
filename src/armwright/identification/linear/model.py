"""Black-box model: result of the ARX, OE, ARMAX and subspace fits."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter, lfiltic

from armwright.errors import ShapeError
from armwright.identification.estimate import Estimate
from armwright.identification.linear.actuator import IdentifiedActuator
from armwright.identification.linear.frequency import python_control
from armwright.identification.linear.measures import percent
from armwright.identification.linear.modes import ModelQuantity
from armwright.identification.linear.prediction_error import Polynomials, filtered
from armwright.identification.linear.records import RecordedStretch, Records
from armwright.identification.linear.state_space import FilteredSensor, StateSpace, realised
from armwright.identification.linear.subspace import initial_state
from armwright.results.page_parts import definitions
from armwright.results.result import Result
from armwright.results.table import Table, number


@dataclass(frozen=True, eq=False)
class LinearModel(Result):
    """A sampled linear model from a log, with its uncertainty and the fit of its free simulation.

    Attributes:
        kind: "arx", "oe", "armax" or "n4sid".   period: [s].   delay: [samples], of all inputs.
        delays: smallest and largest [samples] that the data do not distinguish, in 95 % of logs around the true one; None of
            "n4sid" and where rows are too few.
        inputs, outputs, input_units, output_units: names and units.
        core: the model without its delay.   wait: [samples] by which it is fed late: `delay`, less one where D is 0.
        polynomials: A, B, C; None of "n4sid".   singular: values of the projection of "n4sid".
        values, covariance: of the coefficients that have a name; empty of "n4sid", whose form is not unique.
        poles, zeros, pole_std, zero_std: in z; standard deviations of their magnitudes; zeros empty of "n4sid".
        gain, gain_std: (outputs, inputs) at rest.   quantities: time constants, frequencies, damping, gain.
        fit: measures of the free simulation by run and output: fit_percent, r2, rms, one_step_percent.
        tried: rows of the search for order and delay.   criterion: that decided.   remarks: sentences.
        condition: of the scaled Jacobian; NaN of "n4sid".
        verdict: "identified" or "not identified".   method: one line.   sha256: of the log.
    """

    kind: str
    period: float
    delay: int
    wait: int
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    core: StateSpace
    poles: np.ndarray
    pole_std: np.ndarray
    gain: np.ndarray
    gain_std: np.ndarray
    quantities: tuple[ModelQuantity, ...]
    fit: Mapping[str, Mapping[str, float]]
    method: str
    polynomials: Polynomials | None = None
    names: tuple[str, ...] = ()
    values: np.ndarray = field(default_factory=lambda: np.zeros(0))
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    zeros: np.ndarray = field(default_factory=lambda: np.zeros(0))
    zero_std: np.ndarray = field(default_factory=lambda: np.zeros(0))
    remarks: tuple[str, ...] = ()
    tried: tuple[Mapping[str, float], ...] = ()
    criterion: str = ""
    condition: float = float("nan")
    verdict: str = "identified"
    sha256: str = ""
    singular: np.ndarray = field(default_factory=lambda: np.zeros(0))
    delays: tuple[int, int] | None = None

    @classmethod
    def of(cls, records: Records, **fitted: Any) -> LinearModel:
        """The model of some records: their names, units, period and checksum, beside the fields that a fit gives."""
        shared = ("period", "inputs", "outputs", "input_units", "output_units", "sha256")
        return cls(**{name: getattr(records, name) for name in shared}, **fitted)

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the coefficients that have a name."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def order(self) -> int:
        """Number of poles, without those of the delay."""
        return len(self.poles)

    @property
    def state_space(self) -> StateSpace:
        """The whole model as x(k+1) = A x + B u, y = C x + D u + offset, its delay as further states."""
        core = self.core
        for _ in range(self.wait):  # u(k - 1) becomes a state
            n, m = core.b.shape
            a = np.block([[core.a, core.b], [np.zeros((m, n + m))]])
            b = np.vstack([np.zeros((n, m)), np.eye(m)])
            core = replace(core, a=a, b=b, c=np.hstack([core.c, core.d]), d=np.zeros_like(core.d))
        return core

    def __getitem__(self, name: str) -> float:
        """A quantity's value by its name, such as "time_constant1".

        Raises:
            ModelError: no such quantity.
        """
        return self.estimate()[name]

    def simulate(self, u: Any, y: Any = None) -> np.ndarray:
        """Outputs (rows,) or (rows, outputs) of the free simulation: the model sees the input alone.

        Args:
            u: (rows,) or (rows, inputs), in the units of the fit; before the first row it was as in the first row.
            y: (rows,) or (rows, outputs) measured; where present, the initial state, inputs before the first row included,
                is the one that comes nearest to them, and else the model begins at rest under the first input.
        Raises:
            ShapeError: another number of inputs, outputs or rows.
        """
        u = _rows(u, "u", len(self.inputs))
        measured = None if y is None else _rows(y, "y", len(self.outputs), len(u))
        if self.polynomials is not None:
            result = _filtered(self.polynomials, u[:, 0], None if measured is None else measured[:, 0])[:, None]
        else:
            late = np.concatenate([np.repeat(u[:1], self.wait, axis=0), u])[: len(u)]
            start = (
                np.linalg.lstsq(np.eye(len(self.core.a)) - self.core.a, self.core.b @ late[0], rcond=None)[0]
                if measured is None else initial_state(self.core, RecordedStretch("", late, measured))
            )  # fmt: skip
            result = self.core.simulate(late, start)
        return result[:, 0] if np.ndim(y if y is not None else u) < 2 or len(self.outputs) == 1 else result

    def fit_percent(self, u: Any, y: Any) -> float:
        """Fit of the free simulation [%], the mean over outputs:  100 (1 - |y - ŷ| / |y - mean y|).

        Args:
            u: (rows,) or (rows, inputs).   y: (rows,) or (rows, outputs) measured, in the units of the fit.
        """
        measured = _rows(y, "y", len(self.outputs))
        simulated = np.reshape(self.simulate(u, measured), measured.shape)
        return float(np.mean(percent(measured, measured - simulated)))

    def response(self, frequency: Any) -> np.ndarray:
        """Frequency response: (k,) complex, or (k, outputs, inputs) of several, at frequencies (k,) in Hz."""
        f = np.atleast_1d(np.asarray(frequency, dtype=float))
        late = np.exp(-2j * np.pi * f * self.period * self.wait)
        found = self.core.response(f) * late[:, None, None]
        return found[:, 0, 0] if found.shape[1:] == (1, 1) else found

    def to_control(self) -> Any:
        """The model as a system of python-control: `TransferFunction`, of "n4sid" `StateSpace`; without offset, in deviations.

        Raises:
            LogError: python-control is not installed.
        """
        control = python_control()
        if self.polynomials is None:
            whole = self.state_space
            return control.ss(whole.a, whole.b, whole.c, whole.d, dt=self.period)
        n = self.polynomials.past + 1
        b, a = (np.pad(each, (0, n - len(each))) for each in (self.polynomials.b, self.polynomials.a))
        return control.tf(b, a, dt=self.period)

    def sensor(self, of: str, name: str, unit: str = "") -> FilteredSensor:
        """The model as a sensor of a simulated loop: a signal of the plant, filtered by the model.

        Args:
            of: what it is fed with, such as "qd" or "current".   name, unit: of what it gives.
        Raises:
            ScenarioError: the model has several inputs or outputs.
        """
        return FilteredSensor(self.state_space, of, name, unit or (self.output_units[0] if self.output_units else ""))

    def actuator(self, controller: Any) -> IdentifiedActuator:
        """The controller of a simulated loop with its commands filtered by this model.

        Args:
            controller: any, whose commands have the unit of the model's input; the model's output has that of the drives.
        Raises:
            ScenarioError: the model has several inputs or outputs.
        """
        return IdentifiedActuator(controller, self.state_space)

    def estimate(self) -> Estimate:
        """Gain, time constants, frequencies and damping as an `Estimate`; correlations are unknown."""
        chosen = self.quantities
        return Estimate(
            names=tuple(each.name for each in chosen),
            values=np.array([each.value for each in chosen]),
            covariance=np.diag([each.std**2 if each.std > 0.0 else np.nan for each in chosen]),
            sha256=self.sha256,
            method=self.method,
            units=tuple(each.unit for each in chosen),
            remarks=self.remarks,
            condition=self.condition,
            fit=self.fit,
            verdict="identified" if self.verdict == "identified" else "not identified",
        )

    @property
    def good(self) -> bool:
        """True if the output depends on the input."""
        return self.verdict == "identified"

    def sentences(self) -> list[str]:
        """The verdict, then method and remarks."""
        return [self.verdict, self.method, *self.remarks]

    def tables(self) -> list[Table]:
        """Quantities and coefficients with standard deviations; fits of the free simulation."""
        rows = [[each.name, number(each.value), number(each.std, ".2g"), each.unit] for each in self.quantities]
        coefficients = zip(self.names, self.values, self.std, strict=True)
        rows += [[name, number(value, ".6g"), number(std, ".2g"), ""] for name, value, std in coefficients]
        fits = [[name, *(number(each[key]) for key in ("fit_percent", "r2", "rms"))] for name, each in self.fit.items()]
        return [
            Table(f"{self.kind} of order {self.order}", ("quantity", "value", "± std", "unit"), rows, ("unit",)),
            Table("free simulation", ("run", "fit [%]", "R²", "RMS"), fits),
        ]

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Writes a page: verdict, what to do next, quantities, fits, coefficients.

        Args:
            path: ending in .html.
        Returns:
            path: of the page.
        Raises:
            OutputError: the file cannot be written.
        """
        from armwright.identification.validation.report import write_report  # which draws

        pairs = [(name, f"{v:.6g} ± {s:.2g}") for name, v, s in zip(self.names, self.values, self.std, strict=True)]
        return write_report(path, self.method, self.estimate(), sections=definitions("Coefficients", pairs))

    def __str__(self) -> str:
        """Quantities with 95 % intervals, coefficients, fits and remarks."""
        lines = [self.method]
        for each in self.quantities:
            unit = f" {each.unit}" if each.unit else ""
            lines.append(f"  {each.name:<20} {each.value:12.5g} ± {_half_95(each.std)}{unit}  (95 %)")
        for name, value, std in zip(self.names, self.values, self.std, strict=True):
            lines.append(f"  {name:<20} {value:12.6g} ± {_half_95(float(std))}")
        for name, measures in self.fit.items():
            lines.append(
                f"{name}: free simulation {measures['fit_percent']:.2f} %, R² {measures['r2']:.4f}, RMS {measures['rms']:.4g}"
            )
        return "\n".join([*lines, *self.remarks, self.verdict])


def _half_95(std: float) -> str:
    """Half of a 95 % interval; "unknown" if rounding left no variance: the parameters are not distinguishable."""
    return f"{1.96 * std:.2g}" if std > 0.0 else "unknown"


def polynomial_core(model: Polynomials, period: float) -> StateSpace:
    """State-space form of A and B without the delay."""
    rest = float(np.sum(model.a))
    offset = model.constant / rest if rest != 0.0 else 0.0
    return realised(model.a, model.b[model.delay :], offset, period)


def _filtered(model: Polynomials, u: np.ndarray, measured: np.ndarray | None) -> np.ndarray:
    """Free simulation (rows,) of polynomials."""
    na, before = len(model.a) - 1, len(model.b) - 1
    driven = filtered(model.b, np.ones(1), np.concatenate([np.full(before, u[0]), u]))[before:] + model.constant
    rest, n = float(model.a.sum()), len(u)
    first = driven[0] / rest if measured is None and abs(rest) > 1e-9 else 0.0
    if na == 0:
        return driven
    y = lfilter([1.0], model.a, driven, zi=lfiltic([1.0], model.a, np.full(na, first)))[0]
    if measured is None:
        return y
    free = np.stack([filtered(np.ones(1), model.a, np.eye(n, 1, -k)[:, 0]) for k in range(min(model.past, n))], axis=1)
    return y + free @ np.linalg.lstsq(free, measured - y, rcond=None)[0]


def _rows(values: Any, place: str, count: int, rows: int | None = None) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or array.shape[1] != count or rows not in (None, len(array)) or not len(array):
        raise ShapeError(f"shape {np.shape(values)}", place=place, expected=f"({rows or 'rows'}, {count})")
    return array

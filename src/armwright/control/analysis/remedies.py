"""Gains and a sample period with which a loop keeps its margins: what `armwright loops` recommends.

A slower loop is the same one in a time that is f times longer: with a bandwidth ω for f ω,

    kd f,  kp f²,  ki f³        of a PID or computed torque
    position_kp f,  speed_kp f,  speed_ki f²        of a cascade
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright import scalar
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.parameters import Batch
from armwright.simulation.scenario import Scenario

if TYPE_CHECKING:
    from armwright.control.analysis.analyse import LoopAnalysis

POWERS = {  # of f, by gain
    "kd": 1, "kp": 2, "ki": 3, "position_kp": 1, "speed_kp": 1, "speed_ki": 2,
}  # fmt: skip
LEAST = 1.0 / 64.0  # f, below which none is looked for
STEPS, FINE = 37, 9  # of f, from 1 down; and between two of these
MOST_PARTS = 400  # of the period


@dataclass(frozen=True, eq=False)
class LoopRemedies:
    """Changes with which a loop keeps the margins at all analysed poses; each None where none was found.

    Attributes:
        factor: f, of the bandwidth.   gains: (n,) by name, for f.   slower: the scenario with them.
        period: [s] a whole part of the loop's own.   faster: the scenario with it, its gains unchanged.
        asked: gain and phase margin [rad].
    """

    factor: float | None
    gains: dict[str, np.ndarray]
    slower: Scenario | None
    period: float | None
    faster: Scenario | None
    asked: tuple[float, float]

    def sentences(self) -> list[str]:
        """What would do, in words."""
        gain, phase = self.asked
        asked = f"a gain margin of {gain:g} and a phase margin of {np.degrees(phase):.3g}°"
        lines = []
        if self.factor is not None:
            words = ", ".join(f"{name} × {self.factor ** POWERS[name]:.3g}" for name in self.gains)
            lines.append(f"gains of {self.factor:.3g} times the bandwidth keep {asked} at these poses: {words}")
        if self.period is not None:
            rate = f"a period of {1e3 * self.period:.4g} ms ({1.0 / self.period:.4g} Hz)"
            lines.append(f"with its own gains the loop keeps {asked} at these poses with {rate}")
        return lines or [f"neither slower gains nor a shorter period keep {asked}; design them: armwright design"]


def loop_remedies(analysis: LoopAnalysis) -> LoopRemedies:
    """Slower gains, and a shorter period, with which an analysed loop keeps its margins.

    Args:
        analysis: of `analyse_loops`.
    """
    scenario, q, asked = analysis.loop.scenario, analysis.poses, analysis.asked
    factor, gains = _slower(analysis, q, asked)
    slower = None
    if factor is not None:
        slower = _replaced(scenario, scenario.controller, gains)
    period, faster = _faster(analysis, q, asked)
    return LoopRemedies(factor, gains, slower, period, faster, asked)


def _innermost(control: Any) -> Any:
    """The controller with the gains, within others."""
    return _innermost(control.inner) if hasattr(control, "inner") else control


def _replaced(scenario: Scenario, control: Any, gains: dict[str, Any]) -> Scenario:
    def changed(law: Any) -> Any:
        return replace(law, inner=changed(law.inner)) if hasattr(law, "inner") else replace(law, **gains)

    assert scenario.loop is not None
    return replace(scenario, loop=replace(scenario.loop, controller=changed(control)))


def _own_gains(scenario: Scenario) -> dict[str, np.ndarray]:
    """(n,) gains above 0 by name, in the order of the controller's fields; empty of a controller without such."""
    law, n = _innermost(scenario.controller), scenario.arm.n
    found: dict[str, np.ndarray] = {}
    for each in fields(law) if hasattr(law, "__dataclass_fields__") else ():
        value = getattr(law, each.name)
        if each.name not in POWERS or value is None or isinstance(value, Batch):
            continue
        row = np.broadcast_to(scalar.real_numbers(value), (n,)).astype(float)
        if row.any():
            found[each.name] = row
    return found


def _slower(
    analysis: LoopAnalysis, q: np.ndarray, asked: tuple[float, float]
) -> tuple[float | None, dict[str, np.ndarray]]:
    """The largest f of a grid, and the gains for it."""
    scenario, own = analysis.loop.scenario, _own_gains(analysis.loop.scenario)
    if not own:
        return None, {}
    ones = {name: Batch(np.ones((1, scenario.arm.n))) for name in own}
    loop = LinearLoop(_replaced(scenario, scenario.controller, ones), analysis.loop.period, analysis.loop.plant)

    def first(factors: np.ndarray) -> int | None:
        rows = np.concatenate([row * factors[:, None] ** POWERS[name] for name, row in own.items()], axis=1)
        kept = np.ones(len(factors), dtype=bool)
        for pose in q:
            left = np.flatnonzero(kept)
            if not left.size:
                return None
            kept[left] = loop.keeps(loop.slopes(pose, rows[left]), *asked)
        return int(np.argmax(kept)) if kept.any() else None

    coarse = np.geomspace(1.0, LEAST, STEPS)
    at = first(coarse)
    if at is None:
        return None, {}
    factor = coarse[at]
    if at > 0:
        fine = np.geomspace(coarse[at - 1], coarse[at], FINE)
        finer = first(fine)
        factor = coarse[at] if finer is None else fine[finer]
    return float(factor), {name: row * factor ** POWERS[name] for name, row in own.items()}


def _faster(analysis: LoopAnalysis, q: np.ndarray, asked: tuple[float, float]) -> tuple[float | None, Scenario | None]:
    """The longest whole part of the loop's period that keeps the margins, up to `period_with_margin`."""
    own, scenario = analysis.loop.period, analysis.loop.scenario
    if analysis.period_with_margin <= 0.0:
        return None, None
    parts = max(ceil(own / analysis.period_with_margin * (1.0 - 1e-12)), 1)
    while parts <= MOST_PARTS:
        loop = LinearLoop(scenario, own / parts, analysis.loop.plant)
        if loop.keeps(loop.slopes(q), *asked).all():
            assert scenario.loop is not None
            solver = scenario.solver if scenario.solver.step is None else replace(scenario.solver, step=None)
            faster = replace(scenario, solver=solver, loop=replace(scenario.loop, period=own / parts))
            return own / parts, faster
        parts += 1
    return None, None

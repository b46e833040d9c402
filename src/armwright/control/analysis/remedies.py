"""Gains and a sample period with which a loop keeps its margins: what `armwright loops` recommends.

The loop of a joint with f times the bandwidth is the same one in a time that is 1/f times longer:

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
from armwright.control.analysis.regions import margins_text
from armwright.parameters import Batch
from armwright.simulation.scenario import Scenario

if TYPE_CHECKING:
    from armwright.control.analysis.analyse import LoopAnalysis

POWERS = {  # of f, by gain
    "kd": 1, "kp": 2, "ki": 3, "position_kp": 1, "speed_kp": 1, "speed_ki": 2,
}  # fmt: skip
LEAST = 1.0 / 64.0  # f, below which none is looked for
SHORTER = 0.85  # from one f of a joint to the next
WATCHED = 12  # poses at which steps are chosen, the worst ones
MOST_PARTS = 400  # of the period


@dataclass(frozen=True, eq=False)
class LoopRemedies:
    """Changes with which a loop keeps the margins at all analysed poses; each None where none was found.

    Attributes:
        factors: (n,) f, of each joint's bandwidth.   gains: (n,) by name, for f.   slower: the scenario with them.
        period: [s] a whole part of the loop's own.   faster: the scenario with it, its gains unchanged.
        asked: gain and phase margin [rad].
    """

    factors: np.ndarray | None
    gains: dict[str, np.ndarray]
    slower: Scenario | None
    period: float | None
    faster: Scenario | None
    asked: tuple[float, float]

    def sentences(self) -> list[str]:
        """The remedy in words."""
        asked = margins_text(*self.asked)
        lines = []
        if self.factors is not None and self.slower is not None:
            names = self.slower.arm.names
            joints = [
                f"{joint} {f:.3g} times ({', '.join(f'{name} × {f ** POWERS[name]:.3g}' for name in self.gains)})"
                for joint, f in zip(names, self.factors, strict=True)
                if f < 1.0
            ]
            lines.append(f"a lower bandwidth keeps {asked} at these poses: {'; '.join(joints)}")
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
    factors, gains = slower_gains(analysis.loop, q, asked)
    slower = None if factors is None else _replaced(scenario, scenario.controller, gains)
    period, faster = _faster(analysis, q, asked)
    return LoopRemedies(factors, gains, slower, period, faster, asked)


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


def slower_gains(
    analysed: LinearLoop, q: np.ndarray, asked: tuple[float, float]
) -> tuple[np.ndarray | None, dict[str, np.ndarray]]:
    """(n,) f of each joint, and the gains for it: in each step that joint gets slower which brings the loop nearest.

    The distance is the largest spectral radius over poses and over the changes of a command that the margins ask for.

    Args:
        analysed: the loop.   q: (k, n) poses [rad | m].   asked: gain and phase margin [rad].
    Returns:
        factors: None where no bandwidths keep the margins.   gains: (n,) by name, for the factors.
    """
    scenario, own = analysed.scenario, _own_gains(analysed.scenario)
    if not own:
        return None, {}
    n = scenario.arm.n
    ones = {name: Batch(np.ones((1, n))) for name in own}
    loop = LinearLoop(_replaced(scenario, scenario.controller, ones), analysed.period, analysed.plant)

    def distances(factors: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """(candidates, poses) of factors (candidates, n)."""
        rows = np.concatenate([row * factors ** POWERS[name] for name, row in own.items()], axis=1)
        return np.stack([loop.largest_radius(loop.slopes(pose, rows), *asked) for pose in poses], axis=1)

    best = np.ones((1, n))
    while True:
        every = distances(best, q)[0]
        if (every < 1.0).all():
            return best[0], {name: row * best[0] ** POWERS[name] for name, row in own.items()}
        worst = q[np.argsort(-every)[:WATCHED]]
        now = every.max()
        while now >= 1.0:
            tried = best * np.where(np.eye(n, dtype=bool), SHORTER, 1.0)
            found = np.where(tried.min(axis=1) < LEAST, np.inf, distances(tried, worst).max(axis=1))
            if not found.min() < now:  # no joint's bandwidth helps any more
                return None, {}
            best, now = tried[[int(found.argmin())]], found.min()


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

"""The loops of a scenario over the workspace: inertia, margins and the longest sample period, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armwright import scalar
from armwright.control.analysis.linear_loop import LinearLoop, Margins
from armwright.control.analysis.noise import NoiseGain, noise_gain
from armwright.control.analysis.region_picture import COLUMNS, draw_regions
from armwright.control.analysis.regions import (
    GAIN,
    OTHERS,
    PHASE,
    GainRegion,
    check_margins,
    decibels,
    gain_region,
    longest_period,
    margins_text,
    usual_gains,
)
from armwright.control.analysis.remedies import LoopRemedies, loop_remedies
from armwright.control.analysis.workspace import JointInertias, joint_inertias
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import ScenarioError
from armwright.model.joint_signals import command_unit, joint_units
from armwright.progress import Shown, automatic
from armwright.results.page_parts import bullets, sentence
from armwright.results.result import Result
from armwright.results.table import Cell, Table, number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADS = (
    "joint", "inertia held", "inertia free", "gravity slope", "coupling", "gain margin up", "gain margin down", "phase margin",
    "noise gain",
)  # fmt: skip
FURTHER = 24  # poses drawn evenly beside the extreme ones
DELAYS = (0.0, 1.0, 2.0)  # periods beside the loop's own delay that gain regions are found for
GRID, SPAN = 32, 15.0  # values of each gain of a region, and how far they go to either side of its own


@dataclass(frozen=True, eq=False)
class LoopAnalysis(Result):
    """Inertias, margins and sample periods of a scenario's loops over the workspace.

    Attributes:
        loop: linear, about a pose.   inertias: at all sampled poses.   poses: (k, n) at which loops were analysed: those where
            an inertia, slope or coupling is extreme, and some drawn evenly.
        held: margins of each joint's loop there, the other joints held still.
        radius: (k,) spectral radius of the coupled loop a tick; stable below 1.
        asked: gain and phase margin [rad] for `period_with_margin`.
        period_stable, period_with_margin: [s] the longest with which the coupled loop is stable, and keeps the margins, at all of
            the poses; 0: none does.
        period_held, period_free: [s] the longest with which every joint by itself is stable, the others held still, and the
            others without torque.
        noise: from measured positions, of the coupled loop at the poses.
    """

    loop: LinearLoop
    inertias: JointInertias
    poses: np.ndarray
    held: Margins
    radius: np.ndarray
    asked: tuple[float, float]
    period_stable: float
    period_with_margin: float
    period_held: float
    period_free: float
    noise: NoiseGain

    @property
    def stable(self) -> bool:
        """True if the coupled loop is stable at every analysed pose."""
        return bool((self.radius < 1.0).all())

    @property
    def keeps_margins(self) -> bool:
        """True if the loop keeps the requested margins, one joint's command at a time, at every analysed pose."""
        return self.stable and self.period_with_margin >= self.loop.period

    @cached_property
    def remedies(self) -> LoopRemedies:
        """Slower gains, and a shorter period, with which the loop keeps the margins; searched for when first asked for."""
        return loop_remedies(self)

    @cached_property
    def regions(self) -> list[list[GainRegion]]:
        """For each joint its gain regions with the loop's own delay and those of `DELAYS` more periods, at its extreme poses;
        empty for a controller without two gains.
        """
        scenario, (gain, phase) = self.loop.scenario, self.asked
        loop = scenario.loop
        assert loop is not None
        names = usual_gains(loop.controller)
        if names is None:
            return []
        own = {
            each: np.broadcast_to(scalar.real_numbers(getattr(loop.controller, each)), (scenario.arm.n,))
            for each in names
        }
        delays = [np.asarray(loop.timing.command_delay) + more * self.loop.period for more in DELAYS]
        late = [
            replace(scenario, loop=replace(loop, timing=replace(loop.timing, command_delay=each))) for each in delays
        ]
        found = []
        for j, name in enumerate(self.loop.names):
            grid = {each: np.geomspace(v[j] / SPAN, v[j] * SPAN, GRID) for each, v in own.items()}
            q = self.extreme_poses(j)
            found.append([gain_region(each, name, grid, q, gain_margin=gain, phase_margin=phase) for each in late])
        return found

    @property
    def height(self) -> float:
        """Of its picture [inch]."""
        return 0.8 + 3.0 * max(-(-self.loop.scenario.arm.n // COLUMNS), 1)

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws, for each joint, the gains that keep the margins where its inertia and gravity are extreme, the other joints
        held still, for the loop's delay and longer ones.
        """
        if not self.regions:
            raise ScenarioError(
                "no two gains to draw regions of", place="plot", expected="a PID, cascade or computed torque"
            )
        draw_regions(figure, self.regions, [self.loop.delay + more * self.loop.period for more in DELAYS], ink)

    def sections(self) -> list[tuple[str, str]]:
        """Changes that would keep the margins, if the loop does not keep them."""
        return (
            []
            if self.keeps_margins
            else [("What would keep the margins", bullets(map(sentence, self.remedies.sentences())))]
        )

    def _picture(self) -> list[tuple[str, str]]:
        return super()._picture() if self.regions else []

    def extreme_poses(self, joint: int) -> np.ndarray:
        """(k, n) poses of least and greatest inertia of a joint, the others fixed, and of its extreme gravity slopes."""
        columns = (self.inertias.held[:, joint], self.inertias.slope[:, joint])
        return self.inertias.q[np.unique([index for each in columns for index in (each.argmin(), each.argmax())])]

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.loop.scenario.arm.name}: loops over {len(self.inertias.q)} poses"

    @property
    def good(self) -> bool:
        """True if the loop keeps its margins."""
        return self.keeps_margins

    @property
    def _units(self) -> dict[str, list[str]]:
        """Units of the joints by head."""
        arm = self.loop.scenario.arm
        inertia = [body.kind.units.inertia for body in arm.coordinates]
        slope, noise = (
            [f"{unit}/{q}" for unit, q in zip(joint_units(arm, name), joint_units(arm, "q"), strict=True)]
            for name in ("tau", "u")
        )
        return {"inertia held": inertia, "inertia free": inertia, "gravity slope": slope, "noise gain": noise}

    def tables(self) -> list[Table]:
        """A row for each joint; ranges are those over the poses, margins the least; the phase margin is in degrees."""
        rows, units = [], self._units
        shared = {name: next(iter(each)) for name, each in units.items() if len(set(each)) == 1}
        heads = [f"{head} [{shared[head]}]" if head in shared else head for head in HEADS]
        for j, name in enumerate(self.loop.names):
            ranges = [_range(each[:, j]) for each in (self.inertias.held, self.inertias.free, self.inertias.slope)]
            margins = [
                _gain("×", np.nanmin(self.held.gain_up[:, j]), 1) if np.isfinite(self.held.gain_up[:, j]).any() else "—",
                _gain("÷", 1.0 / down, -1) if (down := np.nanmax(self.held.gain_down[:, j])) > 0 else "∞",
                _angle(np.nanmin(self.held.phase[:, j])),
            ] if np.isfinite(self.held.phase[:, j]).all() else ["unstable"] * 3  # fmt: skip
            noise = self.noise.command[:, j, j]
            margins.append(number(np.nanmax(noise), ".3g") if np.isfinite(noise).all() else "—")
            row = [name, *ranges, number(self.inertias.coupling[:, j].max(), ".2f"), *margins]
            unlike = [len(set(units.get(head, [""]))) > 1 for head in HEADS]
            rows.append(
                [
                    Cell(f"{cell} {units[head][j]}", cell.value) if mixed and isinstance(cell, Cell) else cell
                    for cell, head, mixed in zip(row, HEADS, unlike, strict=True)
                ]
            )
        return [Table(self.heading, heads, rows)]

    def sentences(self) -> list[str]:
        """The result in sentences, which also say how poses were sampled."""
        loop, asked = self.loop, margins_text(*self.asked)
        worst = int(self.radius.argmax())
        pose = ", ".join(f"{value:.3g}" for value in self.poses[worst])
        bad = int((self.radius >= 1.0).sum())
        state = (
            f"stable at the {len(self.poses)} poses"
            if self.stable
            else f"NOT stable at {bad} of {len(self.poses)} poses"
        )
        lines = [
            "the loop keeps its margins" if self.keeps_margins else "the loop does not keep its margins",
            f"the coupled loop at {1e3 * loop.period:.4g} ms with {1e3 * loop.delay:.4g} ms of delay is {state}; "
            f"its largest eigenvalue is {self.radius[worst]:.5f} a tick, at q = [{pose}]",
        ]
        for period, what in ((self.period_stable, "be stable"), (self.period_with_margin, f"keep {asked}")):
            if period == 0.0:
                lines.append(f"at no sample period would it {what}")
            else:
                lines.append(
                    f"it would {what} up to a period of {1e3 * period:.4g} ms, down to a rate of {1.0 / period:.4g} Hz"
                )
        if self.period_stable > 0.0:
            held, free = (100.0 * (each / self.period_stable - 1.0) for each in (self.period_held, self.period_free))
            lines.append(
                f"joint by joint the answer is: stable up to {1e3 * self.period_held:.4g} ms ({held:+.2g} %) with the others "
                f"held still, up to {1e3 * self.period_free:.4g} ms ({free:+.2g} %) with the others free"
            )
        count = len(self.inertias.q)
        lines.append(
            f"inertias are those of {count} sampled poses, margins those of {len(self.poses)} of them, the extreme ones "
            f"among these; between sampled poses nothing is proven"
        )
        counts = self.loop.scenario.loop.joint_sensors.counts_of(self.loop.scenario.arm)  # type: ignore[union-attr]
        if counts.any() and self.stable:
            ripple = np.sqrt(self.noise.command**2 @ (counts**2 / 12.0)).max(axis=0)
            bodies = self.loop.scenario.arm.coordinates
            units = [command_unit(body.drive.command, body.kind.units) for body in bodies]
            listed = ", ".join(f"{value:.2g} {unit}" for value, unit in zip(ripple, units, strict=True))
            lines.append(
                f"quantisation ripple of the commands while joints move, by encoder counts: up to {listed} (1 σ)"
            )
        return [*lines, "limits of drives are left out", *loop.notes]


def _gain(sign: str, factor: float, way: int) -> Cell:
    return Cell(f"{sign} {factor:.3g} ({way * decibels(factor):+.1f} dB)".replace("-", "−"), factor)


def analyse_loops(
    scenario: AnyScenario,
    poses: int = 100_000,
    *,
    seed: int = 0,
    gain_margin: float = GAIN,
    phase_margin: float = PHASE,
    progress: Shown = None,
) -> LoopAnalysis:
    """Inertias, margins and the longest sample period of a scenario's loops over the workspace.

    Args:
        scenario: with a controller in its loop.   poses: how many are drawn within the position limits.   seed: of these.
        gain_margin: factor either way.   phase_margin: [rad].
        progress: True or None: a bar where it is seen; False: none; a function is called with parts done and of all.
    Returns:
        analysis: by joint, and of the coupled loop.
    Raises:
        ScenarioError: a scenario without a controller, or with one that cannot be traced; margins that are none.
    Example:
        >>> pid = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0])
        >>> loop = aw.Loop(pid, aw.trajectories.Step([0.0, 0.0], [0.5, -0.5]), period=0.002)
        >>> scenario = aw.Scenario("two-link", 1.0, loop=loop)
        >>> aw.loops.analyse_loops(scenario, poses=100).good  # all loops keep their margins
        True
    """
    scenario = as_scenario(scenario)
    check_margins(gain_margin, phase_margin)
    asked, periods = (gain_margin, phase_margin), []
    with automatic(progress, f"loops of {scenario.arm.name}") as tell:
        parts = len(OTHERS) + 3
        tell(0, parts)
        loop = LinearLoop(scenario)
        inertias = joint_inertias(loop.plant.arm, poses, seed)
        chosen = np.unique(np.concatenate([inertias.extremes(), np.arange(min(FURTHER, poses))]))
        q = inertias.q[chosen]
        held = loop.margins(q, held=True)
        for k, others in enumerate(OTHERS, start=1):
            tell(k, parts)
            periods.append(longest_period(scenario, q, others=others)[0])
        stable, alone_held, alone_free = periods
        tell(parts - 2, parts)
        with_margin, _ = longest_period(scenario, q, gain_margin=gain_margin, phase_margin=phase_margin)
        tell(parts - 1, parts)
        noise = noise_gain(loop, q)
    return LoopAnalysis(loop, inertias, q, held, held.radius, asked, stable, with_margin, alone_held, alone_free, noise)


def _angle(value: float) -> Cell:
    """An angle [rad] in degrees."""
    degrees = float(np.degrees(value))
    return Cell(f"{degrees:.3g}°", degrees)


def _range(values: np.ndarray) -> Cell:
    low, high = float(values.min()), float(values.max())
    return Cell(f"{low:.3g}" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.3g} … {high:.3g}", [low, high])

"""The loops of a scenario over the workspace: inertia, margins and the longest sample period, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright.control.analysis.linear_loop import LinearLoop, Margins
from armwright.control.analysis.noise import NoiseGain, noise_gain
from armwright.control.analysis.regions import GAIN, OTHERS, PHASE, check_margins, longest_period
from armwright.control.analysis.remedies import LoopRemedies, loop_remedies
from armwright.control.analysis.workspace import JointInertias, joint_inertias
from armwright.entry import AnyScenario, as_scenario
from armwright.model.joint_signals import command_unit, joint_units

HEADS = (
    "joint", "inertia held", "inertia free", "gravity slope", "coupling", "gain margin ×", "gain margin ÷", "phase margin",
    "noise gain",
)  # fmt: skip
FURTHER = 24  # poses drawn evenly beside the extreme ones


@dataclass(frozen=True, eq=False)
class LoopAnalysis:
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

    def extreme_poses(self, joint: int) -> np.ndarray:
        """(k, n) poses of least and greatest inertia of a joint, the others fixed, and of its extreme gravity slopes."""
        columns = (self.inertias.held[:, joint], self.inertias.slope[:, joint])
        return self.inertias.q[np.unique([index for each in columns for index in (each.argmin(), each.argmax())])]

    def heads(self) -> list[str]:
        """`HEADS` with units, for units that all joints share."""
        units = {name: set(each) for name, each in self._units.items()}
        return [f"{head} [{next(iter(units[head]))}]" if len(units.get(head, ())) == 1 else head for head in HEADS]

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

    def rows(self) -> list[list[str]]:
        """A row for each joint, as `heads`; ranges are those over the poses, margins the least."""
        rows, units = [], self._units
        for j, name in enumerate(self.loop.names):
            ranges = [_range(each[:, j]) for each in (self.inertias.held, self.inertias.free, self.inertias.slope)]
            margins = [
                f"{np.nanmin(self.held.gain_up[:, j]):.3g}" if np.isfinite(self.held.gain_up[:, j]).any() else "—",
                f"{1.0 / np.nanmax(self.held.gain_down[:, j]):.3g}" if np.nanmax(self.held.gain_down[:, j]) > 0 else "∞",
                f"{np.degrees(np.nanmin(self.held.phase[:, j])):.3g}°",
            ] if np.isfinite(self.held.phase[:, j]).all() else ["unstable"] * 3  # fmt: skip
            noise = self.noise.command[:, j, j]
            margins.append(f"{np.nanmax(noise):.3g}" if np.isfinite(noise).all() else "—")
            row = [name, *ranges, f"{self.inertias.coupling[:, j].max():.2f}", *margins]
            unlike = [len(set(units.get(head, [""]))) > 1 for head in HEADS]
            rows.append(
                [
                    f"{cell} {units[head][j]}" if mixed else cell
                    for cell, head, mixed in zip(row, HEADS, unlike, strict=True)
                ]
            )
        return rows

    def sentences(self) -> list[str]:
        """The result in sentences, which also say how poses were sampled."""
        loop, (gain, phase) = self.loop, self.asked
        worst = int(self.radius.argmax())
        pose = ", ".join(f"{value:.3g}" for value in self.poses[worst])
        asked = f"a gain margin of {gain:g} and a phase margin of {np.degrees(phase):.3g}°"
        bad = int((self.radius >= 1.0).sum())
        state = (
            f"stable at the {len(self.poses)} poses"
            if self.stable
            else f"NOT stable at {bad} of {len(self.poses)} poses"
        )
        lines = [
            f"the coupled loop at {1e3 * loop.period:.4g} ms with {1e3 * loop.delay:.4g} ms of delay is {state}; "
            f"its largest eigenvalue is {self.radius[worst]:.5f} a tick, at q = [{pose}]"
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
            tremor = np.sqrt(self.noise.command**2 @ (counts**2 / 12.0)).max(axis=0)
            bodies = self.loop.scenario.arm.coordinates
            units = [command_unit(body.drive.command, body.kind.units) for body in bodies]
            listed = ", ".join(f"{value:.2g} {unit}" for value, unit in zip(tremor, units, strict=True))
            lines.append(f"counts of encoders make the commands of moving joints tremble, by up to {listed} (1 σ)")
        return [*lines, "limits of drives are left out", *loop.notes]


def analyse_loops(
    scenario: AnyScenario,
    poses: int = 100_000,
    *,
    seed: int = 0,
    gain_margin: float = GAIN,
    phase_margin: float = PHASE,
) -> LoopAnalysis:
    """Inertias, margins and the longest sample period of a scenario's loops over the workspace.

    Args:
        scenario: with a controller in its loop.   poses: how many are drawn within the position limits.   seed: of these.
        gain_margin: factor either way.   phase_margin: [rad].
    Returns:
        analysis: by joint, and of the coupled loop.
    Raises:
        ScenarioError: a scenario without a controller, or with one that cannot be traced; margins that are none.
    """
    scenario = as_scenario(scenario)
    check_margins(gain_margin, phase_margin)
    loop = LinearLoop(scenario)
    inertias = joint_inertias(loop.plant.arm, poses, seed)
    chosen = np.unique(np.concatenate([inertias.extremes(), np.arange(min(FURTHER, poses))]))
    q = inertias.q[chosen]
    held = loop.margins(q, held=True)
    stable, alone_held, alone_free = (longest_period(scenario, q, others=others)[0] for others in OTHERS)
    with_margin, _ = longest_period(scenario, q, gain_margin=gain_margin, phase_margin=phase_margin)
    asked = (gain_margin, phase_margin)
    noise = noise_gain(loop, q)
    return LoopAnalysis(loop, inertias, q, held, held.radius, asked, stable, with_margin, alone_held, alone_free, noise)


def _range(values: np.ndarray) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.3g}" if f"{low:.3g}" == f"{high:.3g}" else f"{low:.3g} … {high:.3g}"

"""Gains of a scenario's controller by a rule of linear control, at a given bandwidth or at the highest that keeps the margins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from armwright import scalar
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.regions import GAIN, PHASE, check_margins, margins_text
from armwright.control.analysis.small_signal import SUPPORT as SMALL_MOTIONS
from armwright.control.cascade import Cascade
from armwright.control.design.designer import Designer, designed_controller, with_gains
from armwright.control.design.limiting import JointLimit, joint_limits
from armwright.control.design.rest_errors import rest_errors, rest_sentences
from armwright.control.design.rules import RULES
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import ScenarioError
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.simulation.checks import check_choice, check_whole
from armwright.simulation.loop.timing import Timing
from armwright.simulation.scenario import Scenario

SUPPORT = replace(
    SMALL_MOTIONS,
    consumer="design_gains",
    approximated={
        **SMALL_MOTIONS.approximated,
        "loops at several rates": "designed as if they had the loop's period; the check of the margins counts the rates",
        "lanes": "the first is designed for",
    },
    refused={**SMALL_MOTIONS.refused, "commands over time": "has no controller"},
)

FASTER = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # sampling, where the loop's own keeps no margins


@dataclass(frozen=True, eq=False)
class GainDesign(Result):
    """Gains of a controller from a design rule.

    Attributes:
        scenario: with the gains.   gains: (n,) by name.   method: the rule.
        bandwidth: (n,) [rad/s] that each joint is designed for: the natural frequency of its poles, the speed loop's crossover
            (symmetric optimum), the position loop's crossover (loop shaping).
        inertia: (n,) [U s²/rad | U s²/m] the largest of each joint over the poses, per unit U of its command.
        lag: (n,) [s] small delays of each joint's speed loop.
        friction_error, weight_error: (n,) [rad | m] by how much dry friction, and weight that nothing compensates, may leave a
            joint beside its goal; 0 with an integral, which takes both away.
        keeps: whether the coupled loop keeps the margins at all poses.   asked: gain and phase margin [rad].   poses: how many.
        damping: ζ.   drawn: how many poses were drawn, and their seed.
        alone: (n,) [rad/s] bandwidth that each joint could have by itself; None where the bandwidth was stated.
        notes: about features of arm and scenario that the design leaves out.
    """

    scenario: Scenario
    gains: dict[str, np.ndarray]
    method: str
    bandwidth: np.ndarray
    inertia: np.ndarray
    lag: np.ndarray
    friction_error: np.ndarray
    weight_error: np.ndarray
    keeps: bool
    asked: tuple[float, float]
    poses: int
    damping: float
    drawn: tuple[int, int]
    alone: np.ndarray | None
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"GainDesign({self.method!r}, {', '.join(self.gains)}, keeps={self.keeps})"

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return f"{self.scenario.arm.name}: gains"

    def tables(self) -> list[Table]:
        """A row for each gain and joint."""
        rows = [
            [joint, name, number(g, ".4g")]
            for name, values in self.gains.items()
            for joint, g in zip(self.scenario.arm.names, values, strict=True)
        ]
        return [Table(self.heading, ("joint", "gain", "value"), rows, ("gain",))]

    @cached_property
    def limits(self) -> tuple[JointLimit, ...]:
        """Limit of each joint: how much faster it could be without one of its causes, computed when first asked for."""

        def designer(scenario: Scenario, period: float | None) -> Designer:
            law = designed_controller(scenario)
            return Designer.of(scenario, law, self.method, self.damping, self.drawn, self.asked, period)

        return joint_limits(self.scenario, self.bandwidth, self.alone, designer)

    def sentences(self) -> list[str]:
        """The design in words."""
        keeps = "keep" if self.keeps else "do NOT keep"
        speeds = ", ".join(f"{each:.3g}" for each in self.bandwidth)
        return [
            f"{self.method}: bandwidths {speeds} rad/s, small delays {1e3 * self.lag.max():.3g} ms",
            f"the gains {keeps} {margins_text(*self.asked)} at {self.poses} "
            "extreme poses; between them nothing is proven",
            *self.notes,
            *rest_sentences(self.scenario.arm, self.friction_error, self.weight_error),
        ]


def design_gains(
    scenario: AnyScenario,
    method: str | None = None,
    *,
    bandwidth: Any = None,
    damping: float = 1.0,
    gain_margin: float = GAIN,
    phase_margin: float = PHASE,
    poses: int = 2000,
    seed: int = 0,
) -> GainDesign:
    """Gains of a scenario's PID, cascade or computed torque by a rule of linear control.

    Each joint is designed by itself, for its largest inertia over the workspace, the loop's period and its delays. Then the
    coupled sampled loop is checked at the poses where an inertia, a slope or a coupling is extreme. Feed-forward and what else
    wraps the controller stays as it is. An integral gain is designed where the scenario's own is above 0.

    Args:
        scenario: with a loop and its controller, whose other gains stay.
        method: "pole-placement", "symmetric-optimum", "loop-shaping" or "lqr" (`control.design.rules` has the equations);
            None: the symmetric optimum of a cascade, pole placement of others.
        bandwidth: [rad/s] one or (n,); None: the one that makes a joint stiffest while all margins are kept, which but for
            loop shaping is the highest; of the symmetric optimum at most Kessler's.
        damping: ζ.   gain_margin: factor either way that any one command bears.   phase_margin: [rad].
        poses: drawn within the position limits.   seed: of these.
    Returns:
        design: gains, scenario, and whether they keep the margins.
    Raises:
        ScenarioError: no such controller, a bandwidth that the rule cannot give, or margins that no bandwidth keeps: says which
            period or delay would do. The extra `control` is not installed.
    Example:
        >>> scenario = aw.read_scenario("examples/bus-4ms.scenario.toml")
        >>> design = aw.loops.design_gains(scenario, poses=50)
        >>> design.gains["position_kp"].round(1)
        array([ 4.7,  4.3,  9.3,  9.3, 12.3, 13.9])
    """
    scenario = as_scenario(scenario)
    check_margins(gain_margin, phase_margin)
    check_whole("poses", poses, 1)
    check_whole("seed", seed, 0)
    zeta = scalar.real_number(damping)
    if zeta is None or not 0.1 <= zeta <= 3.0:
        raise ScenarioError(place="damping", value=damping, expected="a damping from 0.1 to 3")
    SUPPORT.refuse(scenario.arm, "servo")
    law = designed_controller(scenario)
    method = method or ("symmetric-optimum" if isinstance(law, Cascade) else "pole-placement")
    check_choice("method", method, tuple(RULES))
    notes, scenario = SUPPORT.notes(scenario.arm, scenario), one_lane(scenario)
    designer = Designer.of(scenario, law, method, zeta, (poses, seed), (gain_margin, phase_margin))
    alone = None
    if bandwidth is None:
        alone = designer.alone()
        chosen = None if alone is None else designer.together(alone)
        if chosen is None:
            raise _refusal(designer, (poses, seed))
    else:
        chosen = _checked_bandwidth(bandwidth, designer)
    return _result(designer, chosen, alone, (poses, seed), notes)


def _result(
    designer: Designer, bandwidth: np.ndarray, alone: np.ndarray | None, drawn: tuple[int, int], notes: tuple[str, ...]
) -> GainDesign:
    """The design at bandwidths (n,); alone, drawn, notes: as `GainDesign` has them."""
    gains = designer.gains(bandwidth)
    if not all(np.isfinite(each).all() for each in gains.values()):
        value = float(np.max(bandwidth))
        expected = "a lower one: no positive gains give this crossover with this damping"
        raise ScenarioError(place="bandwidth", value=value, expected=expected)
    if isinstance(designer.law, Cascade) and designer.law.current_kp is not None:
        gains |= {name: np.asarray(getattr(designer.law, name)) for name in ("current_kp", "current_ki")}
    assert designer.scenario.loop is not None
    control = with_gains(designer.scenario.loop.controller, gains)
    scenario = replace(designer.scenario, loop=replace(designer.scenario.loop, controller=control))
    loop, joints = LinearLoop(scenario), designer.task.joints
    keeps = all(loop.keeps(loop.slopes(q), *designer.asked) for q in joints.poses)
    friction = weight = np.zeros(scenario.arm.n)
    if not designer.task.integral:
        friction, weight = rest_errors(
            scenario.arm, control, designer.law, designer.stiffness(bandwidth[None])[0], joints.poses
        )
    return GainDesign(
        scenario, gains, designer.method, bandwidth, joints.largest[0], joints.lag, friction, weight, keeps, designer.asked,
        len(joints.poses), designer.task.damping, drawn, alone, notes,
    )  # fmt: skip


def one_lane(scenario: Scenario) -> Scenario:
    """A scenario of one lane: the first lane of a batched one."""
    whole = scenario.resolved
    if whole.lane_count is None:
        return scenario
    assert scenario.loop is not None
    return replace(whole, lanes=range(1)).resolved


def _checked_bandwidth(bandwidth: Any, designer: Designer) -> np.ndarray:
    """A bandwidth (n,).

    Raises:
        ScenarioError: no numbers above 0, or above what the small delays allow.
    """
    n, most = designer.scenario.arm.n, 1.0 / designer.task.joints.lag
    try:
        chosen = np.array(np.broadcast_to(scalar.real_numbers(bandwidth), (n,)))
    except ValueError:
        chosen = np.zeros(n)
    if not ((chosen > 0.0) & np.isfinite(chosen)).all():
        raise ScenarioError(place="bandwidth", value=bandwidth, expected=f"a number above 0 [rad/s], or {n} of them")
    if not (chosen < most).all():
        joint = int(np.argmax(chosen / most))
        what = f"joint {designer.scenario.arm.names[joint]!r} has {1e3 / most[joint]:.3g} ms of small delays"
        raise ScenarioError(what, place="bandwidth", value=bandwidth, expected=f"below {most[joint]:.4g} rad/s")
    return chosen


def _refusal(designer: Designer, drawn: tuple[int, int]) -> ScenarioError:
    """The error where no bandwidth keeps the margins, with a period at which one does, or that it would without delays."""
    what = (
        f"no bandwidth keeps {margins_text(*designer.asked)} at "
        f"{1e3 * designer.loop.period:.4g} ms with {1e3 * designer.loop.delay:.4g} ms of delay"
    )
    scenario, expected = designer.scenario, ["less margin"]

    def works(changed: Scenario, period: float) -> bool:
        law = designed_controller(changed)
        parts = (designer.method, designer.task.damping, drawn, designer.asked, period)
        return Designer.of(changed, law, *parts).fastest() is not None

    periods = (designer.loop.period / factor for factor in FASTER)
    period = next((each for each in periods if works(scenario, each)), None)
    if period is not None:
        expected.insert(0, f"a sample period of {1e3 * period:.3g} ms, at which one does")
    assert scenario.loop is not None
    prompt = replace(scenario, loop=replace(scenario.loop, timing=Timing()))
    if designer.loop.delay > 0.0 and works(prompt, designer.loop.period):
        expected.insert(0, "no delay, without which one does")
    return ScenarioError(what, place="margins", expected=", or ".join(expected))

"""Gains of a scenario's controller by a rule of linear control, at a given bandwidth or at the highest that keeps the margins."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright import scalar
from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.regions import GAIN, PHASE, check_margins, margins_text
from armwright.control.analysis.small_signal import SUPPORT as SMALL_MOTIONS
from armwright.control.cascade import Cascade
from armwright.control.computed_torque import ComputedTorque
from armwright.control.design.joint_plants import JointPlants, current_lag
from armwright.control.design.rest_errors import rest_errors, rest_sentences
from armwright.control.design.rules import RULES, SYMMETRIC, JointGains, Task
from armwright.control.joint_pid import JointPID
from armwright.entry import AnyScenario, as_scenario
from armwright.errors import ScenarioError
from armwright.parameters import Batch, numbers_by_lane
from armwright.results.result import Result
from armwright.results.table import Table, number
from armwright.simulation.checks import check_choice, check_whole
from armwright.simulation.loop.timing import Timing
from armwright.simulation.scenario import Scenario

if TYPE_CHECKING:
    from armwright.control.design.limiting import JointLimit

SUPPORT = replace(
    SMALL_MOTIONS,
    consumer="design_gains",
    approximated={
        **SMALL_MOTIONS.approximated,
        "loops at several rates": "designed as if they had the loop's period; the check of the margins counts the rates",
        "lanes": "the first is designed for",
    },
    refused={"commands over time": "has no controller"},
)

DESIGNED = (JointPID, Cascade, ComputedTorque)
STEPS = {"lqr": 9}  # bandwidths of a grid; each regulator takes a while
SLOWEST = 1e-2  # of them, as a share of the fastest
SHORTER, HALVINGS = 0.8, 3  # from one common factor of the coupled loop to the next
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
        from armwright.control.design.limiting import joint_limits  # which designs again, without each of the causes

        return joint_limits(self)

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
    """
    scenario = as_scenario(scenario)
    check_margins(gain_margin, phase_margin)
    check_whole("poses", poses, 1)
    check_whole("seed", seed, 0)
    zeta = scalar.real_number(damping)
    if zeta is None or not 0.1 <= zeta <= 3.0:
        raise ScenarioError(place="damping", value=damping, expected="a damping from 0.1 to 3")
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
    return replace(designer.result(chosen, (poses, seed), alone), notes=notes)


def designed_controller(scenario: Scenario) -> Any:
    """The controller to design: the scenario's own, or the inner one of a wrapper.

    Raises:
        ScenarioError: there is none.
    """
    law = scenario.controller if isinstance(scenario, Scenario) else None
    while law is not None and not isinstance(law, DESIGNED) and hasattr(law, "inner"):
        law = law.inner
    if not isinstance(law, DESIGNED):
        expected = "aw.JointPID, aw.Cascade or aw.ComputedTorque, or one of these within another"
        found = "has no controller" if law is None else "no rule designs its gains"
        raise ScenarioError(found, place="loop.controller", expected=expected)
    return law


def with_gains(control: Any, gains: dict[str, Any]) -> Any:
    """A controller with other gains, (n,) each or a batch; for a wrapper, with other gains of its inner controller."""
    if isinstance(control, DESIGNED):
        return replace(control, **gains)
    return replace(control, inner=with_gains(control.inner, gains))


def one_lane(scenario: Scenario) -> Scenario:
    """A scenario of one lane: the first lane of a batched one."""
    whole = scenario.resolved
    if whole.lane_count is None:
        return scenario
    assert scenario.loop is not None
    return replace(whole, lanes=range(1)).resolved


@dataclass(frozen=True, eq=False)
class Designer:
    """A rule applied to the controller of a scenario, and the margins of what it gives.

    Attributes:
        law: the controller that is designed.   bare: the scenario with it alone, without what wraps it.
        loop: linear, of the bare scenario.   task: conditions of the rule.   asked: gain and phase margin [rad].
    """

    scenario: Scenario
    bare: Scenario
    law: Any
    method: str
    loop: LinearLoop
    task: Task
    asked: tuple[float, float]
    order: list[int]  # of the poses: those where candidates failed come first
    known: dict[tuple[tuple[int, ...], bytes], JointGains] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        law: Any,
        method: str,
        zeta: float,
        drawn: tuple[int, int],
        asked: tuple[float, float],
        period: float | None = None,
    ) -> Designer:
        """Args:
        drawn: how many poses, and their seed.   period: [s] in place of the loop's own.
        """
        assert scenario.loop is not None
        law = law if getattr(law, "current_kp", None) is None else replace(law, **current_gains(scenario, period))
        bare = replace(scenario, loop=replace(scenario.loop, controller=law))
        loop = LinearLoop(bare, period)
        joints = JointPlants.of(loop, law, *drawn)
        if isinstance(law, ComputedTorque):  # the model's inverse dynamics leaves double integrators
            joints = replace(joints, inertia=np.ones_like(joints.inertia), damping=0.0 * joints.damping)
        integral = bool(np.any(numbers_by_lane(law.speed_ki if isinstance(law, Cascade) else law.ki) > 0.0))
        task = Task(scenario.arm, joints, zeta, integral, loop.period, loop.delay)
        return cls(scenario, bare, law, method, loop, task, asked, list(range(len(joints.poses))))

    @property
    def highest(self) -> np.ndarray:
        """(n,) [rad/s] highest bandwidth to try."""
        return 1.0 / ((SYMMETRIC if self.method == "symmetric-optimum" else 1.0) * self.task.joints.lag)

    def found(self, bandwidth: np.ndarray) -> JointGains:
        """Result of the rule at bandwidths (…, n), cached."""
        key = (bandwidth.shape, bandwidth.tobytes())
        if key not in self.known:
            self.known[key] = RULES[self.method](self.task, bandwidth)
        return self.known[key]

    def gains(self, bandwidth: np.ndarray) -> dict[str, np.ndarray]:
        """Gains by name, (…, n) each, at bandwidths (…, n); NaN if the rule gives none."""
        found = self.found(bandwidth)
        if isinstance(self.law, Cascade):
            gains = {"position_kp": found.position, "speed_kp": found.speed, "speed_ki": found.integral}
        else:
            kp, ki = found.speed * found.position + found.integral, found.integral * found.position
            gains = {"kp": kp, "ki": ki, "kd": found.speed}
        if not self.task.integral:
            gains.pop("speed_ki" if isinstance(self.law, Cascade) else "ki")
        return gains

    def stiffness(self, bandwidth: np.ndarray) -> np.ndarray:
        """(k, n) stiffness k_s k_p [U/rad | U/m] against a load at bandwidths (k, n), without the integral."""
        found = self.found(bandwidth)
        return np.nan_to_num(found.speed * found.position)

    @cached_property
    def batched(self) -> LinearLoop:
        """The unwrapped loop with gains as batches."""
        rows = {name: Batch(np.atleast_2d(each)) for name, each in self.gains(0.5 * self.highest).items()}
        ones = {name: Batch(np.ones_like(each.values)) for name, each in rows.items()}  # any finite numbers
        assert self.bare.loop is not None
        bare = replace(self.bare, loop=replace(self.bare.loop, controller=replace(self.law, **ones)))
        return LinearLoop(bare, self.loop.period, self.loop.plant)

    def keeping(self, bandwidth: np.ndarray, joint: int | None = None) -> np.ndarray:
        """(k,) True if bandwidths (k, n) keep the margins at all poses; or those of one joint, all others fixed."""
        gains = self.gains(bandwidth)
        ordered = [gains[each.name] for each in fields(self.law) if each.name in gains]
        known = [np.isfinite(each if joint is None else each[:, [joint]]).all(axis=-1) for each in ordered]
        active, kept = np.flatnonzero(np.all(known, axis=0)), np.zeros(len(bandwidth), dtype=bool)
        rows = np.nan_to_num(np.concatenate(ordered, axis=-1))
        for k in list(self.order):
            if not active.size:
                break
            passed = self.batched.keeps(
                self.batched.slopes(self.task.joints.poses[k], rows[active], joint), *self.asked
            )
            if not passed.any():  # the next candidates will most probably fail here too
                self.order.remove(k)
                self.order.insert(0, k)
            active = active[passed]
        kept[active] = True
        return kept

    def alone(self, from_: np.ndarray | None = None) -> np.ndarray | None:
        """(n,) [rad/s] bandwidth with the greatest stiffness that keeps each joint's margins; None if one of them has none.

        Args:
            from_: (n,) [rad/s] lowest of them that are tried, and taken where no other does; None: `SLOWEST` of the highest.
        """
        n, steps = self.scenario.arm.n, STEPS.get(self.method, 25)
        low = SLOWEST * self.highest if from_ is None else np.minimum(from_, self.highest)
        grid, chosen = np.geomspace(self.highest, low, steps), np.zeros(n)
        for joint in range(n):
            kept = np.flatnonzero(self.keeping(grid, joint))
            if kept.size:
                chosen[joint] = grid[kept[self.stiffness(grid[kept])[:, joint].argmax()], joint]
            elif from_ is None:
                return None
            else:
                chosen[joint] = from_[joint]
        return chosen

    def together(self, alone: np.ndarray) -> np.ndarray | None:
        """(n,) [rad/s] bandwidths (n,) of all joints, slowed by one factor until the coupled loop keeps the margins; or None."""
        scale, failing = 1.0, 1.0
        while not self.keeping(scale * alone[None])[0]:
            scale, failing = SHORTER * scale, scale
            if scale < SLOWEST:
                return None
        for _ in range(HALVINGS):
            middle = 0.5 * (scale + failing)
            scale, failing = (middle, failing) if self.keeping(middle * alone[None])[0] else (scale, middle)
        return scale * alone

    def fastest(self) -> np.ndarray | None:
        """(n,) [rad/s] bandwidths with the greatest stiffness that keep all margins; None if no bandwidth keeps them."""
        alone = self.alone()
        return None if alone is None else self.together(alone)

    def result(self, bandwidth: np.ndarray, drawn: tuple[int, int], alone: np.ndarray | None) -> GainDesign:
        """The design at bandwidths (n,); drawn, alone: as `GainDesign` has them."""
        gains = self.gains(bandwidth)
        if not all(np.isfinite(each).all() for each in gains.values()):
            value = float(np.max(bandwidth))
            expected = "a lower one: no positive gains give this crossover with this damping"
            raise ScenarioError(place="bandwidth", value=value, expected=expected)
        if isinstance(self.law, Cascade) and self.law.current_kp is not None:
            gains |= {name: np.asarray(getattr(self.law, name)) for name in ("current_kp", "current_ki")}
        assert self.scenario.loop is not None
        control = with_gains(self.scenario.loop.controller, gains)
        scenario = replace(self.scenario, loop=replace(self.scenario.loop, controller=control))
        loop, joints = LinearLoop(scenario), self.task.joints
        keeps = all(loop.keeps(loop.slopes(q), *self.asked) for q in joints.poses)
        friction = weight = np.zeros(scenario.arm.n)
        if not self.task.integral:
            friction, weight = rest_errors(
                scenario.arm, control, self.law, self.stiffness(bandwidth[None])[0], joints.poses
            )
        return GainDesign(
            scenario, gains, self.method, bandwidth, joints.largest[0], joints.lag, friction, weight, keeps, self.asked,
            len(joints.poses), self.task.damping, drawn, alone,
        )  # fmt: skip


def current_gains(scenario: Scenario, period: float | None = None) -> dict[str, np.ndarray]:
    """Gains of a cascade's current loop by the magnitude optimum:  kp = L / (2 T),  ki = R / (2 T),  T its small delays.

    Args:
        scenario: whose drives take voltages.   period: [s] in place of the loop's own.
    Raises:
        ScenarioError: the record has no resistance or no inductance of a winding.
    """
    loop = LinearLoop(scenario, period)
    rows = []
    for body in scenario.arm.coordinates:
        if body.drive.resistance is None or body.drive.inductance is None:
            what = f"the file of {scenario.arm.name} gives no winding resistance and inductance of joint {body.joint!r}"
            raise ScenarioError(what, place="current_kp", expected="both, to design a current loop")
        rows.append((body.drive.inductance, body.drive.resistance))
    kp, ki = np.array(rows, dtype=float).T / (2.0 * current_lag(loop))
    return {"current_kp": kp, "current_ki": ki}


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

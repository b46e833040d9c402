"""`armwright design`: gains by a rule of linear control, written as a scenario, with what limits every joint."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import armwright as aw
from armwright.cli.arguments import (
    SCENARIO,
    Allow,
    PhaseMargin,
    angle,
    option,
    output_option,
    refuse,
    refuse_without_file,
    robot_argument,
    vector,
)
from armwright.cli.outcome import TOML, check_file, exit_unless, say_each
from armwright.cli.tables import show
from armwright.errors import ScenarioError, check_known
from armwright.progress import progress

CONTROLLERS = ("cascade", "joint_pid", "computed_torque")


def design(
    scenario: str = robot_argument(
        "A .scenario.toml with a controller; or an arm, with --period.", metavar="ROBOT|SCENARIO"
    ),
    out: Path = output_option("SCENARIO", "The scenario with the designed gains.", ...),
    method: str | None = option(
        "NAME", "Method: pole-placement, symmetric-optimum, loop-shaping or lqr; default by the controller."
    ),
    bandwidth: str | None = option(
        "W1,W2,…", "Bandwidth of the joints in rad/s; default the stiffest that keeps the margins."
    ),
    damping: float = option("Z", "Damping of the closed loops; default 1.", 1.0),
    gain_margin: float = option("G", "Gain margin to keep, a factor; default 2.", 2.0),
    phase_margin: PhaseMargin = "30deg",
    poses: int = option("N", "Poses to draw within the position limits; default 2000.", 2000),
    seed: int = option("N", "Seed of the poses; default 0.", 0),
    reference: Path | None = option(
        "FILE", "Motion to follow from its start to its end: .motion.toml or .csv of `excite`, `plan`."
    ),
    robot: str | None = option("ROBOT", "In place of a scenario's, such as the identified one; its [values] go."),
    period: float | None = option("S", "Of an arm: sample period in s."),
    controller: str | None = option(
        "KIND", "Of an arm, its controller: cascade (default), joint_pid or computed_torque."
    ),
    timing: str | None = option("PRESET", "Of an arm, delays of its loop: ideal, one-tick (default) or sync."),
    duration: float | None = option("S", "Of an arm: duration in s of its scenario; default 1."),
    allow: Allow = None,
) -> None:
    """Design a controller's gains for a scenario's period, delay and sensors, and say what limits every joint.

    Each joint gets the gains that make it stiffest while
    the coupled loop keeps its margins. What limits a joint is found by designing it again without the delay, with
    faster sampling, exact speeds, rigid gears and quick windings.
    Exit code: 0 the gains keep the margins, 1 a stated --bandwidth does not keep them, 2 bad input, or no gains keep them.

    \b
    Examples:
      armwright design arm.scenario.toml -o designed.scenario.toml
      armwright design arm.scenario.toml -o designed.scenario.toml --method pole-placement --bandwidth 15
      armwright design lwa4p --period 4e-3 --reference excite.csv -o excited.scenario.toml
      armwright design excited.scenario.toml --robot identified.toml --reference round.motion.toml -o round.scenario.toml
    """
    from dataclasses import replace

    from armwright.cli.simulate import following
    from armwright.control.design.designer import with_gains

    check_file(out, TOML, (scenario,))
    options = {"period": period, "controller": controller, "timing": timing, "duration": duration}
    if scenario.endswith(SCENARIO):
        refuse(options, "the scenario file states this already", with_value=True, expected="none")
        found = aw.read_scenario(scenario, allow=allow or ())
        if robot is not None:
            found = replace(found, arm=aw.load(robot), vary={})
    else:
        refuse_without_file(allow, robot)
        found = _of_robot(scenario, **options)
    if reference is not None:
        found = _from_its_start(following(found, reference, scenario))
    names = found.arm.names
    wanted = None if bandwidth is None else vector("--bandwidth", bandwidth, names, ["1/s"] * len(names))
    with progress(f"gains of {Path(scenario).name}"):
        designed = aw.loops.design_gains(
            found, method, bandwidth=wanted, damping=damping, gain_margin=gain_margin,
            phase_margin=angle("--phase-margin", phase_margin), poses=poses, seed=seed,
        )  # fmt: skip
        limits = designed.limits
    assert found.loop is not None
    control = with_gains(found.controller, designed.gains)
    comments = [f"armwright design: {line}" for line in (*designed.sentences(), *limits)]
    found = replace(found, loop=replace(found.loop, controller=control))
    written = aw.write_scenario(found, out, allow=allow or (), comments=comments)
    show(designed)
    say_each("", limits)
    say_each("wrote ", written)
    exit_unless(designed.keeps)


def _from_its_start(scenario: Any) -> Any:
    """The scenario from the beginning of its reference, at its pose, until its end, in whole periods."""
    from dataclasses import replace
    from math import ceil

    motion = scenario.reference
    ticks = max(ceil((motion.time + motion.duration) / scenario.tick * (1.0 - 1e-12)), 1)
    return replace(scenario, start=motion.at(0.0)[0] + 0.0, duration=ticks * scenario.tick)


def _of_robot(
    robot: str, period: float | None, controller: str | None, timing: str | None, duration: float | None
) -> Any:
    """A scenario of an arm that stands under a controller whose gains are to be designed.

    Raises:
        ScenarioError: no period, or no such controller.
    """
    if period is None:
        expected = f"the sample period [s] of an arm's controller, or FILE{SCENARIO}"
        raise ScenarioError("missing", place="--period", expected=expected)
    kind = controller or CONTROLLERS[0]
    check_known(ScenarioError, kind, CONTROLLERS, "unknown", place="--controller")
    ones: dict[str, Any] = {  # an integral above 0 asks for one
        "cascade": lambda: aw.Cascade(1.0, 1.0, speed_ki=1.0, speed_feedforward=1.0),
        "joint_pid": lambda: aw.JointPID(1.0, ki=1.0, kd=1.0),
        "computed_torque": lambda: aw.ComputedTorque(1.0, 1.0),
    }
    loop = aw.Loop(ones[kind](), period=period, timing=aw.Timing(cast(Any, timing or "one-tick")))
    whole = max(round(1.0 / period), 1) * period if period > 0.0 else 1.0  # a second, in whole periods
    return aw.Scenario(aw.load(robot), whole if duration is None else duration, loop=loop)

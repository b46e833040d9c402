"""`armwright design`: gains by a rule of linear control, written as a scenario, with what limits every joint."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from armwright.cli.arguments import SCENARIO, Allow, complete_robot, option, refuse_allow
from armwright.cli.tables import show
from armwright.errors import ScenarioError
from armwright.terminal import say

FAILS = 1  # the exit code where the gains do not keep the margins
CONTROLLERS = ("cascade", "joint_pid", "computed_torque")
FOR_ROBOTS = ("period", "controller", "timing", "duration")


def design(
    scenario: Annotated[
        str,
        typer.Argument(
            metavar="FILE.scenario.toml|ROBOT",
            autocompletion=complete_robot,
            help="A scenario with a controller; or an arm, with --period.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, option("--output -o", f"DESIGNED{SCENARIO}", "The scenario with the designed gains.")],
    method: Annotated[
        str | None,
        option(
            "--method", "NAME", "pole-placement, symmetric-optimum, loop-shaping or lqr; default by the controller."
        ),
    ] = None,
    bandwidth: Annotated[
        str | None,
        option("--bandwidth", "W1,W2,…", "Of the joints in rad/s; default the stiffest that keeps the margins."),
    ] = None,
    damping: Annotated[float, option("--damping", "Z", "Of the closed loops; default 1.")] = 1.0,
    gain_margin: Annotated[float, option("--gain-margin", "G", "Factor of a command to bear; default 2.")] = 2.0,
    phase_margin: Annotated[float, option("--phase-margin", "DEG", "Phase lag to bear, degrees; default 30.")] = 30.0,
    poses: Annotated[int, option("--poses", "N", "Poses to draw within the position limits; default 2000.")] = 2000,
    seed: Annotated[int, option("--seed", "N", "Of the poses; default 0.")] = 0,
    reference: Annotated[
        Path | None,
        option(
            "--reference",
            "FILE",
            "Motion to follow from its start to its end: .motion.toml or .csv of `excite`, `plan`.",
        ),
    ] = None,
    robot: Annotated[
        str | None, option("--robot", "ROBOT", "In place of a scenario's, such as the identified one; its [values] go.")
    ] = None,
    period: Annotated[float | None, option("--period", "S", "Of an arm: sample period in s.")] = None,
    controller: Annotated[
        str | None, option("--controller", "KIND", "Of an arm: cascade, the default, joint_pid or computed_torque.")
    ] = None,
    timing: Annotated[
        str | None, option("--timing", "PRESET", "Of an arm: ideal, one-tick, the default, or sync.")
    ] = None,
    duration: Annotated[float | None, option("--duration", "S", "Of an arm: of its scenario in s; default 1.")] = None,
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
    import math
    from dataclasses import replace

    import armwright as aw
    from armwright.cli.progress import progress
    from armwright.cli.simulate import following
    from armwright.control.design.designer import with_gains
    from armwright.output import check_destination

    options = {"period": period, "controller": controller, "timing": timing, "duration": duration}
    if scenario.endswith(SCENARIO):
        _refuse(options)
        check_destination(out, (".toml",), read=(scenario,))
        found = aw.read_scenario(scenario, allow=allow or ())
        if robot is not None:
            found = replace(found, arm=aw.load(robot), vary={})
    else:
        refuse_allow(allow)
        _refuse_robot(robot)
        check_destination(out, (".toml",), read=(scenario,))
        found = _of_robot(scenario, **options)
    if reference is not None:
        found = _from_its_start(following(found, reference, scenario))
    wanted = None if bandwidth is None else _numbers(bandwidth, found.arm)
    with progress(f"gains of {Path(scenario).name}"):
        designed = aw.loops.design_gains(
            found, method, bandwidth=wanted, damping=damping, gain_margin=gain_margin,
            phase_margin=math.radians(phase_margin), poses=poses, seed=seed,
        )  # fmt: skip
        limits = designed.limits
    assert found.loop is not None
    control = with_gains(found.controller, designed.gains)
    lines = [*designed.sentences(), *map(str, limits)]
    comments = [f"armwright design: {line}" for line in lines]
    written = aw.write_scenario(
        replace(found, loop=replace(found.loop, controller=control)), out, allow=allow or (), comments=comments
    )
    show(designed)
    for line in limits:
        say(line)
    for path in written:
        say(f"wrote {path}")
    if not designed.keeps:
        raise typer.Exit(FAILS)


def _refuse(options: dict[str, Any]) -> None:
    """Refuses options of an arm beside a scenario, which states them.

    Raises:
        ScenarioError: one of them was given.
    """
    for name, value in options.items():
        if value is not None:
            raise ScenarioError(
                "the scenario file states this already", place=f"--{name}", value=value, expected="none"
            )


def _refuse_robot(robot: str | None) -> None:
    """Refuses --robot beside an arm.

    Raises:
        ScenarioError: it was given.
    """
    if robot is not None:
        raise ScenarioError("goes with a scenario file", place="--robot", value=robot, expected=f"FILE{SCENARIO}")


def _from_its_start(scenario: Any) -> Any:
    """The scenario from the beginning of its reference, at its pose, until its end, in whole periods."""
    from dataclasses import replace
    from math import ceil

    motion = scenario.reference
    ticks = max(ceil((motion.time + motion.duration) / scenario.tick * (1.0 - 1e-12)), 1)
    return replace(scenario, start=motion.at(0.0)[0], duration=ticks * scenario.tick)


def _of_robot(
    robot: str, period: float | None, controller: str | None, timing: str | None, duration: float | None
) -> Any:
    """A scenario of an arm that stands under a controller whose gains are to be designed.

    Raises:
        ScenarioError: no period, or no such controller.
    """
    import armwright as aw

    if period is None:
        expected = f"the sample period [s] of an arm's controller, or FILE{SCENARIO}"
        raise ScenarioError("missing", place="--period", expected=expected)
    kind = controller or CONTROLLERS[0]
    if kind not in CONTROLLERS:
        raise ScenarioError("unknown", place="--controller", value=kind, choices=CONTROLLERS)
    ones: dict[str, Any] = {  # an integral above 0 asks for one
        "cascade": lambda: aw.Cascade(1.0, 1.0, speed_ki=1.0, speed_feedforward=1.0),
        "joint_pid": lambda: aw.JointPID(1.0, ki=1.0, kd=1.0),
        "computed_torque": lambda: aw.ComputedTorque(1.0, 1.0),
    }
    loop = aw.Loop(ones[kind](), period=period, timing=aw.Timing(timing or "one-tick"))
    whole = max(round(1.0 / period), 1) * period if period > 0.0 else 1.0  # a second, in whole periods
    return aw.Scenario(aw.load(robot), whole if duration is None else duration, loop=loop)


def _numbers(text: str, arm: Any) -> Any:
    from armwright.cli.arguments import vector

    return vector("--bandwidth", text, arm.names, ["1/s"] * arm.n)

"""Linear loops: slopes, margins, periods, noise, limit cycles and remedies, about poses at rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright.control.analysis.hold import sampled_system, split_delay
from armwright.control.analysis.instability import growing_mode, unstable_sentence
from armwright.control.analysis.limit_cycles import rounding_factor
from armwright.control.analysis.linear_loop import LinearLoop, first_lost, moving_states
from armwright.control.analysis.noise import noise_gain, quantisation
from armwright.control.analysis.regions import decibels, longest_delay, margins_text, usual_gains
from armwright.control.analysis.remedies import slower_gains
from armwright.control.analysis.small_signal import SmallPlant, cycle_of, small_signal_arm
from armwright.control.analysis.workspace import joint_inertias, sampled_poses
from armwright.model.drive import Friction
from frozen.numbers import Case
from physics.arms import arm
from simulation.plants import COULOMB, ELASTIC, MANY, MOTOR, pendulum

Q = np.array([[0.4, -0.7], [1.2, 0.3], [-1.6, 2.0]])
POSES = np.random.default_rng(2).uniform(-0.9, 0.9, (20, 5))
PID = aw.JointPID(kp=[900.0, 250.0], ki=[500.0, 200.0], kd=[180.0, 50.0], gravity=True)
PD = replace(PID, ki=0.0)
CASCADE = aw.Cascade(position_kp=8.0, speed_kp=[100.0, 20.0], speed_ki=[150.0, 40.0])
SLOW = replace(CASCADE, position_every=4, speed_every=2, speed_phase=1)
COUNTED = aw.Sensors(counts=4096, velocity="difference")


def scenario(law: Any, model: Any = "two-link", period: float = 2e-3, **loop: Any) -> aw.Scenario:
    """A controller in a loop whose commands act a tick later."""
    given = {"timing": aw.Timing("one-tick"), **loop}
    return aw.Scenario(model, duration=100 * period, loop=aw.Loop(law, reference=None, period=period, **given))


def loop_of(law: Any, model: Any = "two-link", period: float = 2e-3, **loop: Any) -> LinearLoop:
    """The linear loop of such a scenario."""
    return LinearLoop(scenario(law, model, period, **loop))


SOFT = pendulum(motor={**MOTOR, "inductance_h": 1e-3}, friction=COULOMB, elasticity=ELASTIC)
VOLTS = pendulum(motor={**MOTOR, "inductance_h": 1e-3}, friction=COULOMB)
CURRENT = aw.Cascade(12.0, 30.0, 100.0, current_kp=2.0, current_ki=900.0)
WEIGHTLESS = arm("two-link").replace(gravity=[0.0, 0.0, 0.0])
FRACTION = aw.Timing(measurement_delay=0.7e-3, command_delay=1.9e-3)
HELD_SOFT = aw.JointPID(kp=200.0, kd=20.0)

LOOPS = {
    "PD": (PD, "two-link", {}),
    "PID": (PID, "two-link", {}),
    "PID without delay": (PID, "two-link", {"timing": aw.Timing()}),
    "PID, a fraction of a period late": (PID, "two-link", {"timing": FRACTION}),
    "PID of a filtered speed": (PID, "two-link", {"sensors": aw.Sensors(velocity="filtered", cutoff_hz=60.0)}),
    "PID of an observed speed": (PD, "two-link", {"sensors": aw.Sensors(velocity="observer", cutoff_hz=40.0)}),
    "PID of differences": (PD, "two-link", {"sensors": COUNTED}),
    "cascade": (CASCADE, "two-link", {}),
    "cascade of several rates": (SLOW, "two-link", {"sensors": COUNTED}),
    "computed torque": (aw.ComputedTorque(kp=400.0, kd=40.0, ki=50.0), "two-link", {}),
    "filtered": (aw.Filtered(PD, [aw.Notch(40.0, 10.0), aw.LowPass(90.0)]), "two-link", {}),
    "observer": (aw.DisturbanceObserver(PD, inertia=[5.0, 0.9], hz=5.0), "two-link", {}),
    "soft gear": (HELD_SOFT, SOFT, {"period": 1e-3}),
    "soft gear, encoder at the link": (HELD_SOFT, SOFT, {"period": 1e-3, "sensors": aw.Sensors(side="link")}),
    "current loop": (CURRENT, VOLTS, {"period": 2.5e-4}),
    "all effects": (aw.JointPID(kp=300.0, kd=20.0), MANY["all"], {"period": 5e-4}),
}


def looked_at(law: Any, model: Any, more: dict[str, Any]) -> dict[str, Any]:
    """Margins, radii and noise of a loop, of all joints and of each alone."""
    loop = loop_of(law, model, **more)
    q = Q[:, : len(loop.names)]
    last = len(loop.names) - 1
    found = {
        "delay": loop.delay,
        "cycle": loop.cycle,
        "radius": loop.radius(q),
        "alone": [loop.radius(q, joint=joint) for joint in range(last + 1)],
        "free": loop.radius(q, joint=last, free=True),
        "margins": loop.margins(q),
        "held": loop.margins(q[:1], held=True),
        "noise": vars(noise_gain(loop, q)),
        "noise alone": vars(noise_gain(loop, q[0], joint=last)),
        "asked": loop.largest_radius(loop.slopes(q), 2.0, 0.5),
        "with another delay": loop.with_delay(3.4e-3).radius(q),
    }
    return found if loop.cycle != 1 else found | {"sensitivity": loop.sensitivity(q, points=60)}


def opened(_: Path) -> dict[str, Any]:
    """Open loops as systems of python-control: of all commands, of one, with the other joint held, with other gains."""
    batched = loop_of(replace(PD, kp=aw.Batch([[900.0, 250.0], [500.0, 100.0]])))
    systems = {
        "all": loop_of(PID).open_loop(Q[0]),
        "one": loop_of(PID).open_loop(Q[0], 1),
        "one, held": loop_of(PID).open_loop(Q[0], 1, held=True),
        "at once": loop_of(PID, timing=aw.Timing()).open_loop(Q[0], 0),
        "other gains": batched.open_loop(Q[0], gains=[600.0, 90.0]),
    }
    return {name: answers(system) for name, system in systems.items()}


def answers(system: Any) -> dict[str, Any]:
    """A system's responses at some frequencies, which do not depend on the order of its states, and its names."""
    at = np.exp(1j * np.array([0.01, 0.1, 0.6])) if system.dt else 1j * np.array([0.3, 4.0, 50.0])
    values = np.array([system(each) for each in at])
    labels = [*system.input_labels, *system.output_labels, *system.state_labels]
    return {"real": values.real, "imaginary": values.imag, "states": system.nstates, "labels": " ".join(labels)}


def slopes_of(model: Any, q: np.ndarray) -> dict[str, np.ndarray]:
    """E, A and B of an arm with its drives about poses."""
    return dict(zip("eab", SmallPlant(model).slopes(q), strict=True))


def held(_: Path) -> list[Any]:
    """Sampled systems: without delay, of a whole, of a part, of two periods and a part, of a batch."""
    a, b = np.array([[0.0, 1.0], [-9.0, -0.4]]), np.array([[0.0, 0.1], [2.0, 0.3]])
    delays = [0.0, 0.05, 0.02, 0.12, 0.05 * (1.0 + 1e-12)]
    found = [aw.loops.zero_order_hold(a, b, 0.05, delay) for delay in delays]
    found.append(aw.loops.zero_order_hold(np.stack([a, 2.0 * a]), b, 0.05, 0.03))
    return [vars(each) for each in found]


def systems(_: Path) -> dict[str, Any]:
    """Sampled systems of python-control, with commands under way."""
    a, b, c = np.array([[0.0, 1.0], [-9.0, -0.4]]), np.array([[0.0], [2.0]]), np.array([[1.0, 0.5]])
    return {str(delay): answers(sampled_system(a, b, c, 0.05, delay)) for delay in (0.0, 0.02, 0.05, 0.12)}


def periods(_: Path) -> dict[str, Any]:
    """Longest periods of a loop: coupled, held, free, with margins; of one that is too slow, that never and always keeps them."""
    find, q = aw.loops.longest_period, Q
    late = scenario(PD, timing=aw.Timing(command_delay=4e-3))
    return {
        "closed": find(scenario(PD), q),
        "held": find(scenario(PD), q, others="held"),
        "free": find(scenario(PD), q, others="free"),
        "margins": find(scenario(PD), q, gain_margin=2.0, phase_margin=0.5),
        "late": find(late, q),
        "many poses": find(scenario(PD), sampled_poses(arm("two-link"), 40, 1), gain_margin=1.5),
        "from a long one": find(scenario(PD, period=0.03), q),
        "never": find(scenario(aw.JointPID(kp=100.0)), q),
        "never, late": find(scenario(replace(PD, kp=4e4), timing=aw.Timing(command_delay=50e-3)), q),
        "always": find(scenario(aw.JointPID(kp=1e-5, kd=1e-4), WEIGHTLESS), q),
    }


def delays(_: Path) -> list[Any]:
    """Longest delays that a loop bears: its own, a part of it, none."""
    late = scenario(PD, timing=aw.Timing(command_delay=12e-3))
    never = scenario(replace(PD, kd=4e4), timing=aw.Timing(command_delay=4e-3))
    asked = {"gain_margin": 2.0, "phase_margin": 0.5}
    return [longest_delay(scenario(PD), Q), longest_delay(late, Q, **asked), longest_delay(never, Q[0])]


def region(law: Any, gains: dict[str, Any], **asked: Any) -> Any:
    """A grid of two gains of the elbow."""
    return vars(aw.loops.gain_region(scenario(law), "elbow", gains, Q, **asked))


def regions(_: Path) -> list[Any]:
    """Grids of gains of a PID, a cascade and of margins."""
    grid = np.geomspace(20.0, 2e4, 9)
    return [
        region(PID, {"kp": grid, "kd": grid / 20.0}),
        region(CASCADE, {"position_kp": grid / 40.0, "speed_kp": grid / 20.0}),
        region(PID, {"kp": grid, "ki": grid}, gain_margin=1.0, phase_margin=0.0),
        region(CASCADE, {"speed_ki": grid, "speed_kp": 20.0}, gain_margin=3.0, phase_margin=0.9),
    ]


def rubbing(force: float) -> Any:
    """The weightless arm with dry friction."""
    own = Friction(coulomb_positive=force, coulomb_negative=1.5 * force)
    return replace(WEIGHTLESS, bodies=tuple(replace(body, friction=own) for body in WEIGHTLESS.bodies))


def swings(_: Path) -> dict[str, Any]:
    """Limit cycles of the elbow by its counts near the end of its gain margin, with more and more dry friction, and factors."""
    sensors = aw.Sensors(counts=500, side="link", velocity="difference")
    pose = np.array([0.0, 144.0 * np.pi / 500.0])
    most = loop_of(aw.JointPID(kp=400.0, kd=60.0), WEIGHTLESS, sensors=sensors).margins(pose).gain_up[1]
    found: dict[str, Any] = {"factor": rounding_factor(np.array([0.4, 0.51, 0.7, 1.6, 3.3, 20.0]) * 1e-3, 1e-3)}
    for force in (0.0, 2.0, 80.0):
        for part in (0.8, 0.95):
            high = 60.0 * most * part
            laws = (aw.JointPID([400.0, high / 0.15], kd=[60.0, high]), aw.Cascade(8.0, [60.0, high], position_every=2))
            loops = [loop_of(law, rubbing(force), sensors=sensors) for law in laws]
            cycles = [aw.loops.limit_cycle(loop, pose, joint) for loop in loops for joint in (0, 1)]
            found[f"{force} {part}"] = [None if each is None else vars(each) for each in cycles]
    return found


def ripple(_: Path) -> list[Any]:
    """Effects of encoder counts, of loops that swing, that do not and that are unstable."""
    laws = [
        (PD, replace(COUNTED, counts=[4096, 900])),
        (PD, COUNTED),
        (CASCADE, COUNTED),
        (replace(SLOW, speed_kp=[300.0, 70.0]), COUNTED),
    ]
    laws.append((aw.JointPID(kp=100.0), COUNTED))
    found = [quantisation(loop_of(law, sensors=sensors), Q) for law, sensors in laws]
    found.append(quantisation(loop_of(PD, sensors=COUNTED), Q[0]))
    return [{**vars(each), "may swing": each.may_swing} for each in found]


def modes(_: Path) -> dict[str, Any]:
    """Modes that grow: swings, a drift, of several rates, none; and what is said of them."""
    laws = {
        "swings": scenario(replace(PD, kd=[900.0, 400.0])),
        "slowly": scenario(replace(PID, ki=[2e5, 100.0])),
        "drifts": scenario(aw.JointPID(kp=[9.0, 1.0], kd=9.0)),
        "rates": scenario(replace(SLOW, speed_kp=[2500.0, 400.0])),
        "stable": scenario(PD),
    }
    up = np.array([[1.6, 0.2]])
    found = {name: growing_mode(LinearLoop(each), np.concatenate([Q, up])) for name, each in laws.items()}
    lanes = scenario(replace(PD, kd=aw.Batch([[180.0, 50.0], [900.0, 400.0]])))
    said = {f"{name}, said": unstable_sentence(each, Q, clipped="current") for name, each in laws.items()}
    of_lanes = [unstable_sentence(lanes, Q, lane) for lane in (0, 1, 2)]
    return found | said | {"lanes": of_lanes, "words": [str(each) for each in found.values()]}


def remedies(_: Path) -> dict[str, Any]:
    """Slower gains and shorter periods of loops without margins, in numbers and words."""
    laws = {
        "fast": scenario(replace(PID, kp=[9e3, 250.0], kd=[1500.0, 50.0])),
        "cascade": scenario(replace(CASCADE, speed_kp=[900.0, 200.0])),
        "wrapped": scenario(aw.Filtered(replace(PD, kp=[9e3, 4e3]), [aw.LowPass(120.0)])),
        "without gains": scenario(lambda t, r, y: 9e3 * (r.q - y.q) - 2e3 * y.qd),
    }
    found = {}
    for name, each in laws.items():
        analysis = aw.loops.analyse_loops(each, poses=5, progress=False)
        own = analysis.remedies
        found[name] = {"factors": own.factors, "gains": own.gains, "period": own.period, "words": own.sentences(),
                       "analysis": analysis.sentences(), "table": analysis.tables()[0].rows()}  # fmt: skip
    return found


def analysed(law: Any, model: Any = "two-link", poses: int = 20, **more: Any) -> dict[str, Any]:
    """An analysis in words and numbers."""
    found = aw.loops.analyse_loops(scenario(law, model, **more), poses=poses, seed=3, progress=False)
    return {
        "words": found.sentences(),
        "rows": found.tables()[0].rows(),
        "cells": [str(cell) for row in found.tables()[0].cells for cell in row],
        "verdict": [found.good, found.stable],
        "radius": found.radius,
        "periods": [found.period_stable, found.period_with_margin, found.period_held, found.period_free],
        "held": found.held,
        "poses": found.poses,
        "inertias": vars(found.inertias),
        "coupling": found.inertias.coupling,
        "extreme": found.extreme_poses(0),
        "sections": [title for title, _ in found.sections()],
        "height": found.height,
    }


def areas(_: Path) -> list[Any]:
    """Regions of gains for more and more delay, of a cascade and of a law that has none."""
    cascade = aw.loops.analyse_loops(scenario(CASCADE), poses=10, progress=False)
    nothing = aw.loops.analyse_loops(
        scenario(lambda t, r, y: 900.0 * (r.q - y.q) - 90.0 * y.qd), poses=20, progress=False
    )
    return [[[vars(each) for each in of_joint] for of_joint in cascade.regions], len(nothing.regions)]


def small_arms(_: Path) -> dict[str, Any]:
    """Arms without what small motions do not have; slopes of plants with all kinds of states."""
    kept = small_signal_arm(MANY["all"])
    bodies = [[body.friction, body.elasticity, body.drive.efficiency, body.limits.position] for body in kept.bodies]
    plants = {
        name: slopes_of(MANY[name], np.array([[0.3, -0.4]])[:, : MANY[name].n])
        for name in ("harmonic", "springs", "all")
    }
    places = [SmallPlant(MANY["all"]).states_of(joint) for joint in (0, 1)]
    named = SmallPlant(MANY["all"]).states_of(1, ["qd", "q"])
    return {
        "bodies": bodies,
        "places": [*places, named],
        "workshop": slopes_of(arm("workshop"), np.full(5, 0.3)),
        **plants,
    }


def words(_: Path) -> list[Any]:
    """Margins in words, decibels, rates, splits of delays, usual gains."""
    laws = [PID, PD, CASCADE, aw.JointPID(kp=9.0, ki=2.0), aw.JointPID(kp=9.0), aw.Filtered(PID, [aw.LowPass(9.0)])]
    wrapped = aw.Filtered(replace(SLOW, position_every=6, speed_every=4), [aw.LowPass(9.0)])
    return [
        margins_text(2.0, 0.5), decibels(0.5), [usual_gains(law) for law in laws], [cycle_of(law) for law in (SLOW, wrapped, PD)],
        [split_delay(each) for each in (0.0, 0.3, 1.0, 1.0 - 1e-12, 2.75)], repr(loop_of(PD)),
        loop_of(HELD_SOFT, arm("workshop")).notes,
    ]  # fmt: skip


def notes(_: Path) -> list[Any]:
    """What small motions leave out, of an arm with all effects and a scenario with all parts."""
    sensors = aw.Sensors(counts=4096, position_noise=1e-4)
    timing = aw.Timing("one-tick", jitter=1e-4, measurement_loss=0.1, clock_drift=1e-4)
    full = replace(
        scenario(HELD_SOFT, MANY["all"], sensors=sensors, timing=timing, command_filter=aw.CommandFilter(limit=30.0)),
        start=aw.Start([0.1, 0.2], [0.3, 0.1]), inputs=aw.Inputs(wrench=[1.0, 2.0, 3.0, 0.0, 0.0, 0.0]),
    )  # fmt: skip
    moving = replace(full, loop=replace(full.loop, reference=aw.trajectories.Quintic([0.0, 0.0], [0.1, 0.1], 0.1)))
    return [LinearLoop(each).notes for each in (full, moving)]


def searches(_: Path) -> list[Any]:
    """First values along a grid at which something ends, and states that matter."""
    grid, ends = np.geomspace(1.0, 1e3, 20), np.array([1.05, 7.0, 400.0, 2e3])
    coupled = np.zeros((5, 5))
    coupled[0, 1] = coupled[1, 2] = coupled[2, 0] = coupled[3, 0] = coupled[1, 4] = 1.0
    return [first_lost(lambda values: values >= ends, grid, (4,), np.inf), moving_states([coupled, coupled.T * 0.0], 1)]


def slower(_: Path) -> list[Any]:
    """Factors of bandwidths with which a loop has margins; none of one that nothing helps."""
    fast = loop_of(replace(PID, kp=[9e3, 2e3], kd=[1500.0, 250.0]))
    hopeless = loop_of(aw.JointPID(kp=1.0, kd=0.1), timing=aw.Timing(command_delay=0.02))
    return [slower_gains(fast, Q, (2.0, 0.5)), slower_gains(hopeless, np.array([[1.6, 0.0]]), (2.0, 0.5))]


CASES = {
    **{f"loop {name}": Case(lambda _, each=each: looked_at(*each), close=1e-5) for name, each in LOOPS.items()},
    "open loops": opened,
    "zero-order hold": held,
    "sampled systems": systems,
    "periods": Case(periods, close=1e-5),
    "delays": delays,
    "regions of gains": regions,
    "limit cycles": Case(swings, close=1e-4),
    "counts of encoders": Case(ripple, close=1e-5),
    "growing modes": Case(modes, close=1e-5),
    "remedies": Case(remedies, close=1e-4),
    "slower gains": slower,
    "analysis of a cascade": Case(lambda _: analysed(CASCADE, sensors=COUNTED), close=1e-5),
    "analysis of an unstable loop": Case(lambda _: analysed(aw.JointPID(kp=100.0, kd=1e-3)), close=1e-5),
    "regions of an analysis": areas,
    "inertias over the workspace": lambda _: vars(joint_inertias("two-link", 50, 4)),
    "inertias of a slide": lambda _: vars(joint_inertias(arm("sprung"), POSES)),
    "small motions": small_arms,
    "words and rates": words,
    "notes": notes,
    "searches": searches,
}

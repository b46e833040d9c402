"""Runs of a scenario for each feature: what is recorded and noted, which steps are recommended, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright.results.aliases import LOOP_STATE
from armwright.results.reducers import REDUCERS
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.plant.step_limits import StepLimit, full_voltage, loads
from features.cases import ARMS, BODY, SCENARIOS, arms, base, commanded, looped, move, together
from frozen.numbers import Case
from simulation.plants import MANY

SHORT = 0.03  # [s]
STEPPED = aw.Solver(step=2.5e-4, integrator="rk3")
SCHEDULE = aw.Schedule([0.0, 0.005, 0.012], [[1.0, -1.0], [4.0, 2.0], [0.0, -3.0]], ["joint0", "joint1"])


def run(scenario: aw.Scenario, **options: Any) -> dict[str, Any]:
    """All that a run records and says of itself."""
    found = aw.simulate(scenario, **options)
    said = {name: found.attrs[name] for name in ("notes", "rule", "step_s", "controller") if name in found.attrs}
    return {"run": found.drop_vars(LOOP_STATE, errors="ignore"), **said}  # what the state consists of may change


def of_feature(feature: str, folder: Path) -> dict[str, Any]:
    """The arm under a controller."""
    return run(looped(arms(feature)[0], SHORT))


def of_scenario(feature: str, folder: Path) -> dict[str, Any]:
    """The scenario as it is, but short."""
    return run(replace(SCENARIOS[feature](base())[0], duration=0.12 if "grips" in feature else SHORT))


def steps_of(feature: str, folder: Path) -> dict[str, Any]:
    """The largest steps of all rules, those that are recommended, and the effects that ask for them."""
    limits = StepLimit(arms(feature)[0])
    found: dict[str, Any] = {
        "states": limits.states,
        "loads": np.array(loads(limits.model, full_voltage(limits.model)[None])),
    }
    for name, rule in INTEGRATORS.items():
        for size, command in (("unloaded", np.zeros(limits.model.n)), ("loaded", full_voltage(limits.model))):
            limit = limits.limit(rule, command)
            whole: Sequence[float] = () if size == "loaded" else (1e-3,)
            found[f"{name}, {size}"] = [limit.step, limit.constant, limits.recommended(limit, rule, command, whole)]
            found[f"{name}, {size}, cause"] = str(limits.cause(limit, rule, command))
    return found


def stepped(folder: Path) -> dict[str, Any]:
    """Steps by hand, a state that is restored, and a run that goes on from it."""
    simulation = aw.simulation.Simulation(replace(commanded(base(), SHORT), command=None, solver=STEPPED))
    found: list[Any] = []
    for k in range(4):
        simulation.step([1.0 + k, -2.0])
        found += [simulation.time, *simulation.plant_state["q"], *simulation.measurement.q]
    kept = simulation.state
    simulation.step([5.0, 5.0])
    ahead = simulation.plant_state["qd"]
    simulation.restore(kept)
    again = simulation.plant_state["qd"]
    simulation.reset()
    return {
        "steps": found,
        "ahead": ahead,
        "again": again,
        "reset": simulation.plant_state["q"],
        "time": simulation.time,
    }


def stepped_loop(folder: Path) -> dict[str, Any]:
    """A loop stepped far beyond the part of its reference that is worked out ahead, and what its lanes refuse."""
    lanes = replace(looped(base(), 0.01, reference=move(2)), vary={"rod1.mass_kg": aw.Batch([1.8, 2.2])})
    simulation = aw.simulation.Simulation(lanes)
    seen = []
    for k in range(2200):
        simulation.step()
        if k % 200 == 0:
            seen.append([*np.ravel(simulation.reference_now.q), *np.ravel(simulation.plant_state["q"])])
    stepped = aw.simulation.Simulation(replace(lanes, loop=None, command=None, solver=STEPPED))
    refused = []
    for count in (1, 2, 3):
        try:
            stepped.step(aw.Batch(np.ones((count, 2))))
        except aw.ArmwrightError as error:
            refused.append(str(error))
    return {"seen": np.array(seen), "refused": refused}


def studied(folder: Path) -> dict[str, Any]:
    """A step study and its progress."""
    told: list[tuple[int, int]] = []
    scenario = replace(looped(base(), SHORT), solver=aw.Solver(integrator="rk3"))
    study = aw.simulation.step_study(scenario, steps=3, progress=lambda done, of: told.append((done, of)))
    return {"study": study, "told": told[:4]}


def continued(folder: Path) -> dict[str, Any]:
    """A loop with delays, noise and a filter that goes on from where it ended."""
    scenario = looped(
        base(), 0.02, timing=aw.Timing("one-tick", command_delay=1.4e-3, jitter=1e-4),
        sensors=aw.Sensors(position_noise=1e-3, velocity="filtered", cutoff_hz=60.0),
    )  # fmt: skip
    first = aw.simulate(scenario)
    return {"first": first, "then": run(replace(scenario, start=first))}


def reduced(folder: Path) -> dict[str, Any]:
    """Lanes of which numbers are kept, and few rows."""
    lanes = aw.Batch([[0.3, -0.6], [0.1, -0.2], [0.4, 0.2]])
    kept = aw.Recording(period=5e-3, what="state", reduce=tuple(REDUCERS))
    return run(replace(looped(arms("heat")[0], SHORT, reference=lanes), recording=kept))


def reversing(effect: str, folder: Path) -> dict[str, Any]:
    """An arm that breaks away, comes to rest, holds and breaks away the other way."""
    arm = MANY[effect]
    ways = [[12.0] * arm.n, [0.0] * arm.n, [-18.0] * arm.n]
    return run(aw.Scenario(arm, 0.09, command=aw.Schedule([0.0, 0.03, 0.06], ways, arm.names)))


RULES = {
    "open loop by steps of its own": lambda: commanded(base(), SHORT),
    "rk4": lambda: replace(commanded(base(), SHORT), solver=aw.Solver(step=5e-4, integrator="rk4")),
    "rk45": lambda: replace(commanded(arms("springs")[0], SHORT), solver=aw.Solver(integrator="rk45")),
    "rk45 in a loop": lambda: replace(looped(base(), SHORT), solver=aw.Solver(integrator="rk45")),
    "rodas3": lambda: replace(commanded(arms("inductance")[0], SHORT), solver=aw.Solver(integrator="rodas3")),
    "semi-implicit Euler": lambda: replace(
        commanded(arms("LuGre friction")[0], SHORT), solver=aw.Solver(step=5e-4, integrator="semi_implicit_euler")
    ),
    "steps of its own at stops": lambda: replace(looped(arms("stops")[0], 0.1), solver=aw.Solver(accuracy=1e-5)),
    "steps of its own with dry friction": lambda: commanded(arms("dry friction")[0], SHORT),
    "commands by a schedule": lambda: replace(commanded(base(), SHORT), command=SCHEDULE),
    "lanes of commands": lambda: replace(commanded(base(), SHORT), command=aw.Batch([[1.0, 2.0], [-3.0, 4.0]])),
    "recorded seldom": lambda: replace(looped(base(), SHORT), recording=aw.Recording(period=5e-3)),
    "a body gripped by its motion": lambda: looped(base(), 0.15, reference=move(2, [BODY])),
    "play before stops": lambda: looped(together(["play", "stops"]), 0.15),
    "losses and delays of a filtered command by lanes": lambda: looped(
        base(),
        SHORT,
        command_filter=aw.CommandFilter(rate=300.0, limit=11.0),
        timing=aw.Timing("one-tick", command_delay=1.3e-3, command_loss=aw.Batch([0.0, 0.4])),
    ),
    "a loop that is unstable": lambda: replace(
        looped(base(), 0.3), loop=aw.Loop(aw.JointPID([9e4] * 2, 0.0, [1.0] * 2), [0.3, -0.6], 4e-3)
    ),
    "a motion that begins elsewhere": lambda: looped(
        base(), SHORT, reference=aw.trajectories.Quintic([0.5, 0.5], [0.6, 0.2], 0.02)
    ),
}

CASES: dict[str, Any] = {
    **{f"arm with {feature}": partial(of_feature, feature) for feature in (*ARMS, "payload", "locked joints")},
    **{f"scenario with {feature}": partial(of_scenario, feature) for feature in SCENARIOS},
    **{
        f"steps with {feature}": Case(partial(steps_of, feature), close=1e-5)
        for feature in ARMS
        if feature != "mimic joints"
    },
    **{f"there and back with {effect}": partial(reversing, effect) for effect in MANY},
    **{name: (lambda folder, make=make: run(make())) for name, make in RULES.items()},
    "stepped by hand": stepped,
    "a stepped loop": stepped_loop,
    "continued": continued,
    "reduced": reduced,
    "step study": Case(
        studied,
        close=1e-2,
        ignored=("time", "cost"),
    ),
    "step study of sticking": Case(
        lambda folder: aw.simulation.step_study(commanded(arms("dry friction")[0], SHORT), steps=3),
        close=1e-2,
        ignored=("time", "cost"),
    ),
    "sensitivities": lambda folder: aw.simulation.sensitivities(
        looped(base(), SHORT),
        ["rod1.mass_kg", "loop.controller.kp", "start.q[1]", "joint0.friction.viscous_n_m_s_per_rad"],
    ),
    "sensitivities in open loop": lambda folder: aw.simulation.sensitivities(
        commanded(arms("springs")[0], SHORT), ["gravity_m_s2[2]", "start.qd"]
    ),
}

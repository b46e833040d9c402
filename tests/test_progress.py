"""The argument `progress` of every public function that has one: True, False, None or a function."""

from __future__ import annotations

import inspect
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError
from identification.arm.moved_arm import moved
from public_names import PUBLIC
from raises_at import raises_at

SEEDS = Path(__file__).parent / "fuzz" / "seeds"
TUNED = SEEDS / "tuned.scenario.toml"


def scenario():
    return aw.Scenario(aw.load("two-link"), duration=0.01, command=[0.0, 0.0], solver=aw.Solver(step=1e-3))


@cache
def log():
    return aw.identification.read_log(SEEDS / "bench.log.toml")


def nod():
    return aw.trajectories.Quintic(np.zeros(6), np.full(6, 0.1), 0.3)


def servo_log():
    """A servo that follows its goals, a tenth behind."""
    t = 0.01 * np.arange(100.0)
    goal = np.sin(3 * t)
    return aw.identification.BenchLog("bench", t, 0.9 * goal, goal, 0 * t + 1, 0 * t + 7.4, 16, 0.5, 0.1, 0.0)


def reproduce(folder, shown):
    aw.save(aw.simulate(aw.read_scenario(TUNED)), folder / "run.nc")
    aw.reproduce(folder / "run.nc", progress=shown)


def sweep(folder, shown):
    pytest.importorskip("zarr", reason="of the extra sweep")
    aw.sweeps.sweep(TUNED, folder / f"{type(shown).__name__}.zarr", lanes=2, progress=shown)


def loop():
    pid = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0])
    move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=0.1)
    return aw.Scenario(aw.load("two-link"), 0.1, loop=aw.Loop(pid, move, period=2e-3)), {"move": move}


def of_arm(folder):
    return moved(folder, "arm", aw.load("two-link"))


CALLS = {  # a short call of each, by its name
    "analyse_loops": lambda folder, shown: aw.loops.analyse_loops(loop()[0], poses=10, progress=shown),
    "compare_controllers": lambda folder, shown: aw.loops.compare_controllers(
        loop()[0], {"pid": loop()[0]}, loop()[1], runs=1, settle=0.01, progress=shown
    ),
    "identify_friction": lambda folder, shown: aw.identification.identify_friction(
        of_arm(folder), "two-link", candidates=(), progress=shown
    ),
    "identify_payload": lambda folder, shown: aw.identification.identify_payload(
        of_arm(folder), "two-link", progress=shown
    ),
    "step_study": lambda folder, shown: aw.simulation.step_study(scenario(), steps=1, progress=shown),
    "Simulation.run": lambda folder, shown: aw.simulation.Simulation(scenario()).run(progress=shown),
    "convert": lambda folder, shown: aw.robotfiles.convert(
        "so101", folder / "so101.xml", actuators="position", motion=nod(), progress=shown
    ),
    "design_excitation": lambda folder, shown: aw.identification.design_excitation(
        aw.load("two-link"), cycle=5.0, harmonics=2, starts=1, progress=shown,
        limits=aw.trajectories.MotionLimits.of(aw.load("two-link"), velocity=2.0, acceleration=5.0, position=1.0),
    ),
    "enumerate_assemblies": lambda folder, shown: aw.modules.enumerate_assemblies(
        aw.modules.read_modules("improv"), max_joints=2, limit=1, progress=shown
    ),
    "fit_actuators": lambda folder, shown: aw.export.fit_actuators("so101", nod(), progress=shown),
    "identify_motor": lambda folder, shown: aw.identification.identify_motor(
        log(), search=aw.identification.MotorSearch(starts=1), progress=shown
    ),
    "identify_servo": lambda folder, shown: aw.identification.identify_servo(
        [servo_log()] * 2, aw.identification.ServoLoop(0.166, 0.97), progress=shown,
        search=aw.identification.ServoSearch(orders=("M1",)),
    ),
    "rank_assemblies": lambda folder, shown: aw.modules.rank_assemblies(
        aw.modules.read_modules("improv"), aw.modules.read_task(SEEDS / "pick.task.toml"), max_joints=3, limit=1, progress=shown
    ),
    "read_log": lambda folder, shown: aw.identification.read_log(SEEDS / "bench.log.toml", progress=shown),
    "reproduce": reproduce,
    "shadow_log": lambda folder, shown: aw.shadow.shadow_log(log(), "two-link", deviation=1.0, progress=shown),
    "simulate": lambda folder, shown: aw.simulate(scenario(), progress=shown),
    "sweep": sweep,
    "tune": lambda folder, shown: aw.tuning.tune(TUNED, progress=shown),
    "validate": lambda folder, shown: aw.identification.validate("two-link", log(), simulation=False, progress=shown),
}  # fmt: skip


def with_progress():
    """Names of public functions and methods with that argument."""
    for path, value in PUBLIC.items():
        name = path.rpartition(".")[2]
        parts = (
            {f"{name}.{key}": each for key, each in vars(value).items()} if inspect.isclass(value) else {name: value}
        )
        for place, each in parts.items():
            if inspect.isfunction(each) and "progress" in inspect.signature(each).parameters:
                yield place


def test_every_function_is_called_here():
    assert sorted(with_progress()) == sorted(CALLS)


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", CALLS)
def test_it_takes_true_false_and_a_function_and_refuses_the_rest(tmp_path, capfd, name):
    if name == "sweep":
        # a cluster for each call would take seconds; the reader of the argument is the same
        CALLS[name](tmp_path, False)
        return
    calls = []
    for shown in (True, False, None, lambda *at: calls.append(at)):
        CALLS[name](tmp_path, shown)
    assert calls
    assert all(0 <= done <= total for done, total in calls)
    for wrong in (1, "yes", []):
        with raises_at(ArmwrightError, "progress", value=wrong):
            CALLS[name](tmp_path, wrong)
    assert capfd.readouterr().err == ""

"""Scenarios written and read back: the same bits, the same text where nothing changed, and refusals by name."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomlkit

import armwright as aw
from armwright.errors import ArmwrightError, ScenarioError
from raises_at import raises_at
from simulation.plants import pendulum

FILES = sorted([*Path("examples").rglob("*.scenario.toml"), *Path("tests/fuzz/seeds").glob("*.scenario.toml")])
SOME = 8  # random scenarios of `make test`; `make test-all` has more


def beside(file, folder):
    """A copy of a scenario file with all that stands beside it; the chain's robot is made from its modules first."""
    for path in file.parent.glob("*"):
        if path.is_file():
            shutil.copy(path, folder)
    if (folder / "arm.assembly.toml").exists():
        aw.robotfiles.write_toml(aw.modules.assemble(folder / "arm.assembly.toml"), folder / "arm.toml")
    return folder / file.name


def short(scenario):
    """A run of a few ticks, of a few lanes."""
    ticks = min(scenario.ticks, 12) * scenario.tick
    lanes = {"lanes": range(2)} if scenario.lane_count else {}
    recording = aw.Recording() if scenario.recording.what == "none" else scenario.recording
    return aw.simulate(replace(scenario, duration=ticks, recording=recording, **lanes))


def same_bits(one, two):
    assert set(one.variables) == set(two.variables)
    for name in one.variables:
        if one[name].dtype.kind in "iufb":
            np.testing.assert_array_equal(one[name].values, two[name].values, err_msg=str(name))


@pytest.mark.sample(4)
@pytest.mark.parametrize("file", FILES, ids=lambda each: each.name)
def test_a_file_that_did_not_change_is_written_as_it_was(file, tmp_path):
    path = beside(file, tmp_path)
    scenario = aw.read_scenario(path)
    aw.write_scenario(scenario, tmp_path / "again.scenario.toml")
    assert (tmp_path / "again.scenario.toml").read_text() == path.read_text()


@pytest.mark.sample(1)
@pytest.mark.parametrize("file", FILES, ids=lambda each: each.name)
def test_a_file_written_anew_gives_the_same_bits(file, tmp_path):
    """Without its text: all values from the scenario, lanes as lists, schedules as files beside it."""
    scenario = aw.read_scenario(beside(file, tmp_path))
    aw.write_scenario(replace(scenario, source=None), tmp_path / "anew.scenario.toml")
    again = aw.read_scenario(tmp_path / "anew.scenario.toml")
    same_bits(short(scenario), short(again))


def test_what_changed_is_replaced_and_the_rest_stays(tmp_path):
    path = beside(Path("examples/robust.scenario.toml"), tmp_path)
    scenario = aw.read_scenario(path)
    gains = scenario.controller.speed_kp * 1.5
    sensors = replace(scenario.loop.sensors, counts=4096)
    changed = replace(
        scenario, loop=replace(scenario.loop, controller=replace(scenario.controller, speed_kp=gains), sensors=sensors)
    )
    assert changed.document is None  # its runs are not those of the file
    aw.write_scenario(changed, tmp_path / "changed.scenario.toml", comments=["designed by hand"])
    old, new = (text.splitlines() for text in (path.read_text(), (tmp_path / "changed.scenario.toml").read_text()))
    differing = [line for line in new if line not in old]
    assert differing == [
        "# designed by hand",
        "speed_kp = [21.0, 24.0, 21.0, 15.0, 1.7999999999999998, 1.35]",
        "counts = 4096                       # 0.001 degrees",
    ]
    assert [line for line in old if line not in new and not line.startswith(("speed_kp", "counts"))] == []
    same_bits(short(changed), short(aw.read_scenario(tmp_path / "changed.scenario.toml")))


def test_another_robot_and_another_folder(tmp_path):
    """Names of files follow the scenario; a folder from which they cannot be named is refused, and nothing is written."""
    folder = tmp_path / "below"
    folder.mkdir()
    path = beside(Path("tests/fuzz/seeds/driven.scenario.toml"), folder)
    scenario = aw.read_scenario(path)
    aw.write_scenario(scenario, tmp_path / "above.scenario.toml")
    assert tomlkit.parse((tmp_path / "above.scenario.toml").read_text())["commands"]["schedule"] == "below/torques.csv"
    same_bits(short(scenario), short(aw.read_scenario(tmp_path / "above.scenario.toml")))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with raises_at(ScenarioError, "commands.schedule", "--allow", value="../below/torques.csv"):
        aw.write_scenario(scenario, elsewhere / "x.scenario.toml")
    assert list(elsewhere.iterdir()) == []
    aw.write_scenario(scenario, elsewhere / "x.scenario.toml", allow=[folder])
    arm = aw.load("two-link").with_values({"upper_arm.mass_kg": 1.3})
    heavier = replace(scenario, arm=arm.replace(friction=None), vary={})
    written = aw.write_scenario(heavier, folder / "heavier.scenario.toml")
    assert [each.name for each in written] == ["heavier.scenario.toml", "heavier.robot.toml"]
    same_bits(short(heavier), short(aw.read_scenario(written[0])))
    aw.robotfiles.write_toml(arm, folder / "arm.toml")
    loaded = replace(heavier, arm=aw.load(folder / "arm.toml").replace(friction=None))
    aw.write_scenario(loaded, folder / "loaded.scenario.toml")
    assert tomlkit.parse((folder / "loaded.scenario.toml").read_text())["robot"] == "arm.toml"
    with raises_at(ScenarioError, "robot", "two-link"):
        aw.write_scenario(heavier, folder / "wrong.scenario.toml", robot="two-link")
    (folder / "torques.csv").write_text((folder / "torques.csv").read_text().replace("1", "2"))
    with pytest.raises(ScenarioError, match=r"commands.schedule"):
        aw.write_scenario(scenario, folder / "other.scenario.toml")


def random_scenario(seed):
    """An arm of two joints, its drive, and everything else that a file can have, or some of it."""
    rng = np.random.default_rng(seed)
    arm = aw.load("two-link")
    if rng.random() < 0.3:
        arm = arm.replace(friction=None)

    def some(chance, value):
        return value() if rng.random() < chance else None

    def row(scale=1.0):
        return rng.uniform(0.1, 1.0, 2) * scale

    def pose():
        return rng.uniform(-0.5, 0.5, 2)

    def schedule(values, names=arm.names):
        times = np.array([0.0, 3e-3, 7.5e-3])
        return aw.Schedule(times, values, names)

    period = float(rng.choice([1e-3, 2e-3]))
    duration = 0.02
    several = rng.random() < 0.4
    lanes = 3

    def differing(value):
        value = np.asarray(value, dtype=float)
        if not several or rng.random() < 0.5:
            return value
        if rng.random() < 0.3:
            return aw.Draw.uniform(0.9 * value, 1.1 * value + 1e-3)
        return aw.Batch(np.stack([value * factor for factor in (1.0, 1.1, 0.8)]))

    limits = aw.trajectories.MotionLimits.of(arm, velocity=2.0, acceleration=10.0, jerk=300.0)
    shape = rng.integers(0, 11)
    reference = [
        lambda: None,
        pose,
        lambda: schedule(rng.uniform(-0.3, 0.3, (3, 2))),
        lambda: aw.trajectories.Sine(pose(), row(0.2), 2.0),
        lambda: aw.trajectories.Quintic(pose(), pose(), 0.015),
        lambda: aw.trajectories.Quintic(pose(), pose(), limits=limits),
        lambda: aw.trajectories.SCurve(pose(), pose(), limits),
        lambda: aw.trajectories.Trapezoid(pose(), pose(), limits, duration=2.0),
        lambda: aw.trajectories.Fourier(pose(), rng.normal(size=(2, 3)) * 0.1, rng.normal(size=(2, 3)) * 0.1, 1.3),
        lambda: aw.trajectories.Waypoints(rng.uniform(-0.5, 0.5, (4, 2)), limits),
        lambda: aw.trajectories.InputShaper(aw.trajectories.Step(pose(), pose()), hz=80.0, damping=0.1),
    ][shape]()
    control = [
        lambda: aw.JointPID(
            differing(row(100.0)),
            kd=differing(row(5.0)),
            ki=10.0,
            gravity=bool(rng.random() < 0.5),
            limit=[20.0, np.inf],
        ),
        lambda: aw.Cascade(differing(8.0), row(20.0), speed_ki=differing(row(10.0)), speed_limit=2.0),
        lambda: aw.FeedForward(aw.Cascade(8.0, row(20.0)), inertia="full", friction=True),
        lambda: aw.Filtered(aw.JointPID(row(100.0), kd=row(5.0)), [aw.LowPass(80.0), aw.Notch(60.0, 20.0)]),
        lambda: aw.ComputedTorque(row(100.0), 20.0),
        lambda: aw.DisturbanceObserver(aw.JointPID(row(50.0), kd=5.0), inertia=row(2.0), hz=5.0),
    ][rng.integers(0, 6)]()
    driven = rng.random() < 0.25
    loop = None if driven else aw.Loop(
        control, reference, period,
        aw.Sensors(
            some(0.5, lambda: 4096), velocity=str(rng.choice(["exact", "difference"])),
            position_noise=float(some(0.4, lambda: 1e-4) or 0.0),
        ),
        aw.CommandFilter(limit=some(0.4, lambda: [30.0, np.inf]), rate=some(0.3, lambda: 1e4)),
        aw.Timing(str(rng.choice(["ideal", "one-tick", "sync"])), command_delay=differing(1.3e-3), measurement_loss=0.1),
        some(0.3, pose),
    )  # fmt: skip
    body = aw.Payload(2e-3, differing(0.5), [0, 0, 0.1], some(0.5, lambda: [1e-3, 2e-3, 1.5e-3]))
    inputs = aw.Inputs(
        wrench=some(0.5, lambda: differing(rng.normal(size=6))) if rng.random() < 0.5
        else some(0.5, lambda: schedule(rng.normal(size=(3, 6)), ("fx", "fy", "fz", "mx", "my", "mz"))),
        payload=some(0.5, lambda: [body, aw.Payload(0.012, 0.0)]),
    )  # fmt: skip
    return aw.Scenario(
        arm, duration,
        command=(schedule(rng.normal(size=(3, 2))) if rng.random() < 0.5 else pose()) if driven else None,
        loop=loop, inputs=inputs,
        start=aw.Start(some(0.6, lambda: differing(pose())), some(0.4, pose)),
        solver=aw.Solver(*some(0.5, lambda: ("rk4",)) or (), **({"step": 1e-3} if driven else {"substeps": 2})),
        recording=aw.Recording(every=some(0.3, lambda: 2), what=str(rng.choice(["all", "state"]))),
        vary={} if rng.random() < 0.5 else {"upper_arm.mass_kg": differing(2.0), "forearm.com_m": differing([0.2, 0.0, 0.01])},
        lanes=lanes if several else None, seed=int(rng.integers(0, 100)),
    )  # fmt: skip


def some_scenarios():
    marks = ([] if seed < SOME else [pytest.mark.study] for seed in range(60))
    return [pytest.param(seed, marks=each) for seed, each in enumerate(marks)]


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", some_scenarios())
def test_random_scenarios_come_back_with_the_same_bits(seed, tmp_path):
    try:
        scenario = random_scenario(seed)
    except ArmwrightError:
        pytest.skip("no scenario")
    path, *_ = aw.write_scenario(scenario, tmp_path / "x.scenario.toml")
    again = aw.read_scenario(path)
    same_bits(aw.simulate(scenario), aw.simulate(again))
    aw.write_scenario(again, tmp_path / "y.scenario.toml")
    assert (tmp_path / "y.scenario.toml").read_text() == path.read_text()


ARM = "two-link"


def looped(controller, **changes):
    parts = {"period": 1e-3} | changes
    return aw.Scenario(aw.load(ARM), 0.01, loop=aw.Loop(controller, **parts))


class Own:
    def signals(self, arm):
        return ()

    def measure(self, plant, s, w):
        return {}, s


def follow(t, r, y):
    return 10.0 * (r.q - y.q)


PID = aw.JointPID(10.0, kd=1.0)
SHAPED = aw.trajectories.InputShaper(aw.trajectories.Step([0, 0], [1, 1]), 5.0, kind="zvd")
NOISES, STARTS = aw.Batch([0.0, 1e-3]), aw.Batch([[0, 0], [0.1, 0]])


def heavier():
    return aw.load(ARM).with_values({"forearm.mass_kg": 2.0})


@pytest.mark.parametrize(
    ("scenario", "said"),
    [
        (lambda: looped(follow), "loop.controller: 'follow' of Python"),
        (lambda: looped(None), "loop.controller: has no controller"),
        (lambda: looped(PID, reference=lambda t: [0.0, t]), "loop.reference: '<lambda>' of Python"),
        (lambda: looped(PID, sensors=[aw.Sensors(), Own()]), "loop.sensors: a Own of Python"),
        (lambda: looped(PID, sensors=aw.Sensors(position_noise=NOISES)), "loop.sensors.position_noise: cannot differ"),
        (lambda: looped(PID, reference=np.zeros((11, 2))), "loop.reference: rows for"),
        (lambda: looped(aw.FeedForward(PID, model=heavier())), "loop.controller.model.*another arm"),
        (lambda: replace(looped(PID), solver=aw.Solver(target="x86-64-v3")), "solver.target"),
        (lambda: replace(looped(PID), arm=aw.load(ARM).replace(gravity=[0, 0, 0])), "arm.*replace.gravity"),
        (lambda: replace(looped(PID), start=aw.simulate(looped(PID))), "start: a state"),
        (lambda: replace(looped(PID), start=aw.Batch([[0.1, 0], [0.2, 0], [0.3, 0]]), lanes=range(1, 3)), "first_lane = 1"),
        (lambda: looped(PID, reference=aw.trajectories.Cubic(STARTS, [0.1, 0.1], 0.01)), "loop.reference.start: cannot differ"),
        (lambda: looped(PID, reference=SHAPED), "loop.reference.kind = 'zvd'"),
    ],
)  # fmt: skip
def test_what_no_file_expresses_is_refused_by_name(scenario, said, tmp_path):
    with pytest.raises(ArmwrightError, match=said):
        aw.write_scenario(scenario(), tmp_path / "x.scenario.toml")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_there_is_not_replaced_by_one_beside_the_scenario(tmp_path):
    (tmp_path / "x.robot.toml").write_text("mine")
    heavy = replace(looped(PID), arm=heavier())
    with raises_at(ArmwrightError, file=tmp_path / "x.robot.toml"):
        aw.write_scenario(heavy, tmp_path / "x.scenario.toml")
    assert (tmp_path / "x.robot.toml").read_text() == "mine"
    for _ in range(2):  # its own it replaces
        aw.write_scenario(heavy, tmp_path / "y.scenario.toml")


def test_a_planned_motion_is_named_by_its_file(tmp_path):
    (tmp_path / "go.motion.toml").write_text(
        'robot = "two-link"\nstart = 0.0\n[limits]\nvelocity = 1\nacceleration = 5\njerk = 100\n'
        '[[segments]]\nkind = "grip"\nmass_kg = 0.2\n[[segments]]\nkind = "move"\ngoal = [0.1, 0.2]\n'
    )
    plan = aw.trajectories.plan(tmp_path / "go.motion.toml")
    scenario = looped(PID, reference=plan.motion)
    aw.write_scenario(scenario, tmp_path / "go.scenario.toml")
    text = (tmp_path / "go.scenario.toml").read_text()
    assert tomlkit.parse(text)["loop"]["reference"] == {"kind": "motion", "file": "go.motion.toml"}
    same_bits(aw.simulate(scenario), aw.simulate(aw.read_scenario(tmp_path / "go.scenario.toml")))
    plan.motion.save(plan.arm, tmp_path / "go.csv")
    rows = looped(PID, reference=aw.trajectories.load_motion(tmp_path / "go.csv", plan.arm))
    aw.write_scenario(rows, tmp_path / "rows.scenario.toml")
    same_bits(aw.simulate(rows), aw.simulate(aw.read_scenario(tmp_path / "rows.scenario.toml")))


def test_an_arm_without_a_file_gets_one_with_its_scenario(tmp_path):
    arm = pendulum("torque")
    scenario = aw.Scenario(arm, 0.01, command=[1.0])
    written = aw.write_scenario(scenario, tmp_path / "swing.scenario.toml")
    assert [each.name for each in written] == ["swing.scenario.toml", "swing.robot.toml"]
    same_bits(aw.simulate(scenario), aw.simulate(aw.read_scenario(written[0])))

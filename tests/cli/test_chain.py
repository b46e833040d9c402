"""The whole way by commands, for every built-in arm with motors: excite, simulate, identify, plan, design, export, run on a bus.

Each step reads files that the steps before wrote. The bench (period, sensors, timing) and the task are stated once, by the user.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.simulation.loop.references import reference_rows

pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")

ARMS = {name: aw.load(name) for name in aw.builtin_names()}
WITH_MOTORS = tuple(
    name for name, arm in ARMS.items() if all(body.drive.torque_constant is not None for body in arm.coordinates)
)
WITHOUT_MOTORS = tuple(name for name in ARMS if name not in WITH_MOTORS)

# Encoders at the joints with counts and noise, speeds made of them, commands that act a tick late.
BENCH = """\
robot = "{robot}"
duration_s = 1.0

[loop]
period_s = {period}

[loop.controller]
kind = "cascade"
position_kp = 1.0
speed_kp = 1.0
speed_ki = 1.0
speed_feedforward = 1.0

[loop.sensors]
side = "link"
counts = 1048576
position_noise = 1e-5
velocity = "filtered"
cutoff_hz = {cutoff}
current_noise = {current_noise}

[loop.timing]
preset = "sync"
"""

# A bus holds no shorter period for six drives, and its currents are the commanded ones; other drives measure theirs.
BUS = {"period": 4e-3, "cutoff": 100.0, "current_noise": 0.0}
AMPLIFIERS = {"period": 1e-3, "cutoff": 20.0, "current_noise": 0.05}

TASK = """\
robot = "identified.toml"
start = 0.0
[limits]
velocity = 0.4
acceleration = 1.0
jerk = 10.0
[[segments]]
kind = "grip"
mass_kg = 0.5
[[segments]]
kind = "move"
goal = 0.4
"""

SEEDS = range(1, 5)  # of noise, beside seed 0 of the chain's log
NEW_MOTIONS = 2
NOISE = 3.0  # times what noise explains
SMALL = {"q": 1e-3, "tau": 0.1}  # most that noise may explain, of the range: else the comparison would say nothing


def armwright(*arguments, code=0):
    result = CliRunner().invoke(app, [*map(str, arguments)])
    assert result.exit_code == code, result.output
    return result


def takes_currents(arm):
    """True of drives as a bus has them; others of the built-in arms take voltages."""
    return all(body.drive.command == "current" for body in arm.coordinates)


def has_friction_by_direction(arm):
    frictions = [body.friction for body in arm.coordinates if body.friction is not None]
    return any(each.coulomb_positive != each.coulomb_negative for each in frictions)


def write_new_motion(path, robot, rng):
    """A motion file of two moves at random from where the excitation starts, far from the excitation's path."""
    arm, start = ARMS[robot], pd.read_csv("excite.csv").filter(regex="^q_").iloc[0].to_numpy()
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    goals = [np.clip(start + rng.uniform(-0.6, 0.6, arm.n), 0.9 * low, 0.9 * high) for _ in range(2)]
    moves = "".join(f'[[segments]]\nkind = "move"\ngoal = {goal.tolist()}\n' for goal in goals)
    limits = "velocity = 0.8\nacceleration = 2.0\njerk = 20.0\n"
    path.write_text(f'robot = "{robot}"\nstart = {start.tolist()}\n[limits]\n{limits}{moves}')


def followed(scenario, arm, motions):
    """Positions and motor torques of an arm under the scenario's controller on motions; the sensors have no counts and no noise.

    Exact sensors, since only the records shall differ: noise of the loop would hide how they do.
    """
    sensors = replace(scenario.loop.sensors.exact(), counts=None)
    runs = []
    for motion in motions:
        loop = replace(scenario.loop, reference=motion, sensors=sensors)
        runs.append(aw.simulate(replace(scenario, arm=arm, loop=loop)))
    return {name: np.array([run[name].values for run in runs]) for name in SMALL}


def rms(values):
    """Over motions and time: (…, motions, time, n) → (…, n)."""
    return np.sqrt(np.mean(values**2, axis=(-3, -2)))


def test_arms_without_motors_are_those_whose_drives_are_torques():
    assert set(WITH_MOTORS) | set(WITHOUT_MOTORS) == set(aw.builtin_names())
    assert len(WITH_MOTORS) >= 3
    for name in WITHOUT_MOTORS:
        assert {(body.drive.command, body.drive.torque_constant) for body in ARMS[name].coordinates} == {
            ("torque", None)
        }


CHAINED = ("lwa4p", "cmu-dd")  # on a bus, behind amplifiers; a minute each


@pytest.mark.study
@pytest.mark.parametrize("robot", CHAINED)
def test_a_chain_of_files_from_the_excitation_to_the_bus(robot, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arm = ARMS[robot]
    on_bus = takes_currents(arm)
    bench = BUS if on_bus else AMPLIFIERS
    Path("bench.scenario.toml").write_text(BENCH.format(robot=robot, **bench))
    Path("task.motion.toml").write_text(TASK)

    # measure
    armwright("excite", robot, "-o", "excite.csv", "--cycle", 8, "--harmonics", 2, "--starts", 1, "--max-velocity", 0.8)
    designed = armwright(
        "design", "bench.scenario.toml", "--reference", "excite.csv", "-o", "excited.scenario.toml", "--json"
    )
    armwright("simulate", "excited.scenario.toml", "-o", "excited.csv", "--log", "arm.log.toml")
    rng = np.random.default_rng(7)
    for k in range(NEW_MOTIONS):
        write_new_motion(tmp_path / f"new{k}.motion.toml", robot, rng)
        armwright("plan", f"new{k}.motion.toml", "-o", f"new{k}.csv")
    held = ("-o", "new0.run.csv", "--log", "arm.log.toml", "--hold-out")
    armwright("simulate", "excited.scenario.toml", "--reference", "new0.csv", *held)

    # identify, with the law of friction of the record, up to where the loop's bandwidth ends: of a log this short the chosen
    # cut-off leaves too few rows, and the command then asks for a higher one
    cutoff = max(json.loads(designed.stdout)["results"][0]["bandwidth"]) / (2 * np.pi)
    friction = "viscous,asymmetric" if has_friction_by_direction(arm) else "viscous,coulomb,offset"
    identify = {"rows": aw.identification.FitRows(cutoff=cutoff), "friction": tuple(friction.split(","))}
    armwright("identify", "arm", "arm.log.toml", "--cutoff", cutoff, "--friction", friction, "-o", "identified.toml")
    armwright("validate", "identified.toml", "arm.log.toml")
    check_new_motions(arm, identify)

    # plan, design, simulate
    armwright("plan", "task.motion.toml", "-o", "task.csv")
    task = ("--robot", "identified.toml", "--reference", "task.motion.toml")
    armwright("design", "excited.scenario.toml", *task, "-o", "task.scenario.toml")
    armwright("loops", "task.scenario.toml", "--poses", 2000)
    armwright("simulate", "task.scenario.toml", "-o", "task.nc")

    # C, FMU, bus
    text = armwright("export", "controller", "task.scenario.toml", "-o", "firmware").output
    assert "every command has the bits of the simulation" in text or "no C compiler" in text
    armwright("export", "fmu", "task.scenario.toml", "--part", "both", "--platforms", "host", "-o", "task.fmu")
    check_fmu()
    pytest.importorskip("canopen")
    if on_bus:
        text = armwright("run-controller", "task.scenario.toml", "--go").output
        assert "are those of the simulation, to the bit" in text
    else:  # drives that take voltages are refused at any period and bit rate
        text = " ".join(armwright("run-controller", "task.scenario.toml", "--go", code=2).output.split())
        assert f"command = 'voltage': drives of {robot} take voltages: {', '.join(arm.names)}" in text
        assert f"loop.period = {bench['period']}" in text


def check_new_motions(arm, identify):
    """On new motions the written record's simulation follows the true one within NOISE times what noise explains.

    The chain's log is simulated again with other seeds of its noise, and each is identified in the same way. The standard
    deviation of the simulated motions of these records and the chain's, about their mean, is what noise explains. An error
    that all of them share, as of a number that a step loses, is not part of it and fails, however small it is.
    """
    scenario = aw.read_scenario("excited.scenario.toml")
    motions = [aw.trajectories.load_motion(f"new{k}.csv", arm) for k in range(NEW_MOTIONS)]
    records = [aw.load("identified.toml")]
    for seed in SEEDS:
        run = aw.simulate(replace(scenario, seed=seed))
        aw.save(run, f"seed{seed}.parquet")
        log = aw.identification.read_log(
            aw.identification.write_log(run, f"seed{seed}.parquet", f"seed{seed}.log.toml", scenario.arm)
        )
        records.append(aw.load(aw.identification.identify_arm(log, checks=(), **identify).write(f"seed{seed}.toml")))
    truth = followed(scenario, arm, motions)
    errors = [
        {name: values - truth[name] for name, values in followed(scenario, record, motions).items()}
        for record in records
    ]
    for name, most in SMALL.items():
        every = np.array([each[name] for each in errors])
        written, scatter = every[0], every - every.mean(axis=0)
        noise = np.sqrt(np.sum(rms(scatter) ** 2, axis=0) / (len(every) - 1))
        swing = np.ptp(truth[name], axis=(0, 1))
        assert (noise < most * swing).all(), (name, noise / swing)
        assert (rms(written) < NOISE * noise).all(), (name, rms(written) / noise)


def check_fmu():
    """The unit of arm and controller moves with the bits of the simulation."""
    pytest.importorskip("fmpy")
    from export.fmu.fmus import Instance

    scenario = aw.read_scenario("task.scenario.toml")
    run = aw.load_run("task.nc")
    ticks, period = scenario.ticks, scenario.tick
    rows = reference_rows(scenario.arm, scenario.loop.reference, np.arange(ticks) * period)
    fmu = Instance(Path("task.fmu"))
    given, x = fmu.names("r", "input"), fmu.names("x", "output")[: 2 * scenario.arm.n]
    fmu.begin()
    states = [fmu.get(*x)]
    for k, row in enumerate(rows):
        for name, value in zip(given, row, strict=True):
            fmu.set(name, value)
        fmu.step(k * period, period)
        states.append(fmu.get(*x))
    fmu.close()
    np.testing.assert_array_equal(states, np.concatenate([run.q.values, run.qd.values], axis=1))

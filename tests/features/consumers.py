"""Each consumer of arms and scenarios, called with a small one: what it answers, what it notes, and a law of what is exact."""

from __future__ import annotations

import atexit
import contextlib
from collections.abc import Callable
from ctypes import CDLL
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.actuators import holding_command
from armwright.actuators.coupling import shares_of, to_joints
from armwright.content import checksum
from armwright.control.analysis import LinearLoop
from armwright.control.wrapper import Wrapper
from armwright.description.paths import quantities
from armwright.dynamics import holding_torques
from armwright.export.controller.sil import find_compiler
from armwright.simulation.loop.references import reference_rows
from features.cases import BODY, GOAL, START, Wave, base, commanded, looped
from identification.arm.moved_arm import written_log
from kernels.c_compilers import BITS, batch_function, build, compiler, run_batch

SMALL = {"progress": False}


@dataclass
class Answer:
    """Numbers or texts that a consumer computes, its notes, and whatever its law needs."""

    values: list
    notes: str = ""
    found: object = None


@dataclass(frozen=True)
class Consumer:
    """A consumer of arms, or of scenarios that `of` makes of an arm.

    Attributes:
        support: where its declaration stands.   answer: of an arm or scenario, in a folder of its own.
        law: asserts that an answer is right.   of: the scenario of an arm; None: it takes arms alone.   command: of its drives.
        each_pair: False: the law takes long, and is held with all exact features together only.
        apart: False: the answer takes long, and features that go with one another are walked together only where they are exact.
    """

    support: str
    answer: Callable[..., Answer]
    law: Callable[..., None]
    of: Callable[[aw.Model], aw.Scenario] | None = None
    command: str = "voltage"
    each_pair: bool = True
    each_alone: bool = True


def states(arm, count=5, seed=1):
    """Positions, speeds and accelerations of a moving arm."""
    rng = np.random.default_rng(seed)
    return tuple(
        size * rng.uniform(0.2, 1.0, (count, arm.n)) * rng.choice([-1, 1], (count, arm.n)) for size in (0.5, 1.5, 4.0)
    )


# Kernels, C and CasADi.


def kernels(arm, folder):
    dyn, (q, qd, qdd) = aw.compile(arm), states(arm)
    values = [dyn.inverse_dynamics(q, qd, qdd), dyn.forward_dynamics(q, qd, 10 * qdd), dyn.mass_matrix(q)]
    values += [dyn.bias_torques(q, qd), dyn.forward_kinematics(q)]
    if any(body.drive.firmware is not None for body in arm.coordinates):
        with pytest.raises(aw.ArmwrightError, match="servo's loop"):
            dyn.forward_arm(q, qd, 5 * qdd)
        dyn = aw.compile(arm.replace(firmware=None))
    return Answer([*values, dyn.forward_arm(q, qd, 5 * qdd)], "\n".join(dyn.notes))


def starts_as_simulated(arm, answer, folder):
    """The first acceleration of a run is that of `forward_arm`."""
    q, qd, u = (each[0] for each in states(arm))
    run = aw.simulate(aw.Scenario(arm, duration=1e-3, command=3 * u, start=aw.Start(q, qd)), **SMALL)
    expected = aw.compile(arm).forward_arm(q, qd, 3 * u)
    np.testing.assert_allclose(run.qdd.values[0], expected, rtol=1e-9, atol=1e-9)


def c_files(arm, folder):
    from armwright.export.c import write_c

    paths = write_c(arm, ["inverse_dynamics", "forward_dynamics", "forward_kinematics"], folder)
    texts = {path.suffix: path.read_text() for path in paths if "selftest" not in path.name}
    return Answer([texts[".c"]], texts[".h"], paths[1])


def bits_of_kernels(arm, answer, folder):
    """The compiled C has the bits of the compiled kernels."""
    source, (q, qd, qdd), dyn, n = answer.found, states(arm), aw.compile(arm), arm.n
    calls = {
        "inverse_dynamics": ((q, qd, qdd), (n,), dyn.inverse_dynamics(q, qd, qdd)),
        "forward_dynamics": ((q, qd, 10 * qdd), (n,), dyn.forward_dynamics(q, qd, 10 * qdd)),
        "forward_kinematics": ((q,), (4, 4), dyn.forward_kinematics(q)),
    }
    driver = [f'#include "{source.stem}.h"\n']
    for name, (inputs, shape, _) in calls.items():
        sizes = [n] * len(inputs) + [int(np.prod(shape))]
        driver.append(batch_function(f"{source.stem}_{name}", sizes, len(inputs)))
    (folder / "driver.c").write_text("".join(driver), encoding="ascii")
    shared = folder / "library.so"
    build([compiler("gcc"), *BITS, "-shared", "-fPIC", folder / "driver.c", source, "-o", shared, "-lm"])
    for name, (inputs, shape, expected) in calls.items():
        (found,) = run_batch(CDLL(str(shared)), f"{source.stem}_{name}", inputs, [shape])
        np.testing.assert_array_equal(found, expected)


def casadi_functions(arm, folder):
    dyn, (q, qd, qdd) = aw.compile(arm), states(arm)
    function = dyn.casadi("inverse_dynamics")
    return Answer(
        [np.array([np.asarray(function(*row)).ravel() for row in zip(q, qd, qdd, strict=True)])], "\n".join(dyn.notes)
    )


def as_kernels(arm, answer, folder):
    np.testing.assert_allclose(answer.values[0], aw.compile(arm).inverse_dynamics(*states(arm)), rtol=1e-10, atol=1e-10)


# Simulation.


def simulated(scenario, folder):
    run = aw.simulate(scenario, **SMALL)
    return Answer([run.q.values, run.tau.values], run.attrs.get("notes", ""), run)


def as_rk45(scenario, answer, folder):
    """Another rule with small tolerances gives the same motion."""
    run = aw.simulate(replace(scenario, solver=aw.Solver("rk45", rtol=1e-9, atol=1e-11)), **SMALL)
    scale = np.ptp(run.q.values) + 1e-9
    assert np.abs(answer.found.q.values - run.q.values).max() < 5e-3 * scale


def by_cvodes(scenario, folder):
    return simulated(replace(scenario, solver=aw.Solver("cvodes")), folder)


def sensitivities(scenario, folder):
    found = aw.simulation.sensitivities(scenario, ["rod0.mass_kg"])
    numbers = [found[name].values for name in found.data_vars if found[name].dtype.kind == "f"]
    return Answer(numbers, found.attrs.get("notes", ""), found)


def as_differences(scenario, answer, folder):
    """Central differences of the simulation by the same steps."""
    step, solver = 1e-4, aw.Solver("rk4", step=1e-4) if scenario.loop is None else aw.Solver("rk4", substeps=10)
    scenario = replace(scenario, solver=solver)
    if scenario.loop is None:
        scenario = replace(scenario, recording=aw.Recording(every=10))
    found = aw.simulation.sensitivities(scenario, ["rod0.mass_kg"])
    ends = [
        aw.simulate(replace(scenario, vary={**scenario.vary, "rod0.mass_kg": 2.0 + sign * step}), **SMALL).q.values
        for sign in (1, -1)
    ]
    expected, mine = (ends[0] - ends[1]) / (2 * step), found["d_q"].values
    scale = np.abs(expected).max() + 1e-12
    assert np.abs(mine.reshape(expected.shape) - expected).max() < 1e-3 * scale


# Kinematics and motions.


def poses(arm, folder):
    q = states(arm, 3)[0]
    target = aw.forward_kinematics(arm, q[0])
    return Answer([np.asarray(aw.inverse_kinematics(arm, target, near=q[1]).q), target])


def reaches(arm, answer, folder):
    q = states(arm, 3)[0]
    np.testing.assert_allclose(
        aw.forward_kinematics(arm, answer.values[0]), aw.forward_kinematics(arm, q[0]), atol=1e-6
    )


def reported(arm, folder):
    report = aw.trajectories.limits_report(arm, _to_and_fro(arm))
    return Answer([*report.highest.values(), *report.lowest.values()], "\n".join(report.notes), report)


def torques_of_inverse_dynamics(arm, answer, folder):
    """No torque of the motion is beyond the report's extremes, which are reached."""
    motion = _to_and_fro(arm)
    tau = aw.compile(arm).inverse_dynamics(*motion.at(np.linspace(0.0, motion.duration, 4001)))[1:-1]
    for extreme, found in (("highest", tau.max(axis=0)), ("lowest", tau.min(axis=0))):
        np.testing.assert_allclose(getattr(answer.found, extreme)["torque"], found, rtol=1e-2, atol=0.1)


def _to_and_fro(arm):
    ends = np.array([[0.0] * arm.n, [0.8] * arm.n])
    there = aw.trajectories.Quintic(*ends, duration=3.0)  # slow, and back by the pose of the largest weight
    return aw.trajectories.Joined([there, aw.trajectories.Quintic(*ends[::-1], duration=3.0, time=3.0)])


def fastest(arm, folder):
    path = aw.trajectories.JointPath([[-0.3] * arm.n, [0.8] * arm.n, [-0.2] * arm.n])
    limits = replace(aw.trajectories.MotionLimits.of(arm), torque=[45.0, 16.0, 8.0][: arm.n])
    motion = aw.trajectories.time_optimal(arm, path, limits, grid=60)
    return Answer([motion.duration], "\n".join(motion.notes), motion)


def within_limits(arm, answer, folder):
    """Another grid finds no torque beyond the limit, and one that is reached."""
    report = aw.trajectories.limits_report(
        arm, answer.found, replace(aw.trajectories.MotionLimits.of(arm), torque=[45.0, 16.0, 8.0][: arm.n])
    )
    assert 0.9 < report.largest < 1.0 + 1e-3


# Loops and gains.


def loops(scenario, folder):
    """Margins about the start, as `analyse_loops` has them about all poses."""
    loop = LinearLoop(scenario)
    margins = loop.margins(START[: scenario.arm.n])
    return Answer([margins.gain_up, margins.gain_down, margins.phase, margins.radius], "\n".join(loop.notes))


@dataclass(frozen=True, eq=False)
class AboutRest(Wrapper):
    """A controller with a factor on each command, beside the command that holds the arm."""

    hold: Any = 0.0
    factor: Any = 1.0

    def memory(self, arm, y):
        return aw.scalar.zeros(0)

    def changed(self, r, y, u, s):
        return aw.scalar.array(self.hold + self.factor * u), s


def unlimited(arm):
    """The arm without limits of its commands and without dry friction, which small motions leave out."""
    limits = [f"{name}.limits.{key}" for name in arm.names for key in ("voltage_v", "current_a", "torque_n_m")]
    dry = [f"{name}.friction.coulomb_{way}_n_m" for name in arm.names for way in ("positive", "negative")]
    known = {path for path, _, _ in quantities(arm.record)}
    return arm.with_values(dict.fromkeys(limits, 1e9) | {path: 0.0 for path in dry if path in known})


def growth(scenario, factors):
    """(k,) factor by which a small deviation from the start pose grows in 0.2 s of `simulate`, for factors (k, n) of commands."""
    arm, (count, n) = unlimited(scenario.arm), np.shape(factors)
    rest, size = np.array(START[:n]), 1e-8
    hold = np.asarray(holding_command(arm, holding_torques(arm, rest)), dtype=float)
    starts = np.tile(rest, (2 * count, 1))
    starts[1::2] += size  # every second lane, whose motion less that of the lane before it is the deviation
    law = AboutRest(scenario.controller, hold=hold, factor=aw.Batch(np.repeat(factors, 2, axis=0)))
    loop = replace(scenario.loop, controller=law, reference=rest)
    moved = replace(scenario, arm=arm, loop=loop, start=aw.Start(aw.Batch(starts)), duration=0.8, inputs=aw.Inputs())
    q = aw.simulate(moved, **SMALL).q.values
    sizes = np.sqrt(((q[1::2] - q[::2]) ** 2).mean(axis=2))
    third, fourth = np.array_split(sizes, 4, axis=1)[2:]
    before = np.maximum(np.sqrt((third**2).mean(axis=1)), 1e-6 * size)  # not less, which is rounding
    return np.sqrt((fourth**2).mean(axis=1)) / before


def ends_at_its_margins(scenario, answer, folder):
    """With 0.97 of the gain margin of any command a small deviation dies away in `simulate`, with 1.03 of it it grows."""
    up, n = answer.values[0], scenario.arm.n
    rows = [np.where(np.arange(n) == joint, each * up, 1.0) for each in (0.97, 1.03) for joint in range(n)]
    dies, grows = np.split(growth(scenario, rows), 2)
    assert (dies < 1.0).all(), dies
    assert (grows > 1.0).all(), grows


def designed(scenario, folder):
    found = aw.loops.design_gains(scenario, poses=50)
    values = [*found.gains.values(), found.friction_error, found.weight_error]
    return Answer(values, "\n".join(found.sentences()), found)


def keeps_its_margins(scenario, answer, folder):
    """A small deviation dies away in `simulate` with any command as much larger or smaller as the design says."""
    found, n = answer.found, scenario.arm.n
    assert found.keeps
    factors = (found.asked[0], 1.0 / found.asked[0])
    rows = [np.where(np.arange(n) == joint, each, 1.0) for each in factors for joint in range(n)]
    dies = growth(replace(scenario, loop=found.scenario.loop), [np.ones(n), *rows])
    assert (dies < 1.0).all(), dies


def _to_goal(n):
    return aw.trajectories.Quintic(START[:n], GOAL[:n], duration=0.1)


def compared(scenario, folder):
    motion = _to_goal(scenario.arm.n)
    found = aw.loops.compare_controllers(
        scenario, {"own": scenario.controller or aw.JointPID(120.0, 0.0, 6.0)}, {"move": motion}, settle=0.05
    )
    names = ("rms_error", "largest_error", "peak_share", "saturation")
    return Answer([found.data[name].values for name in names], "", found)


def errors_of_simulation(scenario, answer, folder):
    """Errors and saturation of the same motion, from the rows of `simulate`."""
    motion, data = _to_goal(scenario.arm.n), answer.found.data.isel(controller=0, motion=0, payload=0)
    q, qd, _ = motion.at(0.0)
    lanes = scenario.lane_count or 8
    made = replace(
        scenario,
        loop=replace(scenario.loop, reference=motion),
        start=aw.Start(q, qd),
        duration=0.15,
        recording=aw.Recording(what="state", reduce=["saturation"]),
        lanes=lanes,
    )
    run = aw.simulate(made, **SMALL)
    t = run.time.values
    error = run.q.values.reshape(lanes, len(t), -1) - motion.at(t)[0]
    moving = t <= motion.duration
    np.testing.assert_allclose(data.rms_error, np.sqrt((error[:, moving] ** 2).mean(axis=(0, 1))), rtol=1e-9)
    np.testing.assert_allclose(data.largest_error, np.abs(error).max(axis=(0, 1)), rtol=1e-9)
    np.testing.assert_allclose(data.saturation, run.saturation.values.reshape(lanes, -1).mean(axis=0), atol=1e-12)


def tuned(scenario, folder):
    gain = "position_kp" if isinstance(scenario.controller, aw.Cascade) else "kp"
    scenario = in_lanes(scenario)
    margins, search = aw.tuning.MarginConstraint(poses=10), aw.tuning.Search(generations=1, candidates=4)
    found = aw.tuning.tune(scenario, {gain: (10.0, 300.0)}, margins=margins, search=search, **SMALL)
    return Answer([*found.held_out.values(), found.history], "", found)


def in_lanes(scenario):
    """The scenario with four lanes, where it has none."""
    masses = aw.Batch([1.8, 1.95, 2.05, 2.2])
    return scenario if scenario.lane_count else replace(scenario, vary={"rod0.mass_kg": masses})


def judged_as_simulated(scenario, answer, folder):
    """Measures of the start and of the gains in the lanes held out, every second one, are those of `simulate`."""
    found, scenario = answer.found, in_lanes(scenario)
    law = scenario.controller
    assert set(found.held_out) == {"rms_error", "saturation"}
    gains = {name: aw.Batch(np.repeat([found.start[name], found.gains[name]], 2, axis=0)) for name in found.gains}
    vary = {name: aw.Batch(np.tile(each.values[1::2], 2)) for name, each in scenario.vary.items()}
    made = replace(
        scenario,
        loop=replace(scenario.loop, controller=replace(law, **gains)),
        vary=vary,
        recording=aw.Recording(what="none", reduce=list(found.held_out)),
    )
    run = aw.simulate(made, **SMALL)
    for name, values in found.held_out.items():
        expected = run[name].values.reshape(2, 2, -1).mean(axis=1)
        np.testing.assert_allclose(values[[0, 1]], expected, rtol=1e-9, atol=1e-12)


def reduced(scenario):
    """The scenario with measures of its voltages in place of rows."""
    return replace(scenario, recording=aw.Recording(what="none", reduce=["peak_voltage", "energy"]))


def as_simulated(scenario, answer, folder):
    """The measures of a run, to the bit."""
    run = aw.simulate(reduced(scenario), **SMALL)
    for name in ("peak_voltage", "energy"):
        np.testing.assert_array_equal(answer.found.load()[name].values.ravel(), run[name].values.ravel())


@cache
def _client():
    """A cluster within this process, for all sweeps of the walk."""
    from distributed import Client

    client = Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=":0")
    atexit.register(client.close)
    return client


def swept(scenario, folder):
    scenario, count = reduced(scenario), scenario.lane_count or 1
    found = aw.sweeps.sweep(scenario, folder / "store.zarr", lanes=count, client=_client(), **SMALL)
    data = found.load()
    assert data.finished.values.all(), str(found)
    return Answer([data[name].values for name in sorted(data.data_vars) if data[name].dtype.kind == "f"], "", found)


# Identification.


LOGGED = {}  # times, positions and torques of arms by their content


def _log(arm, folder, moved=None, seconds=3.0, payload=None):
    """A log of the arm that moved, the arm itself where no other is given, with its torques on the joints."""
    moved = arm if moved is None else moved
    moved = moved if payload is None else moved.with_payload(*payload, name="body")
    key = (checksum(moved), seconds)
    if key not in LOGGED:  # several consumers read the log of the same arm
        run = aw.simulate(looped(moved, seconds, reference=Wave(moved.n, seconds)), **SMALL)
        tau = np.asarray(to_joints(shares_of(moved), run.tau.values.T)).astype(float).T
        LOGGED[key] = run.time.values, run.q.values, tau
    return written_log(folder, "log", moved.names, *LOGGED[key])


def identified(arm, folder, moved=None):
    found = aw.identification.identify_arm(_log(arm, folder, moved), arm, checks=(), record=False)
    return Answer([found.estimate.values], "\n".join(found.estimate.remarks), found)


def predicts(arm, answer, folder):
    assert (answer.found.fit.r2 > 0.998).all(), answer.found.fit.r2


def friction_found(arm, folder, moved=None):
    found = aw.identification.identify_friction(_log(arm, folder, moved), arm, candidates=("stribeck",))
    return Answer([found.values], "\n".join(found.remarks), found)


def viscous_friction(arm, answer, folder):
    """Of the first joint, which has no other."""
    value = answer.found["joint0.friction.viscous_n_m_s_per_rad"]
    assert abs(value - 0.8) < 0.1, value


def payload_found(arm, folder, moved=None):
    log = _log(arm, folder, moved, payload=(1.0, [0.1, 0.0, 0.0], [1e-3] * 3))
    found = aw.identification.identify_payload(log, arm)
    return Answer([found.values], "\n".join(found.remarks), found)


def weighs_a_kilogram(arm, answer, folder):
    assert abs(answer.found.values[0] - 1.0) < 0.03, answer.found.values[0]


def validated(arm, folder, moved=None):
    found = aw.identification.validate(arm, _log(arm, folder, moved), **SMALL)
    return Answer([each.predicted for each in found.predictions], "\n".join(found.notes), found)


def passes(arm, answer, folder):
    assert answer.found.passed, str(answer.found)


def watched(arm, folder, moved=None):
    found = aw.shadow.shadow_log(_log(arm, folder, moved), arm, deviation=[0.3] * arm.n, **SMALL)
    return Answer([found.runs[0].residuals.torque], "\n".join(found.notes), found)


def no_alarm(arm, answer, folder):
    assert not answer.found.alarms, answer.found.alarms[:3]


class Dive(Wave):
    """A wave of all joints in which the second goes down, beyond the end of its range in `cases.ENDS`."""

    def __call__(self, t):
        q = super().__call__(t)
        return aw.scalar.array([2.0 * START[k] - each if k == 1 else each for k, each in enumerate(q)])


def motors_found(arm, folder, moved=None):
    """Torque constants, from those of another motor."""
    made = arm if moved is None else moved
    run = aw.simulate(looped(made, 2.0, reference=Dive(made.n, 2.0), period=2e-3), **SMALL)
    command = made.coordinates[0].drive.command
    log = written_log(folder, "log", made.names, run.time.values, run.q.values, run.u.values, command)
    others = {f"{name}.motor.torque_constant_n_m_per_a": 0.066 for name in arm.names}
    found = aw.identification.identify_motor(
        log,
        arm.with_values(others),
        free=["Kt"],
        fixed={"delay": 0.0},
        search=aw.identification.MotorSearch(starts=1),
        **SMALL,
    )
    return Answer([found.estimate.values], "\n".join(found.estimate.remarks), found)


def constants_of_the_motors(arm, answer, folder):
    np.testing.assert_allclose(answer.found.estimate.values, 0.06, rtol=1e-3)
    assert all(each["r2"] > 0.999 for each in answer.found.estimate.fit.values()), answer.found.estimate.fit


def excited(arm, folder):
    found = aw.identification.design_excitation(arm, cycle=4.0, harmonics=2, starts=1, **SMALL)
    return Answer([*found.used.values(), found.states(20.0)[1]], "\n".join(found.notes), found)


def keeps_its_limits(arm, answer, folder):
    report = aw.trajectories.limits_report(arm, answer.found.trajectory)
    assert report.largest < 1.0 + 1e-2, str(report)


# Export, bus, formats.


def by_model(scenario):
    """The scenario with a controller that computes dynamics in place of a PD controller."""
    if scenario.loop is None or not isinstance(scenario.controller, aw.JointPID):
        return scenario
    return replace(scenario, loop=replace(scenario.loop, controller=aw.ComputedTorque(200.0, 20.0)))


def exported(scenario, folder):
    found = aw.export.export_controller(by_model(scenario), folder / "c", ticks=20)
    texts = [path.read_text() for path in sorted((folder / "c").glob("*.c")) if "selftest" not in path.name]
    return Answer([text.split("*/", 1)[1] for text in texts], "\n".join(found.notes), found)


def commands_of_simulation(scenario, answer, folder):
    """The compiled controller's commands have the bits of the simulation."""
    found = answer.found
    if found.comparison is None:
        pytest.skip("no C compiler")
    run = aw.simulate(by_model(scenario), **SMALL)
    assert (found.comparison.ticks, found.comparison.others) == (20, 0)
    np.testing.assert_array_equal(found.comparison.commands, run.u_issued.values[:20])


def fmu(scenario, folder):
    from zipfile import ZipFile

    found = aw.export.export_fmu(scenario, folder / "arm.fmu", part="both" if scenario.loop else "plant", platforms=())
    with ZipFile(found.path) as archive:
        texts = [archive.read(name).decode() for name in sorted(archive.namelist()) if name.endswith((".c", ".h"))]
    return Answer(texts, "\n".join(found.notes), found)


def moves_as_simulated(scenario, answer, folder):
    """The compiled unit in FMPy moves as `simulate`, and commands the same."""
    from export.fmu.fmus import Instance

    if find_compiler() is None:
        pytest.skip("no C compiler")
    part = "both" if scenario.loop else "plant"
    found = aw.export.export_fmu(scenario, folder / "compiled.fmu", part=part, platforms=["host"])
    run, n = aw.simulate(scenario, **SMALL), scenario.arm.n
    period = scenario.tick
    times = period * np.arange(scenario.ticks)
    unit = Instance(found.path)
    rows = _inputs_of_unit(scenario, times, unit, run)
    names = {prefix: unit.names(prefix, "input") for prefix in rows}
    x, u = unit.names("x", "output"), unit.names("u", "output")
    unit.begin()
    for k, time in enumerate(times):
        expected = np.concatenate([run.q.values[k], run.qd.values[k]])
        np.testing.assert_allclose(unit.get(*x)[: 2 * n], expected, rtol=0.0, atol=1e-12)
        for prefix, values in rows.items():
            for name, value in zip(names[prefix], values[k], strict=True):
                unit.set(name, value)
        unit.step(time, period)
        if scenario.loop:
            np.testing.assert_allclose(unit.get(*u), run.u_issued.values[k], rtol=0.0, atol=1e-9)
    assert not unit.messages
    unit.close()


def _inputs_of_unit(scenario, times, unit, run):
    """Rows of a unit's inputs at some times."""
    if scenario.loop is None:
        rows = {"u": run.u.values[: len(times)]}
    else:
        rows = {"r": reference_rows(scenario.arm, scenario.loop.reference, times)}
    for prefix in ("wrench", "brake"):
        if unit.names(prefix, "input"):
            rows[prefix] = np.tile(getattr(scenario.inputs, prefix), (len(times), 1))
    if unit.names("payload", "input"):  # ten inertial numbers of BODY about the frame that holds it
        m, x, j = 0.5, 0.1, 1e-3
        numbers = np.array([m, m * x, 0.0, 0.0, j, 0.0, 0.0, j + m * x * x, 0.0, j + m * x * x])
        rows["payload"] = (times > BODY.time - 0.5 * scenario.tick)[:, None] * numbers
    return rows


def ros2(arm, folder):
    aw.export.export_ros2(arm, folder / "ros")
    files = sorted(path for path in (folder / "ros").rglob("*") if path.is_file())
    return Answer([path.read_text() for path in files], "", next(path for path in files if path.suffix == ".urdf"))


def on_bus(scenario, folder):
    if scenario.loop is not None:
        seen = replace(scenario.loop.joint_sensors, side="link")
        scenario = replace(scenario, loop=replace(scenario.loop, period=4e-3, sensors=seen))
    with aw.bus.Twin(scenario, "virtual"):
        run = aw.bus.run_controller(scenario, "virtual", following_error=3.0)
    return Answer([run.q, run.u], "", run)


def bus_equals_simulation(scenario, answer, folder):
    assert answer.found.equal, str(answer.found.first_difference)


def served_on_line(arm, folder):
    """The arm as servos in lock-step, whose goals follow a wave, with what they answer."""
    from armwright.twin.serial.client import ServoClient
    from armwright.twin.serial.servo_arm import ServoArm
    from armwright.twin.serial.timing import CycleEnd, LockStep
    from twin.serial.locked_port import LockedPort

    made = ServoArm(arm, start=START[: arm.n])
    made.plant.states = []
    port = LockedPort(made, LockStep(made.bus, 0.02, CycleEnd("sync-write", 42)))
    client, wave, seen = ServoClient(port, made.bus.servos[0].model), Wave(arm.n), []
    client.sync_write("shutdown", dict.fromkeys(made.ids, 0))  # 48 V are too much for servos
    client.sync_write("torque_enable", dict.fromkeys(made.ids, 1))
    for k in range(16):
        away = (-3.0 if k < 8 else 1.0) * (wave(0.02 * k) - wave(0.0))  # also beyond the stops, and back
        goals = [round(at.counts(q)) for at, q in zip(made.plant.mountings, wave(0.0) + away, strict=True)]
        seen += [str(made.plant.measure(joint)) for joint in range(arm.n)]
        client.sync_write("goal_position", dict(zip(made.ids, goals, strict=True)))
    return Answer([np.array(made.plant.states), *seen], "", made.plant)


def has_the_bits_of_its_goals(arm, answer, folder):
    """The simulation of the goals that came, with their times."""
    plant, states = answer.found, answer.values[0]
    run = aw.simulate(plant.scenario(plant.turn))
    assert np.ptp(states[:, : arm.n], axis=0).min() > 1e-3
    np.testing.assert_array_equal(run.q.values[:-1], states[:, : arm.n])


def converted(ending):
    def to(arm, folder):
        aw.robotfiles.write_toml(arm.record, folder / "arm.toml")
        found = aw.robotfiles.convert(folder / "arm.toml", folder / f"out.{ending}")
        texts = [path.read_text() for path in sorted(folder.glob("out.*"))]
        return Answer(texts, "\n".join([*found.lost, *found.notes]), folder / f"out.{ending}")

    return to


def torques_of_mujoco(arm, answer, folder):
    """MuJoCo's inverse dynamics of the file, friction and springs among them, in motion."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is the oracle here: pip install mujoco")
    model = mujoco.MjModel.from_xml_path(str(answer.found))
    data, q = mujoco.MjData(model), states(arm)
    places = [model.joint(name).id for name in arm.names]
    found = []
    for row in zip(*q, strict=True):
        data.qpos[places], data.qvel[places], data.qacc[places] = row
        mujoco.mj_inverse(model, data)
        found.append(data.qfrc_inverse[places].copy())
    np.testing.assert_allclose(found, aw.compile(arm).inverse_dynamics(*q), rtol=1e-7, atol=1e-7)


def reads_back(arm, answer, folder):
    """The URDF with its drive file is the same arm."""
    again, q = aw.load(answer.found), states(arm)
    assert again.names == arm.names
    np.testing.assert_allclose(
        aw.compile(again).inverse_dynamics(*q), aw.compile(arm).inverse_dynamics(*q), rtol=1e-7, atol=1e-7
    )


def information(arm, folder):
    from armwright.cli.app import app

    aw.robotfiles.write_toml(arm.record, folder / "arm.toml")
    with contextlib.chdir(folder):
        done = CliRunner().invoke(app, ["info", "arm.toml"], env={"COLUMNS": "400"})
    assert done.exit_code == 0, done.output
    return Answer([done.output], "", done)


def shows_it(arm, answer, folder):
    """Every optional key of a joint, its motor and friction, and of the robot, stands in the text."""
    for joint in arm.record.joints:
        motor = getattr(joint, "motor", None)
        keys = [
            key for key in ("mimic", "spring", "elasticity", "stops", "brake") if getattr(joint, key, None) is not None
        ]
        keys += [
            key
            for key in ("thermal", "cogging", "pwm", "dead_zone_v", "current_loop_hz")
            if getattr(motor, key, None) is not None
        ]
        for key in keys:
            assert key in answer.values[0].lower(), key
    assert arm.record.supply is None or "supply" in answer.values[0]


def difference(arm, folder):
    found = aw.robotfiles.diff(arm, base(arm.coordinates[0].drive.command))
    return Answer([str(found)], "", found)


def differs_in_every_number(arm, answer, folder):
    """Every number that the records do not share is listed with its values, and the effect is that of the dynamics."""
    other = base(arm.coordinates[0].drive.command)
    one, two = ({path: each.value for path, each, _ in quantities(each.record)} for each in (arm, other))
    listed = {each.path: (each.before, each.after) for each in answer.found.changes}
    for path in {*one, *two}:
        if one.get(path) != two.get(path) and path.split(".")[0] not in listed:  # of a part that comes or goes whole
            assert listed[path] == (one.get(path), two.get(path))
    effect = answer.found.effect
    for arm_, gravity in zip((arm, other), effect.gravity, strict=True):
        places = [arm_.names.index(name) for name in effect.joints]
        q = np.zeros((len(effect.poses), arm_.n))
        q[:, places] = effect.poses
        tau = aw.compile(arm_.replace(friction=None)).bias_torques(q, 0.0 * q)[:, places]
        np.testing.assert_allclose(gravity, tau, rtol=1e-9, atol=1e-9)


CONSUMERS = {
    "kernels": Consumer("kernels.compiled.KERNELS", kernels, starts_as_simulated),
    "export c": Consumer("export.c.SUPPORT", c_files, bits_of_kernels),
    "CasADi": Consumer("kernels.compiled.CASADI", casadi_functions, as_kernels),
    "simulate": Consumer("simulation.simulation.SUPPORT", simulated, as_rk45, looped),
    "cvodes": Consumer("simulation.integrate.cvodes.SUPPORT", by_cvodes, as_rk45, looped),
    "sensitivities": Consumer(
        "simulation.sensitivity.SUPPORT", sensitivities, as_differences, commanded, each_alone=False
    ),
    "ik": Consumer("ik.solve.SUPPORT", poses, reaches),
    "plan": Consumer("trajectory.limits_report.SUPPORT", reported, torques_of_inverse_dynamics),
    "time_optimal": Consumer("trajectory.time_optimal.plan.SUPPORT", fastest, within_limits),
    "loops": Consumer("control.analysis.small_signal.SUPPORT", loops, ends_at_its_margins, looped),
    "design_gains": Consumer("control.design.design_gains.SUPPORT", designed, keeps_its_margins, looped),
    "compare_controllers": Consumer(
        "control.comparison.compare.SUPPORT", compared, errors_of_simulation, looped, each_alone=False
    ),
    "tune": Consumer("tuning.tune.SUPPORT", tuned, judged_as_simulated, looped, each_alone=False),
    "sweep": Consumer("sweeps.sweep.SUPPORT", swept, as_simulated, looped, each_alone=False),
    "identify arm": Consumer("identification.arm.torque_model.SUPPORT", identified, predicts),
    "identify friction": Consumer("identification.arm.friction.SUPPORT", friction_found, viscous_friction),
    "identify payload": Consumer("identification.arm.payload.SUPPORT", payload_found, weighs_a_kilogram),
    "identify motor": Consumer(
        "identification.motor.identify.SUPPORT", motors_found, constants_of_the_motors, each_alone=False
    ),
    "validate": Consumer("identification.validation.validate.SUPPORT", validated, passes),
    "shadow": Consumer("shadow.shadow.SUPPORT", watched, no_alarm),
    "excite": Consumer("identification.experiments.excitation.SUPPORT", excited, keeps_its_limits),
    "export controller": Consumer("export.controller.write.SUPPORT", exported, commands_of_simulation, looped),
    # tests/twin and tests/export/fmu hold every effect of drives, every rule, and loops with all of their features, to the bit
    "export fmu": Consumer("export.fmu.write.SUPPORT", fmu, moves_as_simulated, looped, each_pair=False),
    "export ros2": Consumer("export.ros2.SUPPORT", ros2, reads_back),
    "twin": Consumer(
        "twin.on_bus.SUPPORT", on_bus, bus_equals_simulation, looped, "current", each_pair=False, each_alone=False
    ),
    "twin --serial": Consumer(
        "twin.serial.servo_arm.SUPPORT", served_on_line, has_the_bits_of_its_goals, command="position"
    ),
    "convert to URDF": Consumer("export.urdf.SUPPORT", converted("urdf"), reads_back),
    "convert to MJCF": Consumer("export.mjcf.SUPPORT", converted("xml"), torques_of_mujoco),
    "info": Consumer("features.INFO", information, shows_it),
    "diff": Consumer("robotfiles.difference.SUPPORT", difference, differs_in_every_number),
}

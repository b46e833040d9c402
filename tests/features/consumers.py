"""Each consumer of arms and scenarios, called with a small one: what it answers, what it notes, and a law of what is exact."""

from __future__ import annotations

import atexit
import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from typer.testing import CliRunner

import armwright as aw
from armwright.actuators.coupling import shares_of, to_joints
from armwright.control.analysis import LinearLoop
from features.cases import GOAL, START, Wave, commanded, looped
from identification.arm.moved_arm import written_log

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
    """

    support: str
    answer: Callable[..., Answer]
    law: Callable[..., None] | None = None
    of: Callable[[aw.Model], aw.Scenario] | None = None
    command: str = "voltage"


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
    return Answer([texts[".c"]], texts[".h"])


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
    found = aw.sensitivities(scenario, ["rod0.mass_kg"])
    numbers = [found[name].values for name in found.data_vars if found[name].dtype.kind == "f"]
    return Answer(numbers, found.attrs.get("notes", ""), found)


def as_differences(scenario, answer, folder):
    """Central differences of the simulation by the same steps."""
    step, solver = 1e-4, aw.Solver("rk4", step=1e-4) if scenario.loop is None else aw.Solver("rk4", substeps=10)
    scenario = replace(scenario, solver=solver)
    if scenario.loop is None:
        scenario = replace(scenario, recording=aw.Recording(every=10))
    found = aw.sensitivities(scenario, ["rod0.mass_kg"])
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
    report = aw.limits_report(arm, _to_and_fro(arm))
    return Answer([*report.highest.values(), *report.lowest.values()], "\n".join(report.notes), report)


def torques_of_inverse_dynamics(arm, answer, folder):
    """No torque of the motion is beyond the report's extremes, which are reached."""
    motion = _to_and_fro(arm)
    tau = aw.compile(arm).inverse_dynamics(*motion.at(np.linspace(0.0, motion.duration, 4001)))[1:-1]
    for extreme, found in (("highest", tau.max(axis=0)), ("lowest", tau.min(axis=0))):
        np.testing.assert_allclose(getattr(answer.found, extreme)["torque"], found, rtol=1e-2, atol=0.1)


def _to_and_fro(arm):
    ends = np.array([[0.0] * arm.n, [0.8] * arm.n])
    there = aw.Quintic(*ends, duration=3.0)  # slow, and back by the pose of the largest weight
    return aw.Joined([there, aw.Quintic(*ends[::-1], duration=3.0, time=3.0)])


def fastest(arm, folder):
    path = aw.JointPath([[-0.3] * arm.n, [0.8] * arm.n, [-0.2] * arm.n])
    limits = replace(aw.MotionLimits.of(arm), torque=[45.0, 16.0, 8.0][: arm.n])
    motion = aw.time_optimal(arm, path, limits, grid=60)
    return Answer([motion.duration], "\n".join(motion.notes), motion)


def within_limits(arm, answer, folder):
    """Another grid finds no torque beyond the limit, and one that is reached."""
    report = aw.limits_report(arm, answer.found, replace(aw.MotionLimits.of(arm), torque=[45.0, 16.0, 8.0][: arm.n]))
    assert 0.9 < report.largest < 1.0 + 1e-3


# Loops and gains.


def loops(scenario, folder):
    """Margins about the start, as `analyse_loops` has them about all poses."""
    loop = LinearLoop(scenario)
    margins = loop.margins(START[: scenario.arm.n])
    return Answer([margins.gain_up, margins.gain_down, margins.phase, margins.radius], "\n".join(loop.notes))


def designed(scenario, folder):
    found = aw.design_gains(scenario, poses=50)
    values = [*found.gains.values(), found.friction_error, found.weight_error]
    return Answer(values, "\n".join(found.sentences()), found)


def compared(scenario, folder):
    n = scenario.arm.n
    motion = aw.Quintic(START[:n], GOAL[:n], duration=0.1)
    found = aw.compare_controllers(
        scenario, {"own": scenario.controller or aw.JointPID(120.0, 0.0, 6.0)}, {"move": motion}, settle=0.05
    )
    names = ("rms_error", "largest_error", "peak_share", "saturation")
    return Answer([found.data[name].values for name in names], "", found)


def tuned(scenario, folder):
    gain = "position_kp" if isinstance(scenario.controller, aw.Cascade) else "kp"
    found = aw.tune(scenario, {gain: (10.0, 300.0)}, lanes=4, generations=1, candidates=4, poses=10, **SMALL)
    return Answer([*found.held_out.values(), found.history], "", found)


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

    client = Client(processes=False, n_workers=1, threads_per_worker=1, dashboard_address=None)
    atexit.register(client.close)
    return client


def swept(scenario, folder):
    scenario, count = reduced(scenario), scenario.lane_count or 1
    found = aw.sweep(scenario, folder / "store.zarr", lanes=count, client=_client(), **SMALL)
    data = found.load()
    assert data.finished.values.all(), str(found)
    return Answer([data[name].values for name in sorted(data.data_vars) if data[name].dtype.kind == "f"], "", found)


# Identification.


def _log(arm, folder, moved=None, seconds=3.0, payload=None):
    """A log of the arm that moved, the arm itself where no other is given, with its torques on the joints."""
    moved = arm if moved is None else moved
    moved = moved if payload is None else moved.with_payload(*payload, name="body")
    run = aw.simulate(looped(moved, seconds, reference=Wave(moved.n, seconds)), **SMALL)
    tau = np.asarray(to_joints(shares_of(moved), run.tau.values.T)).astype(float).T
    return written_log(folder, "log", moved.names, run.time.values, run.q.values, tau)


def identified(arm, folder, moved=None):
    found = aw.identify_arm(_log(arm, folder, moved), arm, sensitivity=False, record=False)
    return Answer([found.estimate.values], "\n".join(found.estimate.remarks), found)


def predicts(arm, answer, folder):
    assert (answer.found.fit.r2 > 0.998).all(), answer.found.fit.r2


def friction_found(arm, folder, moved=None):
    found = aw.identify_friction(_log(arm, folder, moved), arm, candidates=("stribeck",))
    return Answer([found.values], "\n".join(found.remarks), found)


def viscous_friction(arm, answer, folder):
    """Of the first joint, which has no other."""
    value = answer.found["joint0.friction.viscous_n_m_s_per_rad"]
    assert abs(value - 0.8) < 0.1, value


def payload_found(arm, folder, moved=None):
    log = _log(arm, folder, moved, payload=(1.0, [0.1, 0.0, 0.0], [1e-3] * 3))
    found = aw.identify_payload(log, arm)
    return Answer([found.values], "\n".join(found.remarks), found)


def weighs_a_kilogram(arm, answer, folder):
    assert abs(answer.found.values[0] - 1.0) < 0.03, answer.found.values[0]


def validated(arm, folder, moved=None):
    found = aw.validate(arm, _log(arm, folder, moved), **SMALL)
    return Answer([each.predicted for each in found.predictions], "\n".join(found.notes), found)


def passes(arm, answer, folder):
    assert answer.found.passed, str(answer.found)


def watched(arm, folder, moved=None):
    found = aw.shadow_log(_log(arm, folder, moved), arm, deviation=[0.3] * arm.n, **SMALL)
    return Answer([found.runs[0].residuals.torque], "\n".join(found.notes), found)


def no_alarm(arm, answer, folder):
    assert not answer.found.alarms, answer.found.alarms[:3]


def excited(arm, folder):
    found = aw.design_excitation(arm, period=4.0, harmonics=2, starts=1, **SMALL)
    return Answer([*found.used.values(), found.states(20.0)[1]], "\n".join(found.notes), found)


def keeps_its_limits(arm, answer, folder):
    report = aw.limits_report(arm, answer.found.trajectory)
    assert report.largest < 1.0 + 1e-2, str(report)


# Export, bus, formats.


def exported(scenario, folder):
    if scenario.loop is not None and isinstance(scenario.controller, aw.JointPID):
        scenario = replace(scenario, loop=replace(scenario.loop, controller=aw.ComputedTorque(200.0, 20.0)))
    found = aw.export_controller(scenario, folder / "c", ticks=20)
    texts = [path.read_text() for path in sorted((folder / "c").glob("*.c")) if "selftest" not in path.name]
    return Answer([text.split("*/", 1)[1] for text in texts], "\n".join(found.notes), found)


def fmu(scenario, folder):
    from zipfile import ZipFile

    found = aw.export_fmu(scenario, folder / "arm.fmu", part="both" if scenario.loop else "plant", platforms=())
    with ZipFile(found.path) as archive:
        texts = [archive.read(name).decode() for name in sorted(archive.namelist()) if name.endswith((".c", ".h"))]
    return Answer(texts, "\n".join(found.notes), found)


def ros2(arm, folder):
    aw.export_ros2(arm, folder / "ros")
    files = sorted(path for path in (folder / "ros").rglob("*") if path.is_file())
    return Answer([path.read_text() for path in files], "", files)


def on_bus(scenario, folder):
    if scenario.loop is not None:
        seen = replace(scenario.loop.joint_sensors, side="link")
        scenario = replace(scenario, loop=replace(scenario.loop, period=4e-3, sensors=seen))
    with aw.Twin(scenario, "virtual"):
        run = aw.run_controller(scenario, "virtual", following_error=3.0)
    return Answer([run.q, run.u], "", run)


def bus_equals_simulation(scenario, answer, folder):
    assert answer.found.equal, str(answer.found.first_difference)


def converted(ending):
    def to(arm, folder):
        aw.write_toml(arm.record, folder / "arm.toml")
        found = aw.convert(folder / "arm.toml", folder / f"out.{ending}")
        texts = [path.read_text() for path in sorted(folder.glob("out.*"))]
        return Answer(texts, "\n".join([*found.lost, *found.notes]), found)

    return to


def reads_back(arm, answer, folder):
    """The file with its drive file is the same arm."""
    again, q = aw.load(folder / "out.urdf"), states(arm)
    assert again.names == arm.names
    np.testing.assert_allclose(
        aw.compile(again).inverse_dynamics(*q), aw.compile(arm).inverse_dynamics(*q), rtol=1e-7, atol=1e-7
    )


def information(arm, folder):
    from armwright.cli.app import app

    aw.write_toml(arm.record, folder / "arm.toml")
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
    from features.cases import base

    return Answer([str(aw.diff(arm, base(arm.coordinates[0].drive.command)))])


CONSUMERS = {
    "kernels": Consumer("kernels.compiled.KERNELS", kernels, starts_as_simulated),
    "export c": Consumer("export.c.SUPPORT", c_files),
    "CasADi": Consumer("kernels.compiled.CASADI", casadi_functions, as_kernels),
    "simulate": Consumer("simulation.simulation.SUPPORT", simulated, as_rk45, looped),
    "cvodes": Consumer("simulation.integrate.cvodes.SUPPORT", by_cvodes, as_rk45, looped),
    "sensitivities": Consumer("simulation.sensitivity.SUPPORT", sensitivities, as_differences, commanded),
    "ik": Consumer("ik.solve.SUPPORT", poses, reaches),
    "plan": Consumer("trajectory.limits_report.SUPPORT", reported, torques_of_inverse_dynamics),
    "time_optimal": Consumer("trajectory.time_optimal.plan.SUPPORT", fastest, within_limits),
    "loops": Consumer("control.analysis.small_signal.SUPPORT", loops, None, looped),
    "design_gains": Consumer("control.design.design_gains.SUPPORT", designed, None, looped),
    "compare_controllers": Consumer("control.comparison.compare.SUPPORT", compared, None, looped),
    "tune": Consumer("tuning.tune.SUPPORT", tuned, None, looped),
    "sweep": Consumer("sweeps.sweep.SUPPORT", swept, as_simulated, looped),
    "identify arm": Consumer("identification.arm.torque_model.SUPPORT", identified, predicts),
    "identify friction": Consumer("identification.arm.friction.SUPPORT", friction_found, viscous_friction),
    "identify payload": Consumer("identification.arm.payload.SUPPORT", payload_found, weighs_a_kilogram),
    "validate": Consumer("identification.validation.validate.SUPPORT", validated, passes),
    "shadow": Consumer("shadow.shadow.SUPPORT", watched, no_alarm),
    "excite": Consumer("identification.experiments.excitation.SUPPORT", excited, keeps_its_limits),
    "export controller": Consumer("export.controller.write.SUPPORT", exported, None, looped),
    "export fmu": Consumer("export.fmu.write.SUPPORT", fmu, None, looped),
    "export ros2": Consumer("export.ros2.SUPPORT", ros2),
    "twin": Consumer("twin.on_bus.SUPPORT", on_bus, bus_equals_simulation, looped, "current"),
    "convert to URDF": Consumer("export.urdf.SUPPORT", converted("urdf"), reads_back),
    "convert to MJCF": Consumer("export.mjcf.SUPPORT", converted("xml")),
    "info": Consumer("cli.info.SUPPORT", information, shows_it),
    "diff": Consumer("robotfiles.difference.SUPPORT", difference),
}

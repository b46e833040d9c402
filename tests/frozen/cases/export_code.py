"""Code that is written: C libraries of an arm, controllers with their parameters and packages for ROS 2, FMUs."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import armwright as aw
from armwright import scalar
from armwright.export.c import c_library
from armwright.export.c_function import c_functions, parse_form
from armwright.export.c_header import comment, described, plain, stack
from armwright.export.c_selftest import _vectors
from armwright.export.controller.build_files import cmake, readme
from armwright.export.controller.footprint import Footprint, _deepest
from armwright.export.controller.parameters import gain_members, layout_of, parameter_file
from armwright.export.controller.recording import record
from armwright.export.controller.selftest import input_rows, reader, selftest
from armwright.export.controller.sil import relative_error
from armwright.export.controller.stages import ControllerStages
from armwright.export.controller.write import controller_code
from armwright.export.fmu.build import PLATFORMS
from armwright.export.fmu.variables import base_unit, quoted
from armwright.export.ros2_controller.package import package_name
from armwright.kernels.compiled import CompiledArm
from armwright.model import Model
from export.controllers import three_rates
from export.running import pid_loop
from frozen.cases.twin import refusals
from frozen.texts import rounded, texts
from simulation.plants import BRAKE, COGGING, COULOMB, ELASTIC, MANY, MOTOR, SUPPLY, THERMAL, chain, pendulum
from simulation.test_switching import PLAY, STOPS

ANY = Callable[[], Any]


def all_rounded(written: dict[str, str | bytes]) -> dict[str, Any]:
    """Texts without their last digits."""
    return {name: text.hex() if isinstance(text, bytes) else rounded(text) for name, text in written.items()}


# Libraries.

KERNELS = (
    "inverse_dynamics", "inverse_dynamics+wrench", "forward_dynamics", "mass_matrix", "gravity_torques", "energy",
    "forward_kinematics", "forward_kinematics:frame=upper_arm", "jacobian_dot_qd",
)  # fmt: skip


def vectors(arm: Model, form: str, real: str) -> Any:
    """Test vectors of a function, with the tolerances of its results."""
    (function,) = c_functions(arm, "arm", [parse_form(form)])
    return _vectors(arm, function, real, CompiledArm(arm, dtype={"double": "float64", "float": "float32"}[real]))


def words() -> dict[str, Any]:
    """Comments, descriptions and stacks of C."""
    doc = """Torques.

    Args:
        q: (n,) [rad | m] positions.   tau: (n,) [N m | N] motor torque, at the joint.
        u: (n,) in force, [A].   x: (4, 4) pose.
    Returns:
        g: (n,) [N m] of gravity.
    """
    names = ("q", "tau", "u", "x", "g", "none")
    return {
        "described": [described(doc, name) for name in names],
        "plain": plain("τ = M(q) q̈ + ½ θ²  */ ??= ∂x/∂q é\t…"),
        "comment": comment(["first", "", "second"]),
        "stack": [stack(waiting, real) for waiting in (0, 1, 7, 100) for real in ("double", "float")],
        "sections": [parse_form(each).words for each in KERNELS],
        "names": [parse_form(each).name for each in KERNELS],
    }


# Controllers.


def controller(
    scenario: ANY, _: Path, real: str = "double", gains: tuple[str, ...] = (), counts: bool = False, ticks: int = 12
) -> dict[str, Any]:
    """All texts of a controller, its parameters, and what it saw and commanded."""
    stages = ControllerStages.of(scenario(), None, gains, counts=counts)
    seen = record(stages, ticks)
    code = controller_code(stages, real)
    code |= {
        "selftest": selftest(stages, seen.first(ticks - 2), seen.u[: ticks - 2], real),
        "reader": reader(stages, seen, real),
    }
    file = parameter_file(stages, real)
    numbers = np.frombuffer(file[4:-4], {"double": "<f8", "float": "<f4"}[real])
    return {
        **all_rounded(code), "README": rounded(readme(stages, ticks, real)), "cmake": cmake(stages.name),
        "layout": layout_of(stages, real), "numbers": numbers, "size": len(file), "gains": gain_members(stages),
        "rows": input_rows(stages, seen), "recording": seen, "limits": stages.limits, "ranges": stages.ranges,
        "ticks of time": stages.ticks_of_time(real), "counters": stages.counters, "loss": stages.loss,
        "delay": stages.delay_ticks,
    }  # fmt: skip


def timed(t, r, y):
    """A law of the time."""
    return scalar.array([5.0 * scalar.sin(3.0 * t) + r.q[0] - y.q[0], -y.qd[1]])


def two(**joint: Any) -> Model:
    """Two driven rods by voltage."""
    return chain([{"command": "voltage", "motor": MOTOR, "friction": COULOMB, **joint}] * 2)


LIMITED = aw.JointPID(
    kp=[80.0, 60.0], kd=2.0, ki=20.0, limit=3.0, anti_windup="back-calculation", tracking_time=0.1, delay_ticks=1
)
LOSSY = aw.Timing("one-tick", measurement_loss=0.3, command_loss=0.1, jitter=2e-4)
SHAPED = aw.CommandFilter(limit=[9.0, 2.0], rate=300.0, resolution=0.01)
ENCODERS = aw.Sensors(counts=4096, velocity="difference")
LOOPS: dict[str, ANY] = {
    "PID": pid_loop,
    "limited PID": lambda: pid_loop(controller=LIMITED, timing=aw.Timing("one-tick")),
    "lossy PID": lambda: pid_loop(controller=LIMITED, timing=LOSSY, command_filter=SHAPED),
    "rounded commands": lambda: pid_loop(command_filter=aw.CommandFilter(resolution=0.5)),
    "law of time": lambda: pid_loop(controller=timed, period=1.6e-3),
    "encoders": lambda: pid_loop(sensors=ENCODERS),
    "one encoder": lambda: pid_loop(pendulum("torque"), sensors=ENCODERS),
    "feed-forward": lambda: pid_loop(
        controller=aw.FeedForward(aw.JointPID(kp=20.0, kd=1.0, cutoff_hz=50.0), gravity=True)
    ),
    "voltages": lambda: pid_loop(
        two(limits={"voltage_v": 24.0, "velocity_rad_per_s": 3.0, "position_rad": [-1.0, 2.0]})
    ),
    "three rates": lambda: three_rates(40),
}


def footprints() -> dict[str, Any]:
    """Memory of a controller whose functions call each other."""
    bodies = {
        "static int a(int x)": "return x;",
        "int b(void)": "return a(1) + a(2);",
        "void c(void)": "b();\n    a(3);",
    }
    code = "\n".join(f"{head}\n{{\n    {body}\n}}\n" for head, body in bodies.items())
    frames = {"a": 16, "b": 8, "c": 100}
    fits = Footprint("a board", 1200, 340, _deepest(code, frames), 5678)
    refused = []
    for ram, flash in ((1663, None), (1664, 5677), (1664, 5678)):
        try:
            fits.check(ram, flash)
        except aw.errors.ModelError as error:
            refused.append(str(error))
    depths = [_deepest(code, each) for each in (frames, {"a": 200}, {"b": 3}, {})]
    return {"depths": depths, "ram": fits.ram, "words": str(fits), "refused": refused}


def written(scenario: ANY, folder: Path, **options: Any) -> dict[str, Any]:
    """What an export writes where there is no compiler."""
    with patch("armwright.export.controller.write.find_compiler", lambda: None):
        made = aw.export.export_controller(scenario(), folder, **options)
    return {"name": made.name, "paths": [each.name for each in made.paths], "notes": made.notes, **texts(folder)}


def package(scenario: ANY, folder: Path, **options: Any) -> dict[str, Any]:
    """A package for ROS 2, written where there is no compiler."""
    with patch("armwright.export.controller.write.find_compiler", lambda: None):
        made = aw.export.export_ros2(scenario(), folder, **options)
    return {"paths": len(made.paths), "lost": made.lost, "notes": made.notes, **texts(folder)}


def untraced(t, r, y):
    """A law that cannot be traced."""
    return np.array([float(each) for each in r.q - y.q])


def refused_controllers() -> list[str]:
    """Scenarios whose controllers cannot be exported."""
    good = pid_loop()
    loops: list[tuple[Any, ...]] = [
        (pid_loop(controller=untraced),),
        (replace(good, loop=replace(good.loop, controller=None)),),
        (good, None, ("none",)),
        (good, None, ("gravity",)),
        (replace(good, vary={"forearm.mass_kg": aw.Batch([1.0, 2.0])}),),
        (good, None, ("kp", "ki")),
    ]
    found = refusals(lambda *words: f"{ControllerStages.of(*words).gains.names}", *loops)
    return found + refusals(lambda: ControllerStages.of(good, counts=True).count.tolist(), ())


def refused_units(folder: Path) -> list[str]:
    """What no FMU and no package can be."""
    path, good = folder / "unit.fmu", pid_loop()
    options: list[dict[str, Any]] = [
        {"part": "none"},
        {"version": "1.0"},
        {"interface": "none"},
        {"name": "9x"},
        {"name": "int"},
        {"name": "x" * 64},
        {"name": "x" * 63},
        {"part": "both", "interface": "model-exchange"},
        {"platforms": ["none"]},
    ]
    found = refusals(
        lambda each: aw.export.export_fmu("two-link", path, **{"platforms": [], **each}).name,
        *((each,) for each in options),
    )
    sources = (
        good,
        commanded(aw.load("two-link"), solver=aw.Solver("cvodes")),
        replace(good, loop=replace(good.loop, controller=None)),
    )
    found += refusals(
        lambda each: aw.export.export_fmu(each, path, part="both", platforms=[]).name, *((each,) for each in sources)
    )
    sticking = pendulum(motor=MOTOR, friction={k: v for k, v in COULOMB.items() if "smoothing" not in k})
    found += refusals(lambda: aw.export.export_fmu(sticking, path, interface="model-exchange", platforms=[]).name, ())
    rates = [pid_loop(period=period) for period in (1.6e-3, 8e-3, 0.1)] + [pid_loop(reference=[0.1, 0.2])]
    with patch("armwright.export.controller.write.find_compiler", lambda: None):
        found += refusals(
            lambda each: len(aw.export.export_ros2(each, folder / "package").paths), *((each,) for each in rates)
        )
        said = [{"rate": 3}, {"command": "effort"}, {"hardware": " "}]
        found += refusals(
            lambda each: len(aw.export.export_ros2(good, folder / "package", **each).paths), *((each,) for each in said)
        )
    arms_only = [
        {"name": "a"},
        {"gains": ("kp",)},
        {"rate": 0},
        {"rate": True},
        {"rate": 1},
        {"command": "none"},
        {"hardware": ""},
    ]
    found += refusals(
        lambda each: len(aw.export.export_ros2(aw.load("two-link"), folder / "arm", **each).paths),
        *((each,) for each in arms_only),
    )
    return [each.replace(str(folder), "") for each in found]


# FMUs.


def fmu(source: ANY, folder: Path, **options: Any) -> dict[str, Any]:
    """Members of an FMU without binaries, but for the sources that are the same in all of them."""
    made = aw.export.export_fmu(source(), folder / "unit.fmu", platforms=[], **options)
    own = {
        name: text
        for name, text in texts(folder).items()
        if not name.endswith(("instance.h", "instance.c", "fmi2.c", "fmi3.c"))
    }
    said = {
        key: getattr(made, key)
        for key in ("name", "version", "interface", "part", "inputs", "outputs", "parameters", "notes")
    }
    with zipfile.ZipFile(folder / "unit.fmu") as archive:
        dates = {each.date_time for each in archive.infolist()}
    return {**said, **own, "files": sorted(texts(folder)), "dates": repr(dates)}


def commanded(arm: Model, **scenario: Any) -> aw.Scenario:
    """A plant under commands over time."""
    rows = 0.5 + np.arange(2 * arm.n).reshape(2, -1)
    return aw.Scenario(arm, duration=0.05, command=aw.Schedule([0.0, 0.02], rows, arm.names), **scenario)


def acted_on() -> aw.Scenario:
    """A plant with a wrench, a brake and a payload."""
    arm = pendulum(motor=MOTOR, friction=COULOMB, brake=BRAKE)
    inputs = aw.Inputs(
        brake=aw.Schedule([0.0, 0.02], np.array([[0.0], [1.0]]), ("joint0",)),
        wrench=aw.Schedule([0.0, 0.01], np.ones((2, 6)), ("fx", "fy", "fz", "mx", "my", "mz")),
        payload=aw.Payload(0.03, 0.7, com=[0.02, 0.0, 0.0], inertia=np.diag([1e-3, 2e-3, 2e-3]), frame="rod0"),
    )
    return commanded(arm, inputs=inputs)


def batched() -> aw.Scenario:
    """A loop with one value of a gain and of a number of the record."""
    loop = pid_loop(controller=aw.JointPID(kp=aw.Batch([[20.0, 10.0]]), kd=aw.Batch([2.0]), ki=5.0))
    return replace(loop, vary={"forearm.mass_kg": aw.Batch([2.0])})


def busy(**scenario: Any) -> aw.Scenario:
    """Everything between controller and drives."""
    timing = aw.Timing("one-tick", measurement_delay=2.5e-3, jitter=4e-4, measurement_loss=0.1)
    sensors = aw.Sensors(counts=4096, position_noise=1e-4)
    made = pid_loop(two(), controller=LIMITED, timing=timing, sensors=sensors, command_filter=SHAPED)
    return replace(made, seed=4, **scenario)


UNITS = ("rad", "N m/rad", "m/s²", "kg m²", "N m", "V", "1", "°C", "W", "Hz", "rad/s", "no such", "A/s")
EXCHANGED: dict[str, ANY] = {
    "two-link": lambda: aw.load("two-link"),
    "elastic joints": lambda: commanded(two(elasticity=ELASTIC), start=aw.Start([0.1, 0.2], [0.3, 0.4])),
    "stops and play": lambda: commanded(
        chain(
            [
                {"command": "torque", "stops": STOPS, "limits": {"position_rad": [-0.1, 0.1]}},
                {"command": "voltage", "motor": MOTOR, "elasticity": PLAY},
            ]
        )
    ),
    "heat and a supply": lambda: commanded(
        chain(
            [{"command": "voltage", "motor": {**MOTOR, "inductance_h": 1e-3, "thermal": THERMAL, "cogging": COGGING}}]
            * 2,
            robot={"supply": SUPPLY},
        )
    ),
}
PLANTS: dict[str, ANY] = {
    "an arm": lambda: aw.load("two-link"),
    "all effects": lambda: commanded(MANY["all"]),
    "a stiff arm": lambda: commanded(MANY["all"], solver=aw.Solver("rodas3")),
    "steps of its own": lambda: commanded(MANY["load"], solver=aw.Solver("rk45")),
    "a busy plant": busy,
    "what acts": acted_on,
}

CASES = {
    **{
        f"C of {real} {name}": lambda _, name=name, real=real, chosen=chosen: all_rounded(
            c_library(aw.load(name), chosen, real)
        )
        for name, chosen in (("two-link", KERNELS), ("puma560", ("inverse_dynamics", "motor_voltage")))
        for real in ("double", "float")
    },
    **{
        f"test vectors of {form} in {real}": lambda _, arm=arm, form=form, real=real: vectors(aw.load(arm), form, real)
        for arm, form in (
            ("two-link", "inverse_dynamics"),
            ("puma560", "operational_inertia"),
            ("two-link", "jacobian"),
        )
        for real in ("double", "float")
    },
    "words of C": lambda _: words(),
    **{f"controller: {name}": partial(controller, loop) for name, loop in LOOPS.items()},
    "controller: PID in float": partial(controller, LOOPS["limited PID"], real="float"),
    "controller: law of time in float": partial(controller, LOOPS["law of time"], real="float"),
    "controller: gains": partial(controller, LOOPS["limited PID"], gains=("kp", "kd", "limit")),
    "controller: gains within": partial(controller, LOOPS["feed-forward"], gains=("kp", "inner.kd")),
    "controller: counts": partial(controller, LOOPS["encoders"], counts=True),
    "controller: counts of one joint": partial(controller, LOOPS["one encoder"], counts=True),
    "controller: counts in float": partial(controller, LOOPS["encoders"], counts=True, real="float"),
    "written controller": partial(written, LOOPS["lossy PID"], name="hold", gains="kp", ticks=300),
    "written controller of all ticks": partial(written, LOOPS["law of time"]),
    "footprints": lambda _: footprints(),
    "errors of commands": lambda _: [
        relative_error(np.array(found), np.array(expected))
        for found, expected in (([[1.0, 2.0], [3.0, 2.5]], [[1.0, 2.0], [2.0, 2.0]]), ([[0.0], [0.0]], [[0.0], [0.0]]))
    ],
    **{f"package: {name}": partial(package, LOOPS[name]) for name in ("PID", "voltages", "encoders", "feed-forward")},
    "package: limited PID": partial(
        package, LOOPS["limited PID"], gains=("kp", "limit"), hardware="a/Driver", name="My  Arm_1"
    ),
    "package names": lambda _: [package_name(each) for each in ("Two-Link", "a__b", "9 lives", "é")],
    **{f"FMU of {name}": partial(fmu, source) for name, source in PLANTS.items()},
    **{f"FMU of {name} in 2.0": partial(fmu, PLANTS[name], version="2.0") for name in ("a busy plant", "what acts")},
    **{
        f"FMU of {part}: {name}": partial(fmu, loop, part=part)
        for part in ("controller", "both")
        for name, loop in {"PID": pid_loop, "busy": busy, "batched": batched}.items()
    },
    "FMU of a batched plant": partial(fmu, batched),
    "FMU of a pose": partial(fmu, lambda: pid_loop(reference=[0.3, -0.2]), part="both", version="2.0", name="pose"),
    **{
        f"FMU to be solved: {name}": partial(fmu, source, interface="model-exchange")
        for name, source in EXCHANGED.items()
    },
    **{
        f"FMU to be solved in 2.0: {name}": partial(fmu, EXCHANGED[name], interface="model-exchange", version="2.0")
        for name in ("two-link", "stops and play")
    },
    "FMU of what acts, to be solved": partial(
        fmu, lambda: replace(acted_on(), arm=pendulum(motor=MOTOR, brake=BRAKE)), interface="model-exchange"
    ),
    "controllers that are refused": lambda _: refused_controllers(),
    "units that are refused": refused_units,
    "units of FMUs": lambda _: {unit: base_unit(unit) for unit in UNITS},
    "names of FMUs": lambda _: [quoted(each) for each in ("", "elbow", "3", "joint 2", "a'b", "é\\")],
    "platforms of FMUs": lambda _: PLATFORMS,
}

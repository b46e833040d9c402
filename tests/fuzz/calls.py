"""Public functions and classes that take numbers: good arguments, of which some are replaced by anything."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np

import armwright as aw
from armwright.kernels.signatures import SIGNATURES
from fuzz.case import Case
from fuzz.values import built, odd_value
from public_names import BY_NAME

ARMS = ("two-link", "two-link", "two-link", "cmu-dd")
POSE, ZERO = [0.1, 0.2], [0.0, 0.0]
TENSOR = [[1e-3, 0, 0], [0, 1e-3, 0], [0, 0, 1e-3]]
OBJECTS: dict[str, dict[str, Any]] = {  # classes and their good arguments
    "Schedule": {"times": [0, 0.1], "commands": [POSE, ZERO], "names": ["shoulder", "elbow"]},
    "Payload": {"time": [0.0], "mass": [1.0], "com": [[0, 0, 0.1]], "inertia": [TENSOR], "frame": "hand"},
    "Batch": {"values": [POSE, ZERO]},
    "Draw": {"kind": "normal", "centre": 0.0, "spread": 1.0, "low": -1.0, "high": 1.0},
    "JointPID": {"kp": POSE, "ki": 0.0, "kd": 0.0, "cutoff_hz": 10.0, "limit": 1.0, "tracking_time": 0.1,
                 "anti_windup": "back-calculation", "delay_ticks": 1,
                 "slack": 0.0, "period": 1e-3},
    "Cascade": {"position_kp": POSE, "speed_kp": POSE, "speed_ki": 0.0, "speed_limit": 1.0, "position_every": 2,
                "tracking_time": 0.1, "anti_windup": "back-calculation", "signs": [1, 1], "period": 1e-3},
    "ComputedTorque": {"kp": POSE, "kd": POSE, "ki": 0.0, "period": 1e-3},
    "CommandFilter": {"limit": POSE, "rate": 1.0, "resolution": 0.1},
    "Sensors": {"counts": 100, "velocity": "filtered", "cutoff_hz": 10.0, "position_noise": 0.0,
                "velocity_noise": 0.0, "current_noise": 0.0},
    "Timing": {"measurement_delay": 0.0, "command_delay": 1e-3, "jitter": 0.0, "measurement_loss": 0.0, "clock_drift": 0.0},
    "Quintic": {"start": ZERO, "goal": POSE, "duration": 1.0, "time": 0.0},
    "Ramp": {"start": ZERO, "goal": POSE, "duration": 1.0, "time": 0.0},
    "Sine": {"centre": ZERO, "amplitude": POSE, "frequency_hz": 1.0, "phase": 0.0},
    "Step": {"start": ZERO, "goal": POSE, "time": 0.0},
    "Signal": {"name": "x", "units": ["m", "m"], "shape": [2], "labels": ["a", "b"]},
    "Solver": {"integrator": "rodas3", "step": 1e-3, "substeps": 1, "rtol": 1e-6, "atol": 1e-9, "max_substeps": 100},
    "Start": {"q": POSE, "qd": ZERO},
    "Recording": {"every": 1, "what": "all", "reduce": []},
    "Inputs": {"wrench": [0, 0, 1, 0, 0, 0], "brake": None, "payload": None},
}  # fmt: skip
REFERENCES = ("Quintic", "Ramp", "Sine", "Step")
SCENARIO: dict[str, Any] = {  # fields of a scenario of two-link, flat: the part and its field
    "duration": 0.01, "command": POSE, "seed": 0, "start": None, "start.q": POSE, "start.qd": ZERO, "solver.step": 1e-3,
    "solver.integrator": "rk4", "solver.substeps": 1, "recording.every": 1, "inputs.wrench": [0, 0, 1, 0, 0, 0],
    "vary": {"upper_arm.mass_kg": 2.0},
}  # fmt: skip
LOOP: dict[str, Any] = {
    "loop.controller": None,
    "kp": POSE,
    "ki": 0.0,
    "limit": 1.0,
    "loop.reference": POSE,
    "loop.period": 1e-3,
    "loop.initial_command": ZERO,
}
PARTS = {"start": "Start", "solver": "Solver", "recording": "Recording", "inputs": "Inputs", "loop": "Loop"}
OTHERS: dict[str, dict[str, Any]] = {  # methods and functions, by what `_other` does with them
    "replace": {"gravity": [0, 0, -9.81]},
    "bind": {"q": {"shape": [2], "dtype": "float64", "fill": "normal", "layout": "plain", "seed": 0}, "lead": []},
    "threads": {"count": 2},
    "load": {"name_or_path": "two-link", "on_impossible": "error"},
    "show": {"q": POSE, "size": 120},
    "read_schedule": {"path": "torques.csv", "names": ["shoulder", "elbow"]},
    "compile": {"target": None, "vary": ["upper_arm.mass_kg"], "dtype": "float32"},
    "controller": {"position": POSE, "kp": 1.0},
}


@functools.cache
def arm(name: str) -> aw.Model:
    """A built-in arm."""
    return aw.load(name)


@functools.cache
def compiled(name: str, dtype: str) -> aw.CompiledArm:
    """Its kernels."""
    return aw.compile(arm(name), dtype=dtype)


@functools.cache
def functions() -> dict[str, list[str]]:
    """Names and arguments of the plain functions of an arm and one state."""
    found = {}
    for name in aw.__all__:
        value = getattr(aw, name)
        if inspect.isfunction(value) and value.__module__.split(".")[1] in ("dynamics", "kinematics", "actuators"):
            found[name] = [*inspect.signature(value).parameters][1:]
    return found


def good(name: str, arm_name: str) -> Any:
    """A good value of an argument of a plain function or kernel."""
    if name == "frame":
        return "hand" if arm_name == "two-link" else None
    return [0.1, -0.2, 1.0, 0.0, 0.0, 0.5] if name == "wrench" else [0.1 * (k + 1) for k in range(arm(arm_name).n)]


def _some_odd(arguments: dict[str, Any], rng: Random, n: int = 2) -> dict[str, Any]:
    """The arguments with one or two replaced by anything, sometimes a part of one."""
    arguments = dict(arguments)
    for name in rng.sample([*arguments], min(len(arguments), rng.choice((1, 1, 1, 2)))):
        value = arguments[name]
        if isinstance(value, list) and value and rng.random() < 0.2:
            arguments[name] = [odd_value(rng, n) if k == 0 else item for k, item in enumerate(value)]
        else:
            arguments[name] = odd_value(rng, n)
    return arguments


def make_function(rng: Random) -> Case:
    arm_name, target = rng.choice(ARMS), rng.choice([*functions()])
    arguments = {name: good(name, arm_name) for name in functions()[target]}
    return Case(
        "function", {}, {"target": target, "arm": arm_name, "arguments": _some_odd(arguments, rng, arm(arm_name).n)}
    )


def run_function(case: Case) -> None:
    model, arguments = arm(case.call["arm"]), {name: built(value) for name, value in case.call["arguments"].items()}
    with np.errstate(all="ignore"):  # NumPy's own notes of numbers that overflow: the caller sees inf and nan
        getattr(aw, case.call["target"])(model, **arguments)


def make_kernel(rng: Random) -> Case:
    arm_name, target = rng.choice(ARMS), rng.choice([*SIGNATURES])
    signature = SIGNATURES[target]
    names = [argument.name for argument in signature.inputs]
    if signature.optional and rng.random() < 0.3:
        names.append(signature.optional[0].name)
    arguments = {name: good(name, arm_name) for name in names}
    if rng.random() < 0.9:
        arguments = _some_odd(arguments, rng, arm(arm_name).n)
    call = {
        "target": target,
        "arm": arm_name,
        "dtype": rng.choice(("float64", "float64", "float32")),
        "arguments": arguments,
    }
    if rng.random() < 0.4:
        call["out"] = [odd_value(rng, arm(arm_name).n) for _ in signature.outputs]
    return Case("kernel", {}, call)


def run_kernel(case: Case) -> None:
    call = case.call
    arguments = {name: built(value) for name, value in call["arguments"].items()}
    if "out" in call:
        outputs = [built(value) for value in call["out"]]
        arguments["out"] = outputs[0] if len(outputs) == 1 else tuple(outputs)
    getattr(compiled(call["arm"], call["dtype"]), call["target"])(**arguments)


def make_object(rng: Random) -> Case:
    target = rng.choice([*OBJECTS])
    return Case("object", {}, {"target": target, "arguments": _some_odd(OBJECTS[target], rng)})


def run_object(case: Case) -> None:
    target = case.call["target"]
    value = BY_NAME[target](**{name: built(recipe) for name, recipe in case.call["arguments"].items()})
    if target in REFERENCES and not isinstance(value.time if target != "Sine" else value.phase, (aw.Batch, aw.Draw)):
        fields = vars(value).values()
        if not any(isinstance(field, (aw.Batch, aw.Draw)) for field in fields):
            with np.errstate(all="ignore"):
                value(0.5)


def make_scenario(rng: Random) -> Case:
    fields = dict(SCENARIO)
    if rng.random() < 0.4:
        del fields["command"]
        fields |= LOOP
    for name in rng.sample([*fields], rng.choice((1, 1, 2))):
        fields[name] = odd_value(rng)
    return Case("scenario-in-python", {}, {"fields": fields, "start": rng.random() < 0.02})


def run_scenario(case: Case) -> None:
    parts: dict[str, dict[str, Any]] = {}
    fields: dict[str, Any] = {}
    recipes = dict(case.call["fields"])
    gains = {name: built(recipes.pop(name)) for name in ("kp", "ki", "limit") if name in recipes}
    for name, recipe in recipes.items():
        part, _, field = name.partition(".")
        value = aw.JointPID(**gains) if name == "loop.controller" and recipe is None else built(recipe)
        if field:
            parts.setdefault(part, {})[field] = value
        elif name != "start" or recipe is not None:
            fields[name] = value
    for part, values in parts.items():
        fields.setdefault(part, getattr(aw, PARTS[part])(**values))
    scenario = aw.Scenario(arm("two-link"), **fields)
    if case.call["start"]:
        aw.simulation.Simulation(scenario)


def make_other(rng: Random) -> Case:
    target = rng.choice([*OTHERS])
    arguments = _some_odd(OTHERS[target], rng) if target != "show" or rng.random() < 0.3 else OTHERS[target]
    return Case("other", {"torques.csv": b"t,shoulder,elbow\n0,1,2\n"}, {"target": target, "arguments": arguments})


def run_other(case: Case) -> None:
    call, two_link = case.call, arm("two-link")
    values = {name: built(recipe) for name, recipe in call["arguments"].items()}
    actions: dict[str, Callable[[], Any]] = {
        "replace": lambda: two_link.replace(**values),
        "bind": lambda: compiled("two-link", "float64").bind("mass_matrix", **values),
        "threads": lambda: setattr(aw.compile(two_link), "threads", values["count"]),
        "load": lambda: aw.load(**values),
        "show": lambda: aw.show(two_link, "arm.png", **values),
        "read_schedule": lambda: aw.simulation.read_schedule(**values),
        "compile": lambda: aw.compile(two_link, **values),
        "controller": lambda: aw.Loop(aw.JointPID(kp=values["kp"]), values["position"]),
    }
    actions[call["target"]]()


CALLS: dict[str, tuple[float, Callable[[Random], Case], Callable[[Case], Any]]] = {
    "function": (300, make_function, run_function),
    "kernel": (100, make_kernel, run_kernel),
    "object": (300, make_object, run_object),
    "scenario-in-python": (20, make_scenario, run_scenario),
    "other": (10, make_other, run_other),
}

"""For each feature a small arm, or a scenario of one, that has it, and the same without it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import cache

import armwright as aw
from armwright.description.database import parse
from armwright.model import build_model
from simulation.plants import BRAKE, COGGING, CYLINDER, ELASTIC, LINE, LUGRE, STOPS, SUPPLY, THERMAL

LIMITS = {
    "position_rad": [-2.0, 2.0],
    "velocity_rad_per_s": 4.0,
    "acceleration_rad_per_s2": 60.0,
    "torque_n_m": 90.0,
    "voltage_v": 48.0,
    "current_a": 40.0,
}
ENDS = {**LIMITS, "position_rad": [-0.55, 2.0]}  # a run of `looped` goes beyond
MOTOR = {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 2e-4, "torque_constant_n_m_per_a": 0.06, "resistance_ohm": 0.8}
VISCOUS = {"viscous_n_m_s_per_rad": 0.8}
DRY = {**VISCOUS, "coulomb_positive_n_m": 2.0, "coulomb_negative_n_m": 2.0}
SMOOTH = {**DRY, "smoothing_rad_per_s": 0.05}
TABLE = {"torque_n_m": [1.0, 10.0, 60.0], "rows": [{"driving": [0.6, 0.75, 0.85]}]}
SIGMOID = {
    "law": "sigmoid",
    "viscous_n_m_s_per_rad": 0.8,
    "sigmoid_amplitude_n_m": 4.0,
    "sigmoid_slope_s_per_rad": 20.0,
    "sigmoid_shift_rad_per_s": 0.01,
}
ON_MOTOR = {
    "side": "motor",
    "viscous_n_m_s_per_rad": 5e-4,
    "coulomb_positive_n_m": 0.04,
    "coulomb_negative_n_m": 0.04,
    "smoothing_rad_per_s": 2.5,
}
LOADED = {
    **SMOOTH,
    "law": "load-dependent",
    "stribeck_torque_n_m": 3.0,
    "stribeck_speed_rad_per_s": 0.4,
    "stribeck_exponent": 1.5,
    "load_motor": 0.2,
    "load_external": 0.1,
    "load_motor_stribeck": 0.05,
    "load_external_stribeck": 0.08,
    "load_motor_quadratic_per_n_m": 1e-3,
    "load_external_quadratic_per_n_m": 2e-3,
}
FIRMWARE = {
    "period_s": 1e-3,
    "p": 32.0,
    "p_scale_per_rad": 0.166,
    "output_limit": 1.0,
    "goal_speed_rad_per_s": 5.0,
    "latency_periods": 1,
}
# Keys of the second joint, of its motor, and of the robot; where the arm without the feature has some of them, those too.
ARMS = {
    "coupled motors": {"motor": {"coupling": [{"joint": "joint0", "ratio": 10.0}]}},
    "gear efficiency": {"motor": {"gear_efficiency": 0.75}},
    "efficiency table": {"motor": {"gear_efficiency_table": TABLE}},
    "load coefficient": {"joint": {"friction": {**SMOOTH, "load_coefficient": 0.15}}, "bare": {"friction": SMOOTH}},
    "dry friction": {"joint": {"friction": DRY}},
    "smoothed friction": {"joint": {"friction": SMOOTH}},
    "friction by direction": {
        "joint": {"friction": {**SMOOTH, "coulomb_negative_n_m": 3.0}},
        "bare": {"friction": SMOOTH},
    },
    "friction offset": {"joint": {"friction": {**VISCOUS, "offset_n_m": 1.0}}},
    "Stribeck friction": {
        "joint": {"friction": {**SMOOTH, "stribeck_torque_n_m": 3.0, "stribeck_speed_rad_per_s": 0.1}},
        "bare": {"friction": SMOOTH},
    },
    "sigmoid friction": {"joint": {"friction": SIGMOID}},
    "LuGre friction": {
        "joint": {"friction": LUGRE},
        "bare": {
            "friction": {key: value for key, value in LUGRE.items() if key != "law" and not key.startswith("bristle")}
        },
    },
    "load-dependent friction": {
        "joint": {"friction": LOADED},
        "bare": {
            "friction": {key: LOADED[key] for key in (*SMOOTH, "stribeck_torque_n_m", "stribeck_speed_rad_per_s")}
        },
    },
    "motor-side friction": {"joint": {"friction": ON_MOTOR}},
    "heat": {"motor": {"thermal": THERMAL}},
    "friction by temperature": {
        "motor": {"thermal": THERMAL},
        "joint": {"friction": {**VISCOUS, "viscous_fall_k": 5.0}},
        "bare": {"motor": {**MOTOR, "thermal": THERMAL}},
    },
    "springs": {"joint": {"spring": LINE}},
    "cylinders": {"robot": {"cylinders": [{**CYLINDER, "force_n": 20.0, "stiffness_n_per_m": 40.0}]}},
    "elasticity": {"joint": {"elasticity": ELASTIC}},
    "play": {"joint": {"elasticity": {**ELASTIC, "backlash_rad": 0.01}}, "bare": {"elasticity": ELASTIC}},
    "kinematic error": {
        "joint": {"elasticity": {**ELASTIC, "error_rad": 1e-3, "error_phase_rad": 0.2}},
        "bare": {"elasticity": ELASTIC},
    },
    "stops": {"joint": {"stops": STOPS, "limits": ENDS}, "bare": {"limits": ENDS}},
    "brakes": {"joint": {"brake": BRAKE}},
    "cogging": {"motor": {"cogging": COGGING}},
    "inductance": {"motor": {"inductance_h": 5e-3}},
    "current loop": {
        "command": "current",
        "motor": {"inductance_h": 5e-3, "current_loop_hz": 100.0},
        "bare": {"motor": {**MOTOR, "inductance_h": 5e-3}},
    },
    "coasting": {"command": "voltage", "motor": {"pwm": "coast"}},
    "dead zone": {"command": "voltage", "motor": {"dead_zone_v": 1.5}},
    "servo": {"joint": {"command": "position", "firmware": FIRMWARE}},
    "servo counts": {
        "joint": {"command": "position", "firmware": {**FIRMWARE, "counts_per_turn": 4096}},
        "bare": {"command": "position", "firmware": FIRMWARE},
    },
    "supply": {"robot": {"supply": {**SUPPLY, "voltage_v": 7.0, "chopper_voltage_v": 8.0}}},
    "mimic joints": {
        "third": {
            "mimic": {"joint": "joint1", "multiplier": 0.5, "offset_rad": 0.1},
            "motor": None,
            "limits": None,
            "command": None,
        }
    },
    "screw joints": {"joint": {"type": "helical", "pitch_m_per_rad": 0.05}},
    "branches": {"third": {"parent": "rod0"}, "robot": {"tip": "rod2"}},
}


UNSERVED = {"screw joints", "coupled motors"}  # for which a record takes no firmware of servos


@cache
def base(command: str = "voltage") -> aw.Model:
    """Two rods that turn about level axes, one across the other."""
    return _built(command)


def arms(feature: str, command: str = "voltage") -> tuple[aw.Model, aw.Model]:
    """The arm with a feature, and the arm without it; drives take that command but where the feature goes with another."""
    if feature == "payload":
        return base(command).with_payload(0.5, [0.1, 0.0, 0.0], [1e-3] * 3), base(command)
    if feature == "locked joints":
        third = _built(command, third={})
        return third.with_locked({"joint2": 0.4}), third.with_locked({"joint2": 0.1})
    case = ARMS[feature]
    command = case.get("command", command)
    if command == "position" and feature in UNSERVED:
        command = "voltage"
    keys = {key: case[key] for key in ("motor", "joint", "robot", "third") if key in case}
    if feature == "mimic joints":
        without = _built(command, third={"limits": LIMITS})
    elif feature == "branches":
        without = _built(command, third={}, robot={"tip": "rod2"})
    else:
        without = _built(command, joint=case["bare"]) if "bare" in case else base(command)
    return _built(command, **keys), without


TOGETHER = (  # features of the second joint that go with one another
    *("gear efficiency", "smoothed friction", "load coefficient", "friction by direction", "friction offset"),
    *("Stribeck friction", "heat", "friction by temperature", "springs", "cylinders", "elasticity", "stops", "brakes"),
    *("cogging", "inductance", "supply"),
)


def together(features, command: str = "voltage") -> aw.Model:
    """The arm with all of some features."""
    keys = {"joint": {}, "motor": {}, "robot": {}}
    for feature in features:
        for part, values in ARMS[feature].items():
            for key, value in values.items() if part in keys else ():
                known = keys[part].get(key)
                keys[part][key] = {**known, **value} if key == "friction" and known else value
    return _built(command, **keys)


def _built(command="voltage", motor=None, joint=None, robot=None, third=None) -> aw.Model:
    joints, links = [], []
    for k in range(2 if third is None else 3):
        frame = {"xyz_m": [0.5 if k else 0.0, 0.0, 0.0], "rpy_rad": [0.0, 0.0, 0.0]}
        own = {"command": command, "motor": deepcopy(MOTOR), "friction": VISCOUS, "limits": LIMITS}
        place = {"name": f"joint{k}", "type": "revolute", "parent": f"rod{k - 1}" if k else "base", "child": f"rod{k}"}
        own |= {**place, "frame": frame, "axis": [0.0, 1.0, 0.0] if k != 1 else [0.0, 0.8, 0.6]}
        if k == 1:
            own = {**own, **(joint or {})}
            own["motor"] = {**own["motor"], **(motor or {})}
        if k == 2:
            own = {key: value for key, value in {**own, **(third or {})}.items() if value is not None}
        if own.get("command") == "position":
            own = {"firmware": {**FIRMWARE, "p": 16.0}, **own}
        joints.append(own)
        tensor = {"xx": 0.01, "xy": 0.0, "xz": 0.0, "yy": 0.1, "yz": 0.0, "zz": 0.1}
        mass = 0.4 if k == 2 else 2.0
        links.append({"name": f"rod{k}", "mass_kg": mass, "com_m": [0.25, 0.0, 0.02], "inertia_kg_m2": tensor})
    record = {
        "name": "chain",
        "source": "definition",
        "gravity_m_s2": [0.0, 0.0, -9.81],
        "joints": joints,
        "links": links,
    }
    return build_model(parse({**record, **(robot or {})}, "chain"))


START, GOAL = [0.2, -0.5, 0.1], [0.3, -0.6, 0.2]


class Wave:
    """A smooth motion of all joints from where `looped` starts, at rest; it has an end."""

    def __init__(self, n: int, duration: float = 4.0):
        self.n, self.duration = n, duration

    def __call__(self, t):
        s = aw.scalar
        waves = [(0.35 - 0.05 * k, 2.3 + k, 0.15, 4.1 + 1.7 * k) for k in range(self.n)]
        return s.array(
            [START[k] + a * (1.0 - s.cos(w * t)) + b * (1.0 - s.cos(v * t)) for k, (a, w, b, v) in enumerate(waves)]
        )


BODY = aw.Payload(0.1, 0.5, com=[0.1, 0.0, 0.0], inertia=[1e-3] * 3)


def move(n: int, payloads=()) -> aw.trajectories.Joined:
    """A motion from where `looped` starts and back, which may take up a body."""
    there, back = START[:n], [q + 0.1 for q in START[:n]]
    parts = [
        aw.trajectories.Quintic(there, back, duration=0.1),
        aw.trajectories.Quintic(back, there, duration=0.1, time=0.1),
    ]
    return aw.trajectories.Joined(parts, payloads)


GAINS = {"voltage": (120.0, 6.0), "current": (60.0, 4.0), "torque": (600.0, 40.0), "position": (1.0, 0.0)}


def looped(arm: aw.Model, duration: float = 0.2, **loop) -> aw.Scenario:
    """A scenario in which a PD controller moves the arm to a pose."""
    kp, kd = zip(*(GAINS[body.drive.command] for body in arm.coordinates), strict=True)
    law = aw.JointPID(list(kp), 0.0, list(kd))
    parts = {"reference": GOAL[: arm.n], "period": 1e-3, "timing": aw.Timing("one-tick"), **loop}
    return aw.Scenario(arm, duration=duration, loop=aw.Loop(law, **parts), start=START[: arm.n])


def commanded(arm: aw.Model, duration: float = 0.2) -> aw.Scenario:
    """A scenario in which constant commands move the arm."""
    size = 2.0 if arm.coordinates[0].drive.command == "current" else 6.0
    return aw.Scenario(arm, duration=duration, command=[size, -size, size][: arm.n], start=START[: arm.n])


def _with(arm, **loop):
    return looped(arm, **loop), looped(arm)


def _timed(arm, **timing):
    return _with(arm, timing=aw.Timing("one-tick", **timing))


def _sensed(arm, without: aw.Sensors | None = None, **sensors):
    bare = looped(arm) if without is None else looped(arm, sensors=without)
    return looped(arm, sensors=aw.Sensors(**sensors)), bare


def _given(arm, **inputs):
    return replace(looped(arm), inputs=aw.Inputs(**inputs)), looped(arm)


def _rates(arm):
    made = looped(arm)
    law = aw.Cascade(position_kp=15.0, speed_kp=8.0, speed_ki=40.0)
    return tuple(
        replace(made, loop=replace(made.loop, controller=each)) for each in (replace(law, position_every=4), law)
    )


def _served(arm, **inputs):
    made = looped(arms("servo", arm.coordinates[0].drive.command)[0])
    return replace(made, inputs=aw.Inputs(**inputs)), made


def _braked(arm):
    arm = _built(arm.coordinates[0].drive.command, joint={"brake": BRAKE})
    return replace(looped(arm), inputs=aw.Inputs(brake=[1.0])), looped(arm)


SCENARIOS = {  # of an arm: the scenario with a feature, and the one without
    "supply over time": lambda arm: _given(arm, supply=aw.Schedule([0.0, 0.1], [[1.0], [0.5]], ["supply"])),
    "servos off": lambda arm: _served(arm, enabled=aw.Schedule([0.0, 0.1], [[1.0], [0.0]], ["joint1"])),
    "commands over time": lambda arm: (commanded(arm), looped(arm)),
    "pose": lambda arm: _with(arm, reference=[0.32, -0.58]),
    "schedule of poses": lambda arm: _with(
        arm, reference=aw.Schedule([0.0, 0.1], [[0.2, -0.5], [0.25, -0.6]], ["joint0", "joint1"])
    ),
    "motion": lambda arm: _with(arm, reference=move(2)),
    "grips of a motion": lambda arm: (looped(arm, reference=move(2, [BODY])), looped(arm, reference=move(2))),
    "delays": lambda arm: _timed(arm, command_delay=1.4e-3, measurement_delay=0.7e-3),
    "jitter": lambda arm: _timed(arm, jitter=5e-3),
    "lost samples": lambda arm: _timed(arm, measurement_loss=0.2, command_loss=0.2),
    "clock drift": lambda arm: _timed(arm, clock_drift=0.01),
    "loops at several rates": _rates,
    "encoder counts": lambda arm: _sensed(arm, counts=4096),
    "sensor noise": lambda arm: _sensed(arm, position_noise=1e-3),
    "speed filter": lambda arm: _sensed(arm, aw.Sensors(velocity="difference"), velocity="filtered", cutoff_hz=40.0),
    "command filter": lambda arm: _with(arm, command_filter=aw.CommandFilter(rate=300.0, limit=11.0)),
    "wrench": lambda arm: _given(arm, wrench=[0.0, 0.0, 5.0, 0.0, 1.0, 0.0]),
    "applied brakes": _braked,
    "payloads over time": lambda arm: _given(arm, payload=[BODY]),
    "moving start": lambda arm: (replace(looped(arm), start=aw.Start(START[:2], [0.5] * 2)), looped(arm)),
    "lanes": lambda arm: (replace(looped(arm), vary={"rod1.mass_kg": aw.Batch([1.8, 1.9, 2.1, 2.2])}), looped(arm)),
}

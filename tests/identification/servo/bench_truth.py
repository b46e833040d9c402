"""Servos on a bench by the tests' own integration of the published equations, all logs of all servos side by side."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from armwright.identification.servo.bench import ServoLoop
from armwright.identification.servo.bench_log import BenchLog

SERVOS = Path(__file__).resolve().parents[4] / "shared" / "data" / "servos"
GRAVITY, COUNT = 9.80665, 2 * np.pi / 4096
TURN, STEP, DURATION = 1e-3, 1e-5, 6.0  # of the loop, of the integration, of a log [s]


@dataclass(frozen=True)
class Bench:
    """A servo and what it swings: kp, and (mass, length, mass of the rod), of logs to fit and of logs held out."""

    parameters: str
    loop: ServoLoop
    volts: float
    p: tuple[float, float]
    loads: tuple[tuple[float, float, float], ...]
    held_out: tuple[float, tuple[float, float, float]]


LOOPS = {
    "mx": ServoLoop(0.158, 0.9625),
    "xl320": ServoLoop(0.05048199),
    "xl330": ServoLoop(4096 / (2 * np.pi) / 256 / 885),
    "sts": ServoLoop(0.166, 0.97, goal_speed_rad_per_s=5.215534),
    "erob": ServoLoop(0.02, 0.6),
    "erob current": ServoLoop(1.0, 12.0, output="current"),
}
_MX, _EROB = LOOPS["mx"], ((12.0, 0.5, 1.5), (6.0, 0.4, 1.2))
_XL320 = ((0.1, 0.1, 0.02), (0.05, 0.1, 0.02))
_XL330 = ((0.49, 0.1, 0.04), (0.3, 0.1, 0.04))
_STS = ((1.13, 0.12, 0.1), (0.5, 0.12, 0.1))
BENCHES = {
    "mx64": Bench("mx64/m6", _MX, 15.0, (4, 16), ((2.0, 0.15, 0.2), (1.0, 0.1, 0.15)), (8, (1.5, 0.2, 0.25))),
    "mx106": Bench("mx106/m6", _MX, 15.0, (4, 16), ((3.0, 0.2, 0.3), (1.5, 0.15, 0.2)), (8, (2.2, 0.2, 0.3))),
    "xl320": Bench("xl320/m6", LOOPS["xl320"], 7.5, (8, 32), _XL320, (16, (0.08, 0.12, 0.03))),
    "xl330": Bench("xl330/m6", LOOPS["xl330"], 7.4, (200, 800), _XL330, (400, (0.3, 0.15, 0.05))),
    "erob80_50": Bench("erob80_50/m6", LOOPS["erob"], 48.0, (16, 64), _EROB, (32, (9.0, 0.5, 1.5))),
    "erob80_100": Bench("erob80_100/m6", LOOPS["erob current"], 48.0, (15, 60), _EROB, (30, (9.0, 0.5, 1.5))),
    "sts3215": Bench("feetech_sts3215_7_4V/m1", LOOPS["sts"], 7.4, (8, 32), _STS, (16, (0.8, 0.15, 0.12))),
}


def cubic(t, begin, end, a, b):
    s = np.clip((t - begin) / (end - begin), 0.0, 1.0)
    return a + (b - a) * s * s * (3.0 - 2.0 * s)


def up_and_down(t):
    return cubic(t, 0.0, 2.5, 0.0, np.pi / 2) + cubic(t, 3.0, 5.5, 0.0, -0.2 * np.pi / 2)


MOTIONS = {
    "sin_time_square": (lambda t: np.sin(t * t), lambda t: np.ones_like(t)),
    "lift_and_drop": (lambda t: cubic(t, 0.0, 2.0, 0.0, -np.pi / 2), lambda t: (t < 2.0).astype(float)),
    "up_and_down": (up_and_down, lambda t: np.ones_like(t)),
    "sin_sin": (lambda t: np.sin(t) * np.pi / 2 + np.sin(5 * t) * 0.5 * np.sin(2 * t), lambda t: np.ones_like(t)),
}


def published(name):
    """Numbers of M6 of a published set; of a smaller model, 0 where it has none."""
    path = SERVOS / f"{name}.json"
    if not path.is_file():
        pytest.skip(f"the published parameters are not here: {path}")
    p = json.loads(path.read_text(encoding="utf-8"))
    both, still = p.get("load_friction_base", 0.0), p.get("load_friction_stribeck", 0.0)
    return {
        "kt": p["kt"],
        "R": p.get("R", np.nan),
        "J": p["armature"],
        "viscous": p["friction_viscous"],
        "coulomb": p["friction_base"],
        "fall": p.get("friction_stribeck", 0.0),
        "stribeck_speed": p.get("dtheta_stribeck", 1.0),
        "exponent": p.get("alpha", 1.0),
        "load_motor": p.get("load_friction_motor", both),
        "load_external": p.get("load_friction_external", both),
        "load_motor_still": p.get("load_friction_motor_stribeck", still),
        "load_external_still": p.get("load_friction_external_stribeck", still),
        "square_motor": p.get("load_friction_motor_quad", 0.0),
        "square_external": p.get("load_friction_external_quad", 0.0),
        "q_offset_rad": p.get("q_offset", 0.0),
    }


def bench_logs(seed=0, counts_in_loop=False, names=tuple(BENCHES)):
    """Logs to fit and logs held out, by servo: what the equations give, at rows every 5 ms with 1 ms of jitter, in counts."""
    cases = []
    for name in names:
        bench = BENCHES[name]
        design = [(p, load, True) for p in bench.p for load in bench.loads]
        design.append((*bench.held_out, False))
        cases += [(name, bench, motion, *each) for each in design for motion in MOTIONS]
    rng = np.random.default_rng(seed)
    n, rows = len(cases), round(DURATION / 5e-3)
    times = 5e-3 * np.arange(rows) + rng.uniform(0.0, 1e-3, (n, rows))
    times[:, 0] = 0.0
    goals = np.array([MOTIONS[case[2]][0](t) for case, t in zip(cases, times, strict=True)])
    on = np.array([MOTIONS[case[2]][1](t) for case, t in zip(cases, times, strict=True)])
    volts = np.array([case[1].volts for case in cases])[:, None] * (1.0 - 0.06 * np.sin(2.0 * times) ** 2)
    positions = _integrated(cases, times, goals, on, volts, counts_in_loop)
    counted = np.floor(positions / COUNT + 0.5) * COUNT
    found = {name: ([], []) for name in names}
    for k, (name, _, motion, p, (mass, length, rod), fitted) in enumerate(cases):
        of = f"{name}_{motion}_kp{p}_{mass}kg"
        log = BenchLog(of, times[k], counted[k], goals[k], on[k], volts[k], float(p), mass, length, rod, name)
        found[name][0 if fitted else 1].append(log)
    return found


def _integrated(cases, times, goals, on, volts, counts_in_loop):
    """Positions at the rows (lanes, rows): steps of `STEP` in which the level is held and the speed goes no further than to 0."""
    sets = [published(case[1].parameters) for case in cases]
    p = {key: np.array([each[key] for each in sets]) for key in sets[0]}
    loops = [case[1].loop for case in cases]
    kp = np.array([case[3] * loop.p_scale_per_rad for case, loop in zip(cases, loops, strict=True)])
    limit = np.array([loop.output_limit for loop in loops])
    slew = np.array([loop.goal_speed_rad_per_s or 1e9 for loop in loops]) * TURN
    current = np.array([loop.output == "current" for loop in loops])
    mass, length, rod = np.array([case[4] for case in cases]).T
    weight, inertia = (mass + rod / 2) * GRAVITY * length, (mass + rod / 3) * length**2 + p["J"]
    kt, slope = p["kt"], np.where(current, 0.0, p["kt"] ** 2 / np.where(current, 1.0, p["R"]))
    q, v = np.zeros(len(cases)), np.zeros(len(cases))
    goal, found = q.copy(), np.zeros(times.shape)
    lanes, row = np.arange(len(cases)), np.zeros(len(cases), dtype=int)
    written = np.ones(len(cases), dtype=int)  # the next row to be stored; the first is 0 at rest
    inside = round(TURN / STEP)
    for tick in range(round(DURATION / TURN) + 10):
        t = tick * TURN
        more = np.minimum(row + 1, times.shape[1] - 1)
        while (later := (times[lanes, more] <= t + 1e-12) & (more > row)).any():
            row = np.where(later, more, row)
            more = np.minimum(row + 1, times.shape[1] - 1)
        active = on[lanes, row]
        wanted = np.where(active > 0, goals[lanes, row], q)
        goal = np.where(active > 0, goal + np.clip(wanted - goal, -slew, slew), q)
        seen = np.floor(q / COUNT + 0.5) * COUNT if counts_in_loop else q
        output = active * np.clip(kp * (goal - seen), -limit, limit)
        given = np.where(current, kt * output, kt * output * volts[lanes, row] / np.where(current, 1.0, p["R"]))
        # speed and position by the trapezoidal rule, gravity in the middle of the step
        a = 0.5 * STEP * (active * slope + p["viscous"]) / inertia
        for _ in range(inside):
            tau_m, tau_e = given - active * slope * v, -weight * np.sin(q + 0.5 * STEP * v + p["q_offset_rad"])
            s = np.exp(-((np.abs(v) / p["stribeck_speed"]) ** p["exponent"]))
            level = p["coulomb"] + np.abs(p["load_external"] * tau_e - p["load_motor"] * tau_m)
            m, e = np.abs(tau_m), np.abs(tau_e)
            square = np.where(m > e, p["square_external"] * e * e, np.where(m < e, p["square_motor"] * m * m, 0.0))
            still = p["fall"] + np.abs(p["load_external_still"] * tau_e - p["load_motor_still"] * tau_m)
            level = level + s * (still + np.where(tau_m * tau_e < 0.0, square, 0.0))
            free, lost = (
                ((1.0 - a) * v + STEP * (given + tau_e) / inertia) / (1.0 + a),
                STEP * level / inertia / (1.0 + a),
            )
            slow, v = v, np.sign(free) * np.maximum(np.abs(free) - lost, 0.0)
            before, q = q, q + 0.5 * STEP * (slow + v)
            t += STEP
            at = times[lanes, np.minimum(written, times.shape[1] - 1)]
            due = (at <= t) & (written < times.shape[1])
            if due.any():
                k = np.flatnonzero(due)
                found[k, written[k]] = before[k] + (q[k] - before[k]) * (at[k] - t + STEP) / STEP
                written[k] += 1
    assert (written == times.shape[1]).all()
    return found

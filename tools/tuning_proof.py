"""Tuned gains of lwa4p's cascade at 4 ms against their designed start and two cascades by hand, over lanes nobody tuned in.

    python tools/tuning_proof.py

By hand are Kessler's symmetric optimum of the outstretched arm with the position gain of Leonhard's damping 1/√2, the same slowed
until its commands are as quiet as the next, and cautious, quiet gains that an engineer would set one joint after the other. One
tuning starts from designed gains; no objective may get
worse than there, and no joint noisier than with the quiet gains. All follow the same motion with masses within ±30 %, friction
within a factor of two, start and goal moved by up to 0.3 rad, encoders of 0.001° and commands one period late. [Kessler1958],
[Leonhard2001]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq

import armwright as aw
from armwright.control.analysis.noise import noise_gain
from armwright.tuning.lanes import scenario_lanes

PERIOD, LAG = 4e-3, 8e-3  # [s] of the bus; half a period of hold, one of delay, half of the speed's difference
MOVES = (0.5, -0.4, 0.5, 0.6, -0.6, 0.6)  # [rad]
DRAWS = {"mass": 0.3, "friction": 2.0, "poses": 0.3}
OBJECTIVES = {"rms_error": 1.0, "peak_error": 1.0, "noise_gain": 0.5}
GAINS = {"position_kp": 6.0, "speed_kp": 12.0, "speed_ki": 8.0}  # factors to either side
QUIETER = 0.97  # of the noise gain by hand: room for poses between those that are watched
BY_HAND = aw.Cascade(
    position_kp=8.0,
    speed_kp=np.array([14.0, 16.0, 14.0, 10.0, 1.2, 0.9]),
    speed_ki=np.array([28.0, 32.0, 28.0, 20.0, 2.4, 1.8]),
    speed_feedforward=1.0,
)


def scenario(law: Any = BY_HAND) -> aw.Scenario:
    """The arm on its bus, along a motion of all joints."""
    start = np.array([0.0, 0.4, -0.6, 0.0, 0.5, 0.0])
    motion = aw.trajectories.Quintic(start=start, goal=start + np.array(MOVES), duration=1.0)
    loop = aw.Loop(
        law,
        reference=motion,
        period=PERIOD,
        timing=aw.Timing(preset="one-tick"),
        sensors=aw.Sensors(counts=360_000.0, side="link", velocity="difference"),
    )
    return aw.Scenario(aw.load("lwa4p"), duration=1.4, start=start, loop=loop)


def textbook(lag: float = LAG) -> aw.Cascade:
    """Kessler's symmetric optimum of each joint of the outstretched arm; nobody looked at margins or other poses.

    Args:
        lag: that it is designed for [s]; a longer one makes the loops slower.
    """
    arm = scenario().arm
    inertia = np.diag(aw.mass_matrix(arm, np.zeros(arm.n)))
    force = np.array([body.drive.gear_ratio * body.drive.torque_constant for body in arm.coordinates])  # [N m/A]
    speed = inertia / force / (2.0 * lag)
    return aw.Cascade(
        position_kp=1.0 / (8.0 * lag), speed_kp=speed, speed_ki=speed / (4.0 * lag), speed_feedforward=1.0
    )


def quiet_textbook() -> aw.Cascade:
    """The textbook's cascade, slowed until its commands are on average as quiet as those by hand."""
    wanted = noise_gains(BY_HAND).mean()
    return textbook(brentq(lambda lag: noise_gains(textbook(lag)).mean() - wanted, LAG, 3.0 * LAG, xtol=1e-5))


def noise_gains(law: Any) -> np.ndarray:
    """(n,) noise gain of each joint's command, the largest over the extreme poses [A/rad]."""
    loop = aw.loops.LinearLoop(scenario(law))
    inertias = aw.loops.joint_inertias(loop.plant.arm, 2000, 0)
    q = inertias.q[inertias.extremes()]
    return np.sqrt((noise_gain(loop, q).command ** 2).sum(axis=-1)).max(axis=0)


def judged(laws: dict[str, Any], lanes: int, seed: int) -> dict[str, dict[str, float]]:
    """Mean over joints and lanes of each objective, by law, in lanes of a seed that was not tuned with."""
    found: dict[str, dict[str, float]] = {}
    for name, law in laws.items():
        every = scenario_lanes(scenario(law), DRAWS, lanes, seed)
        keep = aw.Recording(what="none", reduce=("rms_error", "peak_error", "saturation"))
        run = aw.simulate(replace(every, recording=keep))
        loop = aw.loops.LinearLoop(scenario(law))
        inertias = aw.loops.joint_inertias(loop.plant.arm, 2000, 0)
        q = inertias.q[inertias.extremes()]
        slopes = loop.slopes(q)
        found[name] = {
            "rms error [mrad]": 1e3 * float(run.rms_error.mean()),
            "peak error [mrad]": 1e3 * float(run.peak_error.mean()),
            "worst lane's rms [mrad]": 1e3 * float(run.rms_error.mean("joint").max()),
            "noise gain [A/rad]": float(noise_gains(law).mean()),
            "keeps the margins": float(loop.keeps(slopes, 2.0, np.radians(30.0)).mean()),
        }
    return found


def main() -> None:
    """Tunes, judges and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lanes", type=int, default=24)
    parser.add_argument("--generations", type=int, default=60)
    parser.add_argument("--start", default="pole-placement", help="method of design")
    parser.add_argument("--held-out", type=int, default=200, help="lanes of another seed that judge")
    asked = parser.parse_args()
    began = time.perf_counter()
    result = aw.tuning.tune(
        scenario(), GAINS, start=asked.start, draws=DRAWS, objectives=OBJECTIVES, lanes=asked.lanes,
        limits={"noise_gain": QUIETER * noise_gains(BY_HAND)},
        search=aw.tuning.Search(generations=asked.generations, improve_each=True),
    )  # fmt: skip
    print(*result.sentences(), sep="\n")
    print(f"{time.perf_counter() - began:.0f} s")
    print(result.tables()[0])
    start = replace(result.scenario.controller, **result.start)
    laws = {"textbook": textbook(), "quiet textbook": quiet_textbook(), "by hand": BY_HAND, "designed": start}
    laws["tuned"] = result.scenario.controller
    table = judged(laws, asked.held_out, seed=1)
    heads = list(next(iter(table.values())))
    print("", *heads, sep=" | ")
    for name, row in table.items():
        print(name, *(f"{value:.3g}" for value in row.values()), sep=" | ")


if __name__ == "__main__":
    main()

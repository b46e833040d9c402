"""Stick-slip behind a soft spring, with friction that falls with the speed: beside a solution that lands on every event."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import armwright as aw
from armwright.model.drive import Elasticity
from simulation.sticking import block, dry

MASS, KINETIC, STATIC = 1.0, 1.0, 2.0
DURATION = 4.0


def reference(stiffness, damping, rotor, push, speed, times):
    """Position and speed of a block and of the motor behind its spring, (times, 4); all start at 0, and none turns back.

    The block waits until the spring pulls with the static level, then slides until it stands.
    """

    def spring(state):
        return stiffness * (state[2] - state[0]) + damping * (state[3] - state[1])

    def rates(t, state, slides):
        friction = KINETIC + (STATIC - KINETIC) * np.exp(-((state[1] / speed) ** 2))
        moved = [state[1], (spring(state) - friction) / MASS] if slides else [0.0, 0.0]
        return [*moved, state[3], (push - spring(state)) / rotor]

    rows, t, state, slides = np.zeros((len(times), 4)), 0.0, np.zeros(4), False
    while t < times[-1]:
        begin = t

        def ends(t, state, slides, begin=begin):
            if slides:
                return state[1] if t > begin + 1e-6 else 1.0
            return STATIC - spring(state)

        ends.__dict__.update(terminal=True, direction=-1)
        exact = {"rtol": 1e-11, "atol": 1e-14, "method": "DOP853", "max_step": 2e-3}
        part = solve_ivp(rates, (t, times[-1]), state, events=ends, dense_output=True, args=(slides,), **exact)
        here = (times >= t) & (times <= part.t[-1])
        rows[here] = part.sol(times[here]).T
        t, state, slides = part.t[-1], part.y[:, -1], not slides
        state[1] = 1e-13 if slides else 0.0  # at the break its acceleration is 0 too
    return rows


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("stiffness", "damping", "rotor", "push", "speed"),
    [
        (
            100.0,
            0.0,
            1e4,
            300.0,
            1e-2,
        ),  # a slow pull, as of a belt, and friction that falls within a part of the slips' speed
        (100.0, 1.0, 1e4, 100.0, 1e-4),  # and that falls at once
        (100.0, 0.1, 30.0, 2.0, 2e-2),  # a motor that swings
    ],
)
def test_slips_behind_a_soft_spring(stiffness, damping, rotor, push, speed):
    """Within 1e-3 of each range by default steps; what comes loose late by a little comes too late by all that follows."""
    friction = dry(KINETIC, stribeck=STATIC, stribeck_speed=speed)
    model = block(MASS, friction=friction, rotor_inertia=rotor, elasticity=Elasticity(stiffness, damping))
    run = aw.simulate(aw.Scenario(model, DURATION, command=[push]))
    exact = reference(stiffness, damping, rotor, push, speed, run.time.values)
    rows = np.hstack([run[name].values.reshape(-1, 1) for name in ("q", "qd", "motor_q", "motor_qd")])
    assert (exact[:, 1] >= 0.0).all()
    assert (np.diff((exact[:, 1] > 0.0).astype(int)) > 0).sum() >= 2  # slips
    assert (np.abs(rows - exact).max(axis=0) / np.ptp(exact, axis=0) < 5e-4).all()
    assert run.steps_tried < 1.2e3 * DURATION

"""Speed of identification as ratios of processor times within one run, so that neither the machine nor other work on it counts.

The yardstick is Pinocchio's regressor of six joints in a loop, with NumPy's product of each state added up.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

import armwright as aw
from armwright.identification.arm.equations import equations_of, stacked
from armwright.identification.arm.samples import Samples
from armwright.identification.arm.torque_model import torque_model
from identification.arm.simulated_log import write_log
from identification.motor_truth import write_log as write_motor_log
from identification.real_logs import DC_MOTOR, log_of

ROWS = 45_000  # of a TX40's log of 9 s at 5 kHz
PART = 1_500  # of them in one go


def seconds(work: Callable[[], object]) -> float:
    """Processor time of all threads."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


@pytest.fixture(scope="module")
def yardstick():
    """Does the sums of `PART` states, by Pinocchio from Python."""
    pin = pytest.importorskip("pinocchio", exc_type=ImportError)
    model = pin.buildSampleModelManipulator()
    data, states = model.createData(), np.random.default_rng(0).normal(size=(4, PART, 6))
    assert model.nv == 6

    def loop() -> np.ndarray:
        total = np.zeros((61, 61))
        for q, qd, qdd, tau in zip(*states, strict=True):
            values = np.column_stack([pin.computeJointTorqueRegressor(model, data, q, qd, qdd), tau])
            total += values.T @ values
        return total

    return loop


def test_triangular_factors_are_twice_as_fast_as_pinocchios_loop(yardstick):
    """The two take turns, and the least time of each counts: the one that other work has disturbed least."""
    model = torque_model(aw.load("lwa4p"), friction=(), lacks=("rotors",))
    samples = Samples("states", 0, np.arange(6.0 * PART), *np.random.default_rng(0).normal(size=(4, 6 * PART, 6)))

    def ours() -> None:
        stacked(equations_of([samples], model).factors, len(model))

    ours()  # compiles
    peer, own = np.array([[seconds(yardstick), seconds(ours)] for _ in range(8)]).min(axis=0)
    assert 6 * peer > 2 * own


@pytest.mark.study
def test_the_pipeline_and_a_motor_take_no_longer_than_eleven_loops(yardstick, tmp_path, monkeypatch):
    """Log to record, and a motor from 16 starts: 5 s each at most, where the loop over `ROWS` states takes 0.45 s (Zen 4).

    The motor's includes all compiling.
    """
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", "")
    arm, path = aw.load("lwa4p"), write_log(tmp_path, aw.load("lwa4p"), seconds=9.0, rate=5000.0)
    motor = write_motor_log(tmp_path, 0, name="motor")

    def pipeline() -> None:
        aw.identification.identify_arm(aw.identification.read_log(path), arm).write(tmp_path / "identified.toml")

    pipeline()  # compiles
    assert (
        loops(
            lambda: aw.identification.identify_motor(motor, search=aw.identification.MotorSearch(starts=16)), yardstick
        )
        < 11
    )
    assert loops(pipeline, yardstick) < 11


@pytest.mark.study
def test_a_measured_motor_takes_no_longer_than_two_loops(yardstick, tmp_path):
    """4093 rows of a PRBS in less than 1 s, compiled code at hand."""
    log = aw.identification.read_log(log_of(tmp_path, "dc_motor", DC_MOTOR))
    aw.identification.identify_motor(log)  # compiles
    assert loops(lambda: aw.identification.identify_motor(log), yardstick) < 2.2


def loops(work: Callable[[], object], yardstick: Callable[[], object]) -> float:
    """Time of `work` in that of the loop over `ROWS` states: the least of three, each beside a loop of its own."""

    def ratio() -> float:
        own = seconds(work)
        return own / seconds(lambda: [yardstick() for _ in range(ROWS // PART)])

    return min(ratio() for _ in range(3))

"""The log of a capture: what an arm in another process measured is what `identify arm` and `validate` read."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import LogError
from armwright.twin.serial.arm_servos import ArmServos, ServoFit, ServoSettings
from armwright.twin.serial.capture import capture, plan_capture
from armwright.twin.serial.servo_arm import Line
from twin.serial.test_capture import Descriptor

if sys.platform == "win32":
    pytest.skip("pseudo-terminals need Linux or macOS", allow_module_level=True)

LONG, PERIOD = 30.0, 0.02


@pytest.fixture(scope="module")
def arm():
    return aw.load("so101")


@pytest.fixture
def port(tmp_path):
    """An SO-101 in lock-step, in a process of its own."""
    path = tmp_path / "port"
    words = ["twin", "so101", "--serial", path, "--period", PERIOD, "--tick", "sync-write:42", "--patience", LONG]
    process = subprocess.Popen([sys.executable, "-m", "armwright", *map(str, words)], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        while "servos on" not in (line := process.stdout.readline()):
            assert line
        yield Descriptor(path)
    finally:
        process.kill()
        process.communicate()


def swinging(arm):
    """Through ten poses all over the arm's range, a second for each."""
    low, high = np.array([body.limits.position for body in arm.coordinates]).T
    away = 0.55 * 0.5 * (high - low) * np.random.default_rng(3).uniform(-1.0, 1.0, (10, arm.n))
    return aw.trajectories.Waypoints([np.zeros(arm.n), *(0.5 * (low + high) + away)], times=list(np.arange(11.0)))


class Clock:
    """Time of lock-step: none passes but by waiting."""

    def __init__(self):
        self.time = 0.0

    def now(self):
        return self.time

    def sleep_until(self, time):
        self.time = max(time, self.time)


@pytest.mark.study
def test_an_arm_is_identified_from_what_its_servos_measured(arm, port, tmp_path, monkeypatch):
    ticking = Clock()
    monkeypatch.setattr(
        "armwright.twin.serial.capture.clock", SimpleNamespace(now=ticking.now, sleep_until=ticking.sleep_until)
    )
    stored = ArmServos(port, ServoFit.of(arm, Line()), LONG).read_calibration()
    settings = ServoSettings(step=1.0, torque=1.0, approach=1.0, patience=LONG)
    found = capture(plan_capture(arm, swinging(arm), Line(), settings, stored), port)
    assert (found.reason, len(found.rows), found.missed) == ("the motion's end", 501, 0)
    log = aw.identification.read_log(found.write(tmp_path / "swing.csv", arm))

    fit = aw.identification.identify_arm(log).estimate
    values = dict(zip(fit.names, fit.values, strict=True))
    rotors = [body.drive.rotor_inertia * body.drive.gear_ratio**2 for body in arm.coordinates]
    assert [values[f"Ia{k + 1}"] for k in range(2, 6)] == pytest.approx(rotors[2:], rel=0.12)

    verdict = aw.identification.validate(arm, log)
    assert verdict.passed
    torques = [each.overall for each in verdict.measures if each.quantity == "torque"]
    assert min(each.r2 for each in torques) > 0.9
    assert [each.gain for each in torques] == pytest.approx([1.0] * arm.n, abs=0.08)  # the voltages' scale and signs

    with pytest.raises(LogError, match="torques or currents"):
        aw.shadow.shadow_log(log)  # which has no speed yet to take from voltages

"""Logs as they are: lost, repeated and frozen rows, stamps that jitter, noisy and late speeds. Fits are those of the clean log.

The simulator is this test's own (`logged_machine`): Pinocchio and NumPy, friction that ripples as no model here has it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from identification.arm.logged_machine import Machine, Motion, beside_the_controller, read, written

RATE, SECONDS = 1000.0, 21.0
FROZEN = 0.1  # [s]


@dataclass(eq=False)
class Recorded:
    """Signals of a machine of seven joints at 1 kHz, twice as many rows as a log takes, and logs made of them."""

    folder: Path
    machine: Machine
    signals: dict[str, np.ndarray]
    fits: dict = field(default_factory=dict)

    @classmethod
    def of(cls, folder: Path, seed: int) -> Recorded:
        machine, rng = Machine.written(folder, 7, seed), np.random.default_rng([seed, 2])
        t = np.arange(int(2 * RATE * SECONDS)) / RATE
        q, qd, qdd = Motion.of(7, seed).at(t)
        torque = machine.torque(q, qd, qdd)
        ripple = 0.3 * machine.coulomb * np.sin(2 * q)
        noise = rng.normal(size=(3, *q.shape))
        signals = {
            "position": q + 2e-5 * noise[0], "speed": qd + 3e-3 * noise[1],
            "torque": torque + ripple + 0.02 * torque.std(axis=0) * noise[2],
        }  # fmt: skip
        return cls(folder, machine, signals)

    def log(self, name: str, rows: np.ndarray, stamps: np.ndarray, speeds: bool = False) -> Path:
        """The log of rows of the signals, at stamps [s]."""
        chosen = {key: each[rows] for key, each in self.signals.items() if speeds or key != "speed"}
        return written(self.folder, name, self.machine.names, {"t": stamps, **chosen})

    def fit(self, name: str, rows: np.ndarray, stamps: np.ndarray, speeds: bool = False):
        """The default fit of such a log."""
        if name not in self.fits:
            log = read(self.log(name, rows, stamps, speeds))
            self.fits[name] = log, aw.identification.identify_arm(log, self.machine.arm, checks=())
        return self.fits[name]

    @property
    def clean(self):
        """The fit of the log without defects."""
        rows = np.arange(int(RATE * SECONDS))
        return self.fit("clean", rows, rows / RATE)[1]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    return Recorded.of(tmp_path_factory.mktemp("recorded"), 1)


def beside(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Rows and stamps [s] of a logger beside the controller: 5.5 % of rows repeated and as many lost, stamps jitter by 14 %."""
    stamps, rows = beside_the_controller(rng, int(RATE * SECONDS))
    return rows, stamps / RATE


def lost(share: float):
    def rows(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        kept = np.flatnonzero(rng.random(int(RATE * SECONDS)) > share)
        return kept, kept / RATE

    return rows


def repeated(share: float):
    def rows(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        k = np.arange(int(RATE * SECONDS))
        return np.maximum.accumulate(np.where((rng.random(len(k)) < share) & (k > 0), 0, k)), k / RATE

    return rows


def frozen(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Eight stretches in which the logger writes the same row."""
    k = np.arange(int(RATE * SECONDS))
    rows = k.copy()
    for begin in np.linspace(0.1, 0.9, 8) * len(k):
        rows[int(begin) : int(begin + FROZEN * RATE)] = int(begin)
    return rows, k / RATE


def jittering(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    k = np.arange(int(RATE * SECONDS))
    return k, np.sort(k + 0.1 * rng.normal(size=len(k))) / RATE


WORN = {
    "beside": (beside, 0.002), "lost 5": (lost(0.05), 0.002), "repeated 5": (repeated(0.05), 0.002),
    "lost 20": (lost(0.2), 0.01), "repeated 20": (repeated(0.2), 0.01), "frozen": (frozen, 0.01), "jitter": (jittering, 0.002),
}  # fmt: skip
QUICK = ("lost 20",)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.study) for name in WORN]
)
def test_fits_of_worn_logs_are_those_of_the_clean_one(recorded, name, tmp_path):
    rows, near = WORN[name]
    log, found = recorded.fit(name, *rows(np.random.default_rng(7)))
    assert (np.abs(found.fit.r2 - recorded.clean.fit.r2) < near).all(), (found.fit.r2, recorded.clean.fit.r2)
    validated = aw.identification.validate(found.write(tmp_path / "arm.toml"), log, simulation=False)
    for joint, r2 in zip(recorded.machine.names, found.fit.r2, strict=True):
        assert validated.of("torque", joint).overall.r2 == pytest.approx(r2, abs=0.01)


def test_friction_of_a_joint_that_only_noise_moves_is_not_stated(tmp_path):
    machine, rng = Machine.written(tmp_path, 3, 4), np.random.default_rng(4)
    t = np.arange(int(RATE * SECONDS)) / RATE
    q, qd, qdd = (
        np.where([True, False, True], each, still)
        for each, still in zip(Motion.of(3, 4).at(t), (0.3, 0, 0), strict=True)
    )
    torque = machine.torque(q, qd, qdd)
    noise = rng.normal(size=(2, *q.shape))
    signals = {"position": q + 2e-5 * noise[0], "torque": torque + 0.02 * torque.std(axis=0) * noise[1]}
    log = read(written(tmp_path, "still", machine.names, {"t": t, **signals}))
    assert [each.problem.place for each in log.findings if "at rest" in each.problem.what] == [f"q {machine.names[1]}"]
    found = aw.identification.identify_arm(log, machine.arm, checks=())
    assert found.verdict == "not identified"
    assert {"fv1", "fc1", "fv3", "fc3"} < set(found.fit.base.names)
    assert not any("fv2" in name or "fc2" in name for name in found.fit.base.names)

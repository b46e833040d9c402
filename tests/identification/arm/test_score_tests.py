"""Mistakes of single columns are found with their joint and size, or cannot be seen; clean logs raise no alarm."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.identification.arm.mistakes import Score, made_up_for, suspicions
from identification.arm.logged_machine import Machine, Motion, read, written

T = np.arange(10000) / 500
JOINT = 2  # the third
TWISTED, STIFFNESS = np.arange(4000) / 500, 1500.0  # [s], [N m/rad]
ABOUT = ("deviations)", "cut off at a limit", "off the rows beside")


def sentences(folder: Path, mistake: str, seed: int = 0, joint: int = JOINT, share: float = 0.01) -> list[str]:
    """Remarks of the default fit on columns of a log with a mistake."""
    machine, motion, rng = Machine.written(folder, 4, seed), Motion.of(4, seed), np.random.default_rng([seed, 3])
    q, qd, qdd = motion.at(T)
    torque = machine.torque(q, qd, qdd)
    if mistake == "drift":
        friction = machine.coulomb * np.sign(qd) + machine.viscous * qd
        torque[:, joint] -= 0.4 * (T / T[-1]) * friction[:, joint]
    if mistake == "spring":
        torque[:, joint] += 0.1 * np.ptp(torque[:, joint]) / np.ptp(q[:, joint]) * q[:, joint]
    if mistake == "gear":
        links = machine.torque(q, qd, qdd, link_only=True)[:, joint]
        torque[:, joint] += np.where(links * qd[:, joint] > 0.0, 1.0 / 0.9 - 1.0, 0.9 - 1.0) * links
    if mistake == "late":
        torque[:, joint] = machine.torque(*motion.at(T - 0.01))[:, joint]
    torque = torque + share * torque.std(axis=0) * rng.normal(size=torque.shape)
    if mistake == "outliers":
        torque[:, joint] += (rng.random(len(T)) < 0.01) * 3.0 * torque[:, joint].std() * rng.normal(size=len(T))
    if mistake == "clipped":
        torque[:, joint] = cut_off(torque[:, joint])
    if mistake == "torque":
        torque[:, joint] *= 1.2
    q = q + 2e-5 * rng.normal(size=q.shape)
    if mistake == "scale":
        q[:, joint] *= 1.1
    if mistake == "zero":
        q[:, joint] += 0.3
    path = written(folder, "log", machine.names, {"t": T, "position": q, "torque": torque})
    found = aw.identification.identify_arm(read(path), machine.arm, record=False, checks=())
    return [each for each in found.estimate.remarks if any(about in each for about in ABOUT)]


def cut_off(torque: np.ndarray) -> np.ndarray:
    """A column that a full converter cuts off at 60 % of its largest value."""
    limit = 0.6 * np.abs(torque).max()
    return np.clip(torque, -limit, limit)


SAID = {
    "torque": r"j3: its torques are \+1[5-9]% off in scale",
    "scale": r"j3: its positions are -(8|9|10)\.\d% off in scale",
    "zero": r"j3: the zero of its position is -0\.(2[89]|3[01])\d* rad off",
    "late": r"j3: its torques come 0\.0(09|10|11|12)\d* s after its motion",
    "outliers": r"warning: run1: tau j3: \d+ rows \((0\.[89]|1\.0)\d*%\) by more than",
    "clipped": r"j3: \d+% of its torques are not fitted: cut off at a limit",
    "spring": r"j3: its torques change with its position by \+\d+% of their spread",
    "gear": r"j3: its friction grows by (9|10|11)\.\d% of the torque that its links take",
    "drift": r"j3: its friction changes by -[3-6]\d% over the log",
}


@pytest.mark.sample(1)
@pytest.mark.parametrize("mistake", SAID)
def test_a_mistake_is_found_with_its_joint_and_size(tmp_path, mistake):
    (sentence,) = sentences(tmp_path, mistake)
    assert re.match(SAID[mistake], sentence), sentence


@pytest.mark.parametrize(
    ("share", "explains", "doubts", "remarks"),
    [(0.4, 0.9, 1, 0), (0.4, 0.5, 0, 1), (-0.4, 0.9, 0, 0), (0.01, 0.9, 0, 0)],
)
def test_a_spring_that_leaves_most_of_a_residual_is_a_doubt(share, explains, doubts, remarks):
    """One that pushes away from its rest is none."""
    scores = [Score("j3", "rad", "spring", share, 0.02, 50.0 * share / abs(share), explains)]
    assert (len(made_up_for(scores)), len(list(suspicions(scores)))) == (doubts, remarks)


@pytest.mark.parametrize(("size", "explains", "said"), [(0.1, 0.6, (1, 1)), (0.1, 0.3, (0, 2)), (-0.1, 0.6, (0, 0))])
def test_gears_that_lose_power_without_the_record_are_named_each(size, explains, said):
    """The weaker one of another joint, too; one that gives power is none."""
    sign = np.sign(size)
    scores = [Score("j2", "rad", "gear", size, 0.003, 30 * sign, explains)]
    scores += [Score("j3", "rad", "gear", size, 0.01, 8 * sign, 0.2)]
    assert (len(made_up_for(scores)), len(list(suspicions(scores)))) == said


@pytest.mark.parametrize(
    ("side", "size"), [("motor", 1.0 / STIFFNESS), ("links", None)], ids=["positions of motors", "positions of links"]
)
def test_gears_that_give_way_are_named_and_are_no_arm_that_is_identified(tmp_path, side, size):
    """By Pinocchio:  θ = q + u/K,  tau = I θ̈ + v θ̇ + u,  u the links' torque."""
    machine, motion, rng = (
        Machine.written(tmp_path, 3, 0),
        Motion.of(3, 0, seconds=4.0, speed=2.0),
        np.random.default_rng(0),
    )
    before, u, after = (machine.torque(*motion.at(TWISTED + dt), link_only=True) for dt in (-1e-3, 0.0, 1e-3))
    rates = u, (after - before) / 2e-3, (after - 2.0 * u + before) / 1e-6
    moved = [each + by / STIFFNESS for each, by in zip(motion.at(TWISTED), rates, strict=True)]
    tau = machine.rotor * moved[2] + machine.viscous * moved[1] + u
    tau = tau + 0.01 * rng.normal(size=tau.shape)
    q = (moved if side == "motor" else motion.at(TWISTED))[0] + 2e-7 * rng.normal(size=tau.shape)
    log = read(written(tmp_path, "log", machine.names, {"t": TWISTED, "position": q, "torque": tau}))
    found = aw.identification.identify_arm(log, machine.arm, record=False, checks=())
    assert found.verdict == "not identified"
    said = [each for each in found.estimate.remarks if "gives way" in each]
    assert said
    for each in said if size else []:
        stated = float(re.search(r"by ([0-9.e-]+) rad/\(N m\)", each)[1])
        assert stated == pytest.approx(size, rel=0.3)
    assert not any("motion that they belong to" in each for each in found.estimate.remarks)


@pytest.mark.parametrize(("size", "said"), [(3.0, 1), (56.8, 0), (-56.8, 0)])
def test_no_zero_is_said_to_be_more_than_half_a_turn_off(size, said):
    scores = [Score("j2", "rad", "position zero", size, 0.1, 10.0 * size, 0.9)]
    assert len(list(suspicions(scores))) == said


@pytest.mark.parametrize("seed", range(2))
def test_what_a_limit_cuts_off_does_not_spoil_the_fit(tmp_path, seed):
    machine, states = Machine.written(tmp_path, 4, seed), Motion.of(4, seed).at(T)
    torque = machine.torque(*states)
    torque = torque + 0.01 * torque.std(axis=0) * np.random.default_rng(seed).normal(size=torque.shape)
    torque[:, JOINT] = cut_off(torque[:, JOINT])
    path = written(tmp_path, "log", machine.names, {"t": T, "position": states[0], "torque": torque})
    log = read(path)
    found = aw.identification.identify_arm(log, machine.arm, checks=())
    fit = found.fit
    z = (fit.values - fit.base.of(machine.truth(fit.equations.model))) / fit.std
    assert np.sqrt((z**2).mean()) < 1.5
    assert fit.r2.min() > 0.999
    judged = aw.identification.validate(found.write(tmp_path / "found.toml"), log, simulation=False)
    assert min(each.overall.r2 for each in judged.measures) > 0.999
    assert any(
        re.search(r"j3: \d+% of its torques are not compared: cut off at a limit", each) for each in judged.notes
    )


@pytest.mark.parametrize("kind", ["command", "louder in motion"])
def test_pulses_of_commands_and_noise_that_grows_with_the_speed_are_no_glitches(tmp_path, kind):
    machine, rng = Machine.written(tmp_path, 3, 0), np.random.default_rng(0)
    states = Motion.of(3, 0).at(T)
    torque = machine.torque(*states) + 0.01 * rng.normal(size=(len(T), 3))
    if kind == "command":
        torque += (rng.random(torque.shape) < 0.01) * 5.0
    else:  # for one second in twenty
        torque[5000:5500] += 0.5 * rng.normal(size=(500, 3))
    columns = {"t": T, "position": states[0], "torque": torque}
    log = read(written(tmp_path, "log", machine.names, columns, "torque" if kind == "command" else None))
    assert not any("glitches" in str(note) for note in log.notes)
    assert not aw.identification.choose_preparation(log).spikes


def test_the_zero_of_a_vertical_axis_cannot_be_seen(tmp_path):
    assert sentences(tmp_path, "zero", joint=0) == []


@pytest.mark.study
def test_clean_logs_raise_no_alarm(tmp_path):
    assert [sentences(tmp_path, "", seed, share=0.02) for seed in range(3)] == [[], [], []]


@pytest.mark.study
def test_many_clean_logs_raise_hardly_any(tmp_path):
    alarms = sum(bool(sentences(tmp_path, "", seed, share=0.003 if seed % 2 else 0.03)) for seed in range(3, 23))
    assert alarms <= 1

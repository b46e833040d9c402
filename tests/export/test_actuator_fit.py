"""Actuators of MuJoCo for arms of servos: numbers in closed form, motions in MuJoCo itself, what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError, ModelError, OutputError, ScheduleError
from armwright.export.actuator_fit import STEP
from armwright.export.mjcf import MujocoActuators, mjcf_text
from armwright.export.servo_actuators import servo_actuators, spreads
from cli.test_commands import run
from simulation.test_servo import KT, PLAIN, VISCOUS, VOLTS, R, pendulum

mujoco = pytest.importorskip("mujoco", reason="of the extra bench")
OF_3_0 = {"name", "joint", "kp", "kv", "forcelimited", "forcerange"}  # attributes that MuJoCo 3.0's <position> has
SWING = aw.trajectories.Fourier([0.2], [[0.5, 0.0, -0.1]], [[-0.1, 0.0, 0.05]], 2.0, cycles=1)


def rod(*args, **joint):
    """A pendulum with an inertia that MuJoCo takes."""
    return pendulum(*args, **joint).with_values({f'"rod q".inertia_kg_m2.{axis}': 1e-4 for axis in ("xx", "yy", "zz")})


def loaded():
    """A motion of SO-101 that takes up a body."""
    rests = [
        aw.trajectories.Quintic([a] * 6, [b] * 6, duration=0.1, time=t)
        for a, b, t in ((0.0, 0.1, 0.0), (0.1, 0.0, 0.1))
    ]
    return aw.trajectories.Joined(rests, [aw.Payload(0.1, 0.5, com=[0.1, 0.0, 0.0], inertia=[1e-3] * 3)])


@cache
def swing():
    """A motion of SO-101 through its range."""
    arm = aw.load("so101")
    low, high = np.array(aw.trajectories.MotionLimits.of(arm).position).T
    poses = 0.5 * (low + high) + 0.12 * (high - low) * np.random.default_rng(1).uniform(-1, 1, (3, 6))
    return aw.trajectories.Waypoints(poses, aw.trajectories.MotionLimits.of(arm, acceleration=8.0))


@cache
def fitted(kind):
    return aw.export.fit_actuators("so101", swing(), kind, progress=False)


def test_numbers_of_the_record_are_those_of_the_closed_form():
    found = servo_actuators(pendulum().record)["q"]
    gain = KT * VOLTS / R
    assert found.stiffness == pytest.approx(gain * 32 * 0.166, rel=1e-14)
    assert found.damping == pytest.approx(KT**2 / R + VISCOUS, rel=1e-14)
    assert found.effort == pytest.approx(gain * 0.97, rel=1e-14)
    assert (found.armature, found.friction, found.delay) == (0.028, 0.0, 0.0005)


def test_a_loop_of_currents_has_no_back_emf():
    loop = PLAIN | {"output": "current", "output_limit": 1.5, "d": 2.0, "d_scale_s_per_rad": 0.01}
    found = servo_actuators(pendulum(loop, limits={"voltage_v": VOLTS, "current_a": 1.2}).record)["q"]
    assert found.stiffness == pytest.approx(KT * 32 * 0.166)
    assert (found.damping, found.derivative) == (VISCOUS, pytest.approx(KT * 0.02))
    assert found.effort == pytest.approx(1.2 * KT)


@pytest.mark.study
def test_spreads_are_those_of_a_product():
    spread = spreads(aw.load("so101").record)["elbow_flex"]
    servo = aw.robotfiles.servos()["sts3215-7.4v"]
    k, r, scale = servo.shaft.torque_constant_n_m_per_a, servo.shaft.resistance_ohm, servo.firmware.p_scale_per_rad
    upward = k.std / float(k), float(r) / (float(r) + r.std) - 1.0, scale.std / float(scale)
    assert spread["stiffness"] == pytest.approx(np.hypot(np.hypot(*upward[:2]), upward[2]), rel=1e-9)
    assert spread["armature"] == pytest.approx(0.006 / 0.0284, rel=1e-3)


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", ["dcmotor", "position"])
def test_mujoco_moves_as_armwright_does(kind):
    fit = fitted(kind)
    before, after = fit.rms(fit.before), fit.rms(fit.after)
    assert before.max() < 1e-3
    assert (after < before).all()
    assert {"stiffness [N m/rad]", "limit [N m]", "after [rad]"} <= set(fit.tables()[0].heads)
    assert after.max() < 3e-4  # a count is 1.5e-3
    assert np.abs(fit.simulated - fit.goal).max() > 0.02  # which is not for lack of anything to be seen


def test_what_an_actuator_of_position_has_no_word_for_is_lost_by_name():
    robot = aw.load("so101").record
    numbers = {name: replace(each, goal_speed=np.inf) for name, each in servo_actuators(robot).items()}
    for change, words in (
        ({"integral": 3.0}, "I of the firmware"),
        ({"goal_speed": 2.0}, "the goal's speed in the firmware"),
    ):
        changed = numbers | {"elbow_flex": replace(numbers["elbow_flex"], **change)}
        for actuators, lost in ((numbers, False), (changed, True)):
            losses = mjcf_text(robot, MujocoActuators("position", actuators, STEP))[1]
            assert any(words in loss and "elbow_flex" in loss for loss in losses) == lost
        assert not any(words in loss for loss in mjcf_text(robot, MujocoActuators("dcmotor", changed, STEP))[1])


def test_files_in_circulation_do_not():
    """`arms.md`: gains of 998.22 and 2.731, and 17.8, of two files for SO-101, with a limit of 3.35 N m."""
    fit = fitted("position")
    for stiffness, derivative, damping, least in ((998.22, 2.731, 0.0, 0.03), (17.8, 0.0, 0.6, 0.008)):
        text = mjcf_text(fit.robot, fit.in_mujoco)[0]
        model = mujoco.MjModel.from_xml_string(text)
        model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1] = stiffness, -stiffness
        model.actuator_biasprm[:, 2], model.dof_damping[:] = -derivative, damping
        model.dof_armature[:], model.dof_frictionloss[:], model.actuator_forcerange[:] = 0.028, 0.052, (-3.35, 3.35)
        data = mujoco.MjData(model)
        data.qpos[:] = fit.goal[0]
        found = np.empty_like(fit.goal)
        for k, goal in enumerate(fit.goal):
            found[k], data.ctrl[:] = data.qpos, goal
            mujoco.mj_step(model, data)
        assert np.sqrt(np.mean(fit.rms(found) ** 2)) > least > 50 * np.sqrt(np.mean(fit.rms(fit.after) ** 2))


def test_the_file_says_what_was_played(tmp_path):
    fit = fitted("position")
    (path, beside), lost = fit.write(tmp_path / "so101.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.opt.timestep == STEP
    numbers = json.loads(beside.read_text("utf-8"))["joints"]
    for i, (name, each) in enumerate(numbers.items()):
        assert model.joint(name).damping[0] == each["damping"]["mean"]
        assert model.actuator_gainprm[i, 0] == each["stiffness"]["mean"]
        assert model.actuator_forcerange[i, 1] == each["effort_limit"]["mean"]
        assert 0.1 < each["stiffness"]["spread"] / each["stiffness"]["mean"] < 0.4
    assert not any("electrical" in line for line in lost)
    used = {
        word.partition("=")[0]
        for line in path.read_text().splitlines()
        if "<position" in line
        for word in line.split()[1:-1]
    }
    assert {word for word in used if word.isidentifier()} <= OF_3_0


def test_friction_by_load_is_made_up_for():
    friction = {
        "law": "load-dependent", "viscous_n_m_s_per_rad": 0.02, "coulomb_positive_n_m": 0.02, "coulomb_negative_n_m": 0.02,
        "stribeck_torque_n_m": 0.03, "stribeck_speed_rad_per_s": 0.5, "stribeck_exponent": 1.0,
        "load_motor": 0.2, "load_external": 0.1, "load_motor_stribeck": 0.1, "load_external_stribeck": 0.05,
        "load_motor_quadratic_per_n_m": 0.0, "load_external_quadratic_per_n_m": 0.0,
    }  # fmt: skip
    arm = rod(friction=friction)
    fit = aw.export.fit_actuators(arm, SWING, progress=False)
    assert fit.rms(fit.after)[0] < 0.5 * fit.rms(fit.before)[0]


def test_latency_is_a_delay_and_play_is_told():
    loop = PLAIN | {"period_s": 0.004, "latency_periods": 2}
    gear = {"stiffness_n_m_per_rad": 400.0, "damping_n_m_s_per_rad": 0.5, "backlash_rad": 0.02}
    fit = aw.export.fit_actuators(rod(loop, elasticity=gear), SWING, progress=False)
    text, lost = mjcf_text(fit.robot, fit.in_mujoco)
    model = mujoco.MjModel.from_xml_string(text)
    assert model.actuator_delay[0] == pytest.approx(0.01)
    assert fit.document()["joints"]["q"]["play"]["mean"] == 0.02
    assert "3.14" in str(fit)
    # an encoder behind the play sees it; MuJoCo's joint would not: 11 mrad in place of 6
    assert any("play" in line for line in lost)
    assert fit.rms(fit.after)[0] < 0.5 * fit.rms(fit.before)[0]


@pytest.mark.parametrize(
    ("arm", "motion", "kind", "error", "words"),
    [
        ("panda", SWING, "position", ModelError, "by torque"),
        ("so101", SWING, "velocity", ModelError, "dcmotor, position"),
        ("so101", aw.trajectories.Sine([0.0] * 6, [0.1] * 6, 1.0), "position", ScheduleError, "does not end"),
        ("so101", loaded(), "position", ScheduleError, "carries a payload"),
    ],
)
def test_what_cannot_be_is_refused(arm, motion, kind, error, words):
    with pytest.raises(error, match=words):
        aw.export.fit_actuators(arm, motion, kind, progress=False)


def test_a_poor_fit_is_said(tmp_path):
    """A goal that moves slower than the motion, which a gain with damping cannot follow; without that, nothing is said."""
    assert not aw.export.fit_actuators(rod(), SWING, progress=False).poor
    slow, table, file = rod(PLAIN | {"goal_speed_rad_per_s": 0.3}), tmp_path / "swing.csv", tmp_path / "slow.toml"
    aw.robotfiles.write_toml(slow.record, file)
    SWING.save(slow, table)
    done = run(
        "convert", str(file), "-o", str(tmp_path / "a.xml"), "--actuators", "position", "--reference", str(table)
    )
    assert done.exit_code == 0
    assert "note: the fit of q is poor: MuJoCo is" in done.stderr


def test_convert_writes_both_files(tmp_path):
    swing().save(aw.load("so101"), tmp_path / "swing.csv")
    done = run(
        "convert",
        "so101",
        "-o",
        str(tmp_path / "a.xml"),
        "--actuators",
        "dcmotor",
        "--reference",
        str(tmp_path / "swing.csv"),
    )
    assert done.exit_code == 0
    assert "<dcmotor" in (tmp_path / "a.xml").read_text()
    assert json.loads((tmp_path / "a.actuators.json").read_text("utf-8"))["motion"] == "swing.csv"


@pytest.mark.parametrize(
    ("target", "given", "error", "words"),
    [
        ("a.xml", {"actuators": "position"}, ModelError, "motion"),
        ("a.xml", {"motion": "swing.csv"}, ModelError, "actuators"),
        ("a.urdf", {"actuators": "position", "motion": "swing.csv"}, OutputError, "holds no actuators"),
        ("a.xml", {"actuators": "position", "motion": "missing.csv"}, ArmwrightError, "missing.csv"),
    ],
)
def test_convert_refuses_halves_and_writes_nothing(tmp_path, target, given, error, words):
    with pytest.raises(error, match=words):
        aw.robotfiles.convert("so101", tmp_path / target, **given)
    assert not list(tmp_path.iterdir())

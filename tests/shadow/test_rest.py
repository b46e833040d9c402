"""Friction of joints at rest hides torques within its bounds, and none beyond: by itself, by simulation, on a measured arm."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.actuators.coupling import motor_shares
from armwright.identification.arm.options import FitRows
from armwright.shadow.observer import MomentumObserver
from armwright.shadow.rest import widened
from identification.arm.moved_arm import written_log
from identification.arm.tx40 import tx40_urdf
from identification.real_logs import TX40, log_of

DRY = "coulomb_positive_n_m = 4.0\ncoulomb_negative_n_m = 3.0\nviscous_n_m_s_per_rad = 2.0\noffset_n_m = 0.4\n"
ARMS = {  # motor and friction of both joints; {elbow}: a coupling of the elbow's motor
    "dry": ("", DRY),
    "stiction": ("", f"{DRY}stribeck_torque_n_m = 6.0\nstribeck_speed_rad_per_s = 0.05\n"),
    "friction by loads": (
        "gear_ratio = 50.0\nrotor_inertia_kg_m2 = 1e-5\n",
        f'{DRY}law = "load-dependent"\nstribeck_torque_n_m = 6.0\nstribeck_speed_rad_per_s = 0.05\nstribeck_exponent = 1.3\n'
        "load_motor = 0.2\nload_external = 0.1\nload_motor_stribeck = 0.05\nload_external_stribeck = 0.1\n"
        "load_motor_quadratic_per_n_m = 0.002\nload_external_quadratic_per_n_m = 0.001\n",
    ),
    "lossy gear": ("gear_ratio = 50.0\nrotor_inertia_kg_m2 = 1e-5\ngear_efficiency = 0.7\n", DRY),
    "friction by load": ("gear_ratio = 50.0\nrotor_inertia_kg_m2 = 1e-5\n", f"{DRY}load_coefficient = 0.2\n"),
    "lossy gear, friction before it": (
        "gear_ratio = 50.0\nrotor_inertia_kg_m2 = 1e-5\ngear_efficiency = 0.7\n",
        'side = "motor"\ncoulomb_positive_n_m = 0.08\ncoulomb_negative_n_m = 0.06\n',
    ),
    "coupled and lossy": ("gear_ratio = 50.0\nrotor_inertia_kg_m2 = 1e-5\ngear_efficiency = 0.7\n{elbow}", DRY),
    "coupled": ("gear_ratio = 50.0\nrotor_inertia_kg_m2 = 1e-5\n{elbow}", DRY),
    "coupled on the motor's side": (
        "gear_ratio = 50.0\nrotor_inertia_kg_m2 = 1e-5\n{elbow}",
        'side = "motor"\ncoulomb_positive_n_m = 0.08\ncoulomb_negative_n_m = 0.06\n',
    ),
}
COUPLED = 'coupling = [{ joint = "shoulder", ratio = 50.0 }]\n'
POSE = np.array([0.3, -0.8])


def two_link(folder: Path, motor: str = "", friction: str = DRY) -> aw.Arm:
    """two-link with these lines of motor and friction at both joints."""
    description = aw.load("two-link").description
    assert description is not None
    text = aw.robotfiles.to_toml(description)
    assert text.count("[[links]]") == 2
    for elbow in ("", COUPLED):
        motors = f"[joints.motor]\n{motor.format(elbow=elbow)}" if motor else ""
        text = text.replace("[[links]]", f"{motors}[joints.friction]\n{friction}\n[[LINKS]]", 1)
    path = folder / "arm.toml"
    path.write_text(text.replace("[[LINKS]]", "[[links]]"))
    return aw.load(path)


def corners(arm: aw.Arm, way: float = 1e-5) -> np.ndarray:
    """(4, n) [N m] torques on the joints that just move the arm, for every direction of its joints' and motors' speeds."""
    shares = motor_shares(arm)
    rows = [way * np.array(signs) for signs in itertools.product((-1.0, 1.0), repeat=arm.n)]
    return np.array([aw.compile(arm).inverse_dynamics(POSE, qd, np.zeros(arm.n)) @ shares for qd in rows])


def last_residual(arm: aw.Arm, tau: np.ndarray, seed: int = 0) -> np.ndarray:
    """(n,) [N m] residual after 1 s at rest with a constant torque; the encoder's last digit shakes."""
    t = 2e-3 * np.arange(500)
    q = POSE + 1e-9 * np.random.default_rng(seed).integers(-1, 2, (len(t), arm.n))
    return MomentumObserver(arm).update(t, q, np.tile(tau, (len(t), 1))).torque[-1]


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ARMS)
def test_any_torque_between_those_that_just_move_the_arm_leaves_no_residual(tmp_path, name):
    arm = two_link(tmp_path, *ARMS[name])
    known = corners(arm)
    rng = np.random.default_rng(1)
    for tau in (*known, *(rng.dirichlet(np.ones(4)) @ known for _ in range(2))):
        assert last_residual(arm, tau) == pytest.approx([0.0, 0.0], abs=2e-3), (name, tau)


@pytest.mark.parametrize("name", ARMS)
def test_what_is_beyond_is_a_residual(tmp_path, name):
    """10 N m less of the motor than holds the shoulder at its weakest: 10 N m act on it from outside."""
    arm = two_link(tmp_path, *ARMS[name])
    known = corners(arm)
    tau = known.mean(axis=0)
    tau[0] = known[:, 0].min() - 10.0
    found = last_residual(arm, tau)
    if "coupled" not in name:  # the bounds of coupled motors are those of each joint by itself
        assert found == pytest.approx([10.0, 0.0], abs=0.02)
    else:
        assert 4.0 < found[0] < 10.01
    tau[0] = known[:, 0].max() + 10.0
    assert last_residual(arm, tau)[0] < (-9.9 if "coupled" not in name else -4.0)


def test_bounds_have_the_uncertainty_of_the_record(tmp_path):
    """Levels of 4 ± 0.5 N m may be 5.5."""
    exact = two_link(tmp_path)
    tau = corners(exact).mean(axis=0)
    tau[0] = corners(exact)[:, 0].min() - 1.4
    assert last_residual(exact, tau)[0] == pytest.approx(1.4, abs=0.01)
    stated = "coulomb_positive_n_m = 4.0\ncoulomb_negative_n_m = { value = 3.0, std = 0.5 }\n"
    uncertain = two_link(tmp_path, friction=DRY.replace(DRY[: DRY.index("viscous")], stated))
    assert last_residual(uncertain, tau) == pytest.approx([0.0, 0.0], abs=0.01)
    tau[0] -= 2.0
    assert last_residual(uncertain, tau)[0] == pytest.approx(1.9, abs=0.01)


@pytest.mark.parametrize(("std", "least"), [(0.05, 0.55), (0.2, 0.35)])
def test_bounds_have_the_uncertainty_of_an_efficiency(tmp_path, std, least):
    """0.7 ± 0.05 may be 0.55; that it may be under half of the record's number is not believed."""
    motor, friction = ARMS["lossy gear"]
    arm = two_link(tmp_path, motor.replace("0.7", f"{{{{ value = 0.7, std = {std} }}}}"), friction)
    assert [float(body.drive.efficiency) for body in widened(arm).coordinates] == pytest.approx([least, least])


def test_a_log_without_coulomb_friction_is_of_a_joint_that_it_holds(tmp_path):
    """Torques from which Coulomb friction was taken off: the model lacks it, the joint at rest has it."""
    whole = two_link(tmp_path)
    bare = two_link(tmp_path, friction="viscous_n_m_s_per_rad = 2.0\n")
    t = 2e-3 * np.arange(400)
    tau = aw.compile(bare).inverse_dynamics(POSE, 0 * POSE, 0 * POSE) + np.array([2.5, -2.0])
    q, taus = np.tile(POSE, (len(t), 1)), np.tile(tau, (len(t), 1))
    assert np.abs(MomentumObserver(bare).update(t, q, taus).torque[-1]).max() > 1.9
    assert MomentumObserver(bare, whole=whole).update(t, q, taus).torque[-1] == pytest.approx([0, 0], abs=1e-9)


MOVE = aw.trajectories.Quintic(np.array([0.3, -0.8]), np.array([0.9, -0.3]), 1.0, 0.4)  # rest from 1.4 s on
# turns back every second
TURNS = aw.trajectories.Fourier(np.array([0.3, -0.8]), np.full((2, 1), 0.4), np.zeros((2, 1)), 2.0)


def simulated(arm, reference=MOVE, seconds=4.0, wrench=None, payload=None):
    """Rows of a simulated arm under PD control, whose friction holds it at rest."""
    loop = aw.Loop(aw.ComputedTorque(kp=400.0, kd=40.0), reference, 2e-3, sensors=aw.Sensors(counts=2**17, side="link"))
    start = aw.Start(q=reference(0.0)[0], qd=reference(0.0)[1])
    inputs = aw.Inputs(wrench=wrench, payload=payload)
    found = aw.simulate(aw.Scenario(arm, seconds, loop=loop, start=start, inputs=inputs))
    tau = found["tau"].values + 0.02 * np.random.default_rng(0).normal(size=found["tau"].shape)
    return found["time"].values, found["q_measured"].values, tau


def pushed(force, begin, end):
    """A force [N] on the tip, upwards."""
    wrench = np.zeros((3, 6))
    wrench[1, 1] = force
    return aw.Schedule(np.array([0.0, begin, end]), wrench, ("fx", "fy", "fz", "mx", "my", "mz"))


def alarms_of(arm, rows, **settings):
    shadow = aw.shadow.ArmShadow(arm, deviation=0.1, held=True, **settings)
    shadow.update(*rows)
    return shadow.alarms


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["dry", "stiction", "lossy gear"])
@pytest.mark.parametrize("reference", [MOVE, TURNS], ids=["move and rest", "turns"])
def test_the_right_arm_raises_nothing_where_it_stops_starts_and_turns(tmp_path, name, reference):
    arm = two_link(tmp_path, *ARMS[name])
    assert not alarms_of(arm, simulated(arm, reference))


@pytest.mark.sample(1)
@pytest.mark.parametrize(("begin", "joint"), [(0.7, "moving"), (2.5, "at rest")])
def test_a_contact_is_noticed(tmp_path, begin, joint):
    """25 N at the tip of the right arm, on joints that move, and on joints at rest far beyond what holds them."""
    arm = two_link(tmp_path)
    alarms = alarms_of(arm, simulated(arm, wrench=pushed(25.0, begin, begin + 0.4)))
    assert alarms, joint
    assert begin < alarms[0].t < begin + 0.15
    assert all(each.t < begin + 0.6 for each in alarms)
    assert alarms[-1].end is not None


def test_a_contact_that_friction_holds_is_not_seen_at_rest(tmp_path):
    """1 N at the tip is below what holds the joints: neither motion nor torque tells of it. The same in motion is seen."""
    arm = two_link(tmp_path)
    rows = simulated(arm, wrench=pushed(1.0, 2.5, 2.9))
    still = (rows[0] > 2.4) & (rows[0] < 3.0)
    assert np.ptp(rows[1][still], axis=0).max() < 1e-9
    assert not alarms_of(arm, rows)
    assert alarms_of(arm, simulated(arm, wrench=pushed(5.0, 0.6, 1.0)))


def test_a_payload_is_noticed_at_the_next_motion(tmp_path):
    arm = two_link(tmp_path)
    payload = aw.Payload(0.2, 0.3, np.zeros(3), np.zeros((3, 3)))
    alarms = alarms_of(arm, simulated(arm, payload=payload))
    assert alarms
    assert 0.4 < alarms[0].t < 1.2
    assert alarms[0].kind == "payload"


def test_the_table_has_the_widest_that_friction_hides(tmp_path):
    """An arm that moves, and stops: 3.5 N m either way, half of 4 N m forwards and 3 N m backwards."""
    arm = two_link(tmp_path)
    t = 2e-3 * np.arange(2000)
    q = POSE + 0.3 * np.cos(np.pi * np.minimum(t, 2.0))[:, None]
    tau = np.tile(corners(arm).mean(axis=0), (len(t), 1))
    log = written_log(tmp_path, "stops", arm.names, t, q, tau)
    found = aw.shadow.shadow_log(log, arm, deviation=100.0)
    assert [float(row["friction at rest"]) for row in found.rows()] == pytest.approx([3.5, 3.5], rel=1e-3)


@pytest.mark.study
def test_the_wrist_of_the_tx40_at_rest(tmp_path):
    """Fitted to 5 s of the log; in the other 4 s its joints come to rest, and joint 6 was in contact with nothing there."""
    text = TX40.replace(
        "[gears]",
        '[[runs]]\nname = "fit"\nto_s = 5.0\n[[runs]]\nname = "held"\nfrom_s = 5.0\nuse = "hold-out"\n[gears]',
    )
    log = aw.identification.read_log(log_of(tmp_path, "staubli_tx40", text))
    fit = aw.identification.identify_arm(
        log,
        aw.load(tx40_urdf(tmp_path), kinematics_only=True),
        rows=FitRows(cutoff=100, decimate=20),
        checks=(),
    )
    record = fit.write(tmp_path / "tx40.toml")
    for factor, moving in ((8.0, 0), (2.0, 1)):  # 2 deviations: far below any sensible limit
        found = aw.shadow.shadow_log(log, record, runs=["held"], factor=factor)
        rest = found.runs[0].residuals.t[0] + 2.7
        assert len(found.alarms) <= moving
        assert not [alarm for _, alarm in found.alarms if alarm.t > rest], found.alarms
    (run,) = found.runs
    still = run.residuals.t > rest
    assert np.nanmax(np.abs(run.residuals.speed[still])) < 0.02
    left = np.nanmax(np.abs(run.residuals.torque[still]), axis=0)
    assert (left < 0.25 * found.deviations.values).all(), left
    assert (run.residuals.resting[still].min(axis=0) > 2.4).all()

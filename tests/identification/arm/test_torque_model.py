"""Columns of the torque model against inverse dynamics."""

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from armwright.identification.arm.torque_model import random_states, torque_model
from armwright.model import Model
from armwright.model.drive import Friction
from armwright.model.model import build_model


def test_columns_times_record_are_the_inverse_dynamics():
    arm = aw.load("lwa4p")
    model = torque_model(arm)
    q, qd, qdd = random_states(arm, 30, seed=1)
    predicted = model.rows(q, qd, qdd) @ np.nan_to_num(model.prior)
    np.testing.assert_allclose(predicted, aw.compile(arm).inverse_dynamics(q, qd, qdd), atol=1e-9)


def coupled_arm() -> Model:
    """LWA 4P whose motor of joint 6 turns with joint 5 as well, its friction on the motor's side."""
    arm = aw.load("lwa4p")
    record = arm.record
    joints = list(record.joints)
    last = joints[5]
    coupling = [{"joint": "joint5", "ratio": 0.5 * float(last.motor.gear_ratio)}]
    ratio = abs(float(last.motor.gear_ratio))
    friction = {"side": "motor", "viscous_n_m_s_per_rad": 3.0 / ratio**2, "coulomb_positive_n_m": 2.0 / ratio,
                "coulomb_negative_n_m": 2.0 / ratio}  # fmt: skip
    joints[5] = last.replace(motor=last.motor.replace(coupling=coupling), friction=friction)
    return build_model(record.replace(joints=tuple(joints)))


def test_motor_of_several_joints_gives_its_torque_to_all_of_them():
    arm = coupled_arm()
    model = torque_model(arm)
    assert {"Iam6", "fvm6", "fcm6"} < set(model.names)
    q, qd, qdd = random_states(arm, 30, seed=2)
    predicted = model.rows(q, qd, qdd) @ np.nan_to_num(model.prior)
    truth = np.array([aw.inverse_dynamics(arm, *state) for state in zip(q, qd, qdd, strict=True)])
    shares = np.eye(6)
    shares[5, 4] = 0.5
    np.testing.assert_allclose(predicted, truth @ shares, atol=1e-9)  # motor torques on the joints: Bᵀ tau


def test_terms_that_the_torque_lacks_have_no_columns():
    arm = aw.load("lwa4p")
    q, qd, qdd = random_states(arm, 5)
    model = torque_model(arm, lacks=("gravity", "coulomb", "offset"))
    assert not {"fc1", "off1"} & set(model.names)
    still = model.rows(q, 0 * qd, 0 * qdd)
    assert np.abs(still).max() < 1e-12


@pytest.mark.parametrize(
    ("options", "place"),
    [
        ({"friction": ("dry",)}, "friction"),
        ({"lacks": ("mass",)}, "lacks"),
        ({"springs": ("joint9",)}, "springs"),
        ({"friction": ("asymmetric", "coulomb")}, "friction"),
        ({"friction": ("stribeck",)}, "stribeck_speed"),
        ({"gears": np.zeros((6, 6))}, "gears"),
    ],
)
def test_unknown_terms_are_refused(options, place):
    with pytest.raises(IdentificationError) as caught:
        torque_model(aw.load("lwa4p"), **options)
    assert caught.value.place == place


def test_smoothing_speed_of_the_record_is_that_of_the_column():
    arm = aw.load("lwa4p")
    friction = arm.bodies[0].friction
    assert isinstance(friction, Friction)
    model = torque_model(arm)
    assert model.columns[model.index("fc1")].speed == friction.smoothing

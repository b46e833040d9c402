"""An arm without mass properties has kinematics; whatever needs masses is refused, naming the links."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError
from armwright.kernels.signatures import SIGNATURES
from raises_at import raises_at

BARE = """
name = "bare"
source = "drawing"
command = "torque"
tip = "fore"
links = [{ name = "upper", mass_kg = 2, com_m = [0, 0, 0], inertia_kg_m2 = { xx = 1, yy = 1, zz = 1, xy = 0, xz = 0, yz = 0 } }]
""" + "".join(
    f"""
[[joints]]
name = "{name}"
type = "revolute"
parent = "{parent}"
child = "{child}"
dh = {{ alpha_rad = 0.0, r_m = 0.0, a_m = 0.4, offset_rad = 0.0 }}
"""
    for name, parent, child in (("shoulder", "base", "upper"), ("elbow", "upper", "fore"))
)
WITHOUT_MASSES = ("forward_kinematics", "jacobian", "jacobian_dot_qd", "regressor", "regressor_drive", "spring_torques")
OF_MOTORS = ("motor_voltage", "motor_torque")
SAID = "bare links 'fore': .* needs mass properties, which are not known; expected mass_kg, com_m and inertia_kg_m2"


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "bare.toml").write_text(BARE, encoding="utf-8")
    return aw.load(tmp_path / "bare.toml", kinematics_only=True)


@pytest.mark.parametrize("name", [name for name in SIGNATURES if name not in OF_MOTORS])
def test_functions_and_kernels_that_need_masses_are_refused(arm, name):
    inputs = [
        np.full([k if isinstance(k, int) else arm.n for k in each.shape], 0.1) for each in SIGNATURES[name].inputs
    ]
    if name in WITHOUT_MASSES:
        assert np.isfinite(getattr(aw.compile(arm), name)(*inputs)).all()
        return
    with pytest.raises(ModelError, match=f"{name} needs") as refused:
        getattr(aw.compile(arm), name)(*inputs)
    assert "bare links 'fore'" in str(refused.value)
    with pytest.raises(ModelError, match=SAID):
        SIGNATURES[name].function(arm, *inputs)


def test_simulations_are_refused(arm):
    with raises_at(ModelError, "bare links 'fore'"):
        aw.simulate(aw.Scenario(arm, 0.1, command=[0.0, 0.0]))


def test_variants_and_saved_files_keep_it_and_numbers_end_it(arm, tmp_path):
    with pytest.raises(ModelError, match="links 'fore'"):
        aw.gravity_torques(arm.with_payload(1.0, [0, 0, 0], [0.1, 0.1, 0.1]), [0.0, 0.0])
    aw.robotfiles.write_toml(arm, tmp_path / "again.toml")
    with pytest.raises(ModelError, match="links 'fore'"):
        aw.gravity_torques(aw.load(tmp_path / "again.toml"), [0.0, 0.0])
    known = arm.with_values({"fore.mass_kg": 1.0, "fore.com_m": [0.1, 0.0, 0.0]})
    assert aw.gravity_torques(known.replace(gravity=[0, -9.81, 0]), [0.0, 0.0])[1] > 0.0

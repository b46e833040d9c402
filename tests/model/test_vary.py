"""Numbers of the record as inputs: kernels of an arm that varies are those of the arm that has the values."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import armwright as aw
from actuators.drives import one_joint
from armwright.description import builtin_names
from armwright.description.paths import quantities, with_values
from armwright.errors import DescriptionError, ModelError, ShapeError
from armwright.kernels.signatures import SIGNATURES
from armwright.lint.feasibility import is_possible
from armwright.model import build_model, vary
from armwright.model.vary import Varied
from armwright.spatial import pseudo_inertia
from physics.arms import arm
from raises_at import raises_at
from reference.random_trees import random_description

SEVERAL = {
    "puma560": [
        "link6.mass_kg",
        "link3.com_m",
        "elbow.friction.viscous_n_m_s_per_rad",
        "waist.motor.gear_ratio",
        "gravity_m_s2",
    ],
    "lwa4p": [
        "link2.inertia_kg_m2.xx",
        "link2.inertia_kg_m2.yz",
        "joint2.dh.a_m",
        "joint3.dh.alpha_rad",
        "joint1.dh.offset_rad",
    ],
    "panda": ["link4.mass_kg", "joint2.friction.sigmoid_slope_s_per_rad"],
    "cmu-dd": ["link1.com_m[2]", "joint2.motor.resistance_ohm", "joint2.motor.torque_constant_n_m_per_a"],
}


def rebuilt(model, names, values):
    """The arm built anew from a record with other numbers."""
    record = model.description
    for name, value in zip(names, np.asarray(values).tolist(), strict=True):
        path, _, entry = name.partition("[")
        if entry:
            whole = list(next(q.value for p, q, _ in quantities(record) if p == path))
            whole[int(entry[:-1])] = value
            value = tuple(whole)
        record = with_values(record, {path: value})
    return build_model(record)


def inputs(signature, n, lead, seed=0):
    random = np.random.default_rng(seed)
    return [random.uniform(-1.5, 1.5, size=(*lead, n)) for _ in signature.inputs]


def draws(varied, count, seed=1):
    """Values near the record's, a row each."""
    random = np.random.default_rng(seed)
    return varied.nominal * random.uniform(0.95, 1.05, size=(count, len(varied.nominal)))


@pytest.mark.parametrize("name", SEVERAL)
@pytest.mark.parametrize("kernel", SIGNATURES)
@pytest.mark.sample(3)
def test_a_kernel_that_varies_is_that_of_the_arm_with_the_values(name, kernel):
    model, signature = arm(name), SIGNATURES[kernel]
    names = [n for n in SEVERAL[name] if not n.startswith("joint3.motor")]
    dyn = aw.compile(model, vary=names)
    parameters = draws(dyn.varied, 2)
    states = inputs(signature, model.n, (2,))
    try:
        rebuilt_arms = [rebuilt(model, dyn.varied.names, row) for row in parameters]
        expected = [signature.function(each, *(s[k] for s in states)) for k, each in enumerate(rebuilt_arms)]
    except ModelError as error:  # the arm lacks what the kernel needs, such as a motor constant
        with pytest.raises(ModelError, match=str(error)):
            getattr(dyn, kernel)(*states, parameters)
        return
    found = getattr(dyn, kernel)(*states, parameters)
    single = len(signature.outputs) == 1
    for k, row in enumerate(expected):
        for one, other in zip([found] if single else found, [row] if single else row, strict=True):
            scale = max(1.0, np.abs(other).max())
            np.testing.assert_allclose(one[k], other, atol=1e-9 * scale, rtol=0)


TURNS = ("firmware.period_s", "firmware.latency_periods")


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", builtin_names())
def test_every_number_of_a_record_can_vary(name):
    """But when servos' loops turn, which is the same in all lanes."""
    model = arm(name)
    paths = [path for path, _, _ in quantities(model.description, pictures=False) if not path.endswith(TURNS)]
    varied = Varied(model, paths)
    assert len(varied.nominal) >= len(paths)
    dyn = aw.compile(model, vary=paths)
    states = inputs(SIGNATURES["inverse_dynamics"], model.n, (5,))
    found = dyn.inverse_dynamics(*states, varied.nominal)
    expected = aw.compile(model).inverse_dynamics(*states)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", range(6))
def test_so_can_those_of_trees_with_frames_and_slides(seed):
    model = build_model(random_description(seed))
    paths = [path for path, _, _ in quantities(model.description, pictures=False)]
    varied = Varied(model, paths)
    values = 0.998 * varied.nominal
    random = np.random.default_rng(seed)
    q, qd, qdd = random.uniform(-1.0, 1.0, size=(3, model.n))
    expected = aw.inverse_dynamics(rebuilt(model, varied.names, values), q, qd, qdd)
    found = aw.compile(model, vary=paths).inverse_dynamics(q, qd, qdd, values)
    np.testing.assert_allclose(found, expected, atol=1e-9 * max(1.0, np.abs(expected).max()))


def test_a_varied_zero_is_not_folded():
    model = arm("puma560")
    assert model.description.link("link4").com_m.value[0] == 0.0
    dyn = aw.compile(model, vary=["link4.com_m[0]"])
    q = np.full(6, 0.4)
    assert not np.array_equal(dyn.gravity_torques(q, [0.0]), dyn.gravity_torques(q, [0.02]))


def test_values_are_broadcast_like_the_other_inputs():
    dyn = aw.compile(arm("puma560"), vary=["link6.mass_kg"])
    q = np.linspace(-1.0, 1.0, 30).reshape(5, 6)
    masses = np.linspace(0.1, 2.0, 4).reshape(4, 1, 1)
    found = dyn.gravity_torques(q, masses)
    assert found.shape == (4, 5, 6)
    one = dyn.gravity_torques(q[2], [masses[3, 0, 0]])
    np.testing.assert_array_equal(found[3, 2], one)
    np.testing.assert_array_equal(dyn.gravity_torques(q, parameters=masses), found)


def test_changes_of_the_arm_are_kept():
    model = arm("puma560").replace(friction=None, gravity=[0.0, 0.0, -1.62])
    dyn = aw.compile(model, vary=["link6.mass_kg"])
    q = np.full(6, 0.3)
    np.testing.assert_allclose(
        dyn.inverse_dynamics(q, q, q, dyn.varied.nominal), aw.inverse_dynamics(model, q, q, q), atol=1e-12
    )


def test_bound_pickled_and_symbolic():
    import casadi

    dyn = aw.compile(arm("puma560"), vary=["link6.mass_kg", "link6.com_m"])
    q = np.full(6, 0.3)
    bound = dyn.bind("gravity_torques")
    bound.inputs["q"][:] = q
    bound.inputs["parameters"][:] = dyn.varied.nominal
    expected = aw.gravity_torques(arm("puma560"), q)
    np.testing.assert_allclose(bound(), expected, atol=1e-12)
    again = pickle.loads(pickle.dumps(dyn))
    np.testing.assert_array_equal(again.gravity_torques(q, dyn.varied.nominal), bound.result)
    function = dyn.casadi("gravity_torques")
    mass = casadi.SX.sym("m")
    slope = casadi.jacobian(function(q, casadi.vertcat(mass, dyn.varied.nominal[1:])), mass)
    assert slope.shape == (6, 1)


@pytest.mark.parametrize(
    ("vary", "value", "said"),
    [
        (["link6.mass"], "link6.mass", "expected link6.X, X one of mass_kg, com_m, inertia_kg_m2.xx"),
        (["lnk6.mass_kg"], "lnk6.mass_kg", "gravity_m_s2, waist, shoulder"),
        (["link6.com_m[3]"], "link6.com_m[3]", "no such parameter"),
        (["link6.mass_kg[0]"], "link6.mass_kg[0]", "no such parameter"),
        (["elbow.friction.smoothing_m_per_s"], "elbow.friction.smoothing_m_per_s", "elbow.X, X one of"),
        (["link6.com_m", "link6.com_m[1]"], "link6.com_m[1]", "named twice"),
        ("link6.mass_kg", "link6.mass_kg", "list of names"),
        ([6], [6], "list of names"),
    ],
)
def test_unknown_names_list_what_exists(vary, value, said):
    with pytest.raises(ModelError, match=said) as error:
        aw.compile(arm("puma560"), vary=vary)
    assert (error.value.place, error.value.value) == ("vary", value)


def test_an_absent_smoothing_speed_cannot_vary():
    with raises_at(ModelError, "vary", "smoothing speed", value="joint1.friction.smoothing_rad_per_s") as error:
        aw.compile(arm("rough"), vary=["joint1.friction.smoothing_rad_per_s"])
    assert error.value.value == "joint1.friction.smoothing_rad_per_s"


def test_what_was_taken_away_cannot_vary():
    with raises_at(ModelError, "vary", r"replace\(friction=…\)"):
        aw.compile(arm("puma560").replace(friction=None), vary=["elbow.friction.viscous_n_m_s_per_rad"])


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([[0.09, 1.0], [-0.2, 1.0]], "parameters[1] link6.mass_kg = -0.2: expected a number of 0 or more"),
        ([0.09, np.nan], "parameters[0] waist.motor.gear_ratio = nan: expected a number other than 0"),
        ([0.09, 0.0], "parameters[0] waist.motor.gear_ratio = 0.0: expected a number other than 0"),
    ],
)
def test_values_that_no_record_could_hold_are_refused(values, said):
    dyn = aw.compile(arm("puma560"), vary=["link6.mass_kg", "waist.motor.gear_ratio"])
    with pytest.raises(ModelError) as error:
        dyn.gravity_torques(np.zeros(6), values)
    assert str(error.value).startswith(said)


def test_impossible_bodies_are_refused_lane_by_lane():
    dyn = aw.compile(arm("puma560"), vary=["link2.inertia_kg_m2.xx"])
    good, bad = dyn.varied.nominal[0], 10.0
    with raises_at(ModelError, "parameters[2] link 'link2'", "impossible inertia"):
        dyn.gravity_torques(np.zeros(6), [[good], [good], [bad]])


FLAT = {"xx": 0.005, "yy": 0.005, "zz": 0.01}  # a disc: Izz = Ixx + Iyy, its pseudo-inertia is singular


def disc(zz=FLAT["zz"]):
    """The description of an arm whose one link is a disc."""
    numbers = {f"rod.inertia_kg_m2.{name}": value for name, value in (FLAT | {"zz": zz}).items()}
    return with_values(one_joint().description, numbers)


def test_bodies_of_many_lanes_have_the_pseudo_inertia_of_each():
    numbers = np.random.default_rng(0).normal(size=(10, 20))
    for lane, body in enumerate(vary._pseudo_inertias(numbers)):
        m, com, (xx, xy, xz, yy, yz, zz) = numbers[0, lane], numbers[1:4, lane], numbers[4:, lane]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        np.testing.assert_allclose(body, pseudo_inertia(m, com, tensor), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(("zz", "fits"), [(0.01, True), (0.01 * (1 + 1e-12), True), (0.01 * (1 + 1e-6), False)])
def test_a_flat_body_may_be_in_a_lane_what_it_may_be_in_a_record(zz, fits):
    rows = np.column_stack([np.linspace(0.5, 2.0, 7), np.full(7, 0.01)])
    rows[5, 1] = zz
    varied = Varied(build_model(disc()), ["rod.mass_kg", "rod.inertia_kg_m2.zz"])
    if fits:
        varied.check(rows)
        build_model(disc(zz))
        return
    with raises_at(ModelError, "parameters[5] link 'rod'", "impossible inertia"):
        varied.check(rows)
    with raises_at(DescriptionError, "link 'rod' inertia_kg_m2", "impossible inertia"):
        build_model(disc(zz))


def test_eigenvalues_of_flat_bodies_are_taken_of_many_at_once(monkeypatch):
    """Lanes on the border cost no Python each: 200,000 draws of a disc's mass took 17 s."""
    varied, asked = Varied(build_model(disc()), ["rod.mass_kg"]), []
    monkeypatch.setattr(vary, "is_possible", lambda body: asked.append(len(body)) or is_possible(body))
    varied.check(np.random.default_rng(0).lognormal(0.0, 0.1, (70_000, 1)))
    assert asked == [vary.PIECE, 70_000 - vary.PIECE]


def test_a_wrong_number_of_values():
    dyn = aw.compile(arm("puma560"), vary=["link6.mass_kg"])
    with pytest.raises(ShapeError, match="parameters"):
        dyn.gravity_torques(np.zeros(6), [0.1, 0.2])
    with pytest.raises(ShapeError, match="parameters: missing"):
        dyn.gravity_torques(np.zeros(6))

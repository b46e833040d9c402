"""The plant: states only for what is there, one meaning on floats, traced and compiled, and SciPy's solution at order 3."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

import armwright as aw
from armwright import scalar
from armwright.actuators import limited_drive
from armwright.dynamics import forward_dynamics
from armwright.errors import ModelError, ScenarioError
from armwright.kernels.batch import Kernel
from armwright.kernels.target import select_target
from armwright.model.vary import Varied
from armwright.program import trace
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from raises_at import raises_at
from simulation.plants import (
    BRAKE,
    COULOMB,
    ELASTIC,
    MANY,
    MOTOR,
    RK3,
    STOPS,
    SUPPLY,
    THERMAL,
    exact,
    magnitudes,
    pendulum,
    steps,
)

U = {"all": [12.0, 8.0], "springs": [12.0, 8.0]}
PLAY = {**ELASTIC, "backlash_rad": 0.004}
TOUCHING = pendulum(motor=MOTOR, elasticity=PLAY, stops=STOPS, limits={"position_rad": [-1.0, 1.0]})
FREE_LINK = pendulum(motor=MOTOR, elasticity={**PLAY, "backlash_rad": 1e3})
FAST = ("springs", "inductance", "elastic", "harmonic", "all")  # with time constants of a millisecond
SMOOTH = [name for name in MANY if name != "supply"]  # whose bus may take over the voltage limit within a run


def begun(plant):
    n = plant.model.n
    return plant.initial(np.full(n, 0.3), np.full(n, 0.5))


def test_a_plain_arm_has_the_plain_program():
    """Without extras not a state and not an operation more: the same instructions as from the equations alone."""
    arm = aw.load("puma560", on_impossible="warn")

    def bare(x, command):
        q, qd = x[:6], x[6:]
        return np.concatenate([qd, forward_dynamics(arm, q, qd, limited_drive(arm, qd, command).tau)])

    inputs = {"x": (12,), "command": (6,)}
    plant = Plant.of(arm)
    assert str(plant.program(PlantInputs(np.zeros(6))).program) == str(trace("plant", bare, inputs, ("xd",)))
    assert plant.layout.names == ("q", "qd")


@pytest.mark.parametrize("name", MANY)
def test_states_are_those_of_the_record(name):
    expected = {
        "plain": [],
        "inductance": ["current"],
        "current loop": ["current"],
        "cogging": [],
        "coast": [],
        "dead zone": [],
        "load": [],
        "thermal": ["winding_temperature", "housing_temperature"],
        "lugre": ["bristle"],
        "supply": ["bus_voltage"],
        "elastic": ["motor_q", "motor_qd"],
        "harmonic": ["motor_q", "motor_qd", "bristle"],
    }
    plant = Plant.of(MANY[name])
    names = list(plant.layout.names[2:])
    if name in expected:
        assert names == expected[name]
    assert plant.size == len(begun(plant)) == len(plant.derivative(begun(plant), np.zeros(plant.model.n)))
    with raises_at(ScenarioError, "name", value="nothing") as error:
        plant.part(begun(plant), "nothing")
    assert error.value.choices == plant.layout.names


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", MANY)
def test_floats_interpreter_and_native_code_agree(name):
    plant = Plant.of(MANY[name])
    n, x, u = plant.model.n, begun(plant), np.array(U.get(name, [12.0]))
    program = trace(
        "step", lambda x, u, h: plant.step(RK3, x, u, h), {"x": (plant.size,), "u": (n,), "h": ()}, ("next",)
    )
    compiled = Kernel(program, select_target(None))
    for _ in range(5):
        expected = plant.step(RK3, x, u, 1e-3)
        np.testing.assert_allclose(compiled(x, u, np.array(1e-3)), expected, rtol=1e-11, atol=1e-13)
        x = expected
    names = tuple(plant.outputs(x, u))
    outputs = trace("outputs", lambda x, u: tuple(plant.outputs(x, u).values()), {"x": (plant.size,), "u": (n,)}, names)
    for expected, native in zip(plant.outputs(x, u).values(), Kernel(outputs, select_target(None))(x, u), strict=True):
        np.testing.assert_allclose(native, expected, rtol=1e-10, atol=1e-12)


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", SMOOTH)
def test_scipy_finds_the_same_at_third_order(name):
    """SciPy on `derivative`, which knows nothing of exponentials; the error shrinks by 8 with half the step."""
    plant, u, duration = Plant.of(MANY[name]), U.get(name, [12.0]), 0.1
    x, counts = begun(plant), (400, 800) if name in FAST else (100, 200)
    reference = exact(plant, x, u, duration)
    scale = magnitudes(reference)
    error = [np.max(np.abs(steps(plant, x, u, duration / k, k)[-1] - reference) / scale) for k in counts]
    assert error[1] < 1e-5
    order = np.log2(error[0] / error[1])
    assert 2.6 < order < 4.2


STEP = {"inductance": 1e-5, "thermal": 5e-4, "lugre": 5e-4, "elastic": 5e-5, "coast": 5e-4, "load": 5e-4}


@pytest.mark.parametrize(("name", "step"), STEP.items())
def test_scipy_to_1e_8(name, step):
    plant, x = Plant.of(MANY[name]), begun(Plant.of(MANY[name]))
    reference = exact(plant, x, [12.0], 0.1)
    np.testing.assert_allclose(steps(plant, x, [12.0], step, round(0.1 / step))[-1], reference, rtol=1e-8, atol=1e-11)


def test_numbers_of_the_record_as_symbols():
    """A plant told with a varied inductance and stiffness is the one with those numbers, its derivative one call still."""
    arm = MANY["all"]
    varied = Varied(
        arm, ["joint0.motor.inductance_h", "joint0.elasticity.stiffness_n_m_per_rad", "supply.capacitance_f"]
    )
    x, u = begun(Plant.of(arm)), np.array([12.0, 8.0])

    def step(x, u, p):
        return Plant.of(varied.model(p)).step(RK3, x, u, 1e-3)

    program = trace("step", step, {"x": x.shape, "u": (2,), "p": (3,)}, ("next",))
    for factor in (1.0, 1.7):
        values = varied.nominal * factor
        expected = Plant.of(varied.model(values)).step(RK3, x, u, 1e-3)
        np.testing.assert_allclose(np.asarray(program.graph(x, u, values)).ravel(), expected, rtol=1e-11, atol=1e-13)


def test_motors_stand_where_their_links_are():
    plant = Plant.of(MANY["all"])
    x = plant.initial([0.3, -0.2], [0.5, 0.1])
    u = np.array([1.0, 2.0])
    (q, _, current), (motor_q, motor_qd, _) = plant.measured(x, u), plant.measured(x, u, "motor")
    assert plant.part(x, "motor_q") == pytest.approx(50.0 * 0.3)
    np.testing.assert_allclose(motor_q, [0.3, -0.2 + 10.0 / 50.0 * 0.3])
    np.testing.assert_allclose(motor_qd, [0.5, 0.1 + 10.0 / 50.0 * 0.5])
    assert current[0] == 0.0
    assert q.tolist() == [0.3, -0.2]
    assert x.shape == (plant.size,)
    assert plant.part(x, "bus_voltage") == SUPPLY["voltage_v"]


def test_a_coupled_motor_pulls_at_both_its_joints():
    """Power: n Kt i times the motor's speed, referred to its joint, is Kt i times its own speed."""
    plant = Plant.of(MANY["all"])
    x = plant.initial([0.3, -0.2], [0.5, 0.1])
    outputs = plant.outputs(x, np.array([0.0, 8.0]))
    motor = 10.0 * 0.5 + 50.0 * 0.1  # [rad/s]
    assert outputs["tau"][1] * motor / 50.0 == pytest.approx(0.06 * outputs["current"][1] * motor)


def test_outputs_of_a_plain_arm():
    plant = Plant.of(MANY["plain"])
    x, u = begun(plant), np.array([12.0])
    out = plant.outputs(x, u)
    assert list(out) == [
        *("qdd", "tau", "voltage", "current", "tau_link", "heat", "friction_loss", "electrical_power")
    ]  # fmt: skip
    assert out["heat"][0] == pytest.approx(1.2 * out["current"][0] ** 2)
    arm = plant.model.replace(friction=None, rotors=None)
    np.testing.assert_allclose(out["tau_link"], aw.inverse_dynamics(arm, x[:1], x[1:], out["qdd"]))
    bare = Plant.of(pendulum("torque")).outputs(x, u)
    assert np.isnan([*bare["heat"], *bare["voltage"], *bare["current"]]).all()


def test_a_wrench_reaches_every_plant():
    """As in `forward_dynamics`; the same acceleration of a plain arm and of one that has a state more."""
    wrench, u = np.array([3.0, 0.0, 5.0, 0.0, 2.0, 0.0]), np.array([12.0])
    plain, supplied = (Plant.of(MANY[name]) for name in ("plain", "supply"))
    found = [plant.derivative(begun(plant), PlantInputs(u, wrench))[1] for plant in (plain, supplied)]
    assert found[0] == pytest.approx(found[1], rel=1e-12)
    assert found[0] != pytest.approx(plain.derivative(begun(plain), u)[1])


@pytest.mark.parametrize("name", MANY)
def test_fast_parts_are_told_by_themselves(name):
    """`fast` says of the stiff entries what `split` says of them, without the arm's dynamics."""
    plant, u = Plant.of(MANY[name]), np.array(U.get(name, [12.0]))
    x = begun(plant) + 1e-3
    change, rates = plant.split(x, u)
    alone, same = plant.fast(x, u)
    np.testing.assert_array_equal(alone, change[list(plant.stiff)])
    np.testing.assert_array_equal(same, rates)


@given(st.floats(-1.2, 1.2), st.floats(-3.0, 3.0), st.floats(-0.01, 0.01), st.floats(-3.0, 3.0))
def test_contacts_are_those_of_the_state(q, qd, ahead, faster):
    """With the contacts held that there are, the derivative is what it is; a contact that is taken away pushes no more."""
    plant = Plant.of(TOUCHING)
    x = plant.initial([q], [qd])
    x += plant_moved(plant, ahead, faster)
    touching, u = plant.active_contacts(x), np.array([2.0])
    expected = [q >= 1.0, q <= -1.0, ahead >= 0.002, ahead <= -0.002]
    near = np.abs([q - 1.0, q + 1.0, ahead - 0.002, ahead + 0.002]) < 1e-12
    assert all(a == b or close for a, b, close in zip(touching, expected, near, strict=True))
    np.testing.assert_array_equal(plant.derivative(x, u), plant.derivative(x, PlantInputs(u, contacts=touching)))
    free, without_contact = plant.derivative(x, PlantInputs(u, contacts=np.zeros(4))), Plant.of(FREE_LINK)
    np.testing.assert_allclose(free, without_contact.derivative(x, u), rtol=1e-12)


def plant_moved(plant, ahead, faster):
    """The motor turned ahead of its link by an angle and a speed at the joint."""
    moved = np.zeros(plant.size)
    plant.part(moved, "motor_q")[:], plant.part(moved, "motor_qd")[:] = 50.0 * ahead, 50.0 * faster
    return moved


def test_brakes_take_part_only_where_they_are_asked_for():
    arm = pendulum(motor=MOTOR, friction=COULOMB, brake=BRAKE)
    assert Plant.of(arm).size == 2
    assert Plant.of(arm, brakes=True).layout.names == ("q", "qd", "brake")
    assert not Plant.of(MANY["plain"], brakes=True).brakes
    x = np.array([0.1, 0.2, 1e-3])
    plant = Plant.of(arm, brakes=True)
    released, applied = (PlantInputs(np.array([1.0]), brake=np.array([on])) for on in (0.0, 1.0))
    np.testing.assert_array_equal(plant.derivative(x, [1.0]), plant.derivative(x, released))
    assert scalar.is_symbolic(plant.program(applied).split(x, applied)[0])


def test_what_the_drives_did():
    """In each joint's own unit: the bus is all the voltage there is, a current that is on its way is not limited."""
    sagged = Plant.of(MANY["supply"])
    x = sagged.initial([0.3], [0.5])
    x[2] = 20.0
    assert sagged.applied(x, np.array([40.0])).tolist() == [20.0]
    assert Plant.of(MANY["plain"]).applied(x[:2], np.array([40.0])).tolist() == [40.0]
    loop = Plant.of(MANY["current loop"])
    np.testing.assert_allclose(loop.applied(np.array([0.3, 0.5, 2.0]), np.array([12.0])), 12.0)


@pytest.mark.parametrize(
    ("limits", "followed"),
    [({}, 12.0), ({"current_a": 3.0}, 9.0), ({"torque_n_m": 6.0}, 6.0), ({"voltage_v": 4.5}, 3.0 * (4.5 - 1.5) / 1.2)],
)
@pytest.mark.parametrize(
    "state", [{"inductance_h": 1e-3}, {"inductance_h": 1e-3, "current_loop_hz": 300.0}, {"thermal": THERMAL}]
)
def test_only_limits_keep_a_drive_from_its_command(state, limits, followed):
    """Not its winding, its current loop or its warm magnets: anti-windup would stop integrators for them."""
    plant = Plant.of(pendulum("torque", motor={**MOTOR, **state}, limits=limits))
    x = plant.initial([0.3], [0.5])  # E = 50 · 0.06 · 0.5 V; Kt i of 12 N m is 4 A
    if "thermal" in state:
        x[2:] = 20.0 if "voltage_v" in limits else 80.0  # warm, a winding takes more of the voltage
    else:
        x[2] = 1.0
    np.testing.assert_allclose(plant.applied(x, np.array([12.0])), followed, rtol=1e-12)


def test_an_elastic_gear_needs_its_rotor():
    with raises_at(ModelError, "joint 'joint0'", "elastic gear"):
        Plant.of(MANY["elastic"].replace(rotors=None))

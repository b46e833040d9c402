"""Brakes and coupled motors in the whole loop, under a controller: closed forms and the balance of energies."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.actuators.coupling import from_joints, shares_of
from armwright.errors import ABSENT, ScenarioError
from armwright.simulation.plant.plant import Plant
from physics.arms import arm
from raises_at import raises_at
from simulation.energies import stored_energy
from simulation.fields import scenario_of
from simulation.plants import BRAKE, ELASTIC, MOTOR, chain, pendulum
from simulation.test_servo import pendulum as servo

G, WEIGHT, LINK = 9.81, 3.0 * 9.81 * 0.3, 0.1 + 3.0 * 0.09  # of `pendulum`, at q = 0 [N m], [kg m²]
ROTOR = 50.0**2 * 2e-4  # [kg m²]
PID = aw.JointPID(kp=400.0, ki=400.0, kd=40.0, gravity=True)
PERIOD = 1e-3


def braked(**more):
    return pendulum(motor=MOTOR, brake=BRAKE, **more)


def test_a_released_brake_is_no_brake():
    common = {"controller": PID, "reference": [0.6], "period": PERIOD, "duration": 0.5}
    without = aw.simulate(scenario_of(braked(), **common))
    released = aw.simulate(scenario_of(braked(), brake=0, **common))
    np.testing.assert_allclose(released.q.values, without.q.values, atol=1e-13)
    assert "brake" not in without
    assert not released.brake.values.any()
    assert without.q.values[-1, 0] > 0.3


def test_an_applied_brake_holds_where_the_spring_says():
    """At rest k z is the weight. On the way there q follows Dahl's curve (F/k) ln(1 / (1 - torque/F)), F the holding torque:
    beyond where the weight alone would bring it, not as far as twice the weight would, since it swings in.
    """
    run = aw.simulate(
        aw.Scenario(
            braked(), duration=2.0,
            loop=aw.Loop(controller=lambda t, r, y: 0.0 * y.q, initial_command=[0.0], period=PERIOD),
            inputs=aw.Inputs(brake=[1]), solver=aw.Solver(substeps=2),
        )
    )  # fmt: skip
    holding, stiffness, q = BRAKE["holding_torque_n_m"], BRAKE["stiffness_n_m_per_rad"], run.q.values[-1, 0]
    assert run.brake.values[-1, 0] == pytest.approx(WEIGHT * np.cos(q) / stiffness, rel=1e-6)
    slow, fast = (-holding / stiffness * np.log(1.0 - most / holding) for most in (WEIGHT, 2.0 * WEIGHT))
    assert slow < q < fast
    assert np.abs(run.qd.values[-1]).max() < 1e-9


def test_applied_while_it_moves_it_takes_the_motion_away():
    """The arm slips at its holding torque: q̈ = -F / (J + n² J_m) until it rests, and the brake's heat is the motion's energy."""
    model = pendulum("torque", gravity=0.0, motor=MOTOR, brake=BRAKE)
    inertia, speed, holding = LINK + ROTOR, 2.0, BRAKE["holding_torque_n_m"]
    applied = aw.Schedule([0.0, 0.0505], [[0], [1]], ["joint0"])
    run = aw.simulate(
        aw.Scenario(
            model, duration=1.2, start=aw.Start(qd=[speed]),
            loop=aw.Loop(controller=lambda t, r, y: 0.0 * y.q, period=PERIOD, initial_command=[0.0]),
            inputs=aw.Inputs(brake=applied), solver=aw.Solver(substeps=8),
        )
    )  # fmt: skip
    qd, t = run.qd.values[:, 0], run.time.values
    stops = 0.0505 + speed * inertia / holding
    slipping = (t > 0.07) & (t < stops - 0.01)
    assert slipping.sum() > 3
    np.testing.assert_allclose(np.diff(qd[slipping]) / PERIOD, -holding / inertia, rtol=1e-3)
    assert np.abs(qd[t > stops + 1.0]).max() < 1e-5
    lost = np.trapezoid(run.friction_loss.values[:, 0], t)
    assert lost == pytest.approx(0.5 * inertia * speed**2, rel=5e-3)


def test_a_controller_cannot_move_what_is_braked_and_goes_on_when_it_is_not():
    """Its integrator kept down; electrical energy in = heat + friction + what is stored, all the way."""
    model = braked(limits={"voltage_v": 24.0, "current_a": 6.0}, friction={"viscous_n_m_s_per_rad": 0.8})
    control = aw.JointPID(
        kp=120.0, ki=360.0, kd=12.0, gravity=True, limit=24.0, anti_windup="back-calculation", tracking_time=0.1
    )
    applied = aw.Schedule([0.0, 0.2, 1.0], [[0], [1], [0]], ["joint0"])
    run = aw.simulate(
        aw.Scenario(
            model, duration=2.5, inputs=aw.Inputs(brake=applied),
            loop=aw.Loop(controller=control, reference=aw.trajectories.Ramp([0.0], [0.8], 1.0), period=PERIOD),
            solver=aw.Solver(substeps=2),
        )
    )  # fmt: skip
    q, t = run.q.values[:, 0], run.time.values
    held = q[(t > 0.3) & (t < 0.99)]
    most = 50.0 * 0.06 * 6.0 + WEIGHT  # all that current and weight can do, below the holding torque
    assert 0.05 < held.mean() < 0.3
    holding, stiffness = BRAKE["holding_torque_n_m"], BRAKE["stiffness_n_m_per_rad"]
    assert np.ptp(held) < 2.0 * holding / stiffness * np.log(1.0 / (1.0 - most / holding))  # from one side to the other
    assert q[-1] == pytest.approx(0.8, abs=5e-3)
    flows = {name: np.trapezoid(run[name].values[:, 0], t) for name in ("electrical_power", "heat", "friction_loss")}
    plant = Plant.of(model, brakes=True)
    states = np.stack([run[part.name].values[[0, -1], 0] for part in plant.layout], axis=1)
    stored = [float(stored_energy(plant, x)) for x in states]
    balance = flows["electrical_power"] - flows["heat"] - flows["friction_loss"]
    assert balance == pytest.approx(stored[1] - stored[0], abs=2e-2 * flows["electrical_power"])


@pytest.mark.study
def test_brakes_differ_by_lane_and_bits_do_not():
    joint = {"command": "voltage", "motor": MOTOR, "brake": BRAKE, "limits": {"current_a": 6.0}}
    model = chain([joint, joint], gravity=0.0)
    common = {"controller": PID, "reference": [0.5, -0.3], "period": PERIOD, "duration": 0.5}
    rows = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    many = aw.simulate(scenario_of(model, brake=aw.Batch(rows), **common))
    for lane, row in enumerate(rows):
        np.testing.assert_array_equal(
            aw.simulate(scenario_of(model, brake=row, **common)).q.values, many.q.values[lane]
        )
    moved = np.abs(many.q.values[:, -1]) > 0.05
    np.testing.assert_array_equal(moved, rows == 0)


@pytest.mark.parametrize(
    ("brake", "place", "value", "expected"),
    [
        (0.5, "inputs.brake of joint0", 0.5, "1, applied, or 0, released"),
        ([1, 0], "inputs.brake", ABSENT, "(1,): joint0"),
        (aw.Schedule([0.0], [[1.0]], ["wrist"]), "inputs.brake", ["wrist"], "joint0"),
        (
            aw.Schedule([0.0, 1.0], [[1.0], [2.0]], ["joint0"]),
            "inputs.brake of joint0",
            2.0,
            "1, applied, or 0, released",
        ),
        ("on", "inputs.brake", ["on"], "1 numbers: joint0"),
    ],
)
def test_brakes_that_cannot_be_are_refused(brake, place, value, expected):
    with pytest.raises(ScenarioError) as refused:
        scenario_of(braked(), command=[0.0], duration=0.1, brake=brake)
    assert (refused.value.place, refused.value.value, refused.value.expected) == (place, value, expected)


def test_an_arm_without_brakes_applies_none():
    with raises_at(ScenarioError, "inputs.brake", "two-link has a brake"):
        aw.Scenario(arm("two-link"), command=[0.0, 0.0], duration=0.1, inputs=aw.Inputs(brake=1))


def test_a_current_on_its_way_stops_no_integrator():
    """A load that comes at once is taken up as by a drive whose current is there at once."""
    law = aw.Cascade(position_kp=8.0, speed_kp=2.0, speed_ki=40.0)
    ends = []
    for winding in ({}, {"inductance_h": 1e-3, "current_loop_hz": 300.0}):
        model = pendulum("current", gravity=0.0, motor={**MOTOR, **winding})
        run = aw.simulate(
            aw.Scenario(
                model, duration=0.3, inputs=aw.Inputs(wrench=[0.0, 0.0, 0.0, 0.0, 10.0, 0.0]),
                loop=aw.Loop(controller=law, reference=[0.0], period=PERIOD), recording=aw.Recording(reduce=["saturation"]),
            )
        )  # fmt: skip
        assert run.saturation.values == 0.0
        ends.append(np.abs(run.q.values[50::50, 0]))
    assert ends[0].max() > 1e-4
    np.testing.assert_allclose(ends[1], ends[0], rtol=0.1)


WRIST = {**MOTOR, "gear_ratio": 30.0}


def wrist(**last):
    """An arm whose second and third motors turn with the joints before them, each in a unit of its own."""
    second = {**WRIST, "coupling": [{"joint": "joint0", "ratio": 12.0}]}
    third = {**WRIST, "coupling": [{"joint": "joint0", "ratio": -6.0}, {"joint": "joint1", "ratio": 9.0}], **last}
    return chain(
        [
            {"command": "voltage", "motor": MOTOR},
            {"command": "torque", "motor": second},
            {"command": "current", "motor": third},
        ]
    )


def differential():
    """Two motors that turn two joints together: their sum bends, their difference turns."""
    both = [
        {**WRIST, "coupling": [{"joint": f"joint{1 - k}", "ratio": 30.0 * sign}]} for k, sign in enumerate((-1.0, 1.0))
    ]
    return chain([{"command": "torque", "motor": motor} for motor in both])


@pytest.mark.parametrize("model", [wrist(), differential()], ids=["wrist", "differential"])
def test_what_holds_coupled_motors_holds_the_arm(model):
    """The command before the first tick is  N⁻ᵀ g  on the motors, and nothing moves."""
    q0 = [0.1, 0.2, 0.3][: model.n]
    run = aw.simulate(
        aw.Scenario(model, duration=0.3, start=q0, loop=aw.Loop(controller=lambda t, r, y: y.applied, period=PERIOD))
    )
    np.testing.assert_allclose(run.q.values, np.broadcast_to(q0, run.q.shape), atol=1e-9)
    motors = [from_joints(shares_of(model), aw.gravity_torques(model, q0))]
    np.testing.assert_allclose(run.tau.values[:1], motors, rtol=1e-9)


@pytest.mark.parametrize("side", ["motor", "link"])
def test_a_coupled_wrist_tracks(side):
    """Encoders on the motors tell N q; the loop is told q. In the end gravity is what the motors bear, Nᵀ Kt i."""
    model, goal = wrist(), np.array([0.3, -0.2, 0.4])
    control = aw.JointPID(kp=[400.0, 400.0, 20.0], ki=[400.0, 400.0, 20.0], kd=[20.0, 40.0, 2.0], gravity=True)
    run = aw.simulate(
        aw.Scenario(
            model, duration=8.0,
            loop=aw.Loop(controller=control, reference=aw.trajectories.Quintic([0.0, 0.0, 0.0], goal, 3.0),
                sensors=aw.Sensors(side=side), period=PERIOD),
            recording=aw.Recording(every=10),
        )
    )  # fmt: skip
    assert run.attrs["controller"] == "compiled"
    np.testing.assert_allclose(run.q_measured.values, run.q.values, atol=1e-12)
    np.testing.assert_allclose(run.qd_measured.values, run.qd.values, atol=1e-11)
    assert np.abs(run.q.values - run.q_reference.values).max() < 0.06
    np.testing.assert_allclose(run.q.values[-1], goal, atol=1e-4)
    ratios = np.array([[50.0, 0, 0], [12.0, 30.0, 0], [-6.0, 9.0, 30.0]])
    np.testing.assert_allclose(ratios.T @ (0.06 * run.current.values[-1]), aw.gravity_torques(model, goal), atol=2e-3)


def test_encoders_of_coupled_motors_count_the_motors_turns():
    """What the loop is told is N⁻¹ of whole counts."""
    counts, ratios = 64, np.array([[50.0, 0, 0], [12.0, 30.0, 0], [-6.0, 9.0, 30.0]])
    run = aw.simulate(
        aw.Scenario(
            wrist(), duration=0.05, start=[0.1, 0.2, 0.3],
            loop=aw.Loop(controller=lambda t, r, y: 0.0 * y.q, sensors=aw.Sensors(counts=counts), period=PERIOD),
        )
    )  # fmt: skip
    turns = run.q_measured.values @ ratios.T / (2.0 * np.pi) * counts
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    assert np.abs(run.q_measured.values - run.q.values).max() > 1e-5


@pytest.mark.parametrize("elastic", [False, True])
def test_power_balances_with_coupled_motors_under_a_controller(elastic):
    model = wrist()
    if elastic:
        second = {**WRIST, "coupling": [{"joint": "joint0", "ratio": 12.0}]}
        model = chain(
            [{"command": "voltage", "motor": MOTOR}, {"command": "voltage", "motor": second, "elasticity": ELASTIC}]
        )
    goal = np.array([0.3, -0.2, 0.4])[: model.n]
    control = aw.JointPID(kp=[60.0, 60.0, 5.0][: model.n], kd=[6.0, 6.0, 0.5][: model.n], gravity=True)
    run = aw.simulate(
        aw.Scenario(
            model, duration=0.4,
            loop=aw.Loop(controller=control, reference=aw.trajectories.Quintic(0.0 * goal, goal, 0.5), period=1e-4),
        )
    )  # fmt: skip
    flows = {
        n: np.trapezoid(run[n].values.sum(axis=1), run.time.values)
        for n in ("electrical_power", "heat", "friction_loss")
    }
    plant = Plant.of(model)
    rows = [np.concatenate([run[part.name].values[k][list(part.joints)] for part in plant.layout]) for k in (0, -1)]
    stored = [float(stored_energy(plant, x)) for x in rows]
    balance = flows["electrical_power"] - flows["heat"] - flows["friction_loss"]
    assert balance == pytest.approx(stored[1] - stored[0], abs=2e-3 * flows["electrical_power"])
    assert flows["electrical_power"] > 0.5


@pytest.mark.parametrize("winding", [{}, {"inductance_h": 1e-3}])
def test_a_supply_over_time_is_a_limit_of_the_drive(winding):
    """It stops integrators, and is counted as saturation, as a limit of that voltage does."""
    law = aw.Cascade(position_kp=8.0, speed_kp=20.0, speed_ki=400.0)
    runs = []
    for limits, supply in (({"voltage_v": 6.0}, None), ({}, aw.Schedule([0.0], [[6.0]], ["supply"]))):
        model = pendulum("voltage", gravity=0.0, motor={**MOTOR, **winding}, limits=limits)
        run = aw.simulate(
            aw.Scenario(
                model, duration=0.8, inputs=aw.Inputs(supply=supply), recording=aw.Recording(reduce=["saturation"]),
                loop=aw.Loop(controller=law, reference=[1.0], period=PERIOD),
            )
        )  # fmt: skip
        runs.append(run)
    assert 0.1 < runs[0].saturation.values < 0.9
    assert runs[1].saturation.values == runs[0].saturation.values
    np.testing.assert_allclose(runs[1].q.values, runs[0].q.values, atol=1e-9)


@pytest.mark.parametrize("tick", [0, 5])
@pytest.mark.parametrize("is_servo", [False, True])
def test_measured_currents_are_those_of_the_supply_and_of_servos_that_are_on(is_servo, tick):
    """From the first measurement on."""
    if is_servo:
        model, inputs = servo(), aw.Inputs(enabled=aw.Schedule([0.0, 3 * PERIOD], [[1.0], [0.0]], ["q"]))
    else:
        model, inputs = pendulum("voltage", motor=MOTOR), aw.Inputs(supply=1.5)

    def run(law):
        loop = aw.Loop(law, period=PERIOD, initial_command=[6.0])
        return aw.simulate(aw.Scenario(model, 8 * PERIOD, loop=loop, inputs=inputs))

    def shown(t, r, y):
        return scalar.where(scalar.less(t, (tick - 0.5) * PERIOD), 6.0 + 0.0 * y.q, y.current)

    expected = run(lambda t, r, y: 6.0 + 0.0 * y.q).current.values
    assert run(shown).u.values[tick] == pytest.approx(expected[tick], rel=1e-12)
    assert np.ptp(expected) > 0.1

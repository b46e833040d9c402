"""A run that goes on from another's end: with every state of its drives, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from physics.arms import arm
from simulation.plants import BRAKE, MANY, MOTOR, pendulum


@pytest.mark.parametrize("name", MANY)
def test_two_runs_are_one(name, tmp_path):
    """Currents, bristles, temperatures, motors behind springs and the bus begin as they ended; through a file as well."""
    model = MANY[name]
    common = {"command": np.full(model.n, 5.0), "step": 2e-4}
    whole = aw.simulate(aw.Scenario(model, duration=0.1, **common))
    first = aw.simulate(aw.Scenario(model, duration=0.05, **common))
    aw.save(first, tmp_path / "first.nc")
    for run in (first, aw.load_run(tmp_path / "first.nc")):
        second = aw.simulate(aw.Scenario(model, initial=run, duration=0.05, **common))
        for variable in whole.data_vars:
            np.testing.assert_array_equal(second[variable].values, whole[variable].values[250:], err_msg=str(variable))
    assert second.time.values[0] == 0.0


def test_a_brake_stays_as_bent_as_it_was():
    model = pendulum("torque", motor=MOTOR, brake=BRAKE)
    common = {"command": [3.0], "brake": 1, "step": 5e-4}
    whole = aw.simulate(aw.Scenario(model, duration=0.1, **common))
    first = aw.simulate(aw.Scenario(model, duration=0.05, **common))
    second = aw.simulate(aw.Scenario(model, initial=first, duration=0.05, **common))
    np.testing.assert_array_equal(second.q.values, whole.q.values[100:])
    unbraked = aw.simulate(aw.Scenario(model, command=[3.0], step=5e-4, duration=0.05))
    fresh = aw.simulate(aw.Scenario(model, initial=unbraked, duration=0.05, **common))
    assert fresh.brake.values[0, 0] == 0.0


def law(t, r, y):
    return 300.0 * (r.q - y.q) + 30.0 * (r.qd - y.qd)


def test_lanes_go_on_under_another_controller():
    """With the command in force, what the controller is told first is what the drives did last."""
    model = arm("cmu-dd")
    q0 = aw.Batch(np.random.default_rng(0).uniform(-0.2, 0.2, (5, 6)))
    common = {"reference": np.full(6, 0.1), "sample_period": 2e-3}
    whole = aw.simulate(aw.Scenario(model, controller=law, q0=q0, duration=0.2, **common))
    first = aw.simulate(aw.Scenario(model, controller=law, q0=q0, duration=0.1, **common))
    second = aw.simulate(aw.Scenario(model, controller=law, initial=first, duration=0.1, **common))
    np.testing.assert_array_equal(second.q.values, whole.q.values[:, 50:])
    told = aw.simulate(aw.Scenario(model, controller=lambda t, r, y: y.applied, initial=first, duration=0.01, **common))
    np.testing.assert_allclose(told.u.values[:, 0], first.u.values[:, -1], rtol=1e-9, atol=1e-9)
    one = aw.simulate(aw.Scenario(model, controller=law, initial=first.isel(lane=3), duration=0.1, **common))
    np.testing.assert_array_equal(one.q.values, second.q.values[3])
    spread = aw.simulate(
        aw.Scenario(model, controller=aw.JointPID(kp=aw.Batch([100.0, 200.0])), initial=one, duration=0.01, **common)
    )
    np.testing.assert_array_equal(spread.q.values[:, 0], np.broadcast_to(one.q.values[-1], (2, 6)))
    middle = aw.simulate(aw.Scenario(model, controller=law, initial=whole.isel(time=slice(51)), duration=0.1, **common))
    np.testing.assert_array_equal(middle.q.values, second.q.values)


RUN = aw.simulate(aw.Scenario(arm("two-link"), command=[1.0, 1.0], duration=0.01))


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"initial": "run.nc"}, "initial: of type str; expected a run that recorded q, qd and u"),
        ({"initial": RUN.isel(time=slice(0))}, "initial: a dataset without such rows; expected a run"),
        ({"initial": RUN.drop_vars("qd")}, "expected a run that recorded q, qd and u"),
        ({"initial": RUN.drop_vars("command")}, "no coordinate 'command'; expected a run"),
        ({"initial": RUN, "q0": [0.0, 0.0]}, "q0 and initial: expected one of them"),
        ({"initial": RUN.assign_coords(joint=["a", "b"])}, "a run of the joints a, b; expected shoulder, elbow"),
        (
            {"initial": RUN.assign_coords(command=("joint", ["torque", "voltage"]))},
            "drives told torque, voltage; expected",
        ),
    ],
)
def test_what_is_no_beginning_is_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        aw.Scenario(arm("two-link"), command=[1.0, 1.0], duration=0.01, **fields)


def test_states_that_were_not_recorded_are_asked_for():
    model = MANY["elastic"]
    bare = aw.simulate(aw.Scenario(model, command=[1.0], duration=0.01, step=2e-4, record="state"))
    with pytest.raises(
        ScenarioError, match="initial: the run tells no motor_q; expected one of this arm, with record = 'all'"
    ):
        aw.simulate(aw.Scenario(model, command=[1.0], duration=0.01, step=2e-4, initial=bare))


def test_a_lane_that_diverged_is_no_beginning():
    qd0 = aw.Batch([[0.0, 0.0], [1e200, 0.0]])
    run = aw.simulate(aw.Scenario(arm("two-link"), command=np.zeros(2), qd0=qd0, duration=0.01))
    with pytest.raises(ScenarioError, match="initial: lane 1 stopped at t = 0 s"):
        aw.Scenario(arm("two-link"), command=np.zeros(2), duration=0.01, initial=run)
    aw.simulate(aw.Scenario(arm("two-link"), command=np.zeros(2), duration=0.01, initial=run.isel(lane=0)))

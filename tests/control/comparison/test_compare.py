"""Controllers on the same motions: known errors, payloads, noise, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import armwright as aw
from armwright.control.comparison.compare import command_limits
from armwright.errors import ScenarioError
from armwright.fitting.measures import rms

SPEED, KP = 0.5, 8.0
GAINS = {"position_kp": KP, "speed_kp": [1600.0, 400.0]}  # without friction and gravity no integrator is needed
CONTROLLERS = {"lags": aw.Cascade(**GAINS), "follows": aw.Cascade(**GAINS, speed_feedforward=1.0)}
RAMP = aw.trajectories.Ramp(np.zeros(2), np.array([SPEED, 0.0]), 1.0)


@pytest.fixture(scope="module")
def arm():
    return aw.load("two-link").replace(gravity=np.zeros(3))


def scenario(arm, **sensors):
    loop = aw.Loop(CONTROLLERS["lags"], period=5e-4, sensors=aw.Sensors(**sensors))
    return aw.Scenario(arm, duration=1.0, loop=loop)


@pytest.fixture(scope="module")
def ramps(arm):
    return aw.loops.compare_controllers(scenario(arm), CONTROLLERS, {"ramp": RAMP}, runs=2)


def test_a_speed_loop_behind_a_position_gain_lags_by_speed_over_gain(ramps):
    """q̇ = kp (q_r - q) in the end, so q_r - q = v / kp; with all of the reference's speed fed forward 0."""
    error = ramps.data["error"].isel(motion=0, payload=0).sel(joint="shoulder")
    late = (error["instant"] > 0.44) & (error["instant"] < 0.49)  # of 2 s: before the ramp's end
    np.testing.assert_allclose(error.sel(controller="lags")[late], SPEED / KP, rtol=0.02)
    assert (error.sel(controller="follows")[late] < 0.02 * SPEED / KP).all()


def test_measures_of_the_ramp(ramps):
    data = ramps.data.isel(motion=0, payload=0)
    assert data["largest_error"].dims == ("controller", "joint")
    assert data["rms_error"].sel(controller="follows", joint="shoulder") < data["rms_error"].sel(
        controller="lags", joint="shoulder"
    )
    late = data.sel(controller="lags")
    assert late["settling_time"].sel(joint="shoulder") == pytest.approx(np.log(SPEED / KP / 1e-3) / KP, rel=0.08)
    assert late["path_largest"] < 0.3 * late["largest_error"].sel(joint="shoulder")  # late, but near its arc
    assert (data["path_repeatability"] == 0.0).all()  # no noise: the runs are the same
    assert (data["failed"] == 0).all()
    assert [table.title for table in ramps.tables()][1:] == ["tool off its path"]
    for table in ramps.tables():
        assert [row["controller"] for row in table.rows()] == ["lags", "follows"]
        assert {len(row) for row in table.cells} == {len(table.heads)}


def test_a_saved_comparison_has_its_measures(ramps, tmp_path):
    ramps.save(tmp_path / "errors.nc")
    with xr.open_dataset(tmp_path / "errors.nc", engine="h5netcdf") as data:
        np.testing.assert_array_equal(data["rms_error"], ramps.data["rms_error"])
        assert data["rms_error"].attrs == ramps.data["rms_error"].attrs
        assert list(data["controller"].values) == list(CONTROLLERS)


@pytest.mark.study
def test_noise_spreads_the_runs_and_payloads_cost_effort(arm):
    load = aw.Payload(0.0, 2.0, np.zeros(3), np.zeros((3, 3)))
    motion = aw.trajectories.Quintic(np.zeros(2), np.array([0.8, -0.6]), 0.5)
    controllers = {"only": CONTROLLERS["follows"]}
    quiet, noisy = (
        aw.loops.compare_controllers(
            scenario(arm, position_noise=noise), controllers, {"move": motion}, (None, load), runs=3
        )
        for noise in (0.0, 1e-3)
    )
    assert list(quiet.data["payload"].values) == ["none", "2 kg"]
    assert (quiet.data["path_repeatability"] == 0.0).all()
    assert (noisy.data["path_repeatability"] > 1e-5).all()
    largest = quiet.data["largest_error"].isel(controller=0, motion=0).max("joint")
    assert largest.sel(payload="2 kg") > largest.sel(payload="none")


def test_computed_torque_follows_a_known_arm(arm):
    law = aw.ComputedTorque(kp=400.0, kd=40.0)
    motion = aw.trajectories.Quintic(np.zeros(2), np.array([0.8, -0.6]), 0.5)
    found = aw.loops.compare_controllers(scenario(arm), {"model": law, **CONTROLLERS}, {"move": motion}, runs=1)
    largest = found.data["largest_error"].isel(motion=0, payload=0).max("joint")
    assert largest.sel(controller="model") < 0.05 * largest.sel(controller="lags")
    assert np.isnan(found.data["path_repeatability"]).all()  # of one run nothing is known


def test_a_controller_that_diverges_has_no_measures(arm):
    wild = {"wild": aw.JointPID(kp=1e9), "lags": CONTROLLERS["lags"]}
    found = aw.loops.compare_controllers(scenario(arm), wild, {"ramp": RAMP}, runs=2)
    data = found.data.isel(motion=0, payload=0)
    assert list(data["failed"].values) == [2, 0]
    assert np.isnan(data["rms_error"].sel(controller="wild")).all()
    wild_row, other = found.rows()
    assert [*wild_row.values()][3:] == [None] * (len(wild_row) - 4) + [2]
    assert other["failed runs"] is None


def test_a_scenario_brings_its_own_period(arm):
    slow = aw.Scenario(arm, duration=1.0, loop=aw.Loop(CONTROLLERS["lags"], period=2e-2))
    found = aw.loops.compare_controllers(scenario(arm), {"slow": slow, **CONTROLLERS}, {"ramp": RAMP}, runs=1)
    assert found.data["largest_error"].sizes["controller"] == 3


def test_by_default_there_are_as_many_runs_as_every_scenario_has_lanes(arm):
    lanes = {
        name: replace(scenario(arm), start=aw.Batch(np.zeros((count, 2)))) for name, count in (("two", 2), ("three", 3))
    }
    assert aw.loops.compare_controllers(scenario(arm), lanes, {"ramp": RAMP}).runs == 2


def test_limits_of_commands():
    """[A] of `lwa4p`: no more than the current and the torque allow;  [V] of `cmu-dd`."""
    modular, direct = aw.load("lwa4p"), aw.load("cmu-dd")
    first = modular.coordinates[0]
    per_ampere = first.drive.gear_ratio * first.drive.torque_constant
    expected = min(first.limits.current, first.limits.torque / per_ampere)
    assert command_limits(modular)[0] == pytest.approx(expected, rel=1e-12)
    np.testing.assert_array_equal(command_limits(direct), [body.limits.voltage for body in direct.coordinates])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"controllers": {}}, "controllers"),
        ({"motions": {}}, "motions"),
        ({"motions": {"m": 3.0}}, "motions"),
        ({"motions": {"m": aw.trajectories.Ramp(np.zeros(3), np.ones(3), 1.0)}}, "3 joints"),
        ({"motions": {"m": aw.trajectories.Sine(np.zeros(2), np.ones(2), 1.0)}}, "does not end"),
        ({"payloads": ()}, "payloads"),
        ({"runs": 0}, "runs"),
        ({"band": -1.0}, "band"),
        ({"band": [1.0, 2.0, 3.0]}, "band"),
        ({"settle": 0.0}, "settle"),
        ({"controllers": {"c": 3.0}}, "controller"),
    ],
)
def test_it_refuses(arm, changes, words):
    arguments = {"controllers": CONTROLLERS, "motions": {"ramp": RAMP}} | changes
    with pytest.raises(ScenarioError, match=words):
        aw.loops.compare_controllers(scenario(arm), **arguments)


def test_it_refuses_another_arm(arm):
    other = aw.Scenario(aw.load("cmu-dd"), duration=1.0, loop=aw.Loop(aw.JointPID(kp=1.0), period=5e-4))
    with pytest.raises(ScenarioError, match="another record"):
        aw.loops.compare_controllers(scenario(arm), {"other": other}, {"ramp": RAMP})


def test_the_same_error_has_the_same_size_in_every_room(arm, ramps):
    """A comparison, the reducer that `tune` minimises, and the recorded rows: q − r over the rows of the motion."""
    plain = scenario(arm)
    loop = replace(plain.loop, reference=RAMP)
    run = aw.simulate(
        replace(plain, loop=loop, start=aw.Start(*RAMP.at(0.0)[:2]), recording=aw.Recording(reduce=("rms_error",)))
    )
    recorded = rms(run["q"].values - RAMP.at(run["time"].values)[0], axis=0)
    np.testing.assert_allclose(run["rms_error"].values, recorded, rtol=1e-12)
    compared = ramps.data["rms_error"].sel(controller="lags").isel(motion=0, payload=0)
    np.testing.assert_allclose(compared, recorded, rtol=1e-12)

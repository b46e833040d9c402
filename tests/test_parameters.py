"""Batches, draws and the table of an arm's parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import stats

import armwright as aw
from armwright.description.paths import quantities, unit_at
from armwright.errors import ArmwrightError, ModelError, ScenarioError, ScheduleError
from armwright.parameters import Draw, LaneFields, resolved
from frozen.runs import GEARED, swing
from physics.arms import NAMES, arm
from raises_at import raises_at
from simulation.fields import scenario_of

LANES = range(20_000)


@pytest.mark.parametrize(
    ("draw", "law"),
    [
        (Draw.normal(2.0, 0.5), stats.norm(2.0, 0.5)),
        (Draw.normal(2.0, 0.5, low=1.5), stats.truncnorm(-1.0, np.inf, 2.0, 0.5)),
        (Draw.normal(0.0, 1.0, -0.5, 2.0), stats.truncnorm(-0.5, 2.0)),
        (Draw.uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
        (Draw.lognormal(2.0, 0.3), stats.lognorm(0.3, scale=2.0)),
    ],
)
def test_draws_have_their_distribution(draw, law):
    values = draw.batch(7, "vary['x']", LANES).values
    assert stats.kstest(values, law.cdf).pvalue > 1e-3  # one stream of numbers: this passes always or never
    assert stats.kstest(draw.batch(8, "vary['x']", LANES).values, law.cdf).pvalue > 1e-3


def test_a_lane_is_the_same_whatever_the_others():
    draw = Draw.normal([0.0, 1.0, 2.0], 0.5)
    whole = draw.batch(3, "q0", range(1000)).values
    assert whole.shape == (1000, 3)
    for lanes in (range(77, 78), range(5, 9), range(10), range(998, 1000)):
        np.testing.assert_array_equal(draw.batch(3, "q0", lanes).values, whole[lanes.start : lanes.stop])
    other = [draw.batch(4, "q0", range(1000)).values, draw.batch(3, "qd0", range(1000)).values]
    for values in other:
        assert abs(np.corrcoef(values[:, 0], whole[:, 0])[0, 1]) < 0.15
    assert abs(np.corrcoef(whole[:-1, 0], whole[1:, 0])[0, 1]) < 0.15


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Draw.normal(1.0, -0.1), lambda: Draw.normal(1.0, np.nan), lambda: Draw.normal("1", 0.1),
        lambda: Draw.normal(0.0, 1.0, low=2.0, high=1.0), lambda: Draw.uniform(1.0, 0.9), lambda: Draw.lognormal(-1.0, 0.1),
        lambda: Draw().batch(0, "controller.kp", LANES), lambda: Draw.normal(np.inf, 1.0),
    ],
)  # fmt: skip
def test_draws_that_cannot_be_are_refused(wrong):
    with pytest.raises(ScenarioError):
        wrong()


def uncertain(**more):
    given = {
        "controller": aw.JointPID(kp=Draw.uniform(20.0, 40.0), kd=3.0), "reference": swing, "period": 2e-3,
        "substeps": 8, "integrator": "rk3", "duration": 0.02, "seed": 5,
        "vary": {"rod1.mass_kg": Draw.normal(3.0, 0.3, low=1.0), "joint0.motor.resistance_ohm": Draw.lognormal(1.2, 0.1)},
        "sensors": aw.Sensors(position_noise=Draw.uniform(0.0, 1e-4)), "q0": Draw.normal([0.1, -0.1], 0.02),
        "timing": aw.Timing(command_delay=Draw.uniform(0.0, 2e-3)),
        "payload": [aw.Payload(0.01, Draw.uniform(0.1, 0.5), [0, 0, 0], [0, 0, 0], frame="rod1")],
    }  # fmt: skip
    return scenario_of(GEARED, **(given | more))


def test_one_lane_of_a_thousand_alone():
    many, alone = aw.simulate(uncertain(lanes=1000)), aw.simulate(uncertain(lanes=range(77, 78)))
    assert alone.sizes["lane"] == 1
    assert list(alone.lane.values) == [77]
    for name in ("q", "qd", "u", "q_measured", "tau"):
        np.testing.assert_array_equal(alone[name].values[0], many[name].values[77], err_msg=name)
    part = aw.simulate(uncertain(lanes=range(990, 1000)))
    np.testing.assert_array_equal(part.q.values, many.q.values[990:])
    assert len(np.unique(many.q.values[:, -1, 0])) == 1000


@pytest.mark.study
def test_a_million_lanes_of_twelve_uncertain_parameters():
    """In the time and memory of a test; lane 77 is the same alone."""
    names = [f"rod{k}.{p}" for k in (0, 1) for p in ("mass_kg", "com_m[0]", "com_m[2]")]
    drives = ("motor.torque_constant_n_m_per_a", "motor.resistance_ohm", "friction.viscous_n_m_s_per_rad")
    table = GEARED.parameters
    names += [f"joint{k}.{p}" for k in (0, 1) for p in drives]
    vary = {name: Draw.normal(table[name].value, 0.05 * abs(table[name].value) or 0.005) for name in names}
    law = aw.JointPID(kp=400.0, kd=30.0)
    given = {"controller": law, "reference": swing, "period": 2e-3, "substeps": 8, "duration": 4e-3, "seed": 5}
    scenario = scenario_of(GEARED, integrator="rk3", vary=vary, lanes=10**6, what="none", reduce=["rms_error"], **given)
    many = aw.simulate(scenario)
    alone = aw.simulate(replace(scenario, lanes=range(77, 78)))
    assert many.sizes["lane"] == 10**6
    np.testing.assert_array_equal(many.rms_error.values[77], alone.rms_error.values[0])
    assert np.isfinite(many.rms_error.values).all()


def test_what_does_not_say_how_many_lanes_is_refused():
    with pytest.raises(ScenarioError, match="lanes = None"):
        uncertain()
    with pytest.raises(ScenarioError, match=" lanes; expected "):
        uncertain(lanes=4, qd0=aw.Batch(np.zeros((3, 2))))
    with pytest.raises(ScenarioError, match="holds lane 9"):
        uncertain(lanes=range(5, 10), qd0=aw.Batch(np.zeros((8, 2))))
    for lanes in (0, -1, 2.5, range(3, 3), range(0, 9, 2), "all"):
        with pytest.raises(ScenarioError, match="lanes = "):
            uncertain(lanes=lanes)


def test_a_draw_by_the_record_follows_its_standard_deviation():
    robot = GEARED.with_values({"rod1.mass_kg": {"value": 3.0, "std": 0.2, "source": "measurement"}})
    assert robot.parameters["rod1.mass_kg"].std == 0.2
    scenario = aw.Scenario(
        robot, command=[0, 0], duration=1e-3, vary={"rod1.mass_kg": Draw()}, lanes=5000, solver=aw.Solver(step=1e-3)
    )
    masses = scenario.resolved.parameters[:, 0]
    assert stats.kstest(masses, stats.norm(3.0, 0.2).cdf).pvalue > 1e-3
    with raises_at(ScenarioError, "vary['rod1.mass_kg']", r"rod1\.mass_kg"):
        aw.Scenario(GEARED, command=[0, 0], duration=1e-3, vary={"rod1.mass_kg": Draw()}, lanes=5)


@dataclass(frozen=True)
class Gains:
    K: object
    k: object = 1.0


def test_fields_of_any_shape_vary():
    rows = np.arange(24.0).reshape(3, 2, 4)
    fields = LaneFields.of(Gains(aw.Batch(rows), aw.Batch([1.0, 2.0, 3.0])), "controller")
    assert fields.names == ("K", "k")
    assert fields.lanes == 3
    own = fields.with_values(fields.values[1])
    np.testing.assert_array_equal(own.K, rows[1])
    assert own.k == 2.0
    part = resolved(Gains(aw.Batch(rows), Draw.uniform(0, 1)), "controller", 0, range(1, 3))
    assert len(part.K) == len(part.k) == 2
    np.testing.assert_array_equal(part.K.values, rows[1:])


def test_fields_of_fields_vary():
    outer = Gains(Gains(aw.Batch([[1.0, 2.0], [3.0, 4.0]]), 7.0), aw.Batch([5.0, 6.0]))
    fields = LaneFields.of(outer, "controller")
    assert fields.names == ("K.K", "k")
    own = fields.with_values(fields.values[1])
    assert (own.K.K.tolist(), own.K.k, own.k) == ([3.0, 4.0], 7.0, 6.0)
    assert isinstance(outer.K, Gains)
    assert len(outer.K.K) == 2  # the object itself stays
    with raises_at(ScenarioError, "controller.K[0]", "Batch"):
        LaneFields.of(Gains([aw.Batch([1.0])]), "controller")


# The table.


@pytest.mark.parametrize("name", NAMES)
def test_the_table_holds_every_number_of_the_record(name):
    model = arm(name)
    table = model.parameters
    counted = sum(np.size(q.value) for _, q, _ in quantities(model.description, pictures=False) if np.ndim(q.value) < 2)
    assert len(table) == counted > 10
    assert len(set(table.names)) == len(table)
    for row in table:
        assert table[row.name] is row
        assert row.scale > 0.0
        assert row.bounds[0] <= row.value <= row.bounds[1]
        assert row.unit
    np.testing.assert_array_equal(table.values, [row.value for row in table])
    first = next(row for row in table if row.name.endswith("mass_kg"))
    assert first.unit == "kg"
    assert first.bounds[0] == 0.0
    assert str(table.chosen("mass_kg")).count("\n") == len(table.chosen("mass_kg"))


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("joint2.friction.viscous_n_m_s_per_rad", "N m s/rad"), ("gravity_m_s2", "m/s²"), ("link1.com_m[2]", "m"),
        ("link1.inertia_kg_m2.xx", "kg m²"), ("joint1.motor.torque_constant_n_m_per_a", "N m/A"), ("joint1.dh.a_m", "m"),
        ("joint1.motor.gear_ratio", "1"), ("joint1.motor.thermal.winding_capacity_j_per_k", "J/K"),
        ("joint1.motor.thermal.resistance_temperature_coefficient_per_k", "1/K"),
        ("joint1.elasticity.cubic_n_m_per_rad3", "N m/rad³"), ("supply.source_resistance_ohm", "Ω"),
    ],
)  # fmt: skip
def test_units_are_those_of_the_keys(path, unit):
    assert unit_at(path) == unit


def test_unknown_parameters_are_named():
    with raises_at(ModelError, "parameters", r"rod1\.mass_kg", value="rod1.mass"):
        _ = GEARED.parameters["rod1.mass"]
    with pytest.raises(ArmwrightError):
        _ = replace(GEARED, description=None).parameters


@pytest.mark.parametrize(
    ("fields", "place"),
    [
        ({"kind": "norml"}, "Draw.kind"),
        ({"kind": ["normal"]}, "Draw.kind"),
        ({"kind": "normal", "centre": "a", "spread": 1.0}, "Draw.centre"),
        ({"kind": "normal", "centre": 0.0, "spread": 1j}, "Draw.spread"),
        ({"kind": "normal", "centre": 0.0, "spread": np.ma.masked_array([1.0, 2.0], mask=[0, 1])}, "Draw.spread"),
        ({"kind": "normal", "centre": 0.0, "spread": 1.0, "low": [0.0, 0.0]}, "Draw.low"),
        ({"kind": "normal", "centre": 0.0, "spread": 1.0, "high": None}, "Draw.high"),
        ({"kind": "normal", "centre": 10**400, "spread": 1.0}, "Draw.centre"),
    ],
)
def test_draws_of_something_else_than_numbers_are_refused_in_one_line(fields, place):
    with pytest.raises(ScenarioError) as error:
        aw.Draw(**fields)
    assert error.value.place == place
    assert len(str(error.value).splitlines()) == 1


def test_masked_batches_are_refused():
    with pytest.raises(ScenarioError, match="masked entries"):
        aw.Batch(np.ma.masked_array([1.0, 2.0], mask=[0, 1]))


@pytest.mark.parametrize(
    "value", [["1", "2"], [1j, 2], np.ma.masked_array([1.0, 2.0], mask=[0, 1]), [10**400, 1], [None, 1]]
)
def test_positions_that_are_no_numbers_are_refused(value):
    with pytest.raises(ScenarioError, match=r"Step\.start"):
        aw.trajectories.Step(value, [0.0, 0.0])
    with pytest.raises(ScheduleError, match="commands"):
        aw.Schedule([0.0], [value], ["a", "b"])
    with pytest.raises(ScenarioError, match="kp"):
        aw.Scenario(aw.load("two-link"), duration=0.1, loop=aw.Loop(aw.JointPID(kp=value), [0.0, 0.0], 1e-3))
    with pytest.raises(ScenarioError, match=r"start\.q"):
        aw.Scenario(aw.load("two-link"), command=[0.0, 0.0], duration=0.1, start=value)

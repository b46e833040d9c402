"""The description of plots: which panels and curves, with which names, units, colours and notes."""

import numpy as np
import pytest

import armwright as aw
from armwright.errors import RunError
from armwright.results.plot_curves import COLOURS, DASHES, FEW_LANES, INK, describe
from simulation.runs import invented, mixed_arm


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return mixed_arm(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def run(arm):
    return invented(arm)


def joints_of(panel):
    return [curve.joint for curve in panel.curves]


def test_joints_of_each_unit_have_their_panel(run):
    panels = describe(run).panels
    assert [(panel.title, panel.symbol, panel.unit, *joints_of(panel)) for panel in panels] == [
        ("Joint angles", "q", "rad", "turn", "hinge"),
        ("Joint positions", "q", "m", "slide"),
        ("Joint velocities", "q̇", "rad/s", "turn", "hinge"),
        ("Joint velocities", "q̇", "m/s", "slide"),
        ("Motor torques, joint side", "τ", "N m", "turn", "hinge"),
        ("Motor forces, joint side", "τ", "N", "slide"),
        ("Motor voltages", "V", "V", "turn"),
        ("Motor currents", "i", "A", "turn", "hinge"),
    ]
    assert [panel.stepped for panel in panels] == [False, False, False, False, False, True, True, False]


@pytest.mark.parametrize(
    ("name", "last"),
    [("cmu-dd", "Motor voltages"), ("lwa4p", "Motor currents"), ("panda", "Motor torques, joint side")],
)
def test_the_last_panel_is_what_the_drives_were_given(name, last):
    assert describe(invented(aw.load(name))).panels[-1].title == last


def test_commands_stand_in_where_torques_were_not_recorded():
    run = invented(aw.load("panda")).drop_vars("tau")
    assert describe(run).panels[-1].title == "Drive commands"


def test_named_quantities_are_drawn_in_their_order(run):
    plot = describe(run, ["hinge", "turn"], ["tau", "q"])
    assert [(panel.symbol, panel.unit) for panel in plot.panels] == [("τ", "N m"), ("q", "rad")]
    assert [entry.name for entry in plot.legend] == ["turn", "hinge"]
    assert describe(run, ["3", "1"], ["torque", "theta"]).legend == plot.legend
    assert describe(run, "hinge", "tau").legend == plot.legend[1:]
    assert describe(run, None, "qdd").panels[0].title == "Joint accelerations"


def test_references_stand_beside_what_they_are_for(run):
    with_reference = run.assign(q_reference=run["q"] * 0.9)
    plot = describe(with_reference)
    assert [(curve.joint, curve.series) for curve in plot.panels[0].curves] == [
        *(("turn", ""), ("turn", "reference")),
        *(("hinge", ""), ("hinge", "reference")),
    ]
    assert [entry.name for entry in plot.legend] == ["turn", "slide", "hinge", "reference"]
    alone = describe(with_reference, None, ["q_reference"]).panels
    assert [panel.unit for panel in alone] == ["rad", "m"]
    assert {curve.series for panel in alone for curve in panel.curves} == {""}


def test_references_that_differ_between_lanes_are_not_drawn(arm):
    lanes = invented(arm, lanes=3)
    assert len(describe(lanes.assign(q_reference=lanes["q"])).panels[0].curves) == 6
    shared = lanes["q"].isel(lane=[0, 0, 0]).assign_coords(lane=lanes["lane"])
    assert len(describe(lanes.assign(q_reference=shared)).panels[0].curves) == 8


def test_few_lanes_are_curves_and_many_a_median_with_bands(arm):
    few, many = (describe(invented(arm, lanes=lanes)) for lanes in (FEW_LANES, FEW_LANES + 1))
    assert [curve.series for curve in few.panels[0].curves] == 2 * FEW_LANES * ["lanes"]
    assert few.note == "12 lanes"
    assert many.note == "13 lanes: median and the bands that hold 50 % and 90 % of them"
    values = invented(arm, lanes=FEW_LANES + 1)["q"].values[:, :, 0]
    curve = many.panels[0].curves[0]
    assert curve.series == "median"
    np.testing.assert_allclose(curve.values, np.median(values, axis=0))
    np.testing.assert_allclose(curve.bands, np.quantile(values, [[0.05, 0.95], [0.25, 0.75]], axis=0))


def test_lanes_that_diverged_are_left_out_of_median_and_bands():
    run = invented(aw.load("two-link"), lanes=20)
    whole = run["q"].values.copy()
    run["q"].values[4, 20:] = np.nan
    run["q"].values[5, 30:] = np.inf
    run["q"].values[:, 38:] = np.nan
    for joint, curve in enumerate(describe(run).panels[0].curves):
        drawn = np.array([curve.values, *curve.bands[0], *curve.bands[1]])
        assert np.isnan(drawn[:, 38:]).all()
        shares = [0.5, 0.05, 0.95, 0.25, 0.75]
        for rows, gone in ((slice(0, 20), []), (slice(20, 30), [4]), (slice(30, 38), [4, 5])):
            left = np.delete(whole[:, rows, joint], gone, axis=0)
            np.testing.assert_allclose(drawn[:, rows], np.quantile(left, shares, axis=0))


def test_a_colour_is_a_joint_and_a_dash_a_run(run):
    plot = describe({"before": run, "after": run}, ["hinge", "slide"], ["qd"])
    looks = {(c.joint, plot.runs[c.run]): (c.style.colour, c.style.dash) for p in plot.panels for c in p.curves}
    assert looks == {
        (joint, name): (COLOURS[k], DASHES[j])
        for k, joint in ((1, "slide"), (2, "hinge"))
        for j, name in enumerate(("before", "after"))
    }
    legend = {entry.name: (entry.style.colour, entry.style.dash) for entry in plot.legend}
    assert legend["before"] == (INK, DASHES[0])
    assert legend["after"] == (INK, DASHES[1])
    assert legend["hinge"] == (COLOURS[2], DASHES[0])


def test_of_a_single_joint_a_colour_is_a_run(run):
    plot = describe([run, run], ["hinge"], ["q"])
    assert plot.title.endswith("hinge")
    assert [(entry.name, entry.style.colour) for entry in plot.legend] == [("run 1", COLOURS[0]), ("run 2", COLOURS[1])]
    assert [curve.style.colour for curve in plot.panels[0].curves] == [COLOURS[0], COLOURS[1]]


def test_up_to_28_joints_or_runs_no_two_look_alike():
    joints = describe(_wide(28), None, ["q"]).panels[0].curves
    runs = describe([_wide(1)] * 28, None, ["q"]).panels[0].curves
    for curves in (joints, runs):
        assert len({curve.style for curve in curves}) == 28


def _wide(count):
    """A run of an arm with so many joints, each a copy of the first joint of another arm."""
    run = invented(aw.load("two-link")).isel(joint=count * [0])
    return run.assign_coords(joint=[f"joint{k}" for k in range(count)])


def test_references_of_runs_are_told_apart(run):
    plot = describe({name: run.assign(q_reference=k * run["q"]) for k, name in enumerate("ab", 1)})
    dashes = {entry.name: entry.style.dash for entry in plot.legend}
    assert dashes["reference of a"] != dashes["reference of b"]
    assert {"a", "b", "reference of a", "reference of b"} == {curve.series for curve in plot.panels[0].curves}


def test_each_legend_entry_stands_for_curves(run):
    plot = describe({"before": run, "after": run.assign(q_reference=run["q"])})
    curves = [curve for panel in plot.panels for curve in panel.curves]
    for entry in plot.legend:
        assert any(getattr(curve, entry.group) == entry.value for curve in curves), entry


def test_title_and_note_name_arms_runs_and_interruptions(run):
    partial = run.assign_attrs(partial="after 3 of 5 steps")
    assert (describe(run).title, describe(run).note) == ("lathe", "")
    assert describe({"before": run}).title.split("   ·   ") == ["lathe", "before"]
    assert describe(partial).note == "partial run, after 3 of 5 steps"
    assert describe([run, partial]).note == "run 2: partial run, after 3 of 5 steps"


def test_runs_of_other_lengths_and_other_quantities_are_drawn_together(run):
    short = run.isel(time=slice(0, 21)).drop_vars("u")
    plot = describe({"whole": run, "short": short}, None, ["q"])
    assert [len(t) for t in plot.times] == [41, 21]
    assert [len(curve.values) for curve in plot.panels[1].curves] == [41, 21]


@pytest.mark.parametrize("part", [{"joint": 0}, {"time": -1}, {"time": -1, "joint": 1}, {"joint": [2, 0]}])
@pytest.mark.parametrize("lanes", [None, FEW_LANES + 1])
def test_parts_of_a_run_are_described_as_the_whole(arm, part, lanes):
    whole = invented(arm, lanes=lanes)
    kept = {dim: [k] if isinstance(k, int) else k for dim, k in part.items()}
    for one, other in zip(describe(whole.isel(part)).panels, describe(whole.isel(kept)).panels, strict=True):
        assert (one.title, one.unit, one.stepped) == (other.title, other.unit, other.stepped)
        for a, b in zip(one.curves, other.curves, strict=True):
            np.testing.assert_array_equal(a.values, b.values)


def test_the_order_of_dimensions_does_not_matter(run):
    turned = describe(run.transpose("joint", "time"))
    for one, other in zip(describe(run).panels, turned.panels, strict=True):
        for a, b in zip(one.curves, other.curves, strict=True):
            np.testing.assert_array_equal(a.values, b.values)


@pytest.mark.parametrize(
    ("given", "value", "nearest"),
    [
        ({"joints": ["hing"]}, "hing", "did you mean hinge?"),
        ({"quantities": ["taw"]}, "taw", "did you mean tau or theta?"),
    ],
)
def test_unknown_joints_and_quantities_are_refused(run, given, value, nearest):
    with pytest.raises(RunError) as error:
        describe(run, **given)
    assert error.value.value == value
    assert str(error.value).endswith(nearest)


def test_runs_that_cannot_be_drawn_are_refused(run):
    other = invented(aw.load("two-link"))
    for runs, quantities, words in (
        ({"a": run, "b": other}, None, r"^b joints = .*: expected those of a: turn, slide, hinge$"),
        ({"a": {}}, None, r"^a = \{\}: expected a run"),
        (7, None, "^run = 7: expected a run"),
        ({}, None, "no runs"),
        ([], None, "no runs"),
        ({"a": run.assign(tau=run["tau"] * np.nan)}, ["tau"], r"^a: no finite number of tau to be drawn$"),
        (run.isel(time=slice(0, 0)), None, r"^run: holds no rows of any quantity"),
    ):
        with pytest.raises(RunError, match=words):
            describe(runs, None, quantities)

"""Runs as pages and pictures: every number is in the page, with its unit, and nothing is asked of a network."""

import numpy as np
import pytest

import armwright as aw
from armwright.errors import OutputError, RunError
from armwright.pictures.curves import curve_panels, selected
from armwright.pictures.picture import draw_runs
from armwright.simulation.results.plot import COLOURS
from pictures.reading import Page
from simulation.runs import invented, mixed_arm

MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF", ".html": b"<!DOCTYPE html>"}


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return mixed_arm(tmp_path_factory.mktemp("robot"))


@pytest.fixture(scope="module")
def run(arm):
    return invented(arm)


@pytest.mark.parametrize("ending", MAGIC)
def test_files_are_whole(run, tmp_path, ending):
    aw.plot_runs({"one": run, "two": 2 * run.drop_vars("u")}, tmp_path / f"runs{ending}")
    assert (tmp_path / f"runs{ending}").read_bytes().startswith(MAGIC[ending])
    assert [entry.name for entry in tmp_path.iterdir()] == [f"runs{ending}"]


def test_page_holds_every_number_with_its_unit(run, tmp_path):
    aw.plot_runs({"run": run}, tmp_path / "run.html")
    page = Page(tmp_path / "run.html")
    assert page.plot["joints"] == ["turn", "slide", "hinge"]
    (time,) = [told["time"] for told in page.plot["runs"]]
    assert time == {"start": 0.0, "step": pytest.approx(0.05), "count": 41}
    for title, quantity, unit, joints in (
        ("Joint angles", "q", "rad", [0, 2]),
        ("Joint positions", "q", "m", [1]),
        ("Motor voltages", "voltage", "V", [0]),
    ):
        panel = next(panel for panel in page.plot["panels"] if panel["title"] == title)
        assert panel["unit"] == unit
        assert [series["joint"] for series in panel["series"]] == joints
        for series in panel["series"]:
            expected = run[quantity].values[:, series["joint"]].astype(np.float32)
            assert np.array_equal(page.values(series["values"]), expected)
    assert page.fetched() == []


def test_uneven_times_keep_their_digits(run, tmp_path):
    t = 1000.0 + np.cumsum(np.random.default_rng(1).uniform(1e-6, 1e-3, run.sizes["time"]))
    aw.plot_runs({"run": run.assign_coords(time=t)}, tmp_path / "run.html")
    page = Page(tmp_path / "run.html")
    told = page.plot["runs"][0]["time"]
    again = page.values(told["high"]).astype(float) + page.values(told["low"])
    assert np.abs(again - t).max() < 1e-11


def test_a_run_of_two_seconds_is_a_small_page(tmp_path):
    run = invented(aw.load("cmu-dd"), rows=2001)
    aw.plot_runs({"run": run}, tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size < 400_000


def test_names_cannot_break_out_of_the_page(run, tmp_path):
    bad = '</script><img src=x onerror="alert(1)">'
    run = run.assign_attrs(robot=bad).assign_coords(joint=[bad, "$title", "b"])
    aw.plot_runs({bad: run}, tmp_path / "run.html")
    page = Page(tmp_path / "run.html")
    assert "<img" not in page.text
    assert page.plot["joints"] == [bad, "$title", "b"]


def test_selection_keeps_order_and_colour_follows_the_joint(run):
    chosen = selected({"run": run}, ["hinge", "turn"], ["tau", "q"])["run"]
    assert chosen["joint"].values.tolist() == ["turn", "hinge"]
    panels = curve_panels({"run": chosen}, ["tau", "q"])
    assert [(panel.symbol, panel.unit) for panel in panels] == [("τ", "N m"), ("q", "rad")]


def test_references_stand_beside_what_they_are_for(run):
    with_reference = run.assign(q_reference=run["q"] * 0.9)
    (angles, *_) = curve_panels({"run": with_reference})
    assert [(curve.joint, curve.kind) for curve in angles.curves] == [
        *((0, "line"), (0, "reference")),
        *((2, "line"), (2, "reference")),
    ]
    own = curve_panels({"run": selected({"run": with_reference}, None, ["q_reference"])["run"]}, ["q_reference"])
    assert [panel.unit for panel in own] == ["rad", "m"]


def test_few_lanes_are_curves_and_many_a_band(arm):
    few, many = (curve_panels({"run": invented(arm, lanes=lanes)})[0].curves for lanes in (3, 40))
    assert [curve.kind for curve in few] == 6 * ["lane"]
    assert [curve.kind for curve in many] == 2 * ["band"]
    lanes = invented(arm, lanes=40)["q"].values[:, :, 0]
    assert np.allclose(many[0].low, np.quantile(lanes, 0.05, axis=0))
    assert np.allclose(many[0].values, np.median(lanes, axis=0))


@pytest.mark.parametrize("ending", [".html", ".png"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_diverged_lanes_leave_gaps(arm, tmp_path, ending, value):
    run = invented(arm, lanes=20)
    run["q"].values[:4, 10:] = value
    run["q"].values[:, 30:] = np.nan
    aw.plot_runs({"run": run}, tmp_path / f"run{ending}", quantities=["q"])
    assert (tmp_path / f"run{ending}").exists()


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"joints": ["hing"]}, RunError, "run: no joint 'hing'; did you mean hinge?"),
        ({"quantities": ["taw"]}, RunError, "run: no quantity 'taw'; did you mean tau or theta?"),
        (
            {"path": "run.jpg"},
            OutputError,
            "run.jpg: the ending '.jpg' is not offered; expected .html, .png, .svg or .pdf",
        ),
        ({"path": "no/run.html"}, OutputError, "there is no folder"),
    ],
)
def test_what_cannot_be_drawn_is_told(run, tmp_path, given, error, words):
    path = tmp_path / given.pop("path", "run.html")
    with pytest.raises(error) as told:
        aw.plot_runs({"run": run}, path, **given)
    assert words in str(told.value)
    assert list(tmp_path.iterdir()) == []


def test_runs_of_different_arms_are_refused(run, tmp_path):
    other = invented(aw.load("two-link"))
    with pytest.raises(RunError, match=r"^b: has joints .*; expected those of a: turn, slide, hinge$"):
        aw.plot_runs({"a": run, "b": other}, tmp_path / "both.html")
    with pytest.raises(RunError, match="a dict is no run"):
        aw.plot_runs({"a": {}}, tmp_path / "both.html")
    with pytest.raises(RunError, match="no runs"):
        aw.plot_runs({}, tmp_path / "both.html")
    with pytest.raises(RunError, match=r"^a: no finite number of tau to be drawn$"):
        aw.plot_runs({"a": run.assign(tau=run["tau"] * np.nan)}, tmp_path / "both.html", quantities=["tau"])
    assert list(tmp_path.iterdir()) == []


def test_a_joint_keeps_its_colour_without_the_others(run, tmp_path):
    runs = selected({"run": run}, ["hinge", "slide"])
    drawn = draw_runs(runs, ["qd"], "", "")
    assert [line.get_color() for axis in drawn.axes for line in axis.lines] == [COLOURS[1], COLOURS[2]]
    assert [line.get_color() for line in drawn.legends[0].legend_handles] == [COLOURS[1], COLOURS[2]]
    aw.plot_runs({"run": run}, tmp_path / "run.html", joints=["hinge", "slide"])
    assert Page(tmp_path / "run.html").plot["places"] == [1, 2]


def test_references_of_runs_are_told_apart(run):
    controlled = {name: run.assign(q_reference=k * run["q"]) for k, name in enumerate("ab", 1)}
    figure = draw_runs(selected(controlled), None, "", "")
    own = {line.get_text(): handle for line, handle in zip(*_legend(figure), strict=True)}
    looks = [own[f"reference of {name}"]._dash_pattern for name in "ab"]
    assert looks[0] != looks[1]


def _legend(figure):
    return figure.legends[0].get_texts(), figure.legends[0].legend_handles


def test_many_accelerations_are_many(run):
    assert next(panel.title for panel in curve_panels({"run": run}, ["qdd"])) == "Joint accelerations"

"""Plots as matplotlib figures and as files: what the description says is drawn, whole or not at all."""

import itertools
import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

import armwright as aw
from armwright.errors import OutputError, RunError
from armwright.results.plot_curves import COLOURS, FEW_LANES, describe
from simulation.runs import invented, mixed_arm

MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF", ".html": b"<!DOCTYPE html>"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return invented(mixed_arm(tmp_path_factory.mktemp("robot")))


@pytest.mark.sample(1)
@pytest.mark.parametrize("ending", MAGIC)
@pytest.mark.parametrize("several", [False, True])
def test_files_are_whole(run, tmp_path, ending, several):
    runs = {"one": run, "two": 2 * run.drop_vars("u")} if several else run
    assert aw.plot(runs, tmp_path / f"run{ending}") is None
    assert (tmp_path / f"run{ending}").read_bytes().startswith(MAGIC[ending])
    assert [entry.name for entry in tmp_path.iterdir()] == [f"run{ending}"]


@pytest.mark.study
def test_svg_is_well_formed(run, tmp_path):
    aw.plot(run, tmp_path / "run.svg")
    assert ElementTree.parse(tmp_path / "run.svg").getroot().tag.endswith("svg")


def test_without_a_path_the_figure_is_returned(run):
    figure = aw.plot(run)
    drawn = describe(run)
    axes = [axis for axis in figure.axes if axis.get_visible()]
    assert [axis.get_title(loc="left") for axis in axes] == [panel.title for panel in drawn.panels]
    assert [axis.get_ylabel() for axis in axes] == [f"{panel.symbol} [{panel.unit}]" for panel in drawn.panels]
    assert [axis.get_xlabel() for axis in axes][-2:] == ["time [s]"] * 2
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["turn", "slide", "hinge"]
    assert figure.get_suptitle() == "lathe"
    for panel, axis in zip(drawn.panels, axes, strict=True):
        for curve, line in zip(panel.curves, axis.lines, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), curve.values)
            assert line.get_color() == curve.style.colour


def test_runs_beside_each_other_are_drawn_in_their_styles(run):
    figure = aw.plot({"before": run, "after": 1.1 * run}, joints=["turn"], quantities=["q"])
    (axis,) = figure.axes
    assert [line.get_color() for line in axis.lines] == [COLOURS[0], COLOURS[1]]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["before", "after"]


LONG = "with feed-forward and friction compensation"


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["two-link", "panda", "cmu-dd"])
@pytest.mark.parametrize("names", [["before", "after"], [LONG, f"no {LONG}"]])
def test_the_legend_covers_no_axes_and_is_not_cut(name, names):
    run = invented(aw.load(name), lanes=FEW_LANES + 1)
    figure = aw.plot(dict.fromkeys(names, run))
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    assert not any(legend.overlaps(axis.get_tightbbox()) for axis in figure.axes if axis.get_visible())
    assert figure.bbox.x0 <= legend.x0
    assert figure.bbox.y0 <= legend.y0
    assert legend.x1 <= figure.bbox.x1
    assert all(axis.get_window_extent().width > 0.3 * figure.bbox.width for axis in figure.axes)


def test_few_lanes_are_lines_and_many_a_median_in_two_bands():
    few = aw.plot(invented(aw.load("two-link"), lanes=3)).axes[0]
    assert (len(few.lines), len(few.collections)) == (6, 0)
    many = aw.plot(invented(aw.load("two-link"), lanes=FEW_LANES + 1))
    assert (len(many.axes[0].lines), len(many.axes[0].collections)) == (2, 4)
    assert f"{FEW_LANES + 1} lanes: median" in many.get_suptitle()


def test_a_level_line_is_not_blown_up():
    run = invented(aw.load("two-link"))
    run["q"][:] = 0.3 + 1e-15 * np.arange(41)[:, None]
    low, high = aw.plot(run).axes[0].get_ylim()
    assert high - low > 0.01


@pytest.mark.sample(2)
@pytest.mark.parametrize("ending", [".html", ".png"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_diverged_lanes_leave_gaps(tmp_path, ending, value):
    run = invented(aw.load("two-link"), lanes=20)
    run["q"].values[:4, 10:] = value
    run["q"].values[:, 30:] = np.nan
    aw.plot(run, tmp_path / f"run{ending}", quantities=["q"])
    assert (tmp_path / f"run{ending}").stat().st_size > 5000
    line = aw.plot(run, quantities=["q"]).axes[0].lines[0]
    assert np.isfinite(line.get_ydata()).tolist() == [True] * 30 + [False] * 11


@pytest.mark.study
def test_pyplot_is_left_alone(run, tmp_path):
    """In a process of its own: python-control, which other tests import, brings pyplot along."""
    aw.save(run, tmp_path / "run.nc")
    path = str(tmp_path / "run.nc")
    program = f"import sys, armwright as aw; aw.plot(aw.load_run({path!r})); print('matplotlib.pyplot' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.gif", "the ending '.gif' is not offered; expected .png, .svg, .pdf or .html"),
        ("run", "has no ending"),
        ("nowhere/run.png", "there is no folder"),
        (".", "has no ending"),
    ],
)
def test_refused_destinations(run, tmp_path, name, message):
    with pytest.raises(OutputError) as error:
        aw.plot(run, tmp_path / name)
    assert message in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_cannot_be_drawn_leaves_no_file(run, tmp_path):
    with pytest.raises(RunError):
        aw.plot(run, tmp_path / "run.html", joints=["elbow"])
    assert list(tmp_path.iterdir()) == []


def test_held_values_are_steps_in_a_band_too():
    """A voltage that is held does not climb from row to row, neither its median nor its bands."""
    figure = aw.plot(invented(aw.load("cmu-dd"), lanes=FEW_LANES + 1, rows=5))
    angles, volts = figure.axes[0], figure.axes[-1]
    assert volts.get_title(loc="left") == "Motor voltages"
    assert {line.get_drawstyle() for line in volts.lines} == {"steps-post"}
    assert {line.get_drawstyle() for line in angles.lines} == {"default"}
    (smooth, *_), (stepped, *_) = angles.collections, volts.collections
    assert len(stepped.get_paths()[0].vertices) > 1.5 * len(smooth.get_paths()[0].vertices)
    for x, y in itertools.pairwise(stepped.get_paths()[0].vertices[:-1]):
        assert x[0] == y[0] or x[1] == y[1]  # each edge is level or upright


@pytest.mark.sample(1)
@pytest.mark.parametrize("ending", ["svg", "pdf", "png", "html"])
def test_pictures_of_equal_runs_are_equal_bytes(ending, tmp_path, monkeypatch):
    """Whenever they are drawn: also where a build sets the time for reproducible results."""
    for k, name in enumerate(("one", "two")):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", str(1_000_000_000 * (k + 1)))
        aw.plot(invented(aw.load("two-link"), rows=5), tmp_path / f"{name}.{ending}")
    assert (tmp_path / f"one.{ending}").read_bytes() == (tmp_path / f"two.{ending}").read_bytes()


def test_a_run_of_reducers_alone_is_told_from_what_is_no_run():
    recording = aw.Recording(what="none", reduce=["peak_torque"])
    with pytest.raises(RunError) as caught:
        aw.plot(aw.simulate(aw.Scenario("two-link", 0.01, [0.0, 0.0], recording=recording)))
    assert caught.value.expected.startswith("a run that recorded rows")

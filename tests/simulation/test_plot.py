"""Pictures: which panels, which units, which files. What they look like is for eyes; that they say it all is for tests."""

import itertools
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

import armwright as aw
from armwright.errors import OutputError
from armwright.simulation.results.plot import COLOURS, FEW_LANES, draw, panels, plot
from armwright.simulation.results.recording import in_order
from simulation.runs import invented, mixed_arm

MAGIC = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return invented(mixed_arm(tmp_path_factory.mktemp("robot")))


@pytest.mark.parametrize("ending", MAGIC)
def test_files(run, tmp_path, ending):
    plot(run, tmp_path / f"run{ending}")
    assert (tmp_path / f"run{ending}").read_bytes().startswith(MAGIC[ending])
    assert [entry.name for entry in tmp_path.iterdir()] == [f"run{ending}"]


def test_svg_is_well_formed(run, tmp_path):
    plot(run, tmp_path / "run.svg")
    assert ElementTree.parse(tmp_path / "run.svg").getroot().tag.endswith("svg")


def test_joints_of_each_unit_have_their_panel(run):
    shown = [(panel.title, panel.unit, panel.joints) for panel in panels(run)]
    assert shown == [
        ("Joint angles", "rad", (0, 2)),
        ("Joint positions", "m", (1,)),
        ("Joint velocities", "rad/s", (0, 2)),
        ("Joint velocities", "m/s", (1,)),
        ("Motor torques", "N m", (0, 2)),
        ("Motor forces", "N", (1,)),
        ("Motor voltages", "V", (0,)),
        ("Motor currents", "A", (0, 2)),
    ]
    assert [panel.held for panel in panels(run)] == [False, False, False, False, False, True, True, False]


@pytest.mark.parametrize(
    ("name", "last"), [("cmu-dd", "Motor voltages"), ("lwa4p", "Motor currents"), ("panda", "Motor torques")]
)
def test_the_last_panel_is_what_the_drives_were_given(name, last):
    assert panels(invented(aw.load(name)))[-1].title == last


def test_commands_stand_in_where_torques_were_not_recorded():
    run = invented(aw.load("panda")).drop_vars("tau")
    assert [panel.title for panel in panels(run)][-1] == "Drive commands"


def test_axes_and_legend_name_everything(run):
    figure = draw(run)
    axes = [axis for axis in figure.axes if axis.get_visible()]
    assert len(axes) == len(panels(run))
    assert all("[" in axis.get_ylabel() and axis.get_title(loc="left") for axis in axes)
    assert [axis.get_xlabel() for axis in axes][-2:] == ["time [s]"] * 2
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["turn", "slide", "hinge"]
    assert "lathe" in figure.get_suptitle()


@pytest.mark.parametrize("name", ["two-link", "panda", "cmu-dd"])
def test_the_legend_covers_no_axes(name):
    figure = draw(invented(aw.load(name)))
    figure.draw_without_rendering()
    legend = figure.legends[0].get_window_extent()
    assert not any(legend.overlaps(axis.get_window_extent()) for axis in figure.axes)
    assert legend.x1 <= figure.bbox.x1


def test_lines_tell_more_joints_apart_than_there_are_colours():
    from armwright.simulation.results.plot import _style

    styles = [tuple(_style(joint).values()) for joint in range(4 * len(COLOURS))]
    assert len(set(styles)) == len(styles)


def test_few_lanes_are_lines_and_many_a_band():
    few = draw(invented(aw.load("two-link"), lanes=3)).axes[0]
    assert (len(few.lines), len(few.collections)) == (6, 0)
    many = draw(invented(aw.load("two-link"), lanes=FEW_LANES + 1))
    assert (len(many.axes[0].lines), len(many.axes[0].collections)) == (2, 4)  # two bands each
    assert f"{FEW_LANES + 1} lanes" in many.get_suptitle()


def test_a_level_line_is_not_blown_up():
    run = invented(aw.load("two-link"))
    run["q"][:] = 0.3 + 1e-15 * np.arange(41)[:, None]
    low, high = draw(run).axes[0].get_ylim()
    assert high - low > 0.01


def test_a_lane_that_left_the_finite_numbers_does_no_harm(tmp_path):
    run = invented(aw.load("two-link"), lanes=20)
    run["q"][4, 20:] = np.nan
    plot(run, tmp_path / "run.png")


def test_pyplot_is_left_alone(run, tmp_path):
    plot(run, tmp_path / "run.png")
    assert "matplotlib.pyplot" not in sys.modules


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("run.gif", "the ending '.gif' is not offered; expected .png, .svg or .pdf"),
        ("run", "has no ending"),
        ("nowhere/run.png", "there is no folder"),
        (".", "has no ending"),
    ],
)
def test_refused_destinations(run, tmp_path, name, message):
    with pytest.raises(OutputError) as error:
        plot(run, tmp_path / name)
    assert message in str(error.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("part", [{"joint": 0}, {"time": -1}, {"time": -1, "joint": 1}, {"joint": [2, 0]}])
@pytest.mark.parametrize("lanes", [None, FEW_LANES + 1])
def test_parts_of_a_run_are_drawn(tmp_path, part, lanes):
    whole = invented(mixed_arm(tmp_path), lanes=lanes)
    kept = {dim: [k] if isinstance(k, int) else k for dim, k in part.items()}
    assert panels(in_order(whole.isel(part))) == panels(whole.isel(kept))
    plot(whole.isel(part), tmp_path / "run.png")


def test_the_order_of_dimensions_does_not_matter(run):
    for plain, turned in zip(draw(run).axes, draw(run.transpose("joint", "time")).axes, strict=True):
        for a, b in zip(plain.lines, turned.lines, strict=True):
            np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())


def test_what_is_held_is_steps_in_a_band_too():
    """A voltage that is held does not climb from row to row, neither its median nor its band."""
    figure = draw(invented(aw.load("cmu-dd"), lanes=FEW_LANES + 1, rows=5))
    angles, volts = figure.axes[0], figure.axes[-1]
    assert volts.get_title(loc="left") == "Motor voltages"
    assert {line.get_drawstyle() for line in volts.lines} == {"steps-post"}
    assert {line.get_drawstyle() for line in angles.lines} == {"default"}
    (smooth, *_), (stepped, *_) = angles.collections, volts.collections
    assert len(stepped.get_paths()[0].vertices) > 1.5 * len(smooth.get_paths()[0].vertices)
    for x, y in itertools.pairwise(stepped.get_paths()[0].vertices[:-1]):
        assert x[0] == y[0] or x[1] == y[1]  # each edge is level or upright

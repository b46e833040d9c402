"""Strips of braille: each dot is where a sample is."""

import io

import numpy as np
import pytest
from rich.console import Console

from armwright.errors import RunError
from armwright.pictures.terminal import ROWS, show_runs, strip
from raises_at import raises_at
from simulation.runs import invented, mixed_arm


def dots_of(lines):
    """(4 ROWS, 2 width) whether a dot is there, from the bottom."""
    order = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]]
    rows = [[[bool((ord(c) - 0x2800) & order[r][k]) for c in line for k in (0, 1)] for r in range(4)] for line in lines]
    return np.array(rows).reshape(4 * len(lines), -1)[::-1]


def test_a_straight_line_climbs():
    t = np.linspace(0, 1, 1001)
    dots = dots_of(strip(t, t, t, (0.0, 1.0), 20))
    assert dots.shape == (4 * ROWS, 40)
    height = dots.argmax(axis=0)
    assert dots.any(axis=0).all()
    assert (np.diff(height) >= 0).all()
    assert (height[0], dots.shape[0] - 1 - dots[::-1, -1].argmax()) == (0, 4 * ROWS - 1)


def test_few_samples_are_joined():
    dots = dots_of(strip(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.array([0.0, 1.0]), (0.0, 1.0), 10))
    assert dots.any(axis=0).all()


def test_a_spike_of_one_sample_is_seen():
    t, values = np.linspace(0, 1, 10001), np.zeros(10001)
    values[5003] = 1.0
    dots = dots_of(strip(t, values, values, (0.0, 1.0), 20))
    assert dots[-1].sum() == 1


def test_a_shorter_run_ends_early_and_level_ones_are_in_the_middle():
    t = np.linspace(0, 1, 101)
    dots = dots_of(strip(t, 0 * t + 5, 0 * t + 5, (0.0, 2.0), 10))
    assert not dots[:, 11:].any()
    assert dots[:, :10].sum(axis=0).tolist() == 10 * [1]
    assert dots[[0, -1]].sum() == 0


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return invented(mixed_arm(tmp_path_factory.mktemp("robot")))


def shown(runs, width=100, **chosen):
    console = Console(file=io.StringIO(), width=width, highlight=False, markup=False)
    show_runs(runs, console, **chosen)
    return console.file.getvalue()


@pytest.mark.parametrize("width", [70, 80, 100, 200])
def test_every_joint_has_its_row_in_its_unit(run, width):
    text = shown({"run": run}, width, quantities=["q"])
    assert max(map(len, text.splitlines())) <= width
    assert [line.split()[0] for line in text.splitlines() if line[:1].isalpha()] == [
        *("Joint", "joint", "turn", "hinge"),
        *("Joint", "joint", "slide"),
    ]
    assert "Joint angles [rad]" in text
    assert "Joint positions [m]" in text
    first, last = run["q"].values[[0, -1], 1]
    row = next(line for line in text.splitlines() if line.startswith("slide")).replace("−", "-").split()
    assert float(row[-4]) == pytest.approx(first, abs=1e-3)
    assert float(row[-1]) == pytest.approx(last, abs=1e-3)


def test_runs_and_references_are_named(run):
    text = shown({"before.nc": run, "after.nc": run.assign(q_reference=run["q"])}, 120, joints=["turn"])
    assert "before.nc" in text
    assert "reference of after.nc" in text


def test_strips_of_a_joint_have_one_scale(run):
    text = shown({"low.nc": run, "high.nc": run.assign(q=2.0 * run["q"])}, joints=["turn"], quantities=["theta"])
    lines = [line for line in text.splitlines() if any("\u2800" <= mark <= "\u28ff" for mark in line)]
    low, high = (
        [[mark for mark in line if "\u2800" <= mark <= "\u28ff"] for line in lines[k : k + ROWS]] for k in (0, 2)
    )
    top = [np.flatnonzero(dots_of(own).any(axis=1)) for own in (low, high)]
    assert (top[1].min(), top[1].max()) == (0, 4 * ROWS - 1)
    assert np.ptp(top[0]) < np.ptp(top[1])


def test_joints_go_by_number_and_quantities_by_the_names_of_the_session(run):
    spoken = shown({"run": run}, joints=["2"], quantities=["theta", "torque"])
    assert spoken == shown({"run": run}, joints=["slide"], quantities=["q", "tau"])
    with raises_at(RunError, "run quantity", "theta", value="thta"):
        shown({"run": run}, quantities=["thta"])
    with raises_at(RunError, "run joint", value="4"):
        shown({"run": run}, joints=["4"])


def test_lanes_that_left_the_finite_numbers(run, tmp_path):
    lanes = invented(mixed_arm(tmp_path), lanes=3)
    lanes["q"].values[0, 5:] = np.nan
    lanes["q"].values[1, 30:] = np.inf
    lanes["q"].values[2, 35:] = np.nan
    assert "turn" in shown({"run": lanes}, quantities=["q"])

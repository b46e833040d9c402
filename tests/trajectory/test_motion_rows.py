"""Motions saved and read again, joined, drawn, and what a motion file of rows may not be."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError, RunError, ScenarioError
from physics.arms import arm
from raises_at import raises_at
from trajectory.motions import limits_of


def a_motion():
    limits = limits_of([1.0, 1.5], 4.0, 60.0)
    return aw.trajectories.Waypoints([[0.1, 0.2], [0.5, -0.3], [0.9, 0.4]], limits, time=0.25)


def test_netcdf_keeps_the_pieces_to_the_bit(tmp_path):
    motion, model = a_motion(), arm("two-link")
    motion.save(model, tmp_path / "m.nc")
    found = aw.trajectories.load_motion(tmp_path / "m.nc", model)
    np.testing.assert_array_equal(found.knots, motion.polynomial.knots)
    np.testing.assert_array_equal(found.coefficients, motion.polynomial.coefficients)
    run = aw.load_run(tmp_path / "m.nc")
    np.testing.assert_allclose(run.q.values, motion.at(run.time.values)[0], atol=1e-15)


@pytest.mark.parametrize("named", [True, False])
def test_csv_gives_the_motion_between_its_rows_too(tmp_path, named):
    motion, model = a_motion(), arm("two-link")
    motion.save(model, tmp_path / "m.csv", rate=100.0)
    found = aw.trajectories.load_motion(tmp_path / "m.csv", model if named else None)
    assert (found.time, found.duration) == (motion.time, pytest.approx(motion.duration, rel=1e-14))
    t = np.linspace(0.0, motion.time + motion.duration + 0.5, 1777)
    for ours, theirs, atol in zip(found.at(t), motion.at(t), (1e-12, 1e-10, 1e-7), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=atol)  # cubic pieces, whose knots are rows


def test_csv_of_a_motion_that_is_no_polynomial(tmp_path):
    motion, model = (
        aw.trajectories.Fourier.at_rest([0.1, 0.2], [[0.3, 0.1]] * 2, [[0.1, 0.2]] * 2, 2.0, cycles=1),
        arm("two-link"),
    )
    motion.save(model, tmp_path / "m.csv", rate=200.0)
    t = np.linspace(0.0, 2.0, 3001)
    np.testing.assert_allclose(aw.trajectories.load_motion(tmp_path / "m.csv").at(t)[0], motion.at(t)[0], atol=1e-12)


def test_columns_may_stand_in_any_order(tmp_path):
    rows = "t,q_elbow,q_shoulder,qd_elbow,qd_shoulder,qdd_elbow,qdd_shoulder\n0,2,1,0,0,0,0\n1,4,3,0,0,0,0\n"
    (tmp_path / "m.csv").write_text(rows)
    np.testing.assert_array_equal(
        aw.trajectories.load_motion(tmp_path / "m.csv", arm("two-link")).at(1.0)[0], [3.0, 4.0]
    )
    np.testing.assert_array_equal(aw.trajectories.load_motion(tmp_path / "m.csv").at(1.0)[0], [4.0, 3.0])


def test_a_designed_excitation_is_a_motion(tmp_path):
    """Its table has the same columns."""
    motion, model = a_motion(), arm("two-link")
    motion.save(model, tmp_path / "m.csv")
    header = (tmp_path / "m.csv").read_text().splitlines()[0]
    assert header == (
        "t [s],q_shoulder [rad],q_elbow [rad],qd_shoulder [rad/s],qd_elbow [rad/s],"
        "qdd_shoulder [rad/s²],qdd_elbow [rad/s²]"
    )


@pytest.mark.parametrize("ending", [".png", ".svg", ".html"])
def test_a_motion_is_drawn(tmp_path, ending):
    path = tmp_path / f"m{ending}"
    assert a_motion().plot(arm("two-link"), path) is None
    assert path.stat().st_size > 5000
    assert len(a_motion().plot(arm("two-link")).axes) >= 4


ROWS = "t,q_a,qd_a,qdd_a\n0,0,0,0\n1,1,0,0\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ROWS + "0.5,2,0,0\n", "m.csv:4: column 't' = 0.5: not after 1"),
        (ROWS + "1,2,0,0\n", r"m.csv:4: column 't' = 1.0: not after 1"),
        ("t,q_a,qd_a,qdd_a\n0,0,0,0\n", "one row; .*two"),
        ("t,q_a,qd_a\n0,0,0\n1,0,0\n", "column 'qdd_a'"),
        (ROWS + "2,nan,0,0\n", "m.csv:4: column 'q_a' = 'nan': .*finite number"),
        ("0,0,0,0\n1,0,0,0\n", "no column q_JOINT"),
        ("", "no column q_JOINT"),
        ("t,q_a [deg],qd_a,qdd_a\n0,0,0,0\n1,1,0,0\n", "unit|deg"),
    ],
)
def test_other_tables_are_refused(tmp_path, text, said):
    (tmp_path / "m.csv").write_text(text)
    model = arm("two-link") if "deg" in said else None
    if model is not None:
        text = text.replace("_a", "_shoulder").replace("\n0,0,0,0\n1,1,0,0", "")
        (tmp_path / "m.csv").write_text(
            "t,q_shoulder [deg],q_elbow,qd_shoulder,qd_elbow,qdd_shoulder,qdd_elbow\n0" + 6 * ",0"
        )
    with pytest.raises(ArmwrightError, match=said):
        aw.trajectories.load_motion(tmp_path / "m.csv", model)


def test_other_files_are_refused(tmp_path):
    with raises_at(ArmwrightError, file=tmp_path / "none.csv"):
        aw.trajectories.load_motion(tmp_path / "none.csv")
    with raises_at(ArmwrightError, file=tmp_path / "none.nc"):
        aw.trajectories.load_motion(tmp_path / "none.nc")
    with pytest.raises(ArmwrightError, match=r"\.csv or \.nc"):
        aw.trajectories.load_motion(3)
    with pytest.raises(ArmwrightError, match="ending"):
        a_motion().save(arm("two-link"), tmp_path / "m.txt")
    with raises_at(ScenarioError, "lwa4p", "2 joints"):
        a_motion().save(arm("lwa4p"), tmp_path / "m.csv")
    with raises_at(ScenarioError, "Sine", "not end"):
        aw.trajectories.Sine([0.0, 0.0], [1.0, 1.0], 1.0).save(arm("two-link"), tmp_path / "m.csv")
    with pytest.raises(ScenarioError, match="rate = 0"):
        a_motion().save(arm("two-link"), tmp_path / "m.csv", rate=0)
    assert not list(tmp_path.iterdir())
    a_motion().save(arm("two-link"), tmp_path / "m.nc")
    with raises_at(ScenarioError, "joints", "lwa4p", file=tmp_path / "m.nc"):
        aw.trajectories.load_motion(tmp_path / "m.nc", arm("lwa4p"))


def test_motions_are_joined():
    limits = limits_of([1.0, 1.5], 4.0, 60.0)
    first = aw.trajectories.SCurve([0.0, 0.0], [0.5, 0.2], limits, time=0.5)
    second = aw.trajectories.Quintic([0.5, 0.2], [0.0, 0.3], 1.0, time=0.5 + first.duration)
    both = aw.trajectories.Joined([first, second])
    assert both.duration == pytest.approx(first.duration + 1.0)
    t = np.linspace(0.0, both.time + both.duration + 0.2, 777)
    for ours, a, b in zip(both.at(t), first.at(t), second.at(t), strict=True):
        np.testing.assert_array_equal(ours, np.where((t < second.time)[:, None], a, b))
    from armwright.program import interpret, trace

    program = trace("motion", lambda x: np.concatenate(both(x[0])), {"t": (1,)}, ("motion",))
    np.testing.assert_allclose(interpret(program, t[:, None]), np.concatenate(both.at(t), axis=1), atol=1e-10)
    with raises_at(ScenarioError, "Joined.motions[1]", r"joint 1 begins 0\.5 "):
        aw.trajectories.Joined([first, aw.trajectories.Quintic([0.0, 0.2], [0.0, 0.3], 1.0, time=second.time)])
    with pytest.raises(ScenarioError, match=r"motions\[1\].time = 0.0: expected"):
        aw.trajectories.Joined([first, aw.trajectories.Quintic([0.5, 0.2], [0.0, 0.3], 1.0)])


@pytest.mark.parametrize(
    ("variable", "at", "place"),
    [
        ("q", (3, 1), "q of joint 'elbow', row 4"),
        ("qd", (0, 0), "qd of joint 'shoulder', row 1"),
        ("coefficients", (0, 1, 2), "coefficients of joint 'elbow', piece 1, power 3"),
    ],
)
def test_a_cell_that_is_not_finite_is_named(tmp_path, variable, at, place):
    model = arm("two-link")
    dataset = a_motion().dataset(model, 50.0)
    values = dataset[variable].values.copy()
    values[at] = np.nan
    aw.save(dataset.assign({variable: (dataset[variable].dims, values)}), tmp_path / "m.nc")
    with raises_at(RunError, place, file=tmp_path / "m.nc"):
        aw.trajectories.load_motion(tmp_path / "m.nc", model)

"""Tunings by the [tuning] table of a scenario file, with designed starts, several objectives, and on a cluster."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import armwright as aw
from armwright.tuning.pictures import draw_front
from armwright.tuning.search import Tried
from raises_at import raises_at

pytest.importorskip("cma", reason="cma is not installed: pip install armwright[control]")
pytest.importorskip("control", reason="python-control is not installed: pip install armwright[control]")

EXAMPLES = Path(__file__).parents[2] / "examples"
FILE = """\
robot = "two-link"
duration_s = 0.4

[loop]
period_s = 2e-3

[loop.controller]
kind = "joint_pid"
kp = [600, 120]
kd = [60, 10]
gravity = true

[loop.reference]
kind = "pose"
q = [0.3, 0.2]

[loop.timing]
preset = "one-tick"

[tuning]
{table}
"""
TABLE = """\
start = "analytic"
gains = {{ kp = 8, kd = [1, [400, 100]] }}
objectives = {{ rms_error = 1, noise_gain = 0.3 }}
improve_each = true
phase_margin_rad = 0.7
poses = 100
lanes = 12
generations = {generations}
front = 1

[tuning.draws]
mass = 0.3
payload_kg = [0, 0.5]
vary = {{ "forearm.mass_kg" = {{ uniform = [3.5, 4.5] }} }}
"""


def read(folder, table):
    path = folder / "arm.scenario.toml"
    path.write_text(FILE.format(table=table))
    return aw.read_scenario(path)


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    return aw.tuning.tune(read(tmp_path_factory.mktemp("tuning"), TABLE.format(generations=5)))


def test_the_table_says_what_is_searched(tuned):
    assert tuned.lanes == (6, 6)
    assert tuned.asked == (2.0, 0.7)
    assert set(tuned.objectives) == {"rms_error", "noise_gain"}
    assert len(tuned.history) == 6
    assert (tuned.gains["kp"] / tuned.start["kp"] < 8.01).all()
    assert tuned.gains["kd"][1] <= 100.0
    text = " ".join(tuned.sentences())
    assert "designed (analytic)" in text
    assert "0 … 0.5 kg at the tip" in text
    assert "forearm.mass_kg" in text


def test_a_designed_start_keeps_the_margins_and_is_beaten_on_every_objective(tuned):
    assert tuned.start_keeps
    assert tuned.start["kp"].tolist() != [600.0, 120.0]
    assert tuned.improved
    assert all(after <= before for before, after in tuned.objectives.values())
    assert (tuned.chosen < tuned.tried.first).all()
    changes = {row[0]: float(row[3].replace("−", "-")) for row in tuned.tables()[-1].cells}
    assert changes == {
        name: pytest.approx(100.0 * (after / before - 1.0), abs=0.1)
        for name, (before, after) in tuned.objectives.items()
    }
    margins = aw.loops.LinearLoop(tuned.scenario).margins(np.random.default_rng(5).uniform(-2.0, 2.0, (30, 2)))
    assert margins.phase.min() > 0.69
    assert margins.gain_up.min() > 1.98


def test_nothing_that_was_tried_surpasses_the_front_and_all_of_it_keeps_the_margins(tuned):
    front, values = tuned.tried.front(), tuned.tried.values
    assert len(front) > 1
    for k in front:
        assert not ((values <= values[k]).all(axis=1) & (values < values[k]).any(axis=1)).any()
    kp, kd = (aw.Batch(tuned.tried.gains[front][:, part]) for part in (slice(0, 2), slice(2, 4)))
    batch = replace(tuned.scenario.controller, kp=kp, kd=kd)
    loop = aw.loops.LinearLoop(replace(tuned.scenario, loop=replace(tuned.scenario.loop, controller=batch)))
    for q in np.random.default_rng(6).uniform(-2.0, 2.0, (6, 2)):
        assert loop.keeps(loop.slopes(q, loop.gains), 1.98, 0.69).all()
    with pytest.raises(aw.ArmwrightError, match="two objectives"):
        tuned.tried.front(("rms_error", "energy"))


def test_an_objective_that_is_always_0_is_not_magnified():
    values = np.array([[1.0, 0.0], [0.9, 0.0]])
    figure = Figure()
    draw_front(
        figure, Tried(("rms_error", "saturation"), values, np.ones((2, 4)), values[0]), values[1], "black", "grey"
    )
    low, high = figure.axes[0].get_ylim()
    assert -0.05 < low < 0.0 < high < 0.05
    assert high - low > 1e-3


def test_the_front_is_drawn(tuned, tmp_path):
    path = tmp_path / "front.png"
    tuned.plot(path)
    assert path.read_bytes().startswith(b"\x89PNG")
    axes = tuned.plot().axes[0]
    assert axes.get_xlabel().startswith("rms error")
    assert {text.get_text() for text in axes.get_legend().get_texts()} == {
        "gains tried",
        "Pareto front",
        "start",
        "chosen",
    }


def test_what_python_states_comes_before_the_file(tmp_path):
    found = aw.tuning.tune(
        read(tmp_path, TABLE.format(generations=5)), start="scenario", draws={"mass": 0.1},
        margins=aw.tuning.MarginConstraint(phase_margin=0.4), search=aw.tuning.Search(generations=1, front=0, improve_each=False),
    )  # fmt: skip
    assert found.begun == "scenario"
    assert found.asked == (2.0, 0.4)
    assert len(found.history) == 2
    assert found.drawn == ("masses within ±10 %",)


def test_a_scenario_file_without_the_table_and_a_changed_copy_have_the_defaults(tmp_path):
    scenario = read(tmp_path, "generations = 2")
    from armwright.tuning.tune import in_file

    assert in_file(scenario) == {"generations": 2}
    assert in_file(replace(scenario, seed=1)) == {}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("generation = 3", "generations"),
        ('start = "good"', "start"),
        ('method = "newton"', "method"),
        ("gains = { kp = [1, 2, 3] }", "[lowest, highest]"),
        ("objectives = { rms_error = -1 }", "rms_error"),
        ("improve_each = 3", "improve_each"),
        ("draws = { mass = 2 }", "mass"),
        ("draws = { friction = 0.5 }", "friction"),
        ("draws = { payload_kg = [2, 1] }", "payload_kg"),
        ('draws = { vary = { "a.b" = { values = [1, 2] } } }', "normal, uniform or lognormal"),
        ("front = -1", "front"),
    ],
)
def test_a_wrong_table_is_refused_when_the_file_is_read(tmp_path, table, words):
    with pytest.raises(aw.ArmwrightError) as caught:
        read(tmp_path, table)
    assert "\n" not in str(caught.value)
    assert words in str(caught.value)
    assert "arm.scenario.toml" in str(caught.value)


@pytest.mark.study
def test_the_example_s_table_is_searched_over_its_lanes():
    found = aw.tuning.tune(
        EXAMPLES / "robust.scenario.toml",
        margins=aw.tuning.MarginConstraint(poses=20),
        search=aw.tuning.Search(generations=1, candidates=4),
    )
    assert found.lanes == (32, 32)
    assert set(found.objectives) == {"rms_error", "peak_error", "noise_gain"}
    assert found.searched == ("position_kp", "speed_ki")
    units = {row["gain"]: row["unit"] for row in found.rows()}
    assert units == {"position_kp": "1/s", "speed_ki": "A/rad"}
    assert {row["measure"]: row["unit"] for row in found.tables()[1].rows()}["noise_gain"] == "A/rad"


def test_a_front_needs_two_objectives(tmp_path):
    with pytest.raises(aw.ArmwrightError, match="single objective"):
        aw.tuning.tune(
            read(tmp_path, "poses = 50\nlanes = 4\ngenerations = 1\nfront = 2\nobjectives = { rms_error = 1 }"),
        )


@pytest.mark.study
def test_differential_evolution_gets_better_too_and_repeats_itself(tmp_path):
    scenario = read(tmp_path, "poses = 100\nlanes = 12\ngenerations = 5\nmethod = 'differential-evolution'")
    found, again = aw.tuning.tune(scenario), aw.tuning.tune(scenario)
    assert found.improved
    assert found.score[1] < 0.9 * found.score[0]
    assert all(np.array_equal(found.gains[name], again.gains[name]) for name in found.gains)


@pytest.mark.study
def test_a_cluster_gives_the_same_bits(tmp_path):
    pytest.importorskip("distributed", reason="distributed is not installed: pip install armwright[sweep]")
    pytest.importorskip("zarr", reason="zarr is not installed: pip install armwright[sweep]")
    from armwright.sweeps.cluster import connected

    scenario = read(tmp_path, "poses = 50\nlanes = 8\ngenerations = 2\ncandidates = 4")
    assert scenario.loop is not None
    noisy = replace(scenario, loop=replace(scenario.loop, sensors=aw.Sensors(position_noise=1e-4)))
    few: dict[str, Any] = {"lanes": 8, "margins": aw.tuning.MarginConstraint(poses=50)}
    search = aw.tuning.Search(generations=1, candidates=4)
    here = aw.tuning.tune(noisy, **few, search=search)
    with connected() as client:
        there = aw.tuning.tune(noisy, **few, search=replace(search, client=client))
    assert np.array_equal(here.history, there.history)
    assert here.score == there.score


def test_margins_out_of_reach_say_which_delay_or_period_would_do():
    law = aw.JointPID(kp=np.array([600.0, 120.0]), kd=np.array([60.0, 10.0]), gravity=True)
    timing = aw.Timing(preset="one-tick", command_delay=2e-2)
    loop = aw.Loop(law, reference=[0.3, 0.2], period=2e-3, timing=timing)
    scenario = aw.Scenario(aw.load("two-link"), duration=0.2, loop=loop)
    margins = aw.tuning.MarginConstraint(phase_margin=np.radians(35.0), poses=50)
    with raises_at(aw.ArmwrightError, "gains", "35°.* 12.2 ms") as caught:
        aw.tuning.tune(scenario, {"kp": 1.01}, lanes=4, margins=margins, search=aw.tuning.Search(generations=1))
    text = str(caught.value)
    assert "a delay of" in text
    delay = float(text.split("a delay of ")[1].split(" ms")[0]) * 1e-3
    linear = aw.loops.LinearLoop(scenario)
    q = aw.loops.joint_inertias(scenario.arm, 50, 0)
    q = q.q[q.extremes()]
    for factor, kept in ((0.97, True), (1.05, False)):
        late = linear.with_delay(factor * delay)
        assert bool(late.keeps(late.slopes(q), 2.0, np.radians(35.0)).all()) is kept


def test_options_of_another_type_are_refused(tmp_path):
    options: Any = {"margins": 2.0}
    with raises_at(aw.ArmwrightError, "margins", r"aw\.tuning\.MarginConstraint", value=2.0):
        aw.tuning.tune(read(tmp_path, ""), **options)


def test_a_start_that_fails_in_a_lane_is_named():
    law = aw.JointPID(kp=np.array([600.0, 120.0]), kd=np.array([60.0, 10.0]), gravity=True)
    loop = aw.Loop(law, reference=[0.3, 0.2], period=2e-3)
    one = aw.Scenario(aw.load("two-link"), duration=0.2, loop=loop)
    light = {"forearm.mass_kg": aw.Batch([4.0, 4.0, 4.0, 4.0])}
    wild = replace(one, vary=light, start=aw.Start(qd=aw.Batch([[0.0, 0.0], [0.0, 0.0], [1e200, 0.0], [0.0, 0.0]])))
    with raises_at(aw.ArmwrightError, "loop.controller", "rms_error in 1 of 2 lanes"):
        aw.tuning.tune(wild, margins=aw.tuning.MarginConstraint(poses=50), search=aw.tuning.Search(generations=1))

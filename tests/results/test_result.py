"""Every result of a public function answers the same verbs: rows, plot, report, save, str, and HTML for notebooks."""

from __future__ import annotations

import copy
import csv
import inspect
import json
import pickle
import re

import numpy as np
import pytest

import armwright as aw
from armwright.results.result import Result
from armwright.results.table import Table, number
from public_names import BY_NAME, PUBLIC

INPUTS = {"BenchLog", "CompiledArm", "Log", "Model", "ModuleLibrary", "MotorGuess", "Preparation", "RobotDescription", "Scenario",
          "Schedule", "Task"}  # what other functions take; they have verbs of their own  # fmt: skip
OTHERS = {"LiveArm", "PartsBuild", "Shown"}  # a page that lives, a build with its audit, a picture


def returned():
    """Types of ours that public functions return, motions aside."""
    words = {
        word
        for value in PUBLIC.values()
        if inspect.isfunction(value)
        for word in str(value.__annotations__.get("return")).split(" | ")
    }
    kinds = {
        word.partition("[")[0]: BY_NAME[word.partition("[")[0]] for word in words if word.partition("[")[0] in BY_NAME
    }
    return {
        name: kind
        for name, kind in kinds.items()
        if not issubclass(kind, (aw.trajectories.Motion, *map(BY_NAME.get, INPUTS | OTHERS)))
    }


def test_all_results_are_of_the_one_kind():
    kinds = returned()
    assert len(kinds) > 30
    assert [name for name, kind in kinds.items() if not issubclass(kind, Result)] == []


def scenario():
    loop = aw.Loop(aw.JointPID([400.0, 200.0], kd=[40.0, 20.0]), np.zeros((20, 2)), 1e-3)
    return aw.Scenario("two-link", 0.019, loop=loop, solver=aw.Solver(step=1e-3, integrator="rk4"))


RESULTS = {
    "LoopAnalysis": lambda: aw.loops.analyse_loops(scenario(), 50),
    "GainDesign": lambda: aw.loops.design_gains(scenario(), poses=20),
    "NoiseGain": lambda: aw.loops.noise_gain(aw.loops.LinearLoop(scenario()), [0.1, 0.2]),
    "Manipulability": lambda: aw.kinematics.manipulability("two-link", [0.1, 0.2]),
    "PoseSolutions": lambda: aw.inverse_kinematics("puma560", aw.forward_kinematics("puma560", [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])),
    "Clearance": lambda: aw.collision.clearance("two-link", radius=0.05),
    "Report": lambda: aw.robotfiles.check("two-link"),
    "Difference": lambda: aw.robotfiles.diff("two-link", aw.load("two-link").with_values({"forearm.mass_kg": 9.0})),
    "Enumeration": lambda: aw.modules.enumerate_assemblies(aw.modules.read_modules("improv"), max_joints=2, limit=2),
    "StepStudy": lambda: aw.simulation.step_study(aw.Scenario("two-link", 0.02, command=[1.0, 0.5]), steps=3),
    "LimitsReport": lambda: aw.trajectories.limits_report("two-link", aw.trajectories.Quintic([0.0, 0.0], [1.0, 1.0], 1.0)),
    "FrequencyResponse": lambda: aw.identification.frequency_response(*np.random.default_rng(0).normal(size=(2, 4000)), 1e-3),
    "Estimate": lambda: aw.identification.Estimate(("a", "b"), [1.0, 2.0], np.diag([0.01, np.nan]), 64 * "0", "by hand"),
}  # fmt: skip
NO_PICTURE = {"Report"}  # of words
NUMBER = re.compile(r"[−±×÷+-]?\s*\d")  # at the beginning of a text that should be one


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", RESULTS)
def test_verbs(name, tmp_path):
    found = RESULTS[name]()
    assert type(found).__name__ == name
    rows = found.rows()
    assert rows
    assert all(row.keys() == rows[0].keys() for row in rows)
    assert not [value for row in rows for value in [*row.values()][1:] if str is type(value) and NUMBER.match(value)]
    assert all(len(line) < 200 for table in found.tables() for line in str(table).splitlines())
    assert str(found).count("\n") < 120
    assert len(repr(found)) <= len(str(found))
    assert "<table>" in found._repr_html_()
    if found.good is not None and isinstance(verdict := getattr(found, "verdict", None), str):
        assert found.sentences()[0] == verdict
    with open(found_csv := saved_as_csv(found, tmp_path), encoding="utf-8", newline="") as file:
        assert len([*csv.reader(file)]) == len(rows) + 1, found_csv
    document = json.loads(found.save(tmp_path / "result.json").read_text(encoding="utf-8"))
    assert len(document["tables"][0]["rows"]) == len(rows)
    text = found.report(tmp_path / "result.html").read_text(encoding="utf-8")
    assert "<section>" in text
    assert "http:" not in text.replace("http://www.w3.org", "")
    if name in NO_PICTURE:
        with pytest.raises(aw.ArmwrightError, match="nothing to"):
            found.plot()
    else:
        found.plot(tmp_path / "result.svg")
        assert (tmp_path / "result.svg").stat().st_size > 2000
        assert found.plot().axes


def saved_as_csv(found, folder):
    return found.save(folder / "result.csv")


@pytest.mark.parametrize("verb", ["plot", "report", "save"])
def test_another_ending_is_refused_and_nothing_written(verb, tmp_path):
    found = RESULTS["Manipulability"]()
    with pytest.raises(aw.ArmwrightError, match="xyz"):
        getattr(found, verb)(tmp_path / "result.xyz")
    assert not list(tmp_path.iterdir())


def test_numbers_of_a_difference_are_numbers():
    (row,) = RESULTS["Difference"]().rows()
    assert (row["parameter"], row["A"], row["B"], row["change"]) == ("forearm.mass_kg", 4.0, 9.0, 125.0)


def test_tables_without_rows_are_not_printed():
    assert str(aw.robotfiles.diff("two-link", "two-link")).count("\n") == 0


def test_bars_have_the_names_of_their_rows_and_one_unit():
    limits = aw.trajectories.MotionLimits.of("two-link", velocity=3.0)
    motion = aw.trajectories.Quintic([0.0, 0.0], [1.0, 1.0], 1.0)
    report = aw.trajectories.limits_report("two-link", motion, limits)
    (axes,) = report.plot().axes  # no axis of rad and N m, none of times
    assert axes.get_xlabel() == "limit utilisation [%]"
    assert [each.get_text() for each in axes.get_yticklabels()] == ["shoulder velocity", "elbow velocity"]
    assert report.verdict() in str(report)
    many = aw.inverse_kinematics("puma560", np.tile(aw.forward_kinematics("puma560", np.full(6, 0.1)), (200, 1, 1)))
    assert many.plot().get_figheight() == pytest.approx(13.0)
    assert 40 < len(many.plot().axes[0].get_yticklabels()) <= 60


def test_bars_of_each_unit_have_an_axis():
    axes = aw.loops.joint_inertias("two-link", poses=50).plot().axes
    assert [each.get_xlabel() for each in axes] == [
        "value [rad | m]",
        "value [kg m² | kg]",
        "value [N m/rad | N/m]",
    ]
    assert [len(each.patches) for each in axes] == [2, 4, 2]


def test_a_table_keeps_all_digits_and_knows_its_units():
    table = Table(
        "t", ("joint", "error [rad]", "note"), [["a", number(1.0 / 3.0), ""], ["", number(None), "late"]], ("note",)
    )
    assert table.rows() == [
        {"joint": "a", "error": pytest.approx(1 / 3, rel=1e-15), "note": None},
        {"joint": "a", "error": None, "note": "late"},
    ]
    assert copy.deepcopy(table).rows() == pickle.loads(pickle.dumps(table)).rows() == table.rows()
    assert table.units == {"error": "rad"}
    assert str(table).splitlines() == [
        "t",
        "joint  error [rad]  note",
        "a          0.33333",
        "                 —  late",
    ]


def test_scenarios_and_motions_fit_a_screen():
    corners = [[0.0] * 6, [0.5] * 6]
    motion = aw.trajectories.time_optimal("cmu-dd", corners)
    assert repr(motion) == f"<PathMotion of 6 joints, {motion.duration:.4g} s>"
    assert len(repr(aw.trajectories.follow_path("two-link", straight(), 0.1, 0.5))) < 60
    loop = aw.Loop(aw.JointPID(kp=80.0, kd=8.0), motion, 0.002, sensors=aw.Sensors(counts=4096))
    shown = repr(aw.Scenario("cmu-dd", 1.0, loop=loop))
    assert repr(motion) in shown
    assert "period=0.002, sensors=Sensors(counts=4096" in shown
    assert len(shown) < 400
    assert " at 0x" not in repr(aw.load("two-link").parameters["forearm.mass_kg"])


def straight():
    start = aw.forward_kinematics("two-link", [0.3, 0.9])
    end = aw.forward_kinematics("two-link", [0.35, 0.85])
    line = aw.trajectories.Line(end[:3, 3])
    return aw.trajectories.solve_path(
        "two-link", aw.trajectories.CartesianPath([line], start), near=[0.3, 0.9], aim="position"
    )

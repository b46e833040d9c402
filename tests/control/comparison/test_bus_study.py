"""The modular arm on its bus at 4 and 8 ms, over drawn arms: errors that docs/bus-study.md states."""

from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError

EXAMPLES = Path(__file__).parents[3] / "examples"
STATED = {"4ms": (0.025, 6e-3), "8ms": (0.09, 35e-3)}  # largest joint error [rad] and distance from the path [m]
LANES = 6


@pytest.fixture(scope="module", params=["throw", "pick-and-place"])
def followed(request):
    scenarios = {name: aw.read_scenario(EXAMPLES / f"bus-{name}.scenario.toml") for name in STATED}
    plan = aw.plan(EXAMPLES / "motions" / f"{request.param}.motion.toml")
    return aw.compare_controllers(scenarios["4ms"], scenarios, {request.param: plan}, runs=LANES)


def test_errors_stay_within_those_stated(followed):
    data = followed.data.isel(motion=0, payload=0)
    assert (data["failed"] == 0).all()
    for name, (joint, tool) in STATED.items():
        one = data.sel(controller=name)
        assert one["largest_error"].max() < joint
        assert one["path_largest"] < tool
    assert (data["peak_share"] <= 1.0 + 1e-9).all()  # 75.5 and 40 N m are the most that any drive did


def test_arms_differ(followed):
    """Masses, friction and repeated samples of the runs are drawn: they spread, and half the rate errs more."""
    data = followed.data.isel(motion=0, payload=0)
    assert followed.runs == LANES
    assert (data["path_repeatability"] > 1e-4).all()
    worst = data["rms_error"].max("joint")
    assert worst.sel(controller="8ms") > 2.0 * worst.sel(controller="4ms")


def test_more_runs_than_arms_are_refused():
    scenario = aw.read_scenario(EXAMPLES / "bus-4ms.scenario.toml")
    motion = aw.Quintic(np.zeros(6), np.full(6, 0.1), 0.5)
    with pytest.raises(ScenarioError) as error:
        aw.compare_controllers(scenario, {"bus": scenario}, {"move": motion}, runs=65)
    assert (error.value.problems[0].place, error.value.problems[0].value) == ("runs", 65)

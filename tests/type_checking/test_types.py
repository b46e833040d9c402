"""Type checkers find typical mistakes in programs that use the package, and nothing in right ones."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import typing
from pathlib import Path

import pytest

import armwright as aw
from armwright.control.anti_windup import RULES as ANTI_WINDUP
from armwright.simulation.integrate.integrators import RULES
from armwright.simulation.loop.sensors import SIDES, VELOCITIES
from armwright.simulation.loop.timing import PRESETS
from armwright.simulation.scenario_parts import KEPT
from armwright.trajectory.input_shaper import IMPULSES
from armwright.trajectory.waypoints import CHOICES as WAYPOINT_CURVES

HERE = Path(__file__).parent
CHOICES = {  # of a field, as its type has them and as the code checks them
    (aw.Solver, "integrator"): RULES,
    (aw.Recording, "what"): KEPT,
    (aw.Timing, "preset"): PRESETS,
    (aw.Sensors, "side"): SIDES,
    (aw.Sensors, "velocity"): VELOCITIES,
    (aw.JointPID, "anti_windup"): ANTI_WINDUP,
    (aw.Cascade, "anti_windup"): ANTI_WINDUP,
    (aw.trajectories.Waypoints, "curve"): WAYPOINT_CURVES,
    (aw.trajectories.InputShaper, "kind"): tuple(IMPULSES),
}


@pytest.mark.study
def test_every_mistake_is_found_and_no_right_use(tmp_path):
    pyright = shutil.which("pyright", path=str(Path(sys.executable).parent))
    if pyright is None:
        pytest.skip("pyright is not installed")
    for name in ("mistakes.py", "right.py"):
        shutil.copy(HERE / name, tmp_path / name)
    source = str(Path(aw.__file__).parents[1])
    config = {"extraPaths": [source], "pythonVersion": "3.11", "reportMissingModuleSource": False}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(config))
    words = [pyright, "--outputjson", "--pythonpath", sys.executable, "-p", tmp_path]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, cwd=tmp_path)
    found = json.loads(done.stdout)["generalDiagnostics"]
    errors = [each for each in found if each["severity"] == "error"]
    right = [
        (each["range"]["start"]["line"] + 1, each["message"]) for each in errors if each["file"].endswith("right.py")
    ]
    assert right == []
    lines = {each["range"]["start"]["line"] for each in errors}
    text = (HERE / "mistakes.py").read_text(encoding="utf-8").splitlines()
    marked = {number for number, line in enumerate(text) if "# mistake:" in line}
    assert len(marked) >= 30
    assert [text[number] for number in sorted(marked - lines)] == []
    assert [text[number] for number in sorted(lines - marked)] == []


@pytest.mark.parametrize(("kind", "field"), CHOICES, ids=lambda value: getattr(value, "__name__", value))
def test_choices_of_types_are_those_that_the_code_takes(kind, field):
    namespace = {**vars(sys.modules[kind.__module__]), "Literal": typing.Literal}
    assert set(typing.get_args(eval(kind.__annotations__[field], namespace))) == set(CHOICES[kind, field])

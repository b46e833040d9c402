"""Public functions take arm, scenario, log, run and motion in each of their forms, and refuse others in the same words."""

from __future__ import annotations

import inspect
import traceback
from dataclasses import is_dataclass, replace

import numpy as np
import pydantic
import pytest

import armwright as aw
from armwright.entry import ENTRIES, as_motion, as_run, as_scenario
from public_names import PUBLIC

ARM = aw.load("two-link")
SCENARIO = aw.Scenario(ARM, 0.01, command=[0.0, 0.0])
MOTION = aw.trajectories.Quintic([0.0, 0.0], [1.0, 1.0], 1.0)
WRONG = {
    "None": None, "text": "no-such-thing", "number": 3.5, "list": [1, 2], "another type": aw.Batch([1.0]), "bytes": b"x",
    "scenario": SCENARIO, "arm": ARM,
}  # fmt: skip
GOOD = {  # of parameters behind the first that have no default
    **dict.fromkeys(("q", "qd", "qdd", "tau", "u", "voltage"), np.zeros(2)),
    **dict.fromkeys(("robot", "arm", "model"), ARM),
    **dict.fromkeys(("a", "b", "c"), np.eye(2)),
    **dict.fromkeys(("speed", "acceleration", "mass"), 1.0),
    "scenario": SCENARIO, "motion": MOTION, "run": aw.simulate(replace(SCENARIO, duration=1.0)),
    "path": "out.toml", "directory": "out", "folder": "out",
    "target": "out.urdf", "title": "x", "bus": "x", "by": ["start.q[0]"], "names": ["a"], "controllers": {}, "motions": {},
    "joint": "a", "period": 1e-3, "gains": {"kp": 1.0}, "noise": 0.1, "position": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0],
    "targets": np.eye(4), "lanes": 4, "rows": [],
}  # fmt: skip
OPTIONS = {each.__name__ for each in PUBLIC.values() if isinstance(each, type) and is_dataclass(each)}
FORMS = {f"Any{kind.capitalize()}": kind for kind in ENTRIES}


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log of a simulated run."""
    folder = tmp_path_factory.mktemp("log")
    aw.save(GOOD["run"], folder / "run.csv")
    return aw.identification.read_log(
        aw.identification.write_log(GOOD["run"], folder / "run.csv", folder / "own.log.toml", ARM)
    )


def parameters(name):
    """Parameters of a public name that are walked: the first, and all that take one of the entries or an option type."""
    function = PUBLIC[name]
    if not callable(function):
        return []
    try:
        found = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return []
    positional = [each for each in found if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)]
    return [each for k, each in enumerate(positional) if k == 0 or _kind(each) is not None or _type(each) in OPTIONS]


def _type(parameter):
    return str(parameter.annotation).removesuffix(" | None").strip()


def _kind(parameter):
    return FORMS.get(_type(parameter))


CASES = [(name, each) for name in sorted(PUBLIC) for each in parameters(name)]


@pytest.mark.sample(56)
@pytest.mark.parametrize(("name", "parameter"), CASES, ids=[f"{name}-{each.name}" for name, each in CASES])
def test_a_wrong_object_is_refused_in_words(name, parameter, log, tmp_path, monkeypatch):
    """Only errors of ours, a `TypeError` of the signature itself, or of a record the error of its fields."""
    monkeypatch.chdir(tmp_path)
    function = PUBLIC[name]
    given = {
        each.name: log if each.name in ("log", "loaded_log") else GOOD.get(each.name)
        for each in inspect.signature(function).parameters.values()
        if each.default is each.empty and each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)
    }
    kind = _kind(parameter)
    for form, value in WRONG.items():
        if parameter.default is None and value is None:
            continue
        error = _raised(function, {**given, parameter.name: value})
        if error is None:
            assert kind is None or form in ("scenario", "arm"), form
        elif isinstance(error, TypeError):
            assert len(traceback.extract_tb(error.__traceback__)) == 2, (form, error)
        elif isinstance(error, pydantic.ValidationError):
            assert issubclass(function, pydantic.BaseModel), form
        else:
            assert isinstance(error, aw.ArmwrightError), (form, error)
            if kind is not None and form in ("number", "list", "another type", "bytes"):
                assert f"{parameter.name} = " in str(error), (form, error)
                assert ENTRIES[kind].expected in str(error), (form, error)


def _raised(function, given):
    """The error that a call ends with; None where it does not."""
    try:
        function(**given)
    except Exception as error:  # noqa: BLE001 - which it is, is what is asked
        return error
    return None


def test_the_walk_meets_every_form():
    kinds = [_kind(parameter) for _, parameter in CASES]
    assert {kind: kinds.count(kind) >= 4 for kind in ("arm", "scenario", "log", "run")} == dict.fromkeys(
        ("arm", "scenario", "log", "run"), True
    )
    assert "motion" in kinds


def test_names_and_files_are_read(tmp_path):
    q = np.array([0.3, -0.2])
    np.testing.assert_array_equal(aw.mass_matrix("two-link", q), aw.mass_matrix(ARM, q))
    np.testing.assert_array_equal(aw.compile("two-link").gravity_torques(q), aw.compile(ARM).gravity_torques(q))
    file = tmp_path / "own.scenario.toml"
    aw.write_scenario(replace(SCENARIO, arm=ARM), file)
    run = aw.simulate(str(file))
    np.testing.assert_array_equal(run.q, aw.simulate(SCENARIO).q)
    aw.save(run, tmp_path / "run.nc")
    np.testing.assert_array_equal(as_run(tmp_path / "run.nc").q, run.q)
    aw.plot({"file": tmp_path / "run.nc", "run": run}, tmp_path / "both.svg")
    assert as_scenario(file).duration == SCENARIO.duration
    assert as_run(run) is run
    assert as_motion(MOTION) is MOTION

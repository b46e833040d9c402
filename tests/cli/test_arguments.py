"""Vectors as they are typed."""

import numpy as np
import pytest

import armwright as aw
from armwright.cli.arguments import start_of, vector
from armwright.errors import ScenarioError

NAMES, UNITS = ("turn", "slide"), ("rad", "m")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1,2", [1, 2]),
        (" -1 , 2e-3 ", [-1, 2e-3]),
        ("0", [0, 0]),
        ("90deg,1", [np.pi / 2, 1]),
        ("-90deg,1", [-np.pi / 2, 1]),
        ("pi,0", [np.pi, 0]),
        ("-pi/2,0", [-np.pi / 2, 0]),
        ("2pi/3,0", [2 * np.pi / 3, 0]),
        ("0.5*pi,0", [np.pi / 2, 0]),
    ],
)
def test_reads(text, expected):
    np.testing.assert_allclose(vector("--start", text, NAMES, UNITS), expected, rtol=1e-15)


@pytest.mark.parametrize(
    "text", ["1,2,3", "1,", "", "a,b", "inf,1", "nan,1", "1,30deg", "1,pi", "pi/0,1", ".pi,1", "deg,1"]
)
def test_refuses(text):
    with pytest.raises(ScenarioError, match=r"^--start") as error:
        vector("--start", text, NAMES, UNITS)
    assert "expected" in str(error.value)


@pytest.mark.parametrize(("text", "noted"), [("30", True), ("0,-30,0,0,0,0", True), ("30deg", False), ("2pi", False)])
def test_initial_positions_of_turns_are_noted(text, noted, capsys):
    start_of(aw.load("puma560"), text, None)
    assert ("30 rad is 4.8 turns" in capsys.readouterr().err) is noted

"""Every example runs, says what it found, and writes its pictures only where it was told."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from docs.pages import run_here
from pictures.gallery import TABLE

PICTURES = {words[1]: picture for picture in TABLE if (words := shlex.split(picture.commands[0]))[0] == "python"}
EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("[0-9]*.py"))
SAYS = {  # lines that must come out, and files that must be there
    "01": (["joint2  q = -0.0461 rad"], ["first_motion.nc", "first_motion.png"]),
    "02": (["forward(inverse) off by at most"], []),
    "03": (["bit for bit: True"], []),
    "04": (["<arm scara: 4 joints", "rod.mass_kg: estimate"], ["own_robot.png"]),
    "05": (["1000 lanes of 1500 steps"], ["lanes.png"]),
    "07": (["8 ms late"], ["delay.png"]),
    "08": (
        ["3 V, plain             overshoot 39%, not within 5 % yet", "3 V, clamping          overshoot  3%"],
        ["windup.png"],
    ),
    "10": (
        ["the best cylinder pulls 27075 N", "axis 2 with it:  1764 N m at most,   715 N m rms"],
        ["balanced_arm.png"],
    ),
    "11": (
        ["qd shoulder: 57.3 times the derivative of the position: the speed is in degrees", "every 20th row is kept"],
        [],
    ),
    "13": (
        ["designed", "elbow rests: fv2 cannot be identified from it; designed would do it", "prbs: "],
        ["excite.png", "prbs.png"],
    ),
    "14": (["1.124 m in 6.03 s, 1.00 times slower than requested", "less than 1 µm and 1 µrad"], ["weld_seam.png"]),
    "15": (["plain     torque up to 6256", "speed up to 2.00 rad/s"], ["jumping_reference.png"]),
    "16": (
        ["with motors: 0.0% of ticks above a voltage limit", "113.0% of its limit"],
        ["time_optimal.png"],
    ),
    "17": (["slower where needed: 3.58 s", "2.39 times too fast, joint 'wrist_roll'"], ["slowed_path.png"]),
    "19": (["Pose 8: errors far beyond", "record misses by 0.01 mm"], ["calibration.png", "calibrated.toml"]),
    "20": (["rows frozen: left out         off by 2.001 mrad as logged, 0.008 mrad prepared"], ["worn_log.png"]),
    "09": (["the winding reached 107 °C"], ["hot_motor.png"]),
}


@pytest.mark.study
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example(example: Path, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    done = run_here(["python", str(example), str(folder)], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    assert not [path for path in tmp_path.iterdir() if path != folder]
    lines, files = SAYS.get(example.stem[:2], ([], []))
    for line in lines:
        assert line in done.stdout
    for name in files:
        assert (folder / name).stat().st_size > 1000
    assert 2 <= len(done.stdout.splitlines()) <= 14
    if picture := PICTURES.get(f"examples/{example.name}"):  # which the docs show
        difference = picture.changed(folder / picture.file)
        assert difference is None, f"{picture.file}: {difference}; if it is meant to: make pictures, and look at it"


def test_examples_are_numbered_and_short() -> None:
    assert [path.stem[:2] for path in EXAMPLES] == [f"{k + 1:02}" for k in range(len(EXAMPLES))]
    for path in EXAMPLES:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 40, f"{path.name} is long"

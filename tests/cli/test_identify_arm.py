"""`armwright identify arm` from the command line."""

from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from identification.arm.simulated_log import write_log

run = CliRunner().invoke


def test_arm_is_identified_and_written(tmp_path):
    log = write_log(tmp_path, aw.load("lwa4p"))
    result = run(app, ["identify", "arm", "lwa4p", str(log), "-o", str(tmp_path / "found.toml")])
    assert result.exit_code == 0, result.output
    assert "Izz6" in result.output
    assert "\nidentified\n" in result.output
    assert aw.load(tmp_path / "found.toml").n == 6


def test_resting_joint_ends_with_1(tmp_path):
    log = write_log(tmp_path, aw.load("lwa4p"), still=(5,))
    result = run(app, ["identify", "arm", "lwa4p", str(log)])
    assert result.exit_code == 1
    assert "not identified" in result.output


def test_bad_input_ends_with_2_and_writes_nothing(tmp_path):
    log = write_log(tmp_path, aw.load("lwa4p"), seconds=5)
    for words in (
        ["panda", log],
        [log],
        ["lwa4p", log, "--method", "magic"],
        ["lwa4p", log, "--lacks", "mass"],
        ["lwa4p", log, "--fit-efficiency", "joint9"],
        ["lwa4p", log, "--method", "iv"],
        ["lwa4p", log, "--method", "iv", "--feedback", "1,2;x"],
        ["lwa4p", log, "--method", "iv", "--feedback", "1,2;3,4;0.01"],
        ["lwa4p", log, "--method", "recursive", "--forgetting", "2"],
    ):
        result = run(app, ["identify", "arm", *map(str, words), "-o", str(tmp_path / "found.toml")])
        assert result.exit_code == 2, words
        assert not (tmp_path / "found.toml").exists()

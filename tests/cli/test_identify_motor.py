"""`armwright identify motor`: a table, a record, and exit codes 0, 1 and 2."""

import pytest

import armwright as aw
from cli.test_commands import run
from identification.motor_truth import PATHS, TRUE, write_log


def test_a_motor_is_identified_and_its_record_written(tmp_path):
    log, record = write_log(tmp_path, 0, ("current", "qd"), rows=1000), tmp_path / "motor.toml"
    shown = run("identify", "motor", str(log), "--starts", "2", "-o", str(record)).stdout
    for words in (PATHS["R"], "± std", "fit [%]", "identified", "wrote"):
        assert words in shown
    motor = aw.load(record).record.joints[0].motor
    assert abs(motor.resistance_ohm.value / TRUE["R"] - 1) < 0.05


def test_what_cannot_be_told_ends_with_1(tmp_path):
    log = write_log(tmp_path, 0, ("qd",), rows=600)
    shown = run(
        "identify",
        "motor",
        str(log),
        "--free",
        "R,Kt,J",
        "--fix",
        "viscous=0.0004,coulomb=0.012",
        "--starts",
        "2",
        code=1,
    )
    assert "not identified" in shown.stdout


def test_mistakes_are_one_line_and_write_nothing(tmp_path):
    log, record = write_log(tmp_path, 0, ("qd",), rows=200), tmp_path / "motor.toml"
    for arguments in (
        ["--fix", "R"],
        ["--free", "mass"],
        ["--pwm", "slow"],
        ["--starts", "0"],
        ["--static", "nowhere.log.toml"],
        ["--joint", "elbow"],
        ["--fix", "R=0"],
        ["--fix", "R=-1"],
        ["--fix", "R=nan"],
        ["--fix", "Q=1"],
        ["--free", ""],
    ):
        result = run("identify", "motor", str(log), *arguments, "-o", str(record), code=2)
        assert result.stderr.startswith("armwright: error: ")
        assert result.stderr.count("\n") == 1
    assert not record.exists()


def test_the_log_is_not_replaced_by_the_record(tmp_path):
    log = write_log(tmp_path, 0, ("qd",), rows=200)
    before = log.read_text()
    assert "would be replaced" in run("identify", "motor", str(log), "-o", str(log), code=2).stderr
    assert log.read_text() == before


def test_deviations_count_what_nobody_knows(tmp_path):
    """Volts and speed tell three of Kt, J, viscous and Coulomb friction: with viscous friction held at 0 the others are off."""
    log = write_log(tmp_path, 0, ("qd",), rows=1000)
    found = aw.identification.identify_motor(
        log, fixed={"R": TRUE["R"]}, search=aw.identification.MotorSearch(starts=2)
    ).estimate
    number = found.number(PATHS["Kt"])
    assert not found.identifiable[found.number(PATHS["viscous"])]
    assert abs(found.values[number] - TRUE["Kt"]) < 3.0 * found.std[number]


@pytest.mark.parametrize(
    ("options", "refused"),
    [
        *((["--model", "arx", *each], each[0]) for each in (
            ["--run", "a"], ["--static", "b.log.toml"], ["--pwm", "coast"], ["--starts", "2"], ["--free", "R"], ["--locked"],
        )),
        (["--order", "2"], "--order"),
        (["--delay", "1"], "--delay"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)  # fmt: skip
def test_options_of_another_kind_of_model_are_refused_by_name(tmp_path, options, refused):
    log = write_log(tmp_path, 0, ("qd",), rows=200)
    shown = run("identify", "motor", str(log), *options, code=2)
    assert refused in shown.output
    assert "one of the two" in " ".join(shown.output.split())

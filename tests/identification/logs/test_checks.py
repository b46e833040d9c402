"""Checks of logs: every mistake that a logger or its user makes is found and named, and a good log has none."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.signal import sosfiltfilt

import armwright as aw
from armwright.errors import LogError
from armwright.identification.logs.effort_checks import motion_delay
from armwright.identification.logs.preparation import low_pass
from identification.logs.example_logs import ALL, HEAD, POSITIONS, RATE, TORQUES, columns, motion, written

OF_PUMA560 = f"""
robot = "puma560"
files.arm.path = "arm.csv"
time.column = "t"
time.unit = "s"
[[signals]]
quantity = "position"
columns = ["q1", "q2"]
joints = {list(aw.load("puma560").names[:2])}
unit = "rad"
side = "joint"
"""


def findings(folder, change=None, text=ALL, level=None):
    """Sentences of the findings about a log whose columns were changed."""
    table = columns()
    if change is not None:
        table = change(table) or table
    log = aw.identification.read_log(written(folder, text, {"arm.csv": table}), on_error="keep")
    return [str(each) for each in log.findings if level in (None, each.level)]


def scaled(*names, by):
    return lambda table: table.update({name: table[name] * by for name in names})


def test_a_good_log_has_no_findings(tmp_path):
    assert findings(tmp_path) == []


def test_noise_and_counts_are_no_mistakes(tmp_path):
    rng = np.random.default_rng(3)

    def measured(table):
        for name in ("q1", "q2"):
            table[name] = np.round(table[name] / (2 * np.pi / 40000)) * (2 * np.pi / 40000)
        for name in ("v1", "v2", "m1", "m2"):
            table[name] = table[name] + 0.02 * np.std(table[name]) * rng.normal(size=len(table[name]))

    found = findings(tmp_path, measured)
    assert [line for line in found if "40000 in a turn" in line] == found
    assert len(found) == 1
    assert found[0].endswith("alike: elbow")


@pytest.mark.parametrize("period", [0.002, 0.0025, 0.0033, 0.001])
def test_times_rounded_to_milliseconds_are_no_gaps(tmp_path, period):
    """A clock that a logger rounds shows steps of 1, 2 and 3 ms for rows 2 ms apart; a lost part is a gap still."""
    t = 5.0 + np.arange(4001) * period
    q, qd, _, tau = motion(t)
    stamps = np.round(t + 5e-4 + 3e-4 * np.random.default_rng(0).uniform(-1, 1, len(t)), 3)
    table = {
        "t": stamps,
        "q1": q[:, 0],
        "q2": q[:, 1],
        "v1": qd[:, 0],
        "v2": qd[:, 1],
        "m1": tau[:, 0],
        "m2": tau[:, 1],
    }
    log = aw.identification.read_log(written(tmp_path, ALL, {"arm.csv": table}))
    assert log.runs[0].census.gaps.count == 0
    assert log.runs[0].period == pytest.approx(period, rel=1e-3)
    assert not log.warnings
    assert any("times are rounded to 1 ms" in str(each) for each in log.notes)
    found = aw.identification.prepare_log(log, preparation=aw.identification.choose_preparation(log, cutoff=20.0))
    true = motion(stamps[0] - 5e-4 + found["time"].values)[2]
    assert np.abs(found["qdd"].values - true).max() < 0.05 * np.abs(true).max()
    kept = np.r_[0:1000, 1010:4001]
    cut = aw.identification.read_log(
        written(tmp_path, ALL, {"arm.csv": {name: each[kept] for name, each in table.items()}})
    )
    assert cut.runs[0].census.gaps.count == 1


MISTAKES = {  # change of the columns → what is said, as an error
    "speed in degrees": (scaled("v1", by=180 / np.pi), r"qd shoulder: 57.* times .* degrees"),
    "position in degrees": (scaled("q2", by=180 / np.pi), r"qd elbow: 0.01745 times .* degrees"),
    "speed in rpm": (scaled("v1", by=30 / np.pi), r"qd shoulder: 9.5.* times .* rpm"),
    "speed of the motor": (scaled("v2", by=80.0), r"qd elbow: 80 times .* the speed is the motor's"),
    "position of the motor": (scaled("q2", by=80.0), r"qd elbow: 0.0125.* times .* the position is the motor's"),
    "wrong sign": (scaled("v1", by=-1.0), r"qd shoulder: -1.* times .* wrong sign"),
    "time in milliseconds": (scaled("t", by=1e3), r"time is in ms"),
    "torques of the wrong sign": (scaled("m1", "m2", by=-1.0), r"all motors together do -.* J of work"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_wrong_unit_side_or_sign_is_an_error(tmp_path, name):
    change, said = MISTAKES[name]
    text = ALL.replace("[time]", "[gears]\nratios = [50, 80]\n[time]")
    lines = findings(tmp_path, change, text, "error")
    assert lines
    assert any(re.search(said, line) for line in lines), lines
    with pytest.raises(LogError):
        aw.identification.read_log(tmp_path / "two.log.toml")


def test_speeds_of_mixed_up_joints(tmp_path):
    lines = findings(tmp_path, lambda table: {**table, "v1": table["v2"], "v2": table["v1"]}, level="error")
    assert sum("columns mixed up" in line for line in lines) == 2


@pytest.mark.parametrize("samples", [-3.4, 0.5, 2.3])
def test_the_delay_of_a_speed_is_told_in_fractions_of_a_sample(tmp_path, samples):
    def late(table):
        table["v1"] = motion(table["t"] - samples / RATE)[1][:, 0]

    (line,) = findings(tmp_path, late)
    said = float(line.split("qd shoulder: ")[1].split(" ")[0])
    assert abs(said - abs(samples)) < 0.05
    assert ("behind" if samples > 0 else "ahead of") in line


@pytest.mark.parametrize("samples", [2.3, 4.0])
@pytest.mark.parametrize("cutoff", [6.0, 30.0])
def test_the_delay_of_a_torque(samples, cutoff):
    t, sections = np.arange(6000) / RATE, low_pass(4, cutoff, RATE)
    rng = np.random.default_rng(7)
    tau = motion(t - samples / RATE)[3] + 0.2 * rng.normal(size=(6000, 2))
    q, tau = (sosfiltfilt(sections, each, axis=0) for each in (motion(t)[0], tau))
    found = motion_delay(q[:, 0], tau[:, 0], 1 / RATE, sections)
    assert found is not None
    assert abs(found.samples - samples) < max(0.15, 3 * found.std)


CLOCKS = {
    "gap": (lambda t: np.delete(t, np.arange(1000, 1200)), "note", "1 gap of about 200 rows"),
    "written twice": (lambda t: np.insert(t, 500, t[500]), "note", "1 row (0.02%) at"),
    "backwards": (lambda t: np.where(np.arange(len(t)) == 700, t - 0.1, t), "error", "row 701; first at"),
    "two recordings": (lambda t: np.where(np.arange(len(t)) % 2, t, t + 100.0), "error", "two recordings are two runs"),
    "jitter": (
        lambda t: np.sort(t + 2e-4 * np.random.default_rng(1).uniform(-1, 1, len(t))), "note", "preparation interpolates",
    ),
    "no clock at all": (lambda t: np.sort(np.random.default_rng(1).uniform(0, 8, len(t))), "error", "uneven"),
}  # fmt: skip


@pytest.mark.parametrize("name", CLOCKS)
def test_clocks(tmp_path, name):
    change, level, said = CLOCKS[name]
    t = change(columns()["t"])
    q, qd, _, tau = motion(t)
    table = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "v1": qd[:, 0], "v2": qd[:, 1], "m1": tau[:, 0], "m2": tau[:, 1]}
    lines = findings(tmp_path, lambda _: table, level=level)
    assert any(said in line for line in lines), lines


def test_a_rate_that_is_wrong_by_a_factor(tmp_path):
    text = ALL.replace('column = "t"\nunit = "s"', "rate_hz = 400")
    assert any("1.25 times" in line and "rate" in line for line in findings(tmp_path, text=text))


def test_constant_saturated_and_empty_columns(tmp_path):
    def change(table):
        table["m1"] = np.clip(table["m1"], -8.0, 8.0)
        table["v2"] = np.zeros_like(table["v2"])
        table["m2"] = np.full_like(table["m2"], np.nan)

    lines = findings(tmp_path, change)
    assert any("tau shoulder: stays at its extreme 8 N m" in line for line in lines)
    assert any("qd elbow: constant, 0 rad/s" in line for line in lines)
    assert any(line.startswith("error: ") and "tau elbow: all cells are empty" in line for line in lines)


def test_held_samples(tmp_path):
    def held(table):
        return {
            name: column if name == "t" else np.repeat(column[::4], 4)[: len(column)] for name, column in table.items()
        }

    (line,) = [line for line in findings(tmp_path, held) if "repeat" in line]
    assert "3.0 at a time" in line
    assert "about 125" in line


@pytest.mark.parametrize("lost", [False, True])
def test_an_arm_of_counts_that_rests_has_lost_no_rows(tmp_path, lost):
    """As of bus servos: positions and loads in whole counts, at rest for most of the log, now and then a count to and fro."""
    rng, count = np.random.default_rng(4), 2 * np.pi / 4096

    def servos(table):
        moves = np.clip(table["t"] - 5.0, 0.0, None)
        kept = np.searchsorted(table["t"], 5.0)
        for name in ("q1", "q2", "m1", "m2"):
            step = count if name[0] == "q" else 0.02
            still = np.interp(moves + 1.0, table["t"], table[name])
            table[name] = step * np.round((still + 0.2 * step * rng.normal(size=len(still))) / step)
            if lost:
                table[name][kept + 1 :: 4] = table[name][kept:-1:4]

    found = [line for line in findings(tmp_path, servos, HEAD + POSITIONS + TORQUES) if "repeat" in line]
    assert len(found) == (1 if lost else 0), found


def test_nothing_moves(tmp_path):
    def still(table):
        for name in ("q1", "q2", "v1", "v2"):
            table[name] = np.zeros_like(table["t"])

    assert any("nothing moves" in line for line in findings(tmp_path, still, level="error"))


@pytest.mark.parametrize("sign", [1, -1])
def test_positions_beyond_one_limit_of_the_arm(tmp_path, sign):
    """A position that leaves the joint's range at one end."""
    low, high = aw.load("puma560").coordinates[0].limits.position
    reach = (high if sign > 0 else -low) + 0.2

    def shifted(table):
        table["q1"] = table["q1"] - (sign * table["q1"]).max() * sign + sign * reach

    (line, *_) = findings(tmp_path, shifted, OF_PUMA560)
    assert "beyond the joint's limits" in line


def test_positions_beyond_the_limits_of_the_arm(tmp_path):
    (line, *_) = findings(tmp_path, scaled("q1", by=180 / np.pi), OF_PUMA560, "error")
    assert "beyond the joint's limits" in line
    assert "degrees taken for radians" in line


def test_a_voltage_against_the_motion(tmp_path):
    text = HEAD.replace('joints = ["shoulder", "elbow"]', 'joints = ["motor"]') + (
        '[[signals]]\nquantity = "voltage"\ncolumns = "u"\nunit = "V"\n'
        '[[signals]]\nquantity = "speed"\ncolumns = "w"\nunit = "rad/s"\nside = "joint"\n'
    )
    t = np.arange(4000) / RATE
    w = np.sin(2 * np.pi * t) + 0.3 * np.sin(9 * t)
    for sign, level in ((1.0, None), (-1.0, "error")):
        lines = findings(
            tmp_path, lambda _, s=sign: {"t": t, "u": s * (2 * w + 0.1 * np.cos(7 * t)), "w": w}, text, level
        )
        assert any("voltage motor: pushes against the motion" in line for line in lines) == (level == "error")


def test_findings_of_several_runs_are_told_once(tmp_path):
    text = ALL + '[[runs]]\nname = "one"\n[[runs]]\nname = "two"\n[[runs]]\nname = "three"\n'
    lines = findings(tmp_path, scaled("v1", by=-1.0), text, "error")
    assert len(lines) == 1
    assert "alike in all other runs" in lines[0]


def test_a_motor_on_a_bench_turns_as_far_as_it_likes(tmp_path):
    signal = '[[signals]]\nquantity = "position"\ncolumns = {}\nunit = "rad"\nside = "joint"\n'
    t = np.arange(4000) / RATE
    turned = {"t": t, "q1": 10 * 2 * np.pi * np.sin(t), "q2": np.sin(3 * t)}
    bench = HEAD.replace('joints = ["shoulder", "elbow"]', 'joints = ["motor"]') + signal.format('"q1"')
    assert not any("turns by" in line for line in findings(tmp_path, lambda _: turned, bench))
    arm = HEAD + signal.format('["q1", "q2"]')
    assert any("turns by 20 turns" in line for line in findings(tmp_path, lambda _: turned, arm))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            scaled("m1", by=1e5),
            r"tau shoulder: up to \d+e?.* N m, more than the drive of an arm has: is the unit right",
        ),
        (scaled("t", by=1e3), "time: a row every 2 s: is the unit of the time right"),
    ],
)
def test_sizes_that_no_arm_has_are_in_doubt(tmp_path, change, said):
    assert any(re.search(said, line) for line in findings(tmp_path, change, level="warning"))

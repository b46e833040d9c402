"""Broken logs against every command that takes a log: refused, not identified, or marked, and never a plausible number.

A cell is an exit code and words of what is said. 2: refused in one line. 1: not identified, or fails its limits. 0: the numbers
are the true ones within 5 %, or a sentence says what is wrong with the log. Motors that need a kernel of their own
are left out: `motor/test_channels.py` has a closed loop.
"""

from __future__ import annotations

import re

import numpy as np
import pandas
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from identification.arm.moved_arm import moved
from identification.motor_truth import PERIOD, TRUE, true_record, write_log

ROWS, PAYLOAD = 600, 2.0  # of the bench; [kg]


def bench(folder):
    """A motor with known parameters under random levels of voltage."""
    true_record(folder)
    write_log(folder, 0, ("current", "qd"), rows=ROWS)


def loaded(folder):
    """Two links in motion with a payload, and their record without."""
    arm = aw.load("two-link")
    aw.robotfiles.write_toml(arm, folder / "without.toml")
    carrying = arm.with_payload(PAYLOAD, [0.1, 0.0, 0.0], 0.01 * np.eye(3))
    aw.robotfiles.write_toml(carrying, folder / "truth.toml")
    moved(
        folder,
        "log",
        carrying,
        seconds=10.0,
        rate=200.0,
        torque_noise=0.05,
        position_noise=1e-5,
        harmonics=20,
    )


COMMANDS = {
    "log": "log {log}",
    "linear": "identify linear {log} --order 1 --delay 3",
    "motor": "identify motor {folder}/truth.toml {log} --starts 1",
    "validate motor": "validate {folder}/truth.toml {log}",
    "arm": "identify arm {folder}/truth.toml {log} --cutoff 20",
    "payload": "identify payload {folder}/without.toml {log}",
    "friction": "identify friction {folder}/truth.toml {log}",
    "validate arm": "validate {folder}/truth.toml {log}",
}


def efforts(table):
    """Columns of torques, or of the voltage."""
    return [name for name in table if name.startswith("u")]


def as_is(table, text):
    return table, text


def nan(table, text):
    table = table.astype(object)
    table.iloc[200:203, 1] = "nan"
    table.iloc[400, 2] = ""
    return table, text


def empty(table, text):
    table = table.astype(object)
    table.iloc[:, -1] = ""
    return table, text


def words(table, text):
    table = table.astype(object)
    table.iloc[150, 2] = "overrun"
    return table, text


def gaps(table, text):
    return table.drop(index=[*range(200, 230), *range(400, 440)]), text


def two_clocks(table, text):
    """The second half begins again: two recordings in one file."""
    half = len(table) // 2
    table.loc[half:, "t"] -= table["t"][half // 2]
    return table, text


def two_rates(table, text):
    half = len(table) // 2
    table.loc[half:, "t"] = table["t"][half] + 0.5 * (table["t"][half:] - table["t"][half])
    return table, text


def constant(table, text):
    table[efforts(table)] = 1.0
    return table, text


def closed_loop(table, text):
    """The speed is held against disturbances: commands follow them."""
    draw = np.random.default_rng(5)
    damping = TRUE["Kt"] ** 2 / TRUE["R"] + TRUE["viscous"]
    a, gain = np.exp(-PERIOD * damping / TRUE["J"]), TRUE["Kt"] / TRUE["R"] / damping
    w, u, rows = 0.0, 0.0, []
    for k in range(len(table)):
        rows.append((k * PERIOD, u, (u - TRUE["Kt"] * w) / TRUE["R"], w))
        w, u = a * w + (1 - a) * gain * u + 4.0 * draw.standard_normal(), 0.05 * (30.0 - w)
    return pandas.DataFrame(rows, columns=list(table)), text


def few(table, text):
    return table[:24], text


def hardly_enough(table, text):
    return table[:70], text


def wrong_sign(table, text):
    table[efforts(table)] *= -1.0
    return table, text


def wrong_gear(table, text):
    """The first motor turns its joint the other way than the log says."""
    ratios = [-1.0, *[1.0] * (len(efforts(table)) - 1)]
    return table, text.replace('side = "joint"', 'side = "motor"') + f"\n[gears]\nratios = {ratios}\n"


def another_arm(table, text):
    """The same joints by name, of an arm that is not this one: its columns are exchanged."""
    names = [name for name in table if name[0] in "qiw"]
    return table.rename(columns=dict(zip(names, names[::-1], strict=True))), text


def other_joints(table, text):
    return table, re.sub(r"joints = \[.*\]", f"joints = {[f'axis{k}' for k in range(len(efforts(table)))]}", text)


def repeated(table, text):
    held = table.iloc[np.arange(len(table)) // 4 * 4].reset_index(drop=True)
    held["t"] = table["t"]
    return held, text


def saturated(table, text):
    for name in efforts(table):
        most = 0.5 * table[name].abs().max()
        table[name] = table[name].clip(-most, most)
    return table, text


@pytest.fixture(scope="module")
def bases(tmp_path_factory):
    folders = {}
    for make in (bench, loaded):
        folders[make] = tmp_path_factory.mktemp(make.__name__)
        make(folders[make])
    return folders


def run(bases, tmp_path, damage, command):
    """Exit code and words of a command on a log that was damaged."""
    base = bases[bench if "motor" in command or command == "linear" or damage is closed_loop else loaded]
    table, text = damage(pandas.read_csv(base / "log.csv"), (base / "log.log.toml").read_text(encoding="utf-8"))
    table.to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "log.log.toml").write_text(text, encoding="utf-8")
    for record in base.glob("*.toml"):
        if not record.name.endswith("log.toml"):
            (tmp_path / record.name).write_text(record.read_text(encoding="utf-8"), encoding="utf-8")
    words = [word.format(log=tmp_path / "log.log.toml", folder=tmp_path) for word in COMMANDS[command].split()]
    done = CliRunner().invoke(app, words)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done


TRUTH = {"motor": ("resistance_ohm", TRUE["R"]), "arm": ("mcx2", 3.4), "payload": ("mass_kg", PAYLOAD)}
REFUSED = [
    (empty, COMMANDS, "all cells are empty"),
    (words, COMMANDS, "expected a number"),
    (two_clocks, COMMANDS, "time goes backwards"),
    (two_rates, COMMANDS, "uneven"),
    (few, COMMANDS, "expected more than 32"),
    (constant, ("linear", "motor"), "an input that moves|never changes"),
    (constant, ("arm", "payload", "friction"), "never changes"),
    (
        hardly_enough,
        ("friction", "arm", "payload"),
        "the longest stretch has 70 rows; expected more than|no joint moves both|too few rows",
    ),
    (wrong_sign, ("motor",), "wrong sign of the voltage"),
    (wrong_gear, ("motor",), "or is the gear ratio -1, not 1"),
    (wrong_gear, ("validate motor",), "turns by .-1. in the log's file, by .1. in the robot's record"),
    (another_arm, ("motor",), "look exchanged"),
    (
        other_joints,
        ("motor", "validate motor", "arm", "payload", "friction", "validate arm"),
        "no such joint|same joints",
    ),
]
NOT_IDENTIFIED = [
    (constant, ("validate motor", "validate arm"), "fails its limits"),
    (closed_loop, ("validate motor",), "fails its limits"),
    (wrong_sign, ("arm",), "which no arm has"),
    (wrong_sign, ("payload",), "mass is not above 0"),
    (wrong_sign, ("friction",), "is it this arm"),
    (wrong_sign, ("validate motor", "validate arm"), "fails its limits.*sign of the"),
    (wrong_gear, ("arm",), "not explained by this model"),
    (wrong_gear, ("payload",), "not identified"),
    (wrong_gear, ("friction",), "is it this arm"),
    (wrong_gear, ("validate arm",), "fails its limits"),
    (another_arm, ("arm",), "not explained by this model"),
    (another_arm, ("payload",), "mass is not above 0"),
    (another_arm, ("friction",), "is it this arm"),
    (another_arm, ("validate motor", "validate arm"), "fails its limits"),
    (repeated, ("validate motor",), "fails its limits.*repeat the row before"),
    (saturated, ("validate motor",), "fails its limits.*stays at its extreme|go to its extremes"),
]
WARNED = [
    (constant, ("log",), "constant"),
    (closed_loop, ("linear",), "closed loop"),
    (wrong_sign, ("linear",), "pushes against the motion"),
    (another_arm, ("linear",), "the errors follow past inputs"),
    (repeated, ("log", "linear", "arm", "payload", "friction", "validate arm"), "repeat the row before"),
    (saturated, ("log", "friction", "validate arm"), "stays at its extreme"),
    (saturated, ("linear", "motor"), "go to its extremes"),
]
TRUE_NUMBERS = [
    (as_is, ("motor", "arm", "payload", "friction", "validate motor", "validate arm"), ""),
    (nan, ("log", "linear", "arm", "payload", "friction", "validate motor", "validate arm"), ""),
    (gaps, ("log", "linear", "motor", "arm", "payload", "friction", "validate motor", "validate arm"), ""),
    (hardly_enough, ("motor",), ""),
    (saturated, ("arm", "payload"), "stays at its extreme"),
]
CELLS = [
    pytest.param(damage, command, code, said, id=f"{damage.__name__}-{command}")
    for code, cells in ((2, REFUSED), (1, NOT_IDENTIFIED), (0, WARNED), (0, TRUE_NUMBERS))
    for damage, commands, said in cells
    for command in commands
]


@pytest.mark.parametrize(("damage", "command", "code", "said"), CELLS)
@pytest.mark.sample(3)
def test_a_broken_log_is_explained(bases, tmp_path, damage, command, code, said):
    done = run(bases, tmp_path, damage, command)
    shown = done.stdout + done.stderr
    assert done.exit_code == code, shown
    assert re.search(said, shown, re.DOTALL), shown
    first, *mistakes = done.stderr.splitlines() or [""]
    assert bool(first) == (code == 2), done.stderr
    assert not mistakes or f": {len(mistakes)} mistakes" in first, done.stderr
    if said == "" and command in TRUTH:
        name, value = TRUTH[command]
        found = re.search(rf"{name}\S* +(\S+)", shown)
        assert found
        assert float(found[1]) == pytest.approx(value, rel=0.05)

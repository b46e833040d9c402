"""Motors of an arm logged by themselves, with a known load, or locked; the fit goes into the arm's record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError
from armwright.identification import MotorSearch
from identification.motor_truth import DELAY, PERIOD, TRUE, commands, exact, rounded
from raises_at import raises_at

RATIO, LOAD, STARTS = -20.0, 0.03, 4
NAMES = {
    "resistance_ohm": "R", "torque_constant_n_m_per_a": "Kt", "rotor_inertia_kg_m2": "J",
}  # fmt: skip
JOINT = """
[[joints]]
name = "{name}"
type = "revolute"
parent = "{parent}"
child = "{name}_link"
axis = [0, 1, 0]
frame = {{ xyz_m = [0, 0, 0.3], rpy_rad = [0, 0, 0] }}
friction = {{ side = "motor", viscous_n_m_s_per_rad = 1e-4, coulomb_positive_n_m = 0.02, coulomb_negative_n_m = 0.02 }}
[joints.motor]                               # from a datasheet
gear_ratio = {ratio}
rotor_inertia_kg_m2 = 5e-5
torque_constant_n_m_per_a = 0.07
resistance_ohm = 2
[[links]]
name = "{name}_link"
mass_kg = 2
com_m = [0, 0, 0.15]
inertia_kg_m2 = {{ xx = 0.02, xy = 0, xz = 0, yy = 0.02, yz = 0, zz = 0.002 }}
"""
LOG = """
joints = {joints}
files.log.path = "log.csv"
time = {{ column = "t", unit = "s" }}
gears.ratios = {ratios}
"""
SIGNAL = """
[[signals]]
quantity = "{quantity}"
columns = {columns}
unit = "{unit}"
{side}
"""
QUANTITIES = {"u": ("voltage", "V"), "current": ("current", "A"), "qd": ("speed", "rad/s"), "q": ("position", "rad")}


BACKWARDS = """
joints = ["spin"]
gears.ratios = [-40]
files.log.path = "bench.csv"
time = { column = "t", unit = "s" }
signals = [
    { quantity = "voltage", columns = "u", unit = "V" },
    { quantity = "current", columns = "i", unit = "mA" },
    { quantity = "speed", columns = "w", unit = "rpm", side = "motor" },
]
"""


def arm_of(folder: Path, joints: tuple[str, ...] = ("shoulder", "elbow")) -> Path:
    """Path of the record of an arm whose motors nobody has measured."""
    parents = ["base", *(f"{name}_link" for name in joints)]
    tables = [JOINT.format(name=n, parent=p, ratio=RATIO) for n, p in zip(joints, parents, strict=False)]
    path = folder / "arm.toml"
    path.write_text(
        'name = "arm"\nsource = "datasheet"\ngravity_m_s2 = [0, 0, -9.81]\ncommand = "torque"\n' + "".join(tables)
    )
    return path


def log_of(folder: Path, motors: dict[str, dict[str, np.ndarray]]) -> Path:
    """Path of a log of motors by joint, each signal on the motor's side."""
    first = next(iter(motors.values()))
    columns = {"t": np.arange(len(next(iter(first.values())))) * PERIOD}
    text = LOG.format(joints=[*motors], ratios=[RATIO] * len(motors))
    for name in first:
        heads = [f"{name}_{joint}" for joint in motors]
        columns |= {head: motors[joint][name] for head, joint in zip(heads, motors, strict=True)}
        quantity, unit = QUANTITIES[name]
        side = 'side = "motor"' if name in ("q", "qd") else ""
        text += SIGNAL.format(quantity=quantity, columns=heads, unit=unit, side=side)
    np.savetxt(
        folder / "log.csv", np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments=""
    )
    path = folder / "motor.log.toml"
    path.write_text(text)
    return path


def logged(seed: int, rows: int = 1500, **values: float) -> dict[str, np.ndarray]:
    """Signals of a motor with 1 % noise."""
    rng = np.random.default_rng(seed)
    u = commands(rng, rows)
    found = {"u": u}
    for name, column in exact({**TRUE, **values}, u).items():
        if name != "q":
            most = float(np.abs(column).max())
            found[name] = rounded(column + 0.01 * most * rng.standard_normal(rows), 1.2 * most)
    return found


def check(estimate: aw.identification.Estimate, joint: str, **values: float) -> None:
    truth = {**TRUE, **values}
    for key, name in NAMES.items():
        assert estimate[f"{joint}.motor.{key}"] == pytest.approx(truth[name], rel=0.02), name
    assert estimate[f"{joint}.friction.coulomb_positive_n_m"] == pytest.approx(truth["coulomb"], rel=0.04)


def test_one_motor_off_its_arm_goes_into_its_joint(tmp_path):
    fit = aw.identification.identify_motor(
        log_of(tmp_path, {"elbow": logged(1)}),
        arm_of(tmp_path),
        joint="elbow",
        load=0,
        search=MotorSearch(starts=STARTS),
    )
    check(fit.estimate, "elbow")
    assert fit.estimate["delay_s"] / PERIOD == pytest.approx(DELAY, abs=0.1)
    text = fit.write(tmp_path / "identified.toml").read_text()
    record = aw.load(tmp_path / "identified.toml").record
    assert record.joints[0].motor.resistance_ohm.value == 2.0, "the other joint stays"
    assert record.joints[1].motor.resistance_ohm.value == pytest.approx(TRUE["R"], rel=0.02)
    assert record.links[1].mass_kg.value == 2.0
    assert record.command == "torque"
    assert "# from a datasheet" in text


@pytest.mark.study
def test_all_motors_of_an_arm_each_with_its_own_load(tmp_path):
    loads = {"shoulder": 0.0, "elbow": LOAD}
    with_load = TRUE["J"] + LOAD / RATIO**2
    motors = {"shoulder": logged(2, R=2.4, Kt=0.06), "elbow": logged(3, J=with_load)}
    estimate = aw.identification.identify_motor(
        log_of(tmp_path, motors), arm_of(tmp_path), load=loads, search=MotorSearch(starts=STARTS)
    ).estimate
    check(estimate, "shoulder", R=2.4, Kt=0.06)
    check(estimate, "elbow")


@pytest.mark.study
def test_a_locked_rotor_tells_resistance_and_inductance(tmp_path):
    rng, inductance = np.random.default_rng(4), 0.012
    u = commands(rng, 800)
    late = np.concatenate([u[:1], u[:-1]])
    decay, current = np.exp(-PERIOD * TRUE["R"] / inductance), [u[0] / TRUE["R"]]
    for volts in late[1:]:
        current.append(volts / TRUE["R"] + (current[-1] - volts / TRUE["R"]) * decay)
    noisy = np.array(current) + 0.05 * rng.standard_normal(len(u))
    log = log_of(tmp_path, {"elbow": {"u": u, "current": noisy}})
    fits = [
        aw.identification.identify_motor(
            log,
            arm_of(tmp_path),
            joint="elbow",
            locked=True,
            free=["R", "L"],
            fixed={"delay": 0.0},
            search=MotorSearch(starts=STARTS),
        ),
        aw.identification.identify_motor(log, locked=True, search=MotorSearch(starts=STARTS)),
    ]
    for estimate in (fit.estimate for fit in fits):
        assert estimate.verdict == "identified"
        assert estimate["elbow.motor.resistance_ohm"] == pytest.approx(TRUE["R"], rel=0.01)
        assert estimate["elbow.motor.inductance_h"] == pytest.approx(inductance, rel=0.05)
        assert not any("torque_constant" in name or "inertia" in name for name in estimate.names)


def test_currents_and_speeds_alone_determine_ratios_and_no_motor(tmp_path):
    rng, inertia, damping = np.random.default_rng(2), 0.05, 0.3
    i, w, decay = commands(rng, 400, 3.0), [0.0], np.exp(-damping * PERIOD / inertia)
    for amperes in i[:-1]:  # held from row to row, with a torque constant of 1
        w.append(w[-1] * decay + amperes / damping * (1.0 - decay))
    log = log_of(tmp_path, {"elbow": {"current": i, "qd": np.array(w) + 1e-3 * rng.standard_normal(len(i))}})
    found = aw.identification.identify_motor(log, search=MotorSearch(starts=2)).estimate
    assert found.verdict == "not identified"
    known = aw.identification.identify_motor(
        log, fixed={"Kt": 1.0, "coulomb": 0.0}, search=MotorSearch(starts=2), free=["J", "viscous"]
    )
    assert known.estimate.verdict == "identified"


def test_bad_input_is_refused(tmp_path):
    log, arm = log_of(tmp_path, {"elbow": logged(1, rows=200)}), arm_of(tmp_path)
    for options, words in (
        ({"joint": "elbow"}, "which move as one"),
        ({"joint": "wrist", "load": 0}, "no joint of the robot"),
        ({"joint": "elbow", "load": -1}, "0 or more"),
        ({"joint": "elbow", "load": {"shoulder": 0}}, "no joint that is fitted"),
        ({"joint": "elbow", "load": 0, "locked": True}, "turns nothing"),
    ):
        with pytest.raises(ModelError, match=words):
            aw.identification.identify_motor(log, arm, **options)
    with raises_at(ModelError, "load", value=0):
        aw.identification.identify_motor(log, load=0)


@pytest.mark.study
def test_a_gear_that_turns_backwards_on_a_bench(tmp_path):
    """Counts and rpm are the motor's, as the log's file says: so are the constants, with the sign of the gear."""
    table = logged(3)
    columns = {"t": np.arange(len(table["u"])) * PERIOD, "u": table["u"], "i": 1e3 * table["current"]}
    columns["w"] = table["qd"] * 30 / np.pi
    heads = ",".join(columns)
    np.savetxt(tmp_path / "bench.csv", np.column_stack([*columns.values()]), delimiter=",", header=heads, comments="")
    (tmp_path / "bench.log.toml").write_text(BACKWARDS)
    fit = aw.identification.identify_motor(tmp_path / "bench.log.toml", search=MotorSearch(starts=4))
    assert fit.estimate.verdict == fit.sentences()[0] == "identified"
    check(fit.estimate, "spin", coulomb=40.0 * TRUE["coulomb"])
    assert aw.load(fit.write(tmp_path / "spin.toml")).coordinates[0].drive.gear_ratio == -40.0

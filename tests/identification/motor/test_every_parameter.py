"""Parameters beside R, Kt, J and friction, each found again from a log of a motor that has it, or said not to be told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.identification import MotorSearch
from armwright.identification.motor.response import DriveInputs, Response
from armwright.model.vary import Varied
from identification.motor_truth import COLUMNS, LOG, PATHS, PERIOD, RECORD, SIGNALS, TRUE, commands, rounded

Change = Callable[[str], str]
FINE = 8  # substeps of the truth, where a fit takes one or two
R, KT, KE = PATHS["R"], PATHS["Kt"], "motor.motor.back_emf_constant_v_s_per_rad"


def with_motor(line: str) -> Change:
    return lambda text: text.replace("[joints.motor]", f"[joints.motor]\n{line}")


def with_joint(tables: str) -> Change:
    return lambda text: text.replace("[[links]]", f"{tables}\n[[links]]")


def with_friction(line: str) -> Change:
    return lambda text: text.replace("[joints.friction]", f"[joints.friction]\n{line}")


def geared(text: str) -> str:
    """With a gear of 20 and a load; friction behind the gear."""
    numbers = {"gear_ratio = 1.0": "gear_ratio = 20", "mass_kg = 0": "mass_kg = 1"}
    numbers |= {f"{axis} = 0": f"{axis} = 0.03" for axis in ("xx", "yy", "zz")}
    for name, value in (("viscous", 0.05), ("coulomb", 0.15)):
        numbers[f" = {TRUE[name]}"] = f" = {value}"
    for old, new in numbers.items():
        text = text.replace(old, new)
    return text


def log_of(
    folder: Path, change: Change, u: np.ndarray, period: float = PERIOD, names: tuple[str, ...] = ("current", "q", "qd")
) -> Path:
    """Path of a log with 1 % noise of the motor whose record is changed so."""
    path = folder / "truth.toml"
    path.write_text(change(RECORD.format(**TRUE)))
    arm = aw.load(path)
    response = Response(Varied(arm, [R]), ("q", "qd", "current"), 0, FINE)
    table, p = response.table(DriveInputs(np.full(len(u), period), u[:, None])), np.append(response.varied.nominal, 0.0)
    y, _ = response.run(table, p[None], np.zeros(1), response.initial(arm)[None])
    truth, rng = dict(zip(response.signals, y[0].T, strict=True)), np.random.default_rng(0)
    columns = {"t": np.arange(len(u)) * period, "u": u}
    for name in names:
        most = float(np.abs(truth[name]).max())
        noisy = rounded(truth[name] + 0.01 * most * rng.standard_normal(len(u)), 1.2 * most)
        columns[COLUMNS[name]] = np.round(truth[name] / (2 * np.pi) * 4096) if name == "q" else noisy
    np.savetxt(
        folder / "log.csv", np.column_stack([*columns.values()]), delimiter=",", header=",".join(columns), comments=""
    )
    path = folder / "log.log.toml"
    path.write_text(LOG.format(name="log", signals="".join(SIGNALS[name] for name in names)))
    return path


def fit(log: Path, *free: str, fixed: dict[str, float] | None = None, **options) -> aw.identification.Estimate:
    return aw.identification.identify_motor(
        log, free=[*free] or None, fixed={"delay": 0.0} | (fixed or {}), search=MotorSearch(starts=4), **options
    ).estimate


def volts(rows: int = 1000, most: float = 10.0) -> np.ndarray:
    return commands(np.random.default_rng(3), rows, most)


@pytest.mark.study
def test_inductance(tmp_path):
    found = fit(
        log_of(tmp_path, with_motor("inductance_h = 0.004"), volts(), 1e-3), "R", "L", "Kt", "J", "viscous", "coulomb"
    )
    assert found["motor.motor.inductance_h"] == pytest.approx(0.004, rel=0.01)
    assert found[R] == pytest.approx(TRUE["R"], rel=0.01)


def test_back_emf_constant_apart_from_the_torque_constant(tmp_path):
    """Kt, J and friction are one scale without a torque: the inertia tells it, and without it the fit says so."""
    log = log_of(tmp_path, with_motor("back_emf_constant_v_s_per_rad = 0.06"), volts())
    found = fit(log, "R", "Kt", "Ke", "viscous", "coulomb", fixed={"J": TRUE["J"]})
    assert found[KE] == pytest.approx(0.06, rel=0.01)
    assert found[KT] == pytest.approx(TRUE["Kt"], rel=0.01)
    unknown = fit(log, "R", "Kt", "Ke", "J", "viscous", "coulomb")
    assert unknown[KE] == pytest.approx(0.06, rel=0.01)
    assert unknown.verdict == "not identified"
    assert "a known inertia of about the rotor's added would do it" in " ".join(unknown.sentences())


@pytest.mark.sample(1)
@pytest.mark.parametrize("most", [2.0, 10.0], ids=["slow", "fast"])
def test_stribeck_friction(tmp_path, most):
    stribeck = "stribeck_torque_n_m = 0.02\nstribeck_speed_rad_per_s = 5.0"
    log = log_of(
        tmp_path, lambda text: text.replace("[joints.friction]", f"[joints.friction]\n{stribeck}"), volts(most=most)
    )
    found = fit(log, "R", "Kt", "J", "viscous", "coulomb", "stribeck")
    assert found["motor.friction.stribeck_torque_n_m"] == pytest.approx(0.02, rel=0.02)
    assert found["motor.friction.stribeck_speed_rad_per_s"] == pytest.approx(5.0, rel=0.02)
    assert found[PATHS["coulomb"]] == pytest.approx(TRUE["coulomb"], rel=0.02)


@pytest.mark.study
@pytest.mark.parametrize("mode", ["coast", "brake"])
def test_the_mode_of_the_bridge(tmp_path, mode):
    """Found by the fit of both: the wrong one predicts worse."""
    change = with_joint("[joints.limits]\nvoltage_v = 12")
    log = log_of(tmp_path, lambda text: change(with_motor(f'pwm = "{mode}"')(text)), volts(500))
    found = aw.identification.identify_motor(
        log,
        fixed={"limits.voltage_v": 12.0, "delay": 0.0},
        search=MotorSearch(starts=2, pwm="compare"),
    )
    for name in ("R", "Kt", "J", "coulomb"):
        assert found.estimate[PATHS[name]] == pytest.approx(TRUE[name], rel=0.02), name
    assert found.estimate.fit["run1: qd"]["fit_percent"] > 97
    assert found.robot.joints[0].motor.pwm == mode
    assert f"while it is off ({mode}): the error is" in str(found.estimate)


@pytest.mark.study
@pytest.mark.parametrize("names", [("current", "q", "qd"), ("q", "qd")], ids=["with current", "without"])
def test_a_dead_zone_of_the_stage(tmp_path, names):
    """Apart from Coulomb friction, which acts against the motion where the zone acts against the voltage."""
    log = log_of(tmp_path, with_motor("dead_zone_v = 0.6"), volts(), names=names)
    known = {} if "current" in names else {name: TRUE[name] for name in ("R", "J")}
    free = [name for name in ("R", "Kt", "J", "viscous", "coulomb", "dead_zone") if name not in known]
    found = fit(log, *free, fixed=known)
    assert found["motor.motor.dead_zone_v"] == pytest.approx(0.6, rel=0.02)
    assert found[PATHS["coulomb"]] == pytest.approx(TRUE["coulomb"], rel=0.02)
    assert found.verdict == "identified"


@pytest.mark.study
def test_dry_friction_by_direction_and_a_constant_torque(tmp_path):
    """Levels of 0.018 and 0.009 N m, and 0.004 N m that always pulls: it is in the levels' difference, or stands by itself."""

    def change(text):
        return text.replace(f"coulomb_positive_n_m = {TRUE['coulomb']}", "coulomb_positive_n_m = 0.018").replace(
            f"coulomb_negative_n_m = {TRUE['coulomb']}", "coulomb_negative_n_m = 0.009"
        )

    found = fit(
        log_of(tmp_path, change, volts()),
        "R",
        "Kt",
        "J",
        "viscous",
        "coulomb_positive",
        "coulomb_negative",
    )
    assert found["motor.friction.coulomb_positive_n_m"] == pytest.approx(0.018, rel=0.02)
    assert found["motor.friction.coulomb_negative_n_m"] == pytest.approx(0.009, rel=0.02)
    pulled = with_friction("offset_n_m = 0.004")
    found = fit(log_of(tmp_path, pulled, volts()), "R", "Kt", "J", "viscous", "coulomb", "friction_offset")
    assert found["motor.friction.offset_n_m"] == pytest.approx(0.004, rel=0.02)
    assert found[PATHS["coulomb"]] == pytest.approx(TRUE["coulomb"], rel=0.02)


@pytest.mark.study
def test_gear_efficiency(tmp_path):
    def change(value):
        return lambda text: with_motor(f"gear_efficiency = {value}")(geared(text))

    log = log_of(tmp_path, change(0.75), volts())
    robot = tmp_path / "robot.toml"
    robot.write_text(change(0.9)(RECORD.format(**TRUE)))
    found = fit(log, "R", "Kt", "J", "viscous", "coulomb", "efficiency", arm=robot)
    assert found["motor.motor.gear_efficiency"] == pytest.approx(0.75, rel=0.01)
    assert found[PATHS["coulomb"]] == pytest.approx(0.15, rel=0.02)


@pytest.mark.study
def test_backlash(tmp_path):
    def change(value):
        numbers = f"stiffness_n_m_per_rad = 50\ndamping_n_m_s_per_rad = 0.3\nbacklash_rad = {value}"
        return lambda text: with_joint(f"[joints.elasticity]\n{numbers}")(geared(text))

    log = log_of(tmp_path, change(0.02), volts())
    robot = tmp_path / "robot.toml"
    robot.write_text(change(0.01)(RECORD.format(**TRUE)))
    found = fit(log, "R", "Kt", "coulomb", "elasticity.backlash_rad", arm=robot)
    # flanks meet between the steps of the fit, which are coarser than those of the truth
    assert found["motor.elasticity.backlash_rad"] == pytest.approx(0.02, rel=0.05)
    assert found[R] == pytest.approx(TRUE["R"], rel=0.02)


@pytest.mark.study
def test_heat_of_the_winding(tmp_path):
    def change(capacity):
        numbers = "ambient_c = 20\nreference_c = 20\nwinding_resistance_k_per_w = 3.0\n"
        numbers += f"winding_capacity_j_per_k = {capacity}\nresistance_temperature_coefficient_per_k = 0.0039"
        return with_joint(f"[joints.motor.thermal]\n{numbers}")

    log = log_of(tmp_path, change(8.0), np.repeat(volts(400), 6), 0.02)
    robot = tmp_path / "robot.toml"
    robot.write_text(change(4.0)(RECORD.format(**TRUE)))
    name = "motor.motor.thermal.winding_capacity_j_per_k"
    found = fit(log, "R", "Kt", "J", "viscous", "coulomb", name, arm=robot)
    assert found[name] == pytest.approx(8.0, rel=0.03)
    assert found[R] == pytest.approx(TRUE["R"], rel=0.02)

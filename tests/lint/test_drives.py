"""Mistakes in the numbers of a drive are found with key, line and the value that fits; sound drives raise no question."""

from __future__ import annotations

import re
from importlib import resources
from itertools import product
from math import pi, sqrt
from pathlib import Path

import numpy as np
import pytest
import tomlkit
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.description import builtin_names
from armwright.description.database import parse
from armwright.description.drive import DC_EQUIVALENT
from armwright.description.urdf import read_urdf
from armwright.lint.drives import contradictions
from armwright.toml_text import TomlText
from physics.arms import workshop
from reference.example_robots import robot_files

EXAMPLES = Path(__file__).parents[2] / "examples"
KT, KE, J, R = (
    *("torque_constant_n_m_per_a", "back_emf_constant_v_s_per_rad"),
    *("rotor_inertia_kg_m2", "resistance_ohm"),
)
CURRENT, TORQUE, SPEED, VOLTAGE = "current_a", "torque_n_m", "velocity_rad_per_s", "voltage_v"
LIMITS = (CURRENT, TORQUE, SPEED, VOLTAGE)
RPM = 2 * pi / 60


def record(name: str) -> tomlkit.TOMLDocument:
    own = resources.files("armwright.robots") / f"{name}.toml"
    return tomlkit.parse((own if own.is_file() else EXAMPLES / f"{name}.toml").read_text(encoding="utf-8"))


def numbers(document, joint):
    """The values of a joint's motor and limits by key."""
    tables = [document["joints"][joint].get(table, {}) for table in ("motor", "limits")]
    return {k: v["value"] if hasattr(v, "get") and "value" in v else v for table in tables for k, v in table.items()}


def planted(name, joint, **values):
    """Questions about a record whose joint has these values, or functions of the old ones, and the record's text."""
    document = record(name)
    table, old = document["joints"][joint], numbers(document, joint)
    for key, value in values.items():
        part = table.setdefault("limits", {}) if key in LIMITS else table["motor"]
        part[key] = value(old) if callable(value) else value
    text = TomlText(tomlkit.dumps(document), "arm.toml")
    return [text.with_line(found) for found in contradictions(parse(text.tables, "arm.toml"))], text.text


def back_emf(factor):
    """A back-EMF constant of which the torque constant is `factor` times as large."""
    return {KE: lambda old: old[KT] / factor}


# What is wrong, its key in the file, the question, and what would fit; three records each.
PLANTED = [
    *(
        ("1e3", {KT: lambda old: 1e3 * old[KT]}, KT, "mN m/A?", lambda old: old[KT], *where)
        for where in (("cmu-dd", 0), ("lwa4p", 0), ("puma560", 0), ("hot-lift", 0), ("scara", 1), ("motor", 0))
    ),
    *(
        ("1e3 of Ke", back_emf(1e-3), KE, "mV s/rad?", lambda old: old[KT], *where)
        for where in (("cmu-dd", 1), ("lwa4p", 4), ("scara", 0))
    ),
    *(
        ("1e7", {J: lambda old: 1e7 * old[J]}, J, "g cm²?", lambda old: old[J], *where)
        for where in (("lwa4p", 0), ("lwa4p", 5), ("puma560", 0), ("heavy", 1), ("hot-lift", 0), ("motor", 0), ("scara", 2))
    ),
    *(
        ("n²", {J: lambda old: old["gear_ratio"] ** 2 * old[J]}, J, "n² J", lambda old: old[J], *where)
        for where in (("lwa4p", 0), ("puma560", 3), ("hot-lift", 0), ("scara", 0), ("scara", 2))
    ),
    *(
        ("n", {KT: lambda old: abs(old["gear_ratio"]) * old[KT]}, KT, "at the gear's output?", lambda old: old[KT], *where)
        for where in (("lwa4p", 0), ("puma560", 0), ("puma560", 5), ("hot-lift", 0), ("scara", 2))
    ),
    *(
        ("60/2π", back_emf(1 / RPM), KE, "V/rpm?", lambda old: old[KT], *where)
        for where in (("cmu-dd", 0), ("lwa4p", 0), ("hot-lift", 0))
    ),
    *(
        ("1e3·2π/60", back_emf(1e-3 / RPM), KE, "V per 1000 rpm?", lambda old: old[KT], *where)
        for where in (("cmu-dd", 0), ("lwa4p", 0), ("hot-lift", 0))
    ),
    *(
        (name, back_emf(factor), KE, question, lambda old, basis=basis: f'basis = "{basis}"', *where)
        for name, factor, basis, question in (
            ("√3", sqrt(3), "line_rms", "line or phase, peak or rms: constants of line_rms?"),
            ("3/2", 3 / 2, "phase_peak", "line or phase, peak or rms: constants of phase_peak?"),
            ("√3/2", sqrt(3) / 2, "line_peak", "line or phase, peak or rms: constants of line_peak?"),
        )
        for where in (("cmu-dd", 0), ("lwa4p", 5), ("scara", 1))
    ),
    *(
        ("√2", back_emf(sqrt(2)), KE, "peak or rms: a torque constant per A rms?", lambda old: old[KT] / sqrt(2), *where)
        for where in (("cmu-dd", 0), ("lwa4p", 5), ("scara", 1))
    ),
    *(
        ("√(3/2)", back_emf(sqrt(1.5)), KE, "line_peak beside a torque constant per A rms?",
         lambda old: old[KT] / sqrt(2), *where)
        for where in (("cmu-dd", 0), ("lwa4p", 5), ("scara", 1))
    ),
    *(
        ("60/2π", {SPEED: lambda old: 0.7 * old[VOLTAGE] / old["gear_ratio"] / old[KT] / RPM}, *(SPEED, "rpm?"),
         lambda old: 0.7 * old[VOLTAGE] / old["gear_ratio"] / old[KT], *where)
        for where in (("cmu-dd", 0), ("hot-lift", 0), ("scara", 0))
    ),
    *(
        ("n", {TORQUE: lambda old: 0.99 * old[KT] * old[CURRENT]}, *(TORQUE, "before the gear?"),
         lambda old: 0.99 * old[KT] * old[CURRENT] * old["gear_ratio"], *where)
        for where in (("lwa4p", 0), ("lwa4p", 5), ("scara", 0))
    ),
    *(
        ("1e3 of I", {CURRENT: lambda old: 1e3 * old[CURRENT],
                      TORQUE: lambda old: 0.5 * old[KT] * old[CURRENT] * old["gear_ratio"]},
         *(CURRENT, "mA?"), lambda old: old[CURRENT], *where)
        for where in (("cmu-dd", 0), ("scara", 0), ("scara", 1))
    ),
    *(
        ("1e3 of R", {R: lambda old: 1e3 * old[R], CURRENT: lambda old: old.get(CURRENT, 2.0)}, *(R, "mΩ?"),
         lambda old: old[R], *where)
        for where in (("cmu-dd", 0), ("hot-lift", 0), ("scara", 0))
    ),
]  # fmt: skip


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("values", "key", "question", "fits", "name", "joint"),
    [pytest.param(*case[1:], id=f"{case[0]}-{case[-2]}-{case[-1]}") for case in PLANTED],
)
def test_a_planted_mistake_is_found(values, key, question, fits, name, joint):
    (problem,), text = planted(name, joint, **values)
    assert (
        problem.place
        == f"joint {record(name)['joints'][joint]['name']!r} {'limits' if key in LIMITS else 'motor'}.{key}"
    )
    assert re.match(rf"{key}\b|.*[{{, ]{key} =", text.split("\n")[int(problem.line) - 1])
    assert question in problem.what
    fit = fits(numbers(record(name), joint))
    assert (fit if isinstance(fit, str) else f"{fit:.6g}") in f"{problem.what}; {problem.expected}"


def test_two_units_pasted_at_once():
    """38.5 mN m/A and 33.3 g cm² as they stand in a datasheet: their errors nearly cancel in R J / Kt²."""
    for name in ("scara", "hot-lift", "puma560", "motor"):
        (kt, rotor), _ = planted(name, 0, **{KT: 38.5, J: 33.3})
        assert (kt.what.startswith("mN m/A?"), kt.value, kt.expected) == (True, 38.5, "0.0385")
        assert (rotor.what.startswith("g cm²?"), rotor.value, rotor.expected) == (True, 33.3, "3.33e-06")


def test_check_shows_them(tmp_path, monkeypatch):
    """With file, line and mark, as warnings: exit 0, and 1 with --strict. The output is that of the page."""
    monkeypatch.chdir(tmp_path)
    path = Path("scara.toml")
    text = (EXAMPLES / path).read_text(encoding="utf-8")
    path.write_text(text.replace(f"{KT} = 0.05\n", f"{KT} = 50\n"), encoding="utf-8")
    (found,) = [found for found in aw.robotfiles.check(path).findings if found.check == "drives"]
    assert found.level == "warning"
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 0
    page = (EXAMPLES.parent / "docs" / "how-to" / "record.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"\$ armwright check scara.toml\n…\n(.*?)```", page, re.DOTALL)
    assert block in result.output
    assert str(found.problem) in block
    assert CliRunner().invoke(app, ["check", str(path), "--strict"]).exit_code == 1
    assert any("mN m/A?" in warning for warning in aw.load(path).warnings)


def test_constants_that_no_known_mistake_explains():
    (found,), _ = planted("cmu-dd", 0, **back_emf(1.32))
    assert "1.32 times the back-EMF constant" in found.what
    assert found.expected == ""
    assert planted("cmu-dd", 0, **back_emf(1.08))[0] == []


def test_a_torque_beyond_the_current():
    """No unit is five times another: said without an explanation."""
    (found,), _ = planted("scara", 0, **{TORQUE: 75.0})
    assert (found.place, found.value, found.expected) == (f"joint 'shoulder' limits.{TORQUE}", 75.0, "")
    assert found.what == "the limit of torque, 75 N m, is 5 times n Kt I at the limit of current, 15"


def test_low_and_lavish_limits_are_meant():
    """A torque far below Kt I n, half the no-load speed or a fiftieth, a current beyond V / R."""
    for torque, speed, current in product((0.03, 0.3, 1.0), (0.02, 0.5, 1.2), (1.0, 5.0)):
        values = {
            CURRENT: lambda old, current=current: current * old[CURRENT],
            TORQUE: lambda old, share=torque * current: share * old[CURRENT] * old[KT] * old["gear_ratio"],
            SPEED: lambda old, speed=speed: speed * old[VOLTAGE] / old[KT] / old["gear_ratio"],
        }
        assert planted("scara", 0, **values)[0] == []


@pytest.mark.parametrize("declared", DC_EQUIVALENT)
def test_a_wrong_basis_is_named_from_any_basis(declared):
    """Constants of one basis under the name of another: the right name is asked about, unless both have one ratio Kt/Ke."""
    for true in DC_EQUIVALENT:
        data = workshop()
        factor = DC_EQUIVALENT[true]
        kt, ke = 0.11 / factor.torque_constant, 0.11 / factor.back_emf_constant
        data["joints"][0]["motor"] = {"gear_ratio": 80.0, J: 1e-4, KT: kt, KE: ke, R: 0.5, "basis": declared}
        problems = contradictions(parse(data, "workshop"))
        if true == declared:
            assert problems == []
        else:
            assert any(f'basis = "{true}"' in f"{problem.what} {problem.expected}" for problem in problems)


THERMAL = {
    "ambient_c": 25.0,
    "reference_c": 25.0,
    "winding_capacity_j_per_k": 12.0,
    "winding_resistance_k_per_w": 2.0,
    "housing_capacity_j_per_k": 300.0,
    "housing_resistance_k_per_w": 4.0,
    "resistance_temperature_coefficient_per_k": 0.0039,
    "magnet_temperature_coefficient_per_k": -0.0011,
}


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("key", "value", "question", "fit"),
    [
        ("winding_capacity_j_per_k", 0.012, "kJ/K?", "12"),
        ("winding_resistance_k_per_w", 2e3, "K/kW?", "2"),
        ("housing_resistance_k_per_w", 4e-3, "K/mW?", "4"),
        ("ambient_c", 298.15, "kelvin?", "25"),
        ("resistance_temperature_coefficient_per_k", 0.39, "% per kelvin?", "0.0039"),
        ("magnet_temperature_coefficient_per_k", -0.11, "% per kelvin?", "-0.0011"),
    ],
)
@pytest.mark.parametrize("name", ["cmu-dd", "puma560", "hot-lift"])
def test_thermal_numbers(name, key, value, question, fit):
    """Where a capacity or a resistance may be wrong, both are asked about."""
    assert planted(name, 0, thermal=THERMAL)[0] == []
    (found,), _ = planted(name, 0, thermal=THERMAL | {key: value})
    assert f"motor.thermal.{key}" in f"{found.place} {found.what}"
    assert question in found.what
    assert f"{question} {fit} would fit" in found.what or found.expected == fit


@pytest.mark.sample(2)
@pytest.mark.parametrize("name", [*builtin_names(), "heavy", "hot-lift", "motor", "scara"])
def test_sound_arms_raise_no_question(name):
    assert contradictions(parse(record(name).unwrap(), name)) == []


@pytest.mark.sample(1)
@pytest.mark.parametrize("basis", DC_EQUIVALENT)
def test_sound_drives_raise_no_question(basis):
    """Small and large motors, low limits, spare speed, constants that differ by 7 %, in any basis."""
    rng = np.random.default_rng(4)
    to = DC_EQUIVALENT[basis]
    for _ in range(60):
        log = {name: np.exp(rng.uniform(*np.log(span))) for name, span in SPANS.items()}
        kt, n, rotor = log["kt"], log["n"], log["rotor"]
        ke = kt * rng.uniform(0.93, 1.07)
        resistance = log["time_constant"] * kt * ke / rotor
        voltage = log["no_load"] * n * ke
        current = log["stall"] * voltage / resistance
        data = workshop()
        data["joints"][0]["motor"] = {
            "gear_ratio": float(rng.choice([-1, 1]) * n),
            J: rotor,
            "basis": basis,
            KT: kt / to.torque_constant,
            KE: ke / to.back_emf_constant,
            R: resistance / to.impedance,
            "inductance_h": log["electrical"] * resistance / to.impedance,
        }
        data["joints"][0]["limits"] = {
            VOLTAGE: voltage / to.voltage,
            CURRENT: current / to.current,
            TORQUE: log["torque"] * n * kt * current,
            SPEED: log["speed"] * log["no_load"],
        }
        if n > 3 and abs(log["torque"] * n - 1) < 0.05:
            continue  # a limit that happens to be that of the motor
        assert contradictions(parse(data, "workshop")) == []


SPANS = {
    "kt": (0.005, 2.0),
    "n": (1.0, 300.0),
    "rotor": (1e-7, 5e-3),
    "no_load": (0.3, 40.0),
    "stall": (0.03, 3.0),
    "time_constant": (5e-4, 0.2),
    "electrical": (1e-5, 0.02),
    "torque": (0.05, 1.1),
    "speed": (0.03, 1.5),
}


@pytest.mark.study
@pytest.mark.parametrize("file", robot_files())
def test_real_robots_with_drives_of_their_size_raise_no_question(file):
    """Each joint of `example-robot-data` that states effort and speed gets a motor for them."""
    try:
        robot = read_urdf(robot_files()[file], mimic="independent")
    except aw.errors.ArmwrightError as error:
        pytest.skip(str(error))
    assert contradictions(robot) == []
    for ratio, kt in product((50.0, 160.0), (0.03, 0.2)):
        joints = tuple(_driven(joint, ratio, kt) for joint in robot.joints)
        assert contradictions(robot.replace(joints=joints)) == []


def _driven(joint, ratio, kt):
    limits = getattr(joint, "limits", None)
    effort, speed = getattr(limits, TORQUE, None), getattr(limits, SPEED, None)
    if None in (effort, speed) or not 0.1 < float(speed) < 100 or not 0.1 < float(effort) < 1e3:
        return joint
    current = float(effort) / ratio / kt
    voltage = 1.2 * ratio * kt * float(speed)
    motor = {"gear_ratio": ratio, KT: kt, R: 0.5 * voltage / current, J: 1e-4 * float(effort) / 50}
    values = {"velocity_rad_per_s": speed, TORQUE: effort, CURRENT: current, VOLTAGE: voltage}
    data = {"motor": motor, "limits": values}
    return type(joint).model_validate({**joint.model_dump(), **data})

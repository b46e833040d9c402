"""An estimate in a robot's file: numbers, deviations, correlations, checksum, and nothing else changed."""

from __future__ import annotations

import difflib
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.errors import DescriptionError, IdentificationError, ModelError, OutputError

NAMES = ("joint1.motor.resistance_ohm", "joint1.friction.viscous_n_m_s_per_rad", "link2.com_m[0]", "delay_s", "base3")
COVARIANCE = np.diag([1e-4, 1e-6, 1e-4, 1e-8, 1.0])
COVARIANCE[0, 1] = COVARIANCE[1, 0] = 5e-6
BUILTIN = resources.files("armwright.robots") / "cmu-dd.toml"


def loaded(path: Path) -> Any:
    """Record of the arm in a file."""
    return aw.load(path).record


def estimate(**changes: Any) -> aw.identification.Estimate:
    fields: dict[str, Any] = {
        "names": NAMES,
        "values": [1.234, 0.01, 0.3, 0.0023, 7.0],
        "covariance": COVARIANCE,
        "sha256": "a" * 64,
        "method": "output error",
        "remarks": ('a "remark"',),
        "fit": {"speed": {"fit_percent": 80.4, "r2": 0.9}},
        "condition": 12.3,
        "log": "bench.log.toml",
    }
    return aw.identification.Estimate(**{**fields, **changes})


def test_the_written_robot_has_numbers_deviations_correlation_and_checksum(tmp_path: Path) -> None:
    path = aw.identification.write_into("cmu-dd", estimate(), tmp_path / "fitted.toml")
    record = loaded(path)
    joint, link, fit = record.joints[0], record.link("link2"), record.fits["fit"]
    assert (joint.motor.resistance_ohm.value, joint.motor.resistance_ohm.std) == (1.234, 0.01)
    assert (joint.friction.viscous_n_m_s_per_rad.value, joint.friction.viscous_n_m_s_per_rad.std) == (0.01, 0.001)
    assert (link.com_m.value[0], link.com_m.std) == (0.3, (0.01, 0.0, 0.0))
    assert record.provenance("joint1.motor.resistance_ohm").kind == "fit"
    assert "a" * 64 in record.provenance("link2.com_m").text
    assert fit.log_sha256 == "a" * 64
    assert fit.names == NAMES[:3]
    np.testing.assert_allclose(fit.correlation_matrix(), [[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]])
    assert {name: (each.value, each.std) for name, each in fit.others.items()} == {
        "delay_s": (0.0023, 0.0001),
        "base3": (7.0, 1.0),
    }


@pytest.mark.study
def test_all_other_lines_stay_as_they_were(tmp_path: Path) -> None:
    text = BUILTIN.read_text(encoding="utf-8")
    own = tmp_path / "own.toml"
    own.write_text(text.replace("resistance_ohm = 4.4", "resistance_ohm = 4.4 # cold"), encoding="utf-8")
    before = own.read_text(encoding="utf-8").splitlines()
    aw.identification.write_into(own, estimate(), own)
    after = own.read_text(encoding="utf-8").splitlines()
    removed = [line for line in difflib.ndiff(before, after) if line.startswith("- ")]
    assert len(removed) == 3, "only the three lines of the numbers"
    assert any("1.234" in line and line.endswith("# cold") for line in after)
    once = own.read_text(encoding="utf-8")
    aw.identification.write_into(own, estimate(), own)
    assert own.read_text(encoding="utf-8") == once, "a second time changes nothing"


def test_an_arm_in_memory_is_written_as_its_file_is(tmp_path: Path) -> None:
    first = aw.load(aw.identification.write_into("cmu-dd", estimate(), tmp_path / "a.toml"))
    second = aw.load(aw.identification.write_into(first, estimate(), tmp_path / "b.toml"))
    assert second.record == first.record


def test_tables_that_are_missing_are_made(tmp_path: Path) -> None:
    names = (
        "joint1.motor.inductance_h",
        "joint1.friction.coulomb_positive_n_m",
        "joint1.friction.coulomb_negative_n_m",
    )
    fitted = estimate(names=names, values=[1e-3, 2.0, 3.0], covariance=np.eye(3) * 1e-8)
    friction = loaded(aw.identification.write_into("cmu-dd", fitted, tmp_path / "a.toml")).joints[0].friction
    assert (friction.coulomb_positive_n_m.value, friction.coulomb_negative_n_m.value) == (2.0, 3.0)


def test_a_joint_and_its_link_may_have_one_name(tmp_path: Path) -> None:
    """Numbers go to the table that has their key: the gripper of so100 is both a joint's name and a link's."""
    names = ("gripper.mass_kg", "gripper.motor.resistance_ohm", "gripper.friction.viscous_n_m_s_per_rad")
    fitted = estimate(names=names, values=[0.1, 2.5, 0.06], covariance=np.diag([1e-6, 1e-4, 1e-6]))
    record = loaded(aw.identification.write_into("so100", fitted, tmp_path / "fitted.toml"))
    joint = next(joint for joint in record.joints if joint.name == "gripper")
    assert record.link("gripper").mass_kg.value == 0.1
    assert joint.motor.resistance_ohm.value == 2.5
    assert joint.friction.viscous_n_m_s_per_rad.value == 0.06


def test_what_the_log_cannot_tell_stays_and_is_listed(tmp_path: Path) -> None:
    unknown = estimate(identifiable=[False, True, True, True, True], verdict="not identified")
    record = loaded(aw.identification.write_into("cmu-dd", unknown, tmp_path / "a.toml"))
    assert record.joints[0].motor.resistance_ohm.value == 4.4
    assert record.fits["fit"].unidentified == NAMES[:1]
    assert record.fits["fit"].verdict == "not identified"


@pytest.mark.study
def test_a_value_at_its_bound_has_no_deviation(tmp_path: Path) -> None:
    bound = estimate(at_bound=[True, False, False, False, False])
    assert np.isnan(bound.std[0])
    record = loaded(aw.identification.write_into("cmu-dd", bound, tmp_path / "a.toml"))
    assert record.joints[0].motor.resistance_ohm.std is None
    assert record.fits["fit"].at_bound == NAMES[:1]
    assert "at its bound" in str(bound)


def test_interval_and_selection() -> None:
    low, high = estimate().interval("joint1.motor.resistance_ohm")
    assert (low, high) == pytest.approx((1.234 - 0.0196, 1.234 + 0.0196), abs=1e-6)
    part = estimate().select(NAMES[1:3])
    assert (part.names, part["link2.com_m[0]"]) == (NAMES[1:3], 0.3)
    with pytest.raises(ModelError) as error:
        estimate()["joint9"]
    assert error.value.choices == NAMES


def test_what_cannot_be_believed_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    wrong = estimate(values=[-1.0, 0.01, 0.3, 0.0023, 7.0])
    with pytest.raises(DescriptionError) as error:
        aw.identification.write_into("cmu-dd", wrong, tmp_path / "a.toml")
    assert "resistance_ohm" in error.value.place
    assert not list(tmp_path.iterdir())
    with pytest.raises(OutputError):
        aw.identification.write_into("cmu-dd", estimate(), tmp_path / "a.csv")


def test_the_path_of_a_part_of_a_number_is_refused(tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    robot = aw.robotfiles.write_toml(aw.load("two-link").record, tmp_path / "own" / "robot.toml")
    link = aw.load(robot).record.links[0].name
    wrong = estimate(names=(f"{link}.com_m.x",), values=[0.1], covariance=[[1e-4]])
    for arm in ("two-link", robot):
        with pytest.raises((IdentificationError, DescriptionError)) as error:
            aw.identification.write_into(arm, wrong, tmp_path / "a.toml")
        assert "com_m" in str(error.value)
    assert [each.name for each in tmp_path.iterdir()] == ["own"]


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("correlation = [[], [0.5], [0.0, 0.0]]", "correlation = [[], [0.5]]", "correlation"),
        ("correlation = [[], [0.5], [0.0, 0.0]]", "correlation = [[], [0.99], [0.99, -0.99]]", "correlation"),
        ("correlation = [[], [0.5], [0.0, 0.0]]", "correlation = [[], [1.5], [0.0, 0.0]]", "correlation"),
        ('names = ["joint1', 'names = ["joint9', "names"),
        ('[fits.fit]\nsource = "fit"', '[fits.fit]\nsource = "other"', "source"),
    ],
)
def test_a_fit_that_contradicts_itself_or_the_robot_is_refused(tmp_path: Path, old: str, new: str, place: str) -> None:
    path = aw.identification.write_into("cmu-dd", estimate(), tmp_path / "a.toml")
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(DescriptionError) as error:
        aw.load(path)
    assert place in error.value.place

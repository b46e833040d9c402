"""`armwright identify gains`: torque constants into the robot's file, which the next command reads; exit codes."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from cli.test_commands import run
from identification.arm.weighed_arm import JOINTS, KT, four_joints, weighed


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gains")
    true = four_joints(folder, constants=True)
    four_joints(folder, constants=False)
    weighed(folder, "empty", true, 0)
    weighed(folder, "loaded", true.with_payload(5.0, (0.05, -0.04, 0.08), np.diag([0.03, 0.04, 0.02])), 1)
    return folder


def command(bench, *more, code=0, logs=("empty", "loaded"), robot="as_bought.urdf"):
    empty, loaded = (bench / f"{name}.log.toml" for name in logs)
    return run("identify", "gains", bench / robot, empty, "--loaded-log", loaded, *more, code=code)


@pytest.mark.study
def test_constants_are_written_for_the_next_command(bench):
    output, page = bench / "weighed.toml", bench / "gains.html"
    shown = command(bench, "--payload-mass", "5", "--payload-mass-std", "0.005", "-o", output, "--report", page).stdout
    assert "drive gains from two logs" in shown
    assert "\nidentified\n" in shown
    assert "base.motor.torque_constant_n_m_per_a" in page.read_text(encoding="utf-8")
    arm = aw.load(output)
    found = [float(body.drive.torque_constant) for body in arm.coordinates]
    np.testing.assert_allclose(found, KT, rtol=0.03)
    source = arm.provenance("shoulder.motor.torque_constant_n_m_per_a")
    assert source.kind == "fit"
    assert 0 < arm.record.joints[1].motor.torque_constant_n_m_per_a.std < 0.01 * KT[1]
    assert arm.record.fits["gains"].names == tuple(f"{joint}.motor.torque_constant_n_m_per_a" for joint in JOINTS)
    refused = run("identify", "arm", bench / "as_bought.urdf", bench / "empty.log.toml", code=2)
    assert "torque_constant_n_m_per_a" in refused.stderr
    run("identify", "arm", output, bench / "empty.log.toml", "-o", bench / "identified.toml")
    # without the payload it is another arm
    run("validate", bench / "identified.toml", bench / "loaded.log.toml", code=1)


def test_what_is_identified_is_written_and_the_code_says_that_not_all_is(bench):
    true = aw.load(bench / "with_constants.urdf").with_payload(5.0, (0.05, -0.04, 0.08), np.zeros((3, 3)))
    weighed(bench, "resting", true, 1, moving=np.array([1.0, 1.0, 0.0, 1.0]))
    output = bench / "some.toml"
    shown = command(bench, "--payload-mass", "5", "-o", output, logs=("empty", "resting"), code=1).stdout
    assert "elbow: it does not move in the log with the payload" in shown
    constants = [body.drive.torque_constant for body in aw.load(output).coordinates]
    assert [constant is None for constant in constants] == [False, False, True, False]


def test_bad_input(bench):
    output = bench / "never.toml"
    for more, words in (
        (("--payload-mass", "0"), "mass = 0.0"),
        (("--payload-mass", "5", "--com", "0.1,0.2"), "--com = '0.1,0.2': expected 3 numbers"),
        (("--payload-mass", "5", "--com", "0,0,0", "--inertia", "1,2,x,4,5,6"), "--inertia"),
        (("--payload-mass", "5", "--frame", "nowhere"), "nowhere"),
        (("--payload-mass", "5", "-o", bench / "as_bought.urdf"), ".toml"),
    ):
        shown = command(bench, *more, *(() if "-o" in more else ("-o", output)), code=2)
        assert words in shown.stderr
        assert shown.stderr.count("\n") == 1
    assert "exchanged" in command(bench, "--payload-mass", "5", logs=("loaded", "empty"), code=2).stderr
    assert "Missing option" in command(bench, code=2).stderr
    assert not output.exists()

"""Torque constants that the simulation knows are found by a payload that was weighed, whatever the record says of them."""

from __future__ import annotations

import re

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError, LogError
from armwright.identification.arm.drive_gains import identify_drive_gains
from armwright.identification.arm.payload import identify_payload
from armwright.identification.estimate import HALF_95
from identification.arm.moved_arm import moved, multisine, written_log
from identification.arm.weighed_arm import GEARS, JOINTS, KT, four_joints, weighed
from raises_at import raises_at

MASS, COM, INERTIA = 6.0, (0.15, -0.05, 0.2), np.diag([0.03, 0.04, 0.02])
FACTORS = np.array([0.8, 1.0, 1.15, 1.3, 0.9, 1.0])  # true torque constants by the record's
WEIGHT, AT, ABOUT = 5.0, (0.05, -0.04, 0.08), np.diag([0.03, 0.04, 0.02])  # of the arm of four joints


@pytest.fixture(scope="module")
def arm():
    return aw.load("lwa4p")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Folder, the arm of four joints, its record without torque constants, and its two logs."""
    folder = tmp_path_factory.mktemp("bench")
    true, bought = four_joints(folder, constants=True), four_joints(folder, constants=False)
    empty, loaded = weighed(folder, "empty", true, 0), weighed(folder, "loaded", carrying(true), 1)
    return folder, true, bought, empty, loaded


def carrying(true, mass=WEIGHT):
    return true.with_payload(mass, AT, ABOUT * mass / WEIGHT)


def log_of_currents(folder, name, arm, carrying, seed, noise=0.02, rate=100.0):
    """Currents that move the arm, of motors whose constants are FACTORS times the record's, with noise [A]."""
    t, q, qd, qdd = multisine(arm.n, 20.0, rate, seed)
    constants = np.array([float(b.drive.gear_ratio) * float(b.drive.torque_constant) for b in arm.coordinates])
    current = aw.compile(carrying).inverse_dynamics(q, qd, qdd) / (constants * FACTORS)
    current += noise * np.random.default_rng(seed).normal(size=current.shape)
    return written_log(folder, name, arm.names, t, q, current, "current")


def said(found, words):
    return [remark for remark in found.remarks if words in remark]


@pytest.mark.sample(1)
@pytest.mark.parametrize("known", ["mass", "centre", "all"])
def test_torque_constants_of_six_joints(arm, tmp_path, known):
    empty = log_of_currents(tmp_path, "empty", arm, arm, 0)
    loaded = log_of_currents(tmp_path, "loaded", arm, arm.with_payload(MASS, COM, INERTIA), 5)
    wrong = arm.with_values({"link2.mass_kg": 5.0, "link4.mass_kg": 0.1})  # masses of the arm do not count
    com, inertia = None if known == "mass" else COM, INERTIA if known == "all" else None
    found = identify_drive_gains(empty, loaded, wrong, MASS, com, inertia)
    assert found.verdict == "identified", str(found)
    true = FACTORS * [float(body.drive.torque_constant) for body in arm.coordinates]
    assert found.names[0] == "joint1.motor.torque_constant_n_m_per_a"
    np.testing.assert_allclose(found.values, true, rtol=0.01)
    assert (np.abs(found.values - true) < 4 * found.std).all()
    again = aw.load(aw.identification.write_into(arm, found, tmp_path / "gains.toml"))
    assert float(again.coordinates[2].drive.torque_constant) == pytest.approx(found.values[2])


def test_a_record_without_torque_constants(bench):
    """Motor counts and milliamperes of an arm whose maker states gears and rotors only."""
    _, _, bought, empty, loaded = bench
    assert bought.coordinates[0].drive.torque_constant is None
    found = identify_drive_gains(empty, loaded, bought, WEIGHT)
    assert found.verdict == "identified", str(found)
    assert (np.abs(found.values - KT) < 4 * found.std).all()
    assert (found.std < 0.01 * found.values).all()


def test_the_more_is_known_of_the_payload_the_surer_the_gains(bench):
    _, _, bought, empty, loaded = bench
    by_mass, by_centre, by_all = (
        identify_drive_gains(empty, loaded, bought, WEIGHT, com, inertia)
        for com, inertia in ((None, None), (AT, None), (AT, ABOUT))
    )
    assert (by_all.std <= 1.1 * by_centre.std).all()
    assert (by_centre.std <= 1.1 * by_mass.std).all()
    assert (by_all.std < 0.8 * by_mass.std).any()


def test_gains_are_in_proportion_to_the_mass(bench):
    """The scale is that of the mass: 2 % more of it are 2 % more of every gain, and its deviation is theirs."""
    _, _, bought, empty, loaded = bench
    right, heavier = (identify_drive_gains(empty, loaded, bought, WEIGHT * factor) for factor in (1.0, 1.02))
    np.testing.assert_allclose(heavier.values, 1.02 * right.values, rtol=1e-6)
    assert said(right, "in proportion to the 5 kg")
    doubtful = identify_drive_gains(empty, loaded, bought, WEIGHT, mass_std=0.05)
    np.testing.assert_allclose(doubtful.std**2, right.std**2 + (0.01 * right.values) ** 2, rtol=1e-9)
    assert doubtful.correlation[0, 1] > 0.9


def test_currents_times_a_factor_are_gains_by_it(bench, tmp_path):
    _, true, bought, empty, loaded = bench
    factors = np.array([2.0, 0.5, 1.3, 40.0])
    logs = weighed(tmp_path, "a", true, 0, factors=factors), weighed(tmp_path, "b", carrying(true), 1, factors=factors)
    expected, found = identify_drive_gains(empty, loaded, bought, WEIGHT), identify_drive_gains(*logs, bought, WEIGHT)
    np.testing.assert_allclose(found.values * factors, expected.values, rtol=1e-6)
    np.testing.assert_allclose(found.std * factors, expected.std, rtol=1e-3)


def test_by_mass_alone_any_frame_of_the_link_serves(bench):
    """First moments take up where the frame stands; another link's frame would be another body."""
    _, _, bought, empty, loaded = bench
    tip, link = (identify_drive_gains(empty, loaded, bought, WEIGHT, frame=frame) for frame in (None, "part3"))
    np.testing.assert_allclose(link.values, tip.values, rtol=1e-6)
    other = identify_drive_gains(empty, loaded, bought, WEIGHT, frame="part2")
    assert other.verdict == "not identified"
    assert said(other, "not those of one arm with one payload")


@pytest.mark.study
def test_payload_and_gains_agree(arm, tmp_path):
    """What `identify_payload` finds with the gains that the mass gave is that mass, from the same logs."""
    empty = log_of_currents(tmp_path, "empty", arm, arm, 0)
    loaded = log_of_currents(tmp_path, "loaded", arm, arm.with_payload(MASS, COM, INERTIA), 5)
    gains = identify_drive_gains(empty, loaded, arm, MASS)
    corrected = arm.with_values(dict(zip(gains.names, gains.values, strict=True)))
    payload = identify_payload(empty, corrected, loaded_log=loaded)
    assert payload["payload.mass_kg"] == pytest.approx(MASS, abs=4 * payload.std[0])
    assert payload["payload.mass_kg"] == pytest.approx(MASS, rel=0.005)


def test_factors_of_torques(arm, tmp_path):
    empty = moved(tmp_path, "empty", arm, torque_noise=0.3)
    loaded = moved(tmp_path, "loaded", arm.with_payload(MASS, COM, INERTIA), seed=3, torque_noise=0.3)
    found = identify_drive_gains(empty, loaded, arm, MASS, COM, INERTIA)
    assert found.names[1] == "joint2: drive gain"
    assert found.verdict == "identified"
    assert (np.abs(found.values - 1.0) < 4 * found.std).all()


def test_a_light_payload_is_refused_with_the_weight_that_it_takes(bench, tmp_path):
    _, true, bought, empty, _ = bench
    found = identify_drive_gains(empty, weighed(tmp_path, "light", carrying(true, 0.03), 1), bought, 0.03)
    assert found.verdict == "not identified"
    assert not np.asarray(found.identifiable).any()
    assert np.isnan(found.std).all()
    needed = [float(re.search(r"takes about ([\d.]+) kg", remark)[1]) for remark in said(found, "too uncertain")]
    assert [remark.partition(":")[0] for remark in said(found, "too uncertain")] == list(JOINTS)
    assert 0.03 < max(needed) < 0.3
    enough = 1.5 * max(needed)
    log = weighed(tmp_path, "enough", carrying(true, enough), 1)
    found = identify_drive_gains(empty, log, bought, enough)
    assert found.verdict == "identified", str(found)
    assert (HALF_95 * found.std > 0.04 * found.values).all()  # not many times what it takes


def test_logs_that_were_mixed_up(bench, tmp_path):
    _, true, bought, empty, loaded = bench
    with raises_at(IdentificationError, "loaded_log", "base, shoulder.*exchanged"):
        identify_drive_gains(loaded, empty, bought, WEIGHT)
    with raises_at(IdentificationError, "loaded_log", "one log"):
        identify_drive_gains(loaded, loaded, bought, WEIGHT)
    without = identify_drive_gains(empty, weighed(tmp_path, "without", true, 7), bought, WEIGHT)
    assert without.verdict == "not identified"
    assert not np.asarray(without.identifiable).any()
    assert said(without, "was it on the arm in without.log.toml?")
    changed = true.with_values({"part1.mass_kg": 10.0, "part2.mass_kg": 2.5})
    other = identify_drive_gains(empty, weighed(tmp_path, "other", carrying(changed), 1), bought, WEIGHT)
    assert other.verdict == "not identified"
    assert said(other, "not those of one arm with one payload")


def test_a_link_of_the_wrong_length(bench):
    folder, _, _, empty, loaded = bench
    (folder / "short.urdf").write_text((folder / "as_bought.urdf").read_text().replace("0.4 0.02 0", "0.34 0.02 0"))
    (folder / "short.drive.toml").write_text((folder / "as_bought.drive.toml").read_text())
    found = identify_drive_gains(empty, loaded, aw.load(folder / "short.urdf"), WEIGHT)
    assert found.verdict == "not identified"
    assert said(found, "are kinematics, gears and the joints' order right")


def test_a_joint_at_rest_and_a_motor_of_the_wrong_sign(bench, tmp_path):
    _, true, bought, empty, _ = bench
    at_rest = np.array([1.0, 1.0, 0.0, 1.0])
    found = identify_drive_gains(empty, weighed(tmp_path, "rest", carrying(true), 1, moving=at_rest), bought, WEIGHT)
    assert found.verdict == "not identified"
    assert np.asarray(found.identifiable).tolist() == [True, True, False, True]
    assert np.isnan(found.values[2])  # the record has none either
    assert said(found, "elbow: it does not move in the log with the payload")
    assert (np.abs(found.values - KT) < 4 * found.std)[[0, 1, 3]].all()
    signs = np.array([1.0, 1.0, -1.0, 1.0])
    logs = weighed(tmp_path, "a", true, 0, factors=signs), weighed(tmp_path, "b", carrying(true), 1, factors=signs)
    found = identify_drive_gains(*logs, bought, WEIGHT)
    assert found.verdict == "not identified"
    assert np.asarray(found.identifiable).tolist() == [True, True, False, True]
    assert said(found, "elbow: the payload's torques have the other sign")


def test_one_joint_needs_the_centre(tmp_path):
    """m r is one number: by the mass alone the gain of a single joint has no scale, by mass and centre it has."""
    planar = aw.load("two-link")
    one = planar.with_locked({planar.names[1]: 0.0})
    body = 1.5, (0.1, 0.04, 0.0), np.zeros((3, 3))
    empty = moved(tmp_path, "empty", one, torque_noise=0.05)
    loaded = moved(tmp_path, "loaded", one.with_payload(*body), torque_noise=0.05, seed=3)
    alone = identify_drive_gains(empty, loaded, one, 1.5)
    assert alone.verdict == "not identified"
    assert said(alone, "no heavier one would do; state its centre")
    found = identify_drive_gains(empty, loaded, one, *body[:2])
    assert found.verdict == "identified"
    assert abs(found.values[0] - 1.0) < 4 * found.std[0]


def test_constants_of_a_brushless_motor_stand_in_its_own_basis(bench):
    folder, _, bought, empty, loaded = bench
    text = (folder / "as_bought.drive.toml").read_text()
    (folder / "phase.urdf").write_text((folder / "as_bought.urdf").read_text())
    (folder / "phase.drive.toml").write_text(text.replace("rotor_inertia", 'basis = "phase_rms", rotor_inertia'))
    found = identify_drive_gains(empty, loaded, aw.load(folder / "phase.urdf"), WEIGHT)
    path = aw.identification.write_into(aw.load(folder / "phase.urdf"), found, folder / "phase.toml", key="gains")
    equivalent = [float(body.drive.torque_constant) for body in aw.load(path).coordinates]  # of the DC motor
    np.testing.assert_allclose(equivalent, identify_drive_gains(empty, loaded, bought, WEIGHT).values, rtol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        ((0.0,), {}, "mass = 0.0"),
        ((-1.0,), {}, "mass = -1.0"),
        ((float("nan"),), {}, "mass = nan"),
        ((None,), {}, "mass = None"),
        ((5.0, (0.1, 0.2)), {}, "com"),
        ((5.0, (0.1, 0.2, float("inf"))), {}, "com"),
        ((5.0, None, np.eye(3)), {}, "inertia"),
        ((5.0, (0, 0, 0), np.eye(2)), {}, "inertia"),
        ((5.0,), {"mass_std": -0.1}, "mass_std"),
        ((5.0,), {"mass_std": 5.0}, "mass_std"),
    ],
)
def test_bad_numbers_are_refused(bench, arguments, options, words):
    _, _, bought, empty, loaded = bench
    with pytest.raises(IdentificationError, match=re.escape(words)):
        identify_drive_gains(empty, loaded, bought, *arguments, **options)


def test_arms_and_logs_that_it_does_not_serve(bench, arm, tmp_path):
    folder, _, bought, empty, loaded = bench
    torques = moved(tmp_path, "torques", bought, seconds=2.0)
    with pytest.raises(IdentificationError, match="different signals"):
        identify_drive_gains(empty, torques, bought, WEIGHT)
    text = (folder / "as_bought.drive.toml").read_text()
    for name, old, new, words in (
        (
            "lossy",
            f"gear_ratio = {GEARS[1]}",
            f"gear_efficiency = 0.8, gear_ratio = {GEARS[1]}",
            "shoulder.motor.gear_eff",
        ),
        (
            "coupled",
            f"gear_ratio = {GEARS[3]}",
            f'coupling = [{{ joint = "elbow", ratio = 50.0 }}], gear_ratio = {GEARS[3]}',
            "motors that several joints turn|gears",
        ),
    ):
        (folder / f"{name}.urdf").write_text((folder / "as_bought.urdf").read_text())
        (folder / f"{name}.drive.toml").write_text(text.replace(old, new))
        with pytest.raises((IdentificationError, LogError), match=words):
            identify_drive_gains(empty, loaded, aw.load(folder / f"{name}.urdf"), WEIGHT)
    (folder / "bare.urdf").write_text((folder / "as_bought.urdf").read_text())
    with pytest.raises((IdentificationError, LogError), match="motor"):
        identify_drive_gains(empty, loaded, aw.load(folder / "bare.urdf"), WEIGHT)


@pytest.mark.study
@pytest.mark.parametrize(("name", "seeds", "most"), [("four", 24, 1.3), ("lwa4p", 8, 1.6)])
def test_deviations_are_those_of_the_errors(bench, arm, tmp_path, name, seeds, most):
    """By mass alone, over seeds of motion and noise: errors by their deviations, all joints together. The docs say how much
    too small the deviations of longer Monte Carlo runs were."""
    _, true, bought, _, _ = bench
    true, record = (true, bought) if name == "four" else (arm, arm)
    constants, errors = np.array([float(body.drive.torque_constant) for body in true.coordinates]), []
    for seed in range(seeds):
        empty = weighed(tmp_path, "empty", true, 2 * seed, noise=0.02)
        loaded = weighed(tmp_path, "loaded", carrying(true), 2 * seed + 1, noise=0.02)
        found = identify_drive_gains(empty, loaded, record, WEIGHT)
        assert found.verdict == "identified", (seed, str(found))
        errors.append((found.values - constants) / found.std)
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) < most
    assert np.mean(np.abs(errors) < HALF_95) > 0.8
    assert (np.abs(np.mean(errors, axis=0)) < 1.0).all()

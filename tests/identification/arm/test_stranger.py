"""An arm that no example has, by a URDF and a drive file: gears that turn backwards, a coupled wrist, units of drives.

Logs that are described rightly give the truth, whatever their units; each wrong description is refused or named.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.errors import LogError
from armwright.results.csv_tables import write_table
from identification.arm.moved_arm import multisine, written_log as written_arm_log
from raises_at import raises_at

ORIGINS = (  # xyz [m], roll [rad]
    ("0 0 0.35", 0.0), ("0.08 0 0.05", -np.pi / 2), ("0.38 0 0", 0.0),
    ("0.04 0.3 0", -np.pi / 2), ("0 0 0.02", np.pi / 2), ("0 -0.01 0", -np.pi / 2),
)  # fmt: skip
MASSES, SIZES = (14.0, 11.0, 7.0, 3.5, 1.6, 0.6), (0.3, 0.5, 0.35, 0.25, 0.14, 0.1)  # [kg], [m]
GEARS = np.diag([-101.0, 121.0, -80.0, 51.0, -64.0, 50.0])
GEARS[5, 4] = -50.0  # the motor of axis_6 turns with axis_5 too
KT = np.array([0.11, 0.12, 0.09, 0.06, 0.05, 0.05])  # [N m/A]
ROTORS = (1.1e-4, 1.3e-4, 6e-5, 1.6e-5, 9e-6, 9e-6)  # [kg m²]
VISCOUS, COULOMB = (9.0, 11.0, 5.0, 1.2, 0.9, 0.5), (8.0, 10.0, 5.0, 2.0, 1.5, 0.9)  # at the joints
COUNTS, SECONDS, RATE = 8192, 10.0, 250.0
NAMES = [f"axis_{k}" for k in range(1, 7)]
SHIFTED = np.array([0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0])
PAYLOAD = 2.0  # [kg]


def written_arm(folder: Path, name: str, *, seed: int = 5, masses: float = 1.0, payload: float = 0.0) -> aw.Model:
    """A random arm, read from its files; `payload` is a ball of 3 cm, 8 cm out along the last axis."""
    rng, links, joints = np.random.default_rng(seed), ['<link name="base"/>'], []
    for k, ((xyz, roll), mass, size) in enumerate(zip(ORIGINS, MASSES, SIZES, strict=True), start=1):
        m, c, moments = masses * mass, rng.uniform(-0.3, 0.3, 3) * size, rng.uniform(0.3, 1.0, 3) * mass * size**2 / 10
        tensor = np.diag(moments.sum() - moments)
        if payload and k == 6:
            at = np.array([0.0, 0.0, 0.08])
            centre, reduced, d = (m * c + payload * at) / (m + payload), m * payload / (m + payload), at - c
            tensor = tensor + reduced * (d @ d * np.eye(3) - np.outer(d, d)) + 0.4 * payload * 0.03**2 * np.eye(3)
            m, c = m + payload, centre
        inertia = " ".join(
            f'i{a}{b}="{tensor[i, j]!r}"' for i, a in enumerate("xyz") for j, b in enumerate("xyz") if i <= j
        )
        own = f'<origin xyz="{c[0]!r} {c[1]!r} {c[2]!r}"/><mass value="{m!r}"/><inertia {inertia}/>'
        links.append(
            f'<link name="part{k}"><inertial>{own}</inertial></link>'.replace("np.float64(", "").replace(")", "")
        )
        parent = "base" if k == 1 else f"part{k - 1}"
        joints.append(
            f'<joint name="axis_{k}" type="revolute"><parent link="{parent}"/><child link="part{k}"/><axis xyz="0 0 1"/>'
            f'<origin xyz="{xyz}" rpy="{roll!r} 0 0"/><limit lower="-3" upper="3" velocity="6" effort="400"/></joint>'
        )
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="{name}">{"".join(links + joints)}</robot>')
    lines = [
        'source = "datasheet"',
        'command = "current"',
        "[sources.datasheet]",
        'kind = "datasheet"',
        'text = "made"',
    ]
    for k, joint in enumerate(NAMES):
        coupling = ', coupling = [{ joint = "axis_5", ratio = -50.0 }]' * (k == 5)
        motor = f"gear_ratio = {GEARS[k, k]}, rotor_inertia_kg_m2 = {ROTORS[k]}, torque_constant_n_m_per_a = {KT[k]}"
        dry = f"coulomb_positive_n_m = {COULOMB[k]}, coulomb_negative_n_m = {COULOMB[k]}"
        lines += [f"[joints.{joint}]", f"motor = {{ {motor}{coupling} }}"]
        lines += [f"friction = {{ viscous_n_m_s_per_rad = {VISCOUS[k]}, {dry} }}"]
    (folder / f"{name}.drive.toml").write_text("\n".join(lines))
    return aw.load(path)


def moved(arm: aw.Model, seed: int) -> dict[str, np.ndarray]:
    """Joint angles and torques, and what encoders and drives of the motors report of them, with noise."""
    t, q, qd, qdd = multisine(6, SECONDS, RATE, seed, 0.45)
    of_motors = aw.compile(arm).inverse_dynamics(q, qd, qdd) / np.diag(GEARS)
    current = of_motors / KT
    current += 0.005 * current.std(axis=0) * np.random.default_rng(seed).normal(size=q.shape)
    counts = np.round(q @ GEARS.T / (2 * np.pi) * COUNTS)
    return {"t": t, "q": q, "tau": current * KT @ GEARS, "counts": counts, "mA": 1e3 * current, "own": current * KT}


def written_log(
    folder: Path, name: str, table: dict[str, np.ndarray], signals: str, head: str = ""
) -> aw.identification.Log:
    """A log with columns NAME1 … NAME6 of every quantity."""
    columns = {"t": table["t"]}
    for key in (each for each in table if each != "t"):
        columns |= {f"{key}{k}": table[key][:, k - 1] for k in range(1, 7)}
    write_table(folder / f"{name}.csv", columns)
    path = folder / f"{name}.log.toml"
    clock = f'[files.log]\npath = "{name}.csv"\n[time]\ncolumn = "t"\nunit = "s"\n'
    path.write_text((head or f"joints = {NAMES}\n") + clock + signals)
    return aw.identification.read_log(path)


def signal(quantity: str, key: str, more: str, order: tuple[int, ...] = (1, 2, 3, 4, 5, 6)) -> str:
    return f'[[signals]]\nquantity = "{quantity}"\ncolumns = {[f"{key}{k}" for k in order]}\n{more}\n'


OF_JOINTS = signal("position", "q", 'unit = "rad"\nside = "joint"') + signal(
    "torque", "tau", 'unit = "N m"\nside = "joint"'
)
OF_DRIVES = signal("position", "counts", f'unit = "counts"\nside = "motor"\ncounts_per_turn = {COUNTS}') + signal(
    "current", "mA", 'unit = "mA"'
)


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    return written_arm(tmp_path_factory.mktemp("truth"), "truth")


@pytest.fixture(scope="module")
def nominal(tmp_path_factory):
    """What the maker's CAD has: other centres and inertias."""
    return written_arm(tmp_path_factory.mktemp("nominal"), "nominal", seed=6, masses=1.15)


@pytest.fixture(scope="module")
def table(truth):
    return moved(truth, 1)


def test_counts_and_milliamperes_of_motors_give_the_truth(tmp_path, truth, nominal, table):
    """The log lists the joints in another order than the robot does."""
    order = (6, 5, 4, 3, 2, 1)
    turned = GEARS[::-1, ::-1].tolist()
    head = f"joints = {NAMES[::-1]}\ngears.matrix = {turned}\n"
    signals = signal("position", "counts", f'unit = "counts"\nside = "motor"\ncounts_per_turn = {COUNTS}', order)
    log = written_log(tmp_path, "drives", table, signals + signal("current", "mA", 'unit = "mA"', order), head)
    found = aw.identification.identify_arm(log, nominal, checks=())
    assert found.verdict == "identified", str(found)
    again = aw.load(found.write(tmp_path / "found.toml"))
    states = multisine(6, SECONDS, 50.0, 9, 0.45)[1:]
    expected = aw.compile(truth).inverse_dynamics(*states)
    error = aw.compile(again).inverse_dynamics(*states) - expected
    assert (np.abs(error).std(axis=0) < 0.01 * expected.std(axis=0)).all()


def test_gears_that_are_not_those_of_the_record_are_refused(tmp_path, nominal, table):
    head = f"joints = {NAMES}\ngears.ratios = {np.diag(GEARS).tolist()}\n"  # the coupling is forgotten
    log = written_log(tmp_path, "gears", table, OF_DRIVES, head)
    with raises_at(LogError, "gears", r"'axis_6' .*\[0, 0, 0, 0, 0, 50\].*\[0, 0, 0, 0, -50, 50\]"):
        aw.identification.identify_arm(log, nominal)


def test_positions_beyond_the_limits_of_a_robot_that_the_log_does_not_name_are_refused(tmp_path, nominal, table):
    log = written_log(tmp_path, "degrees", {**table, "q": np.degrees(table["q"])}, OF_JOINTS)
    with raises_at(LogError, "run 'run1' q axis_1", "degrees"):
        aw.identification.identify_arm(log, nominal)


MISTAKES = {
    "columns": (lambda t: {"q": t["q"][:, [0, 2, 1, 3, 4, 5]], "tau": t["tau"][:, [0, 2, 1, 3, 4, 5]]},
                "axis_2 and axis_3", "positions and torques exchanged"),
    "motors": (lambda t: {"tau": t["own"] * np.diag(GEARS)}, "axis_5 and axis_6", "torques taken as those of the motors"),
    "zero": (lambda t: {"q": t["q"] - SHIFTED}, "no arm has the parameters", "zero positions"),
}  # fmt: skip


@pytest.mark.sample(1)
@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_no_check_of_units_sees_is_named_by_the_fit(tmp_path, nominal, table, mistake):
    """Every joint is predicted with R² above 0.5."""
    change, joints, words = MISTAKES[mistake]
    log = written_log(tmp_path, mistake, {**table, **change(table)}, OF_JOINTS)
    found = aw.identification.identify_arm(log, nominal, checks=())
    assert found.verdict == "not identified"
    assert [each for each in found.estimate.remarks if joints in each and words in each], str(found)


def test_torques_that_come_late_are_said(tmp_path, nominal, table):
    """By 20 ms, five rows of a motion that ends where it begins."""
    late = {**table, "tau": np.roll(table["tau"], 5, axis=0)}
    found = aw.identification.identify_arm(
        written_log(tmp_path, "late", late, OF_JOINTS), nominal, checks=(), record=False
    )
    (said,) = [each for each in found.estimate.remarks if "after the motion that they belong to" in each]
    assert float(said.split()[2]) == pytest.approx(20.0, rel=0.3)


@pytest.mark.study
def test_a_payload_on_a_coupled_wrist_is_found_from_currents(tmp_path, truth):
    carrying = written_arm(tmp_path, "carrying", payload=PAYLOAD)
    log = written_log(
        tmp_path, "loaded", moved(carrying, 2), OF_DRIVES, f"joints = {NAMES}\ngears.matrix = {GEARS.tolist()}\n"
    )
    found = aw.identification.identify_payload(log, truth)
    assert found.verdict == "identified"
    assert found["payload.mass_kg"] == pytest.approx(PAYLOAD, rel=0.01)
    assert found["payload.com_m[2]"] == pytest.approx(0.08, abs=0.002)
    assert found.fit["axis_5"]["r2"] > 0.99  # which the motor of axis_6 turns too


@pytest.mark.study
def test_friction_of_joints_of_a_coupled_wrist(tmp_path, truth, table):
    log = written_log(tmp_path, "drives", table, OF_DRIVES, f"joints = {NAMES}\ngears.matrix = {GEARS.tolist()}\n")
    found = aw.identification.identify_friction(log, truth, candidates=())
    for name, viscous, coulomb in zip(NAMES, VISCOUS, COULOMB, strict=True):
        assert found[f"{name}.friction.viscous_n_m_s_per_rad"] == pytest.approx(viscous, rel=0.03)
        assert found[f"{name}.friction.coulomb_positive_n_m"] == pytest.approx(coulomb, rel=0.03)


@pytest.mark.study
def test_a_good_fit_is_not_in_doubt_where_the_log_has_a_gap(tmp_path):
    """Mistakes are tried on the rows before the gap, few of them, with columns of a filtered motion: some always gain."""
    arm = aw.load("panda").replace(friction=None)
    t, q, qd, qdd = multisine(7, 6.0, 1000.0, 6, 0.35)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    tau += tau.std(axis=0) * (0.8 * np.sign(qd) + 0.4 * qd + 0.01 * np.random.default_rng(0).normal(size=q.shape))
    q = np.round(q / 2.4e-5) * 2.4e-5
    q[2000:2007] = np.nan
    found = aw.identification.identify_arm(written_arm_log(tmp_path, "gap", list(arm.names), t, q, tau), arm, checks=())
    assert found.verdict == "identified", str(found)

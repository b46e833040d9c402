"""Logs: whatever unit, side, sign, file format and block size, the signals are those that were measured."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import armwright as aw
from armwright.errors import LogError
from armwright.identification.logs.quantisation import quantisation_step
from identification.logs.example_logs import (
    ALL,
    HEAD,
    POSITIONS,
    RATE,
    SPEEDS,
    TORQUES,
    columns,
    motion,
    write_joint_states,
    written,
)
from raises_at import raises_at

TWO = HEAD + POSITIONS + TORQUES
UNITS = {"rad": 1.0, "deg": np.pi / 180, "turn": 2 * np.pi, "counts": 2 * np.pi / 4096}


@pytest.mark.parametrize("spelling", ["1/min", "min⁻¹", "U/min", "rev/min"])
def test_turns_a_minute_are_written_as_data_sheets_write_them(tmp_path, spelling):
    table = columns()
    speeds = {f"v{k} [{spelling}]": 30.0 / np.pi * table.pop(f"v{k}") for k in (1, 2)}
    text = ALL.replace('["v1", "v2"]', str([*speeds])).replace('"rad/s"', '"rpm"')
    data = aw.identification.read_log(written(tmp_path, text, {"arm.csv": table | speeds})).dataset()
    np.testing.assert_allclose(data["qd"], motion(table["t"])[1], atol=1e-9)


@settings(max_examples=25)
@given(
    unit=st.sampled_from(sorted(UNITS)),
    side=st.sampled_from(["joint", "motor"]),
    signs=st.tuples(st.sampled_from([1, -1]), st.sampled_from([1, -1])),
    ratios=st.tuples(st.floats(-120, -20), st.floats(20, 160)),
    coupling=st.sampled_from([0.0, 30.0, -7.5]),
    offsets=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
)
def test_units_sides_signs_and_couplings_round_trip(tmp_path_factory, unit, side, signs, ratios, coupling, offsets):
    folder = tmp_path_factory.mktemp("log")
    t = np.arange(200) / RATE
    q, _, _, tau = motion(t)
    gears = np.array([[ratios[0], 0.0], [coupling, ratios[1]]])
    motor, motor_tau = (q - offsets) @ gears.T, tau @ np.linalg.inv(gears)  # θ_motor = N q, tau = Nᵀ tau_motor
    seen, torque = (motor, motor_tau) if side == "motor" else (q - offsets, tau)
    seen, torque = seen * signs / UNITS[unit], torque * signs / 1e-3
    text = f"""
        joints = ["a", "b"]
        files.x.path = "x.csv"
        time = {{ column = "t", unit = "ms" }}
        gears.matrix = {gears.tolist()}
        [[signals]]
        quantity = "position"
        columns = ["p1", "p2"]
        unit = "{unit}"
        side = "{side}"
        signs = {list(signs)}
        offsets = {list(offsets)}
        {"counts_per_turn = 4096" if unit == "counts" else ""}
        [[signals]]
        quantity = "torque"
        columns = ["f1", "f2"]
        unit = "mN m"
        side = "{side}"
        signs = {list(signs)}
    """
    table = {"t": 1e3 * t, "p1": seen[:, 0], "p2": seen[:, 1], "f1": torque[:, 0], "f2": torque[:, 1]}
    data = aw.identification.read_log(written(folder, text, {"x.csv": table}), on_error="keep").dataset()
    assert np.allclose(data["time"], t, atol=1e-12)
    assert np.allclose(data["q"], q, atol=1e-11)
    assert np.allclose(data["tau"], tau, atol=1e-10)
    assert data["q"].attrs["units"] == "rad"


@pytest.mark.parametrize("ending", ["csv", "parquet", "nc"])
def test_a_simulated_run_comes_back(tmp_path, ending):
    if ending == "parquet":
        pytest.importorskip("pyarrow")
    arm = aw.load("two-link")
    run = aw.simulate(aw.Scenario(arm, 0.4, command=[3.0, 1.0]))
    aw.save(run, tmp_path / f"run.{ending}")
    names = list(arm.names)
    text = f"""
        robot = "two-link"
        files.run.path = "run.{ending}"
        time.column = "t"
        signals = [
            {{ quantity = "position", columns = {[f"q_{name}" for name in names]}, side = "joint" }},
            {{ quantity = "speed", columns = {[f"qd_{name}" for name in names]}, side = "joint" }},
            {{ quantity = "torque", columns = {[f"tau_{name}" for name in names]}, side = "joint" }},
        ]
    """
    log = aw.identification.read_log(written(tmp_path, text, {"unused.csv": {"t": np.zeros(1)}}))
    data = log.dataset()
    for name in ("q", "qd", "tau"):
        assert np.array_equal(data[name].values, run[name].values)
    assert np.allclose(data["time"], run["time"], atol=1e-15)
    assert log.arm is not None
    assert list(log.joints) == names


def test_an_mcap_recording_of_joint_states(tmp_path):
    pytest.importorskip("mcap_ros2.writer")
    t = np.arange(1500) / RATE
    q, qd, _, tau = motion(t)
    write_joint_states(tmp_path / "arm.mcap", ["shoulder", "elbow"], t, q, qd, tau)
    names = '"{0}/shoulder", "{0}/elbow"'
    text = f"""
        joints = ["shoulder", "elbow"]
        files.bag.path = "arm.mcap"
        time.column = "stamp"
        signals = [
            {{ quantity = "position", columns = [{names.format("position")}], unit = "rad", side = "joint" }},
            {{ quantity = "speed", columns = [{names.format("velocity")}], unit = "rad/s", side = "joint" }},
            {{ quantity = "torque", columns = [{names.format("effort")}], unit = "N m", side = "joint" }},
        ]
    """
    path = written(tmp_path, text, {"unused.csv": {"t": t}})
    log = aw.identification.read_log(path)
    data = log.dataset()
    assert np.array_equal(data["q"], q)
    assert np.array_equal(data["tau"], tau)
    assert np.abs(data["time"].values - t).max() < 1e-9  # nanoseconds since 1970 keep their last digit
    path.write_text(text.replace("arm.mcap", "damaged.mcap"))
    content = (tmp_path / "arm.mcap").read_bytes()
    (tmp_path / "damaged.mcap").write_bytes(content[: len(content) // 2])
    with pytest.raises(LogError, match=r"damaged\.mcap"):
        aw.identification.read_log(path)


def test_blocks_of_any_size_make_the_same_log(tmp_path):
    log = aw.identification.read_log(written(tmp_path, ALL))
    whole = log.dataset()
    for rows in (100, 999, 4001):
        blocks = list(log.blocks(rows=rows))
        assert max(len(block.t) for block in blocks) == rows
        assert [block.row for block in blocks] == list(range(0, 4001, rows))
        assert np.array_equal(np.concatenate([block.values["tau"] for block in blocks]), whole["tau"])


def test_runs_in_folders_are_split_and_files_may_be_a_row_short(tmp_path):
    table = columns(2.0)
    for number in (1, 2, 3):
        (tmp_path / f"run_{number}").mkdir()
        motion_only = {name: table[name] for name in ("t", "q1", "q2", "v1", "v2")}
        torque = {name: table[name][:-1] for name in ("m1", "m2")}  # acts between samples
        written(tmp_path / f"run_{number}", "", {"arm.csv": motion_only, "torque.csv": torque})
    text = HEAD.replace('unit = "s"', 'unit = "s"\nfile = "arm"') + 'files.torque.path = "torque.csv"\n'.join(["", ""])
    text = text.replace("[time]", '[files.torque]\npath = "torque.csv"\n[time]').replace(
        'files.torque.path = "torque.csv"\n', ""
    )
    text += '[[runs]]\nfolder = ["run_1", "run_2"]\n[[runs]]\nfolder = "run_3"\nuse = "hold-out"\n'
    text += POSITIONS + 'file = "arm"' + SPEEDS + 'file = "arm"' + TORQUES + 'file = "torque"'
    log = aw.identification.read_log(written(tmp_path, text))
    assert (log.fit, log.hold_out) == (("run_1", "run_2"), ("run_3",))
    assert log.dataset("run_3").sizes["time"] == len(table["t"]) - 1
    assert log.run("run_1").sha256["arm"] == hashlib.sha256((tmp_path / "run_1" / "arm.csv").read_bytes()).hexdigest()
    written(tmp_path / "run_2", "", {"torque.csv": {name: table[name][:-7] for name in ("m1", "m2")}})
    with raises_at(LogError, "run 'run_2'", r"arm.csv 1001, torque.csv 994") as error:
        aw.identification.read_log(tmp_path / "two.log.toml")
    assert "clock of its own" in error.value.expected


@pytest.mark.parametrize("late", [-0.0503, 0.3507])
def test_a_file_with_its_own_clock_is_interpolated(tmp_path, late):
    t = np.arange(2001) / RATE
    other = np.arange(401) / 100.0 * (1 + 1e-5) + late
    q, qd, _, _ = motion(t)
    tau = motion(other)[3]
    text = HEAD.replace('unit = "s"', 'unit = "s"\nfile = "arm"') + POSITIONS + 'file = "arm"' + SPEEDS + 'file = "arm"'
    text += TORQUES + 'file = "drive"\n'
    text = text.replace("[time]", '[files.drive]\npath = "drive.csv"\ntime = { column = "stamp", unit = "ms" }\n[time]')
    tables = {
        "arm.csv": {"t": 5.0 + t, "q1": q[:, 0], "q2": q[:, 1], "v1": qd[:, 0], "v2": qd[:, 1]},
        "drive.csv": {"stamp": 1e3 * (5.0 + other), "m1": tau[:, 0], "m2": tau[:, 1]},
    }
    log = aw.identification.read_log(written(tmp_path, text, tables))
    data = log.dataset()
    covered = (t >= other[0]) & (t <= other[-1])
    assert np.isnan(data["tau"].values[~covered]).all()
    truth = np.stack([np.interp(t, other, column) for column in tau.T], axis=1)
    assert np.allclose(data["tau"].values[covered], truth[covered], atol=1e-9)
    assert sum(stretch.rows for stretch in log.runs[0].stretches) == covered.sum()


def test_percent_of_rated_torque_current_and_permille(tmp_path):
    table = columns(1.0)
    text = HEAD + POSITIONS + TORQUES.replace('"N m"', '"permille"') + "rated = [40, 20]\n"
    table |= {"m1": table["m1"] / 40 * 1000, "m2": table["m2"] / 20 * 1000}
    data = aw.identification.read_log(written(tmp_path, text, {"arm.csv": table})).dataset()
    assert np.allclose(data["tau"], motion(table["t"])[3], atol=1e-12)


def test_the_checksum_depends_on_file_and_data(tmp_path):
    first = aw.identification.read_log(written(tmp_path, ALL)).sha256
    assert aw.identification.read_log(written(tmp_path, ALL)).sha256 == first
    table = columns()
    table["q1"][7] += 1e-12
    assert aw.identification.read_log(written(tmp_path, ALL, {"arm.csv": table})).sha256 != first


def test_a_robot_file_may_have_kinematics_alone(tmp_path):
    joints = "".join(
        f"""
        [[joints]]
        name = "{name}"
        type = "revolute"
        parent = "{parent}"
        child = "{child}"
        dh = {{ alpha_rad = 0.0, r_m = 0.0, a_m = 0.4, offset_rad = 0.0 }}
        """
        for name, parent, child in (("shoulder", "base", "upper"), ("elbow", "upper", "fore"))
    )
    (tmp_path / "arm.toml").write_text(f'name = "bare"\nlinks = []\nsource = "drawing"\ncommand = "torque"\n{joints}')
    text = ALL.replace("joints =", 'robot = "arm.toml"\nkinematics_only = true\njoints =')
    log = aw.identification.read_log(written(tmp_path, text))
    assert log.arm is not None
    assert any("kinematics only" in warning for warning in log.arm.warnings)
    assert log.gears is None
    assert np.allclose(aw.forward_kinematics(log.arm, [0.0, 0.0])[:3, 3], [0.8, 0.0, 0.0])
    with pytest.raises(aw.ArmwrightError, match=r"mass_kg|links|upper"):
        aw.load(tmp_path / "arm.toml")


def test_gears_of_thousands_of_motors_are_refused_before_their_matrix_is_inverted(tmp_path):
    text = f"{ALL}[gears]\nratios = {[1.0] * 5000}\n"
    with pytest.raises(LogError, match=r"gears\.ratios"):
        aw.identification.read_log(written(tmp_path, text))


def test_an_integer_beyond_floats_is_named_with_its_place(tmp_path):
    path = written(tmp_path, ALL)
    (tmp_path / "arm.csv").write_text(f"t,q1,q2,v1,v2,m1,m2\n0.5,{'9' * 400},2,3,4,5,6\n", encoding="utf-8")
    with raises_at(LogError, "column 'q1'", "a number") as refused:
        aw.identification.read_log(path)
    assert refused.value.file.endswith("arm.csv:2")


def test_one_cell_far_beyond_all_others_is_no_warning():
    """Steps of the printed digits come before the first of the quantised ones."""
    values = np.concatenate([np.arange(10.0), np.arange(10.0), [0.0] * 20, [-(2.0**64)]])
    with np.errstate(all="raise"):
        quantisation_step(values)
    near = np.concatenate([np.arange(40) * 1e-12, np.arange(6.0), np.zeros(60)])
    with np.errstate(all="raise"):
        quantisation_step(near)


PARTS = '\n[[runs]]\nname = "fit"\nto_s = 5.0\n\n[[runs]]\nname = "held"\nfrom_s = 5.0\nto_s = 7.0\nuse = "hold-out"\n'


def test_runs_that_are_parts_of_a_file_are_its_rows(tmp_path):
    table = columns(8.0)
    log = aw.identification.read_log(written(tmp_path, TWO + PARTS, {"arm.csv": table}))
    assert (log.fit, log.hold_out) == (("fit",), ("held",))
    rows = {"fit": slice(0, 2500), "held": slice(2500, 3500)}  # at 500 Hz
    for name, part in rows.items():
        data = log.dataset(name)
        np.testing.assert_allclose(data["q"].values[:, 0], table["q1"][part], atol=1e-9)
        np.testing.assert_allclose(data["time"], np.arange(part.stop - part.start) / 500, atol=1e-9)
        blocks = list(log.blocks(name, rows=300))
        np.testing.assert_array_equal(np.concatenate([b.values["q"] for b in blocks]), data["q"])
        assert [b.row for b in blocks] == list(np.cumsum([0, *(len(b.t) for b in blocks[:-1])]))
        assert log.run(name).rows == part.stop - part.start


def test_a_share_of_every_run_is_held_out(tmp_path):
    log = aw.identification.read_log(written(tmp_path, "hold_out = 0.25\n" + TWO, {"arm.csv": columns(8.0)}))
    assert (log.fit, log.hold_out) == (("run1",), ("run1-held",))
    assert [run.rows for run in log.runs] == [3000, 1001]
    whole = aw.identification.read_log(written(tmp_path, TWO, {"arm.csv": columns(8.0)}))
    assert log.sha256 != whole.sha256


def test_places_of_a_part_are_lines_of_its_file(tmp_path):
    table = columns(8.0)
    table["q1"][3000] = np.nan
    log = aw.identification.read_log(written(tmp_path, TWO + PARTS, {"arm.csv": table}))
    assert any("arm.csv:3002" in str(each) for each in log.findings)


@pytest.mark.parametrize(
    ("head", "tail", "words"),
    [
        ("", PARTS.replace("from_s = 5.0", "from_s = 4.9"), "holds out rows"),
        ("", PARTS.replace("to_s = 7.0", "to_s = 4.0"), "above from_s"),
        ("", PARTS.replace("5.0", "500.0").replace("7.0", "700.0"), "a part of 0 to 8 s"),
        ("hold_out = 0.2\n", PARTS, "to be fitted"),
        ("hold_out = 1.5\n", "", "less than 1"),
    ],
)
def test_parts_that_cannot_be_are_refused(tmp_path, head, tail, words):
    with pytest.raises(LogError, match=words):
        aw.identification.read_log(written(tmp_path, head + TWO + tail, {"arm.csv": columns(8.0)}))

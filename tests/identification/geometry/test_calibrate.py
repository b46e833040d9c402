"""Kinematic calibration: known arms, and TIAGo's motion capture against an independent Levenberg-Marquardt."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import IdentificationError
from identification.geometry.measured_arm import measured, nominal, true_values, truth
from identification.geometry.tiago import FOLDS, TABLE, TiagoChain, tiago_file
from raises_at import raises_at
from reference.example_robots import robot_files

tiago = pytest.mark.skipif(
    not TABLE.exists() or not robot_files(), reason="TIAGo's measurements or its URDF are not here"
)


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", ["frame", "row"])
def test_what_is_identifiable_is_the_rank_of_a_numerical_jacobian(kind, tmp_path):
    """Columns by central differences of the plain chain: the same rank, with every point and the tracker unknown."""
    real = truth(kind, 0)
    found = aw.calibrate(measured(real, 0), nominal(kind, tmp_path))
    q = np.random.default_rng(5).uniform(-3, 3, (60, 6))
    names, still = [*real.mistakes], type(real)(kind, {}, np.eye(4))

    def points(name, step):
        arm = type(real)(kind, {name: step}, np.eye(4))
        return np.array([arm.points(each) for each in q]).ravel()

    columns = [(points(name, 1e-5) - points(name, -1e-5)) / 2e-5 for name in names]
    placed = np.array([still.pose(each) for each in q])
    at = np.array([still.points(each) for each in q])
    columns += [np.broadcast_to(axis, at.shape).ravel() for axis in np.eye(3)]  # the tracker's place and direction
    columns += [np.cross(axis, at).ravel() for axis in np.eye(3)]
    for marker in range(3):
        for axis in range(3):
            column = np.zeros_like(at)
            column[:, marker] = placed[:, :3, axis]
            columns.append(column.ravel())
    matrix = np.array(columns).T / np.maximum(np.linalg.norm(columns, axis=1), 1e-12)
    singular = np.linalg.svd(matrix, compute_uv=False)
    assert len(found.estimate.names) == (singular > 1e-6 * singular[0]).sum()
    assert len(found.estimate.names) < len(columns)  # some cannot be told apart, and are named as combinations
    assert any("*" in name for name in found.fit.setting.grouped.names)


@pytest.mark.study
@pytest.mark.parametrize("kind", ["frame", "row"])
def test_known_mistakes_are_found_within_their_intervals(kind, tmp_path):
    """Two seeds of each kind; tools/geometry_seeds.py has the table of many."""
    arm, scaled = nominal(kind, tmp_path), []
    for seed in range(2):
        real = truth(kind, seed)
        found = aw.calibrate(measured(real, seed), arm)
        assert found.good
        assert found.errors[0].calibrated < 0.1 * found.errors[0].record
        assert not found.fit.outliers
        assert not any(each.found for each in found.tried_terms)
        scaled += [(value - true) / std for value, true, std in true_values(found, real).values()]
    assert np.mean(np.abs(scaled) < 1.96) > 0.85
    assert 0.6 < np.sqrt(np.mean(np.square(scaled))) < 1.4


def test_poses_with_a_mistaken_marker_do_not_count(tmp_path):
    """One marker of three is off by some cm in four of 40 poses: named, and the corrections are as sure as without them."""
    real, arm = truth("row", 1), nominal("row", tmp_path)
    clean = aw.calibrate(measured(real, 1), arm)
    data = measured(real, 1, wrong=4)
    mistaken = [k for k in range(40) if np.abs(data.measured[0].values[k] - real.points(data.q[k])[0]).max() > 0.01]
    found = aw.calibrate(data, arm)
    assert set(mistaken) <= set(found.fit.outliers)
    assert len(found.fit.outliers) <= len(mistaken) + 1
    for name, (value, true, std) in true_values(found, real).items():
        assert abs(value - true) < 4.5 * std, name
    assert np.median(found.estimate.std / clean.estimate.std) < 1.3


@pytest.mark.parametrize(("kind", "path"), [("frame", "joint3.frame.xyz_m"), ("row", "elbow.dh.a_m")])
def test_the_record_has_the_calibrated_numbers(kind, path, tmp_path):
    """Read back, the file predicts poses that were not measured as the true arm does, and inverse kinematics reaches them."""
    real, arm = truth(kind, 2), nominal(kind, tmp_path)
    found = aw.calibrate(measured(real, 2, 60, noise=2e-5), arm)
    calibrated = aw.load(found.write(tmp_path / "calibrated.toml"), kinematics_only=True, on_impossible="warn")
    q = np.random.default_rng(9).uniform(-2, 2, (20, 6))

    def errors(model):
        frames = [aw.forward_kinematics(model, each, frame="measuring") for each in q]
        marks = [[aw.forward_kinematics(model, each, frame=f"marker{k}") for k in (1, 2, 3)] for each in q]
        at = [[(np.linalg.inv(frame) @ T)[:3, 3] for T in row] for frame, row in zip(frames, marks, strict=True)]
        return np.linalg.norm(np.array(at) - [real.points(each) for each in q], axis=2)

    assert errors(calibrated).max() < 2e-4
    assert "geometry" in calibrated.record.fits
    assert calibrated.provenance(path).kind == "fit"
    assert any(each.name.startswith(path) and each.std for each in calibrated.parameters)
    goal = aw.forward_kinematics(calibrated, q[0], frame="marker1")
    reached = aw.inverse_kinematics(calibrated, goal, frame="marker1")
    assert np.allclose(aw.forward_kinematics(calibrated, reached.q, frame="marker1"), goal, atol=1e-6)


def test_eccentric_gears_are_found_and_not_written(tmp_path):
    """2 mrad at joint 2: the term is named as found, with its value; a record of it is refused by name."""
    real, arm = truth("frame", 3, eccentricity={1: 2e-3}), nominal("frame", tmp_path)
    data = measured(real, 3)
    plain = aw.calibrate(data, arm)
    (term,) = plain.tried_terms
    assert term.found
    value, std = next((v, s) for name, v, s, _ in term.values if name == "joint2 eccentricity cos")
    assert abs(value - real.eccentricity[1]) < 5 * std
    asked = aw.calibrate(data, arm, terms=("zeros", "frames", "eccentricity"))
    assert asked.errors[0].calibrated < 0.6 * plain.errors[0].calibrated
    assert "joint2 eccentricity cos" in str(asked)
    page = asked.report(tmp_path / "asked.html").read_text(encoding="utf-8")
    assert asked.sentences()[0] == asked.verdict
    assert page.index('<p class="verdict') < page.index(asked.verdict[1:20])
    with raises_at(IdentificationError, "terms", "eccentricity"):
        asked.write(tmp_path / "no.toml")


@pytest.mark.study
def test_links_that_bend_under_gravity_are_found():
    """A give of 2e-4 rad/(N m) at the shoulder of the PUMA, whose moments come from its masses by `gravity_torques`."""
    arm, real = aw.load("puma560", on_impossible="warn"), truth("row", 4)
    rng = np.random.default_rng(4)
    q = rng.uniform(-2.5, 2.5, (60, 6))
    bent = q.copy()
    bent[:, 1] -= 2e-4 * aw.compile(arm).gravity_torques(q)[:, 1]  # gravity turns it by the opposite of what holds it
    points = np.array([real.points(each) for each in bent]) + rng.normal(0, 1e-4, (60, 3, 3))
    given = [aw.identification.Measured(f"m{k}", "point", points[:, k]) for k in range(3)]
    data = aw.identification.Measurements(arm.names, q, given)
    found = aw.calibrate(data, arm, terms=("zeros", "frames", "joint compliance"))
    value, std = found.estimate["shoulder joint compliance z"], found.estimate.std
    assert abs(value - 2e-4) < 5 * std[found.estimate.number("shoulder joint compliance z")]
    assert value > 10 * std[found.estimate.number("shoulder joint compliance z")]


@pytest.mark.study
@tiago
def test_tiago_is_predicted_better_than_by_an_independent_search(tmp_path):
    """Motion capture of 34 poses, held out in the same ten parts: Pinocchio's chain and SciPy's Levenberg-Marquardt of all
    identifiable parameters reach 4.2 mm; the default is below."""
    found = aw.calibrate(tiago_file(tmp_path))
    assert any("marker4 repeats the columns of marker3" in each for each in found.estimate.remarks)
    chain = TiagoChain()
    assert len(found.estimate.names) == chain.rank
    independent = chain.held_out(FOLDS)
    assert found.errors[0].calibrated_all <= independent
    assert found.errors[0].calibrated_all < found.errors[0].record_all
    plain = aw.calibrate(tiago_file(tmp_path), loss="squares")
    assert plain.tried_priors[0.0] * np.sqrt(3) == pytest.approx(independent, rel=2e-3)  # the same fit, by other code
    assert plain.errors[0].calibrated_all <= independent
    path = found.write(tmp_path / "calibrated.toml")
    assert aw.load(path, on_impossible="warn").provenance("arm_3_joint.frame.xyz_m").kind == "fit"


def test_the_command_says_and_writes(tmp_path):
    """Exit 0, the record, the page and the picture; an unknown term or column ends in one line and exit 2."""
    real, arm = truth("frame", 5), nominal("frame", tmp_path)
    data = measured(real, 5, 20)
    columns = [*(f"joint{k}" for k in range(1, 7)), *(f"{axis}{k}" for k in (1, 2, 3) for axis in "xyz")]
    table = np.c_[data.q, *(each.values for each in data.measured)]
    np.savetxt(tmp_path / "points.csv", table, delimiter=",", header=",".join(columns), comments="")
    file, text = tmp_path / "tx40.calibration.toml", f'robot = "{arm.file}"\nfile.path = "points.csv"\n'
    text += f"[[joints]]\ncolumns = {columns[:6]}\n"
    for k in (1, 2, 3):
        text += f'[[measured]]\nname = "marker{k}"\nkind = "point"\ncolumns = ["x{k}", "y{k}", "z{k}"]\n'
    file.write_text(text)
    out = [str(tmp_path / name) for name in ("a.toml", "a.html", "a.png")]
    result = CliRunner().invoke(app, ["calibrate", str(file), "-o", out[0], "--report", out[1], "--plot", out[2]])
    assert result.exit_code == 0, result.output
    assert "calibrated" in result.output
    assert aw.load(out[0], kinematics_only=True).record.fits["geometry"].verdict == "identified"
    wrong = CliRunner().invoke(app, ["calibrate", str(file), "--terms", "zeros,nothing"])
    assert wrong.exit_code == 2
    assert "--terms" in wrong.output
    wrong = CliRunner().invoke(app, ["calibrate", str(file), "--terms", "zeros,eccentricity", "-o", out[0]])
    assert wrong.exit_code == 2
    assert "eccentricity" in wrong.output
    file.write_text(text.replace('"x1"', '"x9"'))
    wrong = CliRunner().invoke(app, ["calibrate", str(file)])
    assert wrong.exit_code == 2
    assert "x9" in wrong.output
    poses = [
        "excite",
        "poses",
        arm.file,
        "-n",
        "12",
        "--point",
        "0.1,0,0.1",
        "--candidates",
        "60",
        "-o",
        str(tmp_path / "p.csv"),
    ]
    result = CliRunner().invoke(app, [*poses, "--point", "0,0.1,0.1", "--radius", "0.02"])
    assert result.exit_code == 0, result.output
    assert len((tmp_path / "p.csv").read_text().splitlines()) == 13
    assert CliRunner().invoke(app, [*poses, "--point", "0,0.1"]).exit_code == 2

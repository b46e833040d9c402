"""Output and files of each command."""

import io
import itertools
import re
from pathlib import Path

import numpy as np
import pandas
import pytest
import typer
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from physics.arms import arm
from simulation.runs import mixed_file


def run(*arguments, code=0):
    """The result of a command that should end with that exit code."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result


def table(path, columns):
    """Writes a CSV file of columns {header: values}."""
    pandas.DataFrame(columns).to_csv(path, index=False)
    return path


def motions(arm, quantities, rows=5, seed=0):
    """A random table of data sets."""
    random = np.random.default_rng(seed)
    return {f"{quantity}_{name}": random.normal(size=rows) for quantity in quantities for name in arm.names}


def columns(frame, quantity, arm):
    return np.stack([frame[f"{quantity}_{name}"] for name in arm.names], axis=1)


def test_version():
    assert run("--version").stdout == f"armwright {aw.__version__}\n"


@pytest.mark.parametrize("command", ["robots", "info", "inverse-dynamics", "forward-dynamics", "simulate"])
def test_help_teaches_by_example(command):
    shown = run(command, "--help").stdout
    assert re.search(r"^ *Usage: .*armwright|^ *Usage: ", shown, re.M)
    if command != "robots":
        assert f"armwright {command} " in shown
        assert "Examples:" in shown


BRACKETS = re.compile(r"(?<!\\)\[[^\]\n]*\]")


def every_command(command, path=()):
    yield path, command
    for name, inner in getattr(command, "commands", {}).items():
        yield from every_command(inner, (*path, name))


def test_units_in_brackets_survive_in_the_help():
    checked = 0
    for path, command in every_command(typer.main.get_command(app)):
        texts = [str(getattr(each, "help", "") or "").replace("\\[", "[") for each in command.params]
        found = [bracket for text in (command.help or "", *texts) for bracket in BRACKETS.findall(text)]
        if found:
            shown = " ".join(re.sub("[│╭╮╰╯─]", " ", run(*path, "--help").stdout).split())
            for bracket in found:
                assert all(word in shown for word in bracket.split()), (path, bracket)
                checked += 1
    assert checked > 3


def test_alone_it_shows_its_help():
    shown = run().stdout
    assert all(
        command in shown for command in ("robots", "info", "inverse-dynamics", "forward-dynamics", "simulate", "Try:")
    )


def test_robots_lists_every_built_in_arm():
    shown = run("robots").stdout
    for name in aw.builtin_names():
        arm = aw.load(name)
        assert re.search(rf"^{name} +{arm.n} +{arm.bodies[0].drive.command} ", shown, re.M)


@pytest.mark.parametrize("name", ["cmu-dd", "puma560", "lwa4p", "panda", "two-link"])
def test_info(name):
    arm = aw.load(name)
    assert arm.description is not None
    shown = run("info", name).stdout
    assert arm.description.title in shown
    assert f"{arm.description.total_mass:.5g} kg" in shown
    assert "m at most, base to" in shown
    words = " ".join(shown.split())
    for joint in arm.names:
        assert len(re.findall(rf"^{joint} ", shown, re.M)) >= 2
    for source in arm.description.sources.values():
        assert " ".join(source.text.split())[:40] in words
    for warning in arm.warnings:
        assert "warning: " + " ".join(warning.split())[:60] in words


def test_info_of_every_kind_of_joint(tmp_path):
    shown = run("info", mixed_file(tmp_path)).stdout
    assert "Denavit-Hartenberg, classic" in shown
    assert re.search(r"^slide +prismatic +column +carriage +28.648 +0.1 +q \+ 0.2 +14.324", shown, re.M)
    assert "Denavit-Hartenberg, modified" in shown
    assert re.search(r"^hinge +revolute +carriage +hand +0 +0 +0.3 +q - 28.648", shown, re.M)
    assert "Joint frames in the parent link" in shown
    assert "-0.1 … 0.6 m" in shown


def test_info_shows_an_arm_that_load_would_refuse(tmp_path):
    path = mixed_file(tmp_path)
    path.write_text(path.read_text().replace("mass_kg = 1\n", "mass_kg = 1e-9\n").replace("zz = 0.1 }", "zz = 9 }"))
    run("simulate", path, "--command", "0", "--duration", "1", code=2)
    assert "warning: link 'hand' inertia_kg_m2: an impossible inertia" in run("info", path).stdout


def test_info_shows_springs(tmp_path):
    """With the keys of the file, and cylinders with both ends."""
    path = tmp_path / "sprung.toml"
    path.write_text(aw.robotfiles.to_toml(arm("sprung").record), encoding="utf-8")
    shown = " ".join(run("info", path).stdout.split())
    assert "joint2 positions_m [-0.8, -0.1, 0.3, 0.9], forces_n [30, 12, -8, -9], outside linear" in shown
    assert "balancer base (0.3, -0.2, 0.9) link1 (0.1, 0.5, 0) -80 0.9 240" in shown


def test_info_shows_coupled_motors_and_efficiency_by_load(tmp_path):
    text = Path(aw.__file__).with_name("robots").joinpath("puma560.toml").read_text(encoding="utf-8")
    table = """gear_efficiency_table.torque_n_m = [1.0, 5.0]
gear_efficiency_table.rows = [
    { speed_rad_per_s = 0.5, driving = [0.5, 0.7], driven_back = [0.45, 0.6] },
    { speed_rad_per_s = 3.0, driving = [0.4, 0.6] },
]
coupling = [{ joint = "wrist_pitch", ratio = -40.0 }]
"""
    before, last = text.rsplit("[joints.motor]\n", 1)
    path = tmp_path / "coupled.toml"
    path.write_text(f"{before}[joints.motor]\n{table}{last}", encoding="utf-8")
    shown = run("info", path).stdout
    name, ratio = aw.load(path).names[-1], aw.load(path).coordinates[-1].drive.gear_ratio
    assert re.search(rf"^{name} +{f'{ratio:.5g}'} · {name} \+ -40 · ", shown, re.M)
    assert re.search(rf"^{name} +\[1, 5\] +0.5 +\[0.5, 0.7\] +\[0.45, 0.6\]", shown, re.M)
    assert re.search(rf"^{name} +\[1, 5\] +3 +\[0.4, 0.6\] +\[0.4, 0.6\]", shown, re.M)


@pytest.mark.parametrize("name", ["cmu-dd", "lwa4p", "two-link"])
def test_inverse(tmp_path, name):
    arm = aw.load(name)
    sets = motions(arm, ("q", "qd", "qdd"))
    run("inverse-dynamics", name, table(tmp_path / "in.csv", sets), "-o", tmp_path / "out.csv")
    frame = pandas.read_csv(tmp_path / "out.csv")
    q, qd, qdd = (columns(sets, quantity, arm) for quantity in ("q", "qd", "qdd"))
    expected = np.array([aw.inverse_dynamics(arm, *row) for row in zip(q, qd, qdd, strict=True)])
    got = np.stack([frame[f"tau_{joint} [N m]"] for joint in arm.names], axis=1)
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9)
    drive = {"cmu-dd": "voltage", "lwa4p": "current", "two-link": None}[name]
    kinds = {head.split("_")[0] for head in frame.columns}
    assert kinds == {"tau", drive} - {None}
    if drive == "voltage":
        volts = np.array([aw.motor_voltage(arm, *row) for row in zip(qd, expected, strict=True)])
        got = np.stack([frame[f"voltage_{joint} [V]"] for joint in arm.names], axis=1)
        np.testing.assert_allclose(got, volts, rtol=1e-9, atol=1e-9)
    if drive == "current":
        amperes = np.array([aw.motor_current(arm, row) for row in expected])
        got = np.stack([frame[f"current_{joint} [A]"] for joint in arm.names], axis=1)
        np.testing.assert_allclose(got, amperes, rtol=1e-9, atol=1e-9)


def test_forward_undoes_inverse(tmp_path):
    arm = aw.load("cmu-dd")
    sets = motions(arm, ("q", "qd", "qdd"))
    run("inverse-dynamics", "cmu-dd", table(tmp_path / "in.csv", sets), "-o", tmp_path / "out.csv")
    volts = pandas.read_csv(tmp_path / "out.csv")
    states = {head: values for head, values in sets.items() if not head.startswith("qdd")}
    states |= {f"u_{joint}": volts[f"voltage_{joint} [V]"] for joint in arm.names}
    shown = run("forward-dynamics", "cmu-dd", table(tmp_path / "states.csv", states)).stdout  # without -o it is printed
    frame = pandas.read_csv(io.StringIO(shown))
    got = np.stack([frame[f"qdd_{joint} [rad/s²]"] for joint in arm.names], axis=1)
    np.testing.assert_allclose(got, columns(sets, "qdd", arm), rtol=1e-8, atol=1e-8)


def test_simulate_writes_run_and_picture(tmp_path):
    files = [tmp_path / name for name in ("run.nc", "run.png")]
    result = run(
        "simulate", "cmu-dd", "--voltage", "8,12,8,4,2,1", "--duration", "0.2", "-o", files[0], "--plot", files[1]
    )
    assert "cmu-dd: 0.2 s in 33 steps" in result.stdout
    assert all(f"wrote {file}" in result.stdout for file in files)
    saved = aw.load_run(files[0])
    arm = aw.load("cmu-dd")
    same = aw.simulate(aw.Scenario(arm, duration=0.2, command=[8, 12, 8, 4, 2, 1]))
    np.testing.assert_array_equal(saved["q"], same["q"])
    assert saved["time"].values[-1] == pytest.approx(0.2)
    assert files[1].read_bytes().startswith(b"\x89PNG")


def test_simulate_shows_the_end_state():
    shown = run("simulate", "two-link", "--torque", "0", "--duration", "0.1", "--start=-90deg,0").stdout
    assert re.search(r"^joint +q \[rad\] +qd \[rad/s\] +tau \[N m\]$", shown, re.M)
    assert re.search(r"^shoulder +-1.5708 ", shown, re.M)  # it hangs straight down and stays there


def test_simulate_reads_a_schedule(tmp_path):
    (tmp_path / "torques.csv").write_text("t,elbow,shoulder\n0,1,20\n0.05,2,30\n0.1,0,0\n")
    run("simulate", "two-link", "--schedule", tmp_path / "torques.csv", "-o", tmp_path / "run.csv")
    frame = pandas.read_csv(tmp_path / "run.csv")
    assert len(frame) == 101
    assert frame["u_shoulder [N m]"].iloc[[0, 49, 50, 99]].tolist() == [20, 20, 30, 30]
    assert frame["u_elbow [N m]"].iloc[[0, 49, 50, 99]].tolist() == [1, 1, 2, 2]


def test_simulate_takes_starts_step_and_recording(tmp_path):
    options = (
        "--torque",
        "0",
        "--duration",
        "0.1",
        "--step",
        "5e-4",
        "--start",
        "pi/2,30deg",
        "--start-velocity",
        "0.5",
    )
    run("simulate", "two-link", *options, "--record-every", "50", "-o", tmp_path / "run.nc")
    saved = aw.load_run(tmp_path / "run.nc")
    np.testing.assert_allclose(saved["time"], [0, 0.025, 0.05, 0.075, 0.1])
    np.testing.assert_allclose(saved["q"][0], [np.pi / 2, np.pi / 6])
    np.testing.assert_allclose(saved["qd"][0], [0.5, 0.5])


def test_mixed_drives_take_commands_in_their_own_units(tmp_path):
    path = mixed_file(tmp_path)
    run("simulate", path, "--command", "1,2,3", "--duration", "0.01", "-o", tmp_path / "run.csv")
    first = pandas.read_csv(tmp_path / "run.csv").iloc[0]
    assert [first["u_turn [V]"], first["u_slide [N]"], first["u_hinge [A]"]] == [1, 2, 3]


def test_notes_go_to_stderr():
    result = run("simulate", "cmu-dd", "--voltage", "80", "--duration", "0.1")
    assert "armwright: note: " in result.stderr
    assert "note" not in result.stdout


def test_info_counts_operations():
    """Every kernel of the table with what each step saves; one that the record cannot serve says why."""
    text = run("info", "lwa4p", "--operations").output
    assert "aligned frames" in text
    assert "base parameters" in text
    line = next(line for line in text.splitlines() if line.startswith("inverse_dynamics "))
    assert re.search(r"276, 254 +264, 243 +217, 198 +5, 5", line)  # with friction; each step saves
    assert "motor.resistance_ohm: motor_voltage needs it" in text


def test_inverse_knows_what_it_can_of_every_joint(tmp_path):
    """As in a simulation: nan for a joint without a motor, currents beside voltages that are not known of every motor."""
    path = mixed_file(tmp_path)
    arm = aw.load(path)
    sets = motions(arm, ("q", "qd", "qdd"))
    frame = pandas.read_csv(io.StringIO(run("inverse-dynamics", path, table(tmp_path / "in.csv", sets)).stdout))
    tau, qd = frame["tau_turn [N m]"], sets["qd_turn"]
    np.testing.assert_allclose(frame["voltage_turn [V]"], 2.0 / (50 * 0.1) * tau + 50 * 0.1 * qd, rtol=1e-12)
    np.testing.assert_allclose(frame["current_turn [A]"], tau / (50 * 0.1), rtol=1e-12)
    np.testing.assert_allclose(frame["current_hinge [A]"], frame["tau_hinge [N m]"] / (-10 * 0.2), rtol=1e-12)
    for column in ("voltage_slide [V]", "voltage_hinge [V]", "current_slide [A]"):
        assert frame[column].isna().all()


@pytest.mark.parametrize(
    "command", [("robots",), ("info",), ("inverse-dynamics",), ("forward-dynamics",), ("simulate",), ("export", "c")]
)
def test_help_fills_the_width(command):
    """A line of a paragraph ends where the next word would not have fitted, not where the source's line did."""
    shown = run(*command, "--help").stdout.split("Examples:")[0].split("╭")[0]
    lines = [line.rstrip() for line in shown.splitlines()]
    for line, after in itertools.pairwise(lines):
        if line.strip() and after.strip():
            assert len(line) + 1 + len(after.split()[0]) > 78, (line, after)


def test_servos_lists_the_library_and_shows_one_with_its_sources():
    shown = run("servos").stdout
    for name, servo in aw.robotfiles.servos().items():
        assert re.search(rf"^{re.escape(name)} +{re.escape(servo.title)} +{servo.command} ", shown, re.M)
    one = run("servos", "xl330-m288").stdout
    assert re.search(r"^shaft\.torque_constant_n_m_per_a +0\.36601 +0\.017 +N m/A +servos-bam-xl330", one, re.M)
    assert "arXiv 2410.08650" in one
    assert "no such servo; did you mean mx-64" in run("servos", "mx64", code=2).stderr


def test_info_shows_what_a_joint_has_of_a_servo(tmp_path):
    text = Path(aw.__file__).with_name("robots").joinpath("two-link.toml").read_text(encoding="utf-8")
    assert 'name = "elbow"' in text
    path = tmp_path / "arm.toml"
    path.write_text(
        text.replace('name = "elbow"', 'name = "elbow"\nservo = "sts3215-7.4v"\ncommand = "position"', 1),
        encoding="utf-8",
    )
    shown = run("info", path).stdout
    assert "servos-bam-sts3215" in shown
    assert "p_scale_per_rad 0.166" in shown

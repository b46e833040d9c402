"""`export ros2` of a scenario: the plugin compiled against ros2_control's signatures and driven as a controller manager does."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright import scalar
from armwright.cli.app import app
from armwright.errors import ModelError, ScenarioError
from armwright.export.controller.recording import record
from armwright.export.controller.stages import ControllerStages
from armwright.export.ros2_controller.package import package_name, reference_interfaces, state_interfaces
from export.controllers import CONTROLLERS
from export.running import pid_loop
from kernels.c_compilers import BITS, STRICT, build, compiler

yaml = pytest.importorskip("yaml")

HERE = Path(__file__).parent / "ros2_control"
TICKS = 400
INIT, CONFIGURE, ACTIVATE, UPDATE = 1, 2, 3, 4  # exit codes of drive_plugin


def without_losses(scenario, timing):
    """A loop whose drives do what they are told, as ros2_control has it."""
    return replace(scenario, loop=replace(scenario.loop, timing=aw.Timing(timing)))


LOOPS = {
    "pid": lambda: pid_loop(),
    "pid with limits and a delay": lambda: pid_loop(
        controller=aw.JointPID(kp=80.0, kd=2.0, ki=20.0, limit=3.0, anti_windup="back-calculation", tracking_time=0.1),
        timing=aw.Timing("one-tick"),
    ),
    "cascade": lambda: without_losses(CONTROLLERS["cascade"](TICKS), "one-tick"),
    "voltages": lambda: without_losses(CONTROLLERS["voltage_loop"](TICKS), "one-tick"),
    "computed torque": lambda: without_losses(CONTROLLERS["computed_torque"](TICKS), "ideal"),
}


@dataclass
class Plugin:
    """A package, its plugin compiled, and what its controller saw and commanded in the simulation."""

    folder: Path
    stages: ControllerStages
    table: dict
    rows: np.ndarray  # states, references and the command in force, as drive_plugin reads them
    u: np.ndarray

    def drive(self, rows=None, *, scene="chained", changes=None, rate=None):
        """(exit code, errors, names of the interfaces, commands) of a run; `changes` are of the parameters."""
        name, rows = self.stages.name, self.rows if rows is None else rows
        table = flat(self.table[name]["ros__parameters"]) | (changes or {})
        (self.folder / "parameters").write_text("".join(line(*each) for each in table.items() if each[1] is not None))
        rows.tofile(self.folder / "inputs")
        rate = rate or self.table["controller_manager"]["ros__parameters"]["update_rate"]
        words = [self.folder / each for each in ("drive", "parameters", "inputs", "commands")]
        (self.folder / "commands").unlink(missing_ok=True)
        done = subprocess.run([*words, str(rate), scene], capture_output=True, text=True, timeout=60)
        commands = np.fromfile(self.folder / "commands") if (self.folder / "commands").exists() else np.zeros(0)
        return done.returncode, done.stderr, done.stdout.split("\n")[:-1], commands.reshape(-1, self.stages.arm.n)


def flat(table, path=""):
    rows = {}
    for key, value in table.items():
        rows |= flat(value, f"{path}{key}.") if isinstance(value, dict) else {f"{path}{key}": value}
    return rows


def line(name, value):
    """A parameter as drive_plugin reads it, with the type that ROS finds in the YAML."""
    values = value if isinstance(value, list) else [value]
    types = {type(each) for each in values}
    assert len(types) == 1, f"{name}: ROS refuses lists of several types"
    kind = {float: "doubles", str: "strings", int: "int"}[types.pop()]
    return f"{name} {kind} {len(values)} {' '.join(map(str, values))}\n"


@pytest.fixture(scope="module")
def plugins(tmp_path_factory):
    """Plugins of `LOOPS`, made when a test first asks for one."""
    found = {}

    def plugin(which, gains=()):
        if which not in found:
            found[which] = made(tmp_path_factory.mktemp("package"), LOOPS[which](), gains)
        return found[which]

    return plugin


def made(folder, scenario, gains=()):
    gcc, gxx = compiler("gcc"), compiler("g++")
    exported = aw.export.export_ros2(scenario, folder, gains=gains)
    assert all(path.is_file() for path in exported.paths)
    assert exported.comparison is not None
    name = package_name(f"{scenario.arm.name} controller")
    build([gcc, *BITS, *STRICT, "-c", folder / f"src/{name}.c", "-o", folder / "c.o"])
    sources = [folder / f"src/{name}_plugin.cpp", HERE / "drive_plugin.cpp", folder / "c.o"]
    flags = ["-std=c++17", "-O1", *STRICT, f"-I{HERE / 'include'}", f"-I{folder / 'src'}"]
    build([gxx, *flags, *sources, "-o", folder / "drive"])
    stages = ControllerStages.of(scenario, name, gains)
    seen = record(stages, min(scenario.ticks, TICKS))
    y, r, first = seen.y, seen.r, seen.y_begin
    states = [stages.measured.place(signal) for signal in state_interfaces(stages)]
    wanted = [stages.reference.place(signal) for signal in reference_interfaces(stages)]
    begin = np.concatenate([*(first[place] for place in states), *(r[0, place] for place in wanted), seen.u_begin])
    rows = np.hstack([*(y[:, place] for place in states), *(r[:, place] for place in wanted), seen.u])
    table = yaml.safe_load((folder / "config/controllers.yaml").read_text(encoding="utf-8"))
    return Plugin(folder, stages, table, np.vstack([begin, rows]), seen.u)


@pytest.mark.parametrize("which", LOOPS)
@pytest.mark.sample(1)
def test_the_plugin_commands_the_bits_of_the_simulation(plugins, which):
    """Also `applied` is its own: the limited commands that were sent, as late as the loop's timing says."""
    plugin = plugins(which)
    code, errors, names, commands = plugin.drive()
    assert (code, errors) == (0, "")
    limit = plugin.stages.limits
    expected = np.clip(plugin.u, -limit, limit)
    assert np.abs(expected).max() > 0.0
    np.testing.assert_array_equal(commands[:-1], expected)
    np.testing.assert_array_equal(commands[-1], 0.0)  # deactivated
    kind = plugin.stages.arm.coordinates[0].drive.command
    joint = plugin.stages.arm.names[0]
    assert names[0] == f"{joint}/position"
    assert f"{joint}/{ {'torque': 'effort'}.get(kind, kind) }" in names
    assert f"law/{joint}/position" in names


def test_alone_it_holds_the_pose_of_its_start(plugins):
    plugin = plugins("pid")
    n = plugin.stages.arm.n
    rows = plugin.rows.copy()
    rows[:, 2 * n : 3 * n] = rows[0, :n]
    rows[:, 3 * n : 4 * n] = 0.0
    held, alone = plugin.drive(rows), plugin.drive(plugin.rows, scene="alone")
    assert held[0] == alone[0] == 0
    np.testing.assert_array_equal(alone[3], held[3])
    assert np.abs(held[3] - plugin.drive()[3]).max() > 0.1


@pytest.mark.study
def test_parameters_of_the_file_count(tmp_path):
    law = aw.JointPID(kp=20.0, kd=0.0, ki=0.0)
    plugin = made(tmp_path, pid_loop(controller=law), gains=("kp",))
    usual, doubled = plugin.drive()[3], plugin.drive(changes={"gains.kp": [40.0, 40.0]})[3]
    np.testing.assert_array_equal(doubled, 2.0 * usual)
    most = float(0.4 * np.abs(usual).max())
    limited = plugin.drive(changes={"limits.command_limit": [most, most]})[3]
    np.testing.assert_array_equal(limited, np.clip(usual, -most, most))
    rows = plugin.rows.copy()
    rows[0, -2:] = (1.25, -0.5)  # the command in force
    rows[1, 2:4] = rows[0, :2]  # a reference that begins at the pose
    taken = plugin.drive(rows, changes={"take_over_ticks": 50})[3]
    np.testing.assert_allclose(taken[0], rows[0, -2:], atol=1e-12)
    np.testing.assert_array_equal(taken[60:], usual[60:])


BAD_PARAMETERS = {
    "missing": ({"limits.velocity": None}, CONFIGURE, "parameter 'limits.velocity' is missing: expected 2"),
    "short": ({"limits.velocity": [1.0]}, CONFIGURE, "'limits.velocity' has another number of values: expected 2"),
    "nan": ({"limits.velocity": [1.0, float("nan")]}, CONFIGURE, "has the value nan: expected numbers of 0 or more"),
    "negative": ({"limits.command_limit": [1.0, -2.0]}, CONFIGURE, "has the value -2: expected numbers of 0 or more"),
    "type": ({"limits.velocity": ["a", "b"]}, INIT, "parameters of another type"),
    "no joints": ({"joints": None}, CONFIGURE, "parameter 'joints' has 0 names: expected 2 different ones"),
    "twice": ({"joints": ["elbow", "elbow"]}, CONFIGURE, "expected 2 different ones"),
    "order": ({"joints": ["elbow", "shoulder"]}, CONFIGURE, "in another order: 'shoulder' must come first"),
    "ticks": ({"take_over_ticks": -1}, CONFIGURE, "'take_over_ticks' = -1: expected 0 or more"),
}


@pytest.mark.parametrize("which", BAD_PARAMETERS)
def test_bad_parameters_are_refused_with_their_name(plugins, which):
    changes, code, text = BAD_PARAMETERS[which]
    found, errors, _, commands = plugins("pid").drive(changes=changes)
    assert found == code
    assert text in errors
    assert len(commands) == 0


def test_what_goes_wrong_while_it_runs_returns_an_error(plugins):
    plugin, n = plugins("pid"), 2
    for row, column, code, text in (
        (0, 0, ACTIVATE, "state interface shoulder/position is infinite or not a number"),
        (20, n, UPDATE, "state interface shoulder/velocity is infinite or not a number"),
        (20, 2 * n + 1, UPDATE, "elbow/position is infinite or not a number"),
    ):
        rows = plugin.rows.copy()
        rows[row, column] = np.nan
        found, errors, _, commands = plugin.drive(rows)
        assert (found, text in errors, errors.count("\n")) == (code, True, 1)
        if code == UPDATE:
            np.testing.assert_array_equal(commands[19], commands[18])  # the last command stays until it is deactivated
            np.testing.assert_array_equal(commands[-1], 0.0)
    assert "expected 1000 Hz" in plugin.drive(rate=100)[1]
    found, errors, *_ = plugin.drive(scene="wrong-names")
    assert (found, "is a joint's name wrong?" in errors) == (ACTIVATE, True)


def test_other_names_of_joints_are_claimed(plugins):
    names = plugins("pid").drive(changes={"joints": ["left_shoulder", "left_elbow"]})[2]
    assert names[:2] == ["left_shoulder/position", "left_elbow/position"]
    assert "law/left_elbow/velocity" in names


@pytest.mark.study
def test_files_of_the_package_agree(plugins):
    plugin = plugins("cascade")
    folder, name = plugin.folder, plugin.stages.name
    package = ElementTree.parse(folder / "package.xml").getroot()
    assert package.findtext("name") == name
    wanted = set(re.findall(r"find_package\((\w+)", (folder / "CMakeLists.txt").read_text()))
    assert wanted == {each.text for each in (*package.findall("buildtool_depend"), *package.findall("depend"))}
    library = ElementTree.parse(folder / f"{name}_plugin.xml").getroot()
    manager = plugin.table["controller_manager"]["ros__parameters"]
    assert library.attrib["path"] == name
    assert library[0].attrib["name"] == manager[name]["type"] == f"{name}/Controller"
    assert manager["update_rate"] == 250
    exported = [each.removeprefix("law/") for each in plugin.drive()[2] if each.startswith("law/")]
    front = plugin.table["arm_controller"]["ros__parameters"]
    asked = {f"{joint}/{kind}" for joint in front["command_joints"] for kind in front["command_interfaces"]}
    assert asked == {f"{name}/{each}" for each in exported}
    robot = ElementTree.parse(folder / "urdf/lwa4p.urdf").getroot()
    joints = {each.attrib["name"]: each for each in robot.findall("ros2_control/joint")}
    limits = plugin.table[name]["ros__parameters"]["limits"]
    claimed = [each.rsplit("/", 1) for each in plugin.drive()[2] if not each.startswith("law/")]
    for k, body in enumerate(plugin.stages.arm.coordinates):
        (command,) = joints[body.joint].findall("command_interface")
        assert command.attrib["name"] == "current"
        most = float(next(each.text for each in command.findall("param") if each.attrib["name"] == "max"))
        assert limits["command_limit"][k] <= most == float(body.limits.current)
        states = {each.attrib["name"] for each in joints[body.joint].findall("state_interface")}
        assert {kind for joint, kind in claimed if joint == body.joint} <= states | {"current"}


def test_cmake_builds_it_and_its_selftest_passes(plugins, tmp_path):
    """With packages of the names that it looks for, which have the headers of this folder."""
    cmake, folder = compiler("cmake"), plugins("pid").folder
    for package in ("controller_interface", "hardware_interface", "pluginlib", "rclcpp", "rclcpp_lifecycle"):
        target = f"{package}::{package}"
        text = (
            f"add_library({target} INTERFACE IMPORTED)\ntarget_include_directories({target} INTERFACE {HERE}/include)\n"
        )
        (tmp_path / f"{package}Config.cmake").write_text(text)
    macro = "function(pluginlib_export_plugin_description_file)\nendfunction()\n"
    (tmp_path / "pluginlibConfig.cmake").write_text((tmp_path / "pluginlibConfig.cmake").read_text() + macro)
    (tmp_path / "ament_cmakeConfig.cmake").write_text("include(CTest)\nfunction(ament_package)\nendfunction()\n")
    place = ["-B", str(tmp_path / "build"), "-S", str(folder), f"-DCMAKE_PREFIX_PATH={tmp_path}"]
    folders = [f"-D{each.stem.removesuffix('Config')}_DIR={tmp_path}" for each in tmp_path.glob("*Config.cmake")]
    for words in (
        [*place, *folders, f"-DCMAKE_INSTALL_PREFIX={tmp_path}/at"],
        ["--build", str(tmp_path / "build"), "--target", "all", "test", "install"],
    ):
        done = subprocess.run([cmake, *words], capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert "100% tests passed" in done.stdout
    assert (tmp_path / "at/lib/libtwo_link_controller.so").is_file()
    assert (tmp_path / "at/share/two_link_controller/config/controllers.yaml").is_file()
    nm = shutil.which("nm")
    if nm is not None:
        shown = subprocess.run(
            [nm, "-uC", tmp_path / "at/lib/libtwo_link_controller.so"], capture_output=True, text=True
        )
        assert "operator new" in shown.stdout
        assert not re.search("mutex|pthread|sem_", shown.stdout)


def test_names_of_packages_are_those_of_ros():
    assert package_name("UR5 -- controller") == "ur5_controller"
    assert package_name("2-link") == "arm_2_link"


class Around:
    """A reference of the end effector's height, which no joint has."""

    def signals(self, arm):
        return (aw.Signal("height", "m", (1,)),)

    def __call__(self, t):
        return {"height": scalar.array([scalar.sin(t)])}


def follows_height(t, r, y):
    return scalar.array([r.height[0] - q for q in y.q])


def test_refusals_name_the_place(tmp_path):
    arm = aw.load("two-link")
    for source, options, error, text in (
        (
            replace(pid_loop(), duration=0.3, loop=replace(pid_loop().loop, period=3e-3)),
            {},
            ScenarioError,
            r"loop.period = 0.003: expected 1/N s",
        ),
        (pid_loop(), {"rate": 100}, ModelError, "rate = 100: goes with an arm"),
        (pid_loop(), {"command": "effort"}, ModelError, "command = 'effort': goes with an arm"),
        (pid_loop(), {"gains": ("kq",)}, ScenarioError, "gains = 'kq'"),
        (arm, {"gains": ("kp",)}, ModelError, "gains = .*: goes with a scenario"),
        (arm, {"name": "law"}, ModelError, "name = 'law': goes with a scenario"),
        (aw.Scenario(arm, duration=0.1), {}, ScenarioError, "no controller"),
        (pid_loop(controller=follows_height, reference=Around()), {}, ScenarioError, "reference: has height"),
    ):
        with pytest.raises(error, match=text):
            aw.export.export_ros2(source, tmp_path / "out", **options)
        assert not (tmp_path / "out").exists()


def test_the_command_writes_a_package(tmp_path):
    path = tmp_path / "hold.scenario.toml"
    aw.write_scenario(pid_loop(reference=[0.1, 0.2]), path)
    result = CliRunner().invoke(
        app, ["export", "ros2", str(path), "-o", str(tmp_path / "pkg"), "--gains", "kp", "--name", "My Law"]
    )
    assert result.exit_code == 0, result.output
    assert "package.xml" in result.output
    assert "not under ROS 2" in result.output
    assert json.loads((tmp_path / "pkg/config/controllers.yaml").read_text().split("kp: ")[1].split("\n")[0]) == [
        20.0,
        20.0,
    ]
    assert (tmp_path / "pkg/src/my_law_plugin.cpp").is_file()
    result = CliRunner().invoke(app, ["export", "ros2", str(path), "-o", str(tmp_path / "no"), "--update-rate", "10"])
    assert (result.exit_code, result.output.count("\n")) == (2, 1)
    assert "--update-rate = 10: goes with an arm" in result.output

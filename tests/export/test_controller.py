"""Controllers as C: the bits of the simulation in everything that goes wrong, clean under strict compilers, refusals."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
import subprocess
import tempfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

import armwright as aw
from armwright.errors import ModelError, OutputError, ScenarioError
from armwright.export.controller.footprint import footprint
from armwright.export.controller.header import STATUS
from armwright.export.controller.recording import record
from armwright.export.controller.sil import relative_error, software_in_the_loop
from armwright.export.controller.stages import ControllerStages
from armwright.export.controller.write import WRITTEN
from armwright.program import interpret
from export import random_loops
from export.controllers import CONTROLLERS, EXAMPLES
from export.cortex import meter, run_on_board
from export.random_loops import compared, loops
from export.running import pid_loop, run_c
from kernels.c_compilers import BITS, STRICT, build, compiler
from physics.arms import arm
from raises_at import raises_at

TICKS = 10_000
SATURATED, OUT_OF_RANGE, NOT_FINITE, LOST, TIME = (1 << k for k in range(len(STATUS)))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A loop of `CONTROLLERS`, exported when a test first asks for it."""
    compiler("gcc")

    @functools.cache
    def controller(which: str):
        return aw.export.export_controller(CONTROLLERS[which](TICKS), tmp_path_factory.mktemp(which))

    return controller


@pytest.mark.parametrize("which", CONTROLLERS)
@pytest.mark.sample(1)
def test_every_command_has_the_bits_of_the_simulation(exported, which):
    """Through saturation, lost samples, jitter, spikes of the encoders and blows on the tip."""
    comparison = exported(which).comparison
    assert comparison.ticks == TICKS
    assert comparison.others == 0
    assert comparison.error == 0.0
    status = comparison.status
    assert 0.001 < (status & SATURATED > 0).mean() < 0.6
    assert 0.01 < (status & LOST > 0).mean() < 0.1
    assert not (status & NOT_FINITE).any()


@pytest.mark.study
def test_the_recording_is_the_simulation():
    """What is compared with is what `simulate` gives: measurements, references and commands."""
    scenario = CONTROLLERS["voltage_loop"](300)
    recording, run = record(ControllerStages.of(scenario), 300), aw.simulate(scenario)
    assert np.array_equal(recording.u, run["u_issued"].values[:300])
    assert np.array_equal(recording.y[:, :6], run["q_measured"].values[:300])
    assert np.array_equal(recording.r[:, 6:12], run["qd_reference"].values[:300])
    repeated = (recording.y[1:, :6] == recording.y[:-1, :6]).all(axis=1)
    assert repeated[recording.lost[1:]].all()
    assert 0 < recording.lost.sum() < 30


def test_a_wrong_number_is_found(tmp_path):
    """Another gain in the code, and the comparison and the self-test say so."""
    compiler("gcc")
    stages = ControllerStages.of(pid_loop())
    exported = aw.export.export_controller(pid_loop(), tmp_path)
    code = exported.paths[1]
    code.write_text(re.sub(r"\b20\.0\b", "20.0000000000001", code.read_text()))
    found = software_in_the_loop(stages, record(stages, 50), tmp_path)
    assert found.others > 0
    assert found.first is not None
    assert 0.0 < found.error < 1e-9
    build([compiler("gcc"), *BITS, *tmp_path.glob("*.c"), "-o", tmp_path / "selftest", "-lm"])
    done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stdout.endswith("two_link_controller: FAILED\n")


def test_inputs_that_are_not_finite_change_nothing(tmp_path):
    """The law's state and the command stay, and the next good sample goes on from them."""
    name = aw.export.export_controller(pid_loop(), tmp_path, ticks=20).name
    body = f"""
    uint32_t status;
    double before;
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    y.q[0] = 0.1;
    (void)STEP;
    before = u.u[0];
    y.q[1] = NAN;
    status = STEP;
    printf("%u %d %d ", (unsigned)status, u.u[0] == before, (int)state.tick);
    y.q[1] = 0.0;
    r.q[0] = INFINITY;
    printf("%u ", (unsigned)STEP);
    r.q[0] = 0.0;
    y.lost = 1;
    y.q[0] = NAN;
    status = STEP;
    printf("%u %u ", (unsigned)status, (unsigned)state.lost);
    status = STEP;
    printf("%u %u ", (unsigned)status, (unsigned)state.lost);
    y.lost = 0;
    y.q[0] = 100.0;
    status = STEP;
    printf("%u %u", (unsigned)status, (unsigned)state.lost);"""
    words = [int(word) for word in run_c(tmp_path, name, body)]
    assert words[:8] == [NOT_FINITE, 1, 2, NOT_FINITE, LOST, 1, LOST, 2]
    assert words[8] & LOST == 0
    assert words[9] == 0


def test_the_status_tells_of_limits(tmp_path):
    """A position beyond its joint's limits, and a command that asks for more than the filter lets through."""
    model = arm("puma560")
    loop = {"controller": aw.JointPID(kp=100.0), "command_filter": aw.CommandFilter(limit=20.0, rate=1e3)}
    name = aw.export.export_controller(pid_loop(model, **loop), tmp_path, ticks=5).name
    low, _ = model.coordinates[0].limits.position
    body = f"""
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    printf("%u ", (unsigned)STEP);
    y.q[0] = {low - 0.01};
    r.q[0] = {low - 0.01};
    printf("%u ", (unsigned)STEP);
    y.q[0] = 0.0;
    r.q[0] = 0.0;
    r.q[1] = 0.005;
    printf("%u ", (unsigned)STEP);
    r.q[1] = 0.1;
    printf("%u ", (unsigned)STEP);
    printf("%.17g", u.u[1]);"""
    assert run_c(tmp_path, name, body) == ["0", str(OUT_OF_RANGE), "0", str(SATURATED), "1.5"]


def test_reset_begins_anew_from_the_last_command(tmp_path):
    """The rate limit goes on from it; init takes the command that it is given."""
    loop = {"controller": lambda t, r, y: 10.0 * r.q, "command_filter": aw.CommandFilter(rate=1e3)}
    name = aw.export.export_controller(pid_loop(**loop), tmp_path, ticks=5).name
    body = f"""
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    r.q[0] = 10.0;
    (void)STEP;
    (void)STEP;
    printf("%.17g ", u.u[0]);
    {name}_reset(&state, &{name}_default_parameters, &y);
    printf("%d ", (int)state.tick);
    (void)STEP;
    printf("%.17g ", u.u[0]);
    u.u[0] = -5.0;
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    (void)STEP;
    printf("%.17g", u.u[0]);"""
    assert run_c(tmp_path, name, body) == ["2", "0", "3", "-4"]


def test_the_watchdog_hook_is_served_every_step(tmp_path):
    name = aw.export.export_controller(pid_loop(), tmp_path, ticks=5).name
    (tmp_path / "hook.h").write_text("extern unsigned served, unwell;\n")
    (tmp_path / "hook.c").write_text("unsigned served = 0u, unwell = 0u;\n")
    hook = f"-D{name.upper()}_WATCHDOG(state)=(served++, unwell += ((state)->status != 0u))"
    body = f"""
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    (void)STEP;
    y.lost = 1;
    (void)STEP;
    printf("%u %u", served, unwell);"""
    flags = (hook, "-include", tmp_path / "hook.h", tmp_path / "hook.c")
    assert run_c(tmp_path, name, body, *flags) == ["2", "1"]


def test_gains_become_parameters(tmp_path):
    """With their values the bits are those of the simulation with a batch of one; with others the command is another one."""
    compiler("gcc")
    exported = aw.export.export_controller(pid_loop(), tmp_path, gains=("kp", "kd"), ticks=100)
    name = exported.name
    assert exported.comparison is not None
    assert "double kp[2]; /* the controller's */" in exported.paths[0].read_text()
    body = f"""
    {name}_parameters mine = {name}_default_parameters;
    {name}_init(&state, &mine, &y, &u);
    r.q[0] = 1.0;
    (void){name}_step(&state, &mine, &r, &y, &u);
    printf("%.17g ", u.u[0]);
    mine.kp[0] *= 2.0;
    {name}_init(&state, &mine, &y, &u);
    (void){name}_step(&state, &mine, &r, &y, &u);
    printf("%.17g", u.u[0]);"""
    first, second = map(float, run_c(tmp_path, name, body))
    assert first == 20.0
    assert second == 40.0


def test_the_header_serves_cpp_and_names_units(exported, tmp_path):
    header = exported("cascade").paths[0]
    text = header.read_text(encoding="ascii")
    for line in ("double q[6]; /* [rad] measured position */", "double u[6]; /* [A] drive command */"):
        assert line in text
    assert "#define LWA4P_CONTROLLER_PERIOD 0.004 /* [s] */" in text
    (tmp_path / "user.cpp").write_text(
        '#include "lwa4p_controller.h"\nint main() { return LWA4P_CONTROLLER_JOINTS - 6; }\n'
    )
    build(
        [
            compiler("g++"),
            "-Wall",
            "-Wextra",
            "-Werror",
            "-I",
            header.parent,
            tmp_path / "user.cpp",
            "-o",
            tmp_path / "user",
        ]
    )


@pytest.mark.study
def test_it_builds_with_cmake_and_without_a_compiler(exported, tmp_path, monkeypatch):
    folder = exported("computed_torque").paths[0].parent
    for command in (["-S", folder, "-B", tmp_path], ["--build", tmp_path]):
        done = subprocess.run([compiler("cmake"), *command], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert subprocess.run([compiler("ctest"), "--test-dir", tmp_path], capture_output=True).returncode == 0
    monkeypatch.setattr("shutil.which", lambda name: None)
    without = aw.export.export_controller(pid_loop(), tmp_path / "without", ticks=5)
    assert without.comparison is None
    assert without.notes[0].startswith("no C compiler here")
    assert all(path.is_file() for path in without.paths)


STRICTER = (
    *STRICT,
    "-Wshadow",
    "-Wcast-qual",
    "-Wstrict-prototypes",
    "-Wmissing-prototypes",
    "-Wundef",
    "-Wswitch-default",
)


@pytest.mark.sample(1)
@pytest.mark.parametrize("which", ["cascade", "voltage_loop"])
@pytest.mark.parametrize("with_", ["gcc", "clang"])
def test_strict_compilers_and_sanitizers_have_nothing_to_say(exported, tmp_path, which, with_):
    """No conversion is implicit, nothing is undefined, and the self-test stays within its arrays."""
    sources = [path for path in exported(which).paths if path.suffix == ".c"]
    sanitized = ("-fsanitize=undefined,address", "-fno-sanitize-recover=all", "-O1")
    build([compiler(with_), *BITS, *STRICTER, *sanitized, *sources, "-o", tmp_path / "selftest", "-lm"])
    done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].endswith(": ok")


def test_cppcheck_has_nothing_to_say(tmp_path):
    """Of a small law: it takes minutes for the straight lines of a long one."""
    loop = {"command_filter": aw.CommandFilter(limit=20.0, rate=1e3)}
    code = aw.export.export_controller(pid_loop(**loop), tmp_path, ticks=20).paths[1]
    options = ("--std=c99", "--quiet", "--error-exitcode=1", "--enable=warning,style,performance,portability")
    options += (
        "--suppress=normalCheckLevelMaxBranches",
    )  # of newer versions: says that it looked at some branches only
    done = subprocess.run([compiler("cppcheck"), *options, code], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.sample(1)
@pytest.mark.parametrize("which", CONTROLLERS)
def test_a_microcontroller_has_the_bits_of_the_simulation(exported, tmp_path, which):
    """On an emulated Cortex-M7: the self-test's steps, the instructions of one by QEMU's count, and its stack."""
    controller = exported(which)
    sources = [path for path in controller.paths if path.suffix == ".c"]
    flags, count = meter(controller.name, WRITTEN, tmp_path), ("-icount", "shift=0")
    done = run_on_board("mps2-an500", sources, tmp_path, *flags, emulator=count)
    assert done.returncode == 0, done.stdout + done.stderr
    shown = done.stdout
    assert f"0 of {WRITTEN} commands with other bits" in shown
    found = re.search(r"(\d+) instructions a step, (\d+) bytes of stack", shown)
    assert found is not None, shown
    instructions, stack = map(int, found.groups())
    assert 500 < instructions < 40_000  # 216 MHz make a million in 5 ms
    reckoned = footprint(controller.name, {path.name: path.read_text() for path in controller.paths[:2]}).stack
    assert reckoned <= stack <= reckoned + 200  # the self-test's own frames on top


@pytest.mark.sample(1)
@pytest.mark.parametrize(("which", "most"), [("swing", 1e-5), ("voltage_loop", 1e-2)])
def test_in_float_the_commands_are_near(tmp_path, which, most):
    """By parts of their range, on the simulation's inputs; no double is left, and the self-test holds its bits in Clang, too."""
    compiler("gcc")
    scenario = aw.read_scenario(EXAMPLES / "swing.scenario.toml") if which == "swing" else CONTROLLERS[which](1000)
    controller = aw.export.export_controller(scenario, tmp_path, real="float")
    assert controller.comparison is not None
    assert 1e-9 < controller.comparison.error < most
    assert "double" not in re.sub(
        r"/\*.*?\*/", "", controller.paths[1].read_text().replace("typedef char", ""), flags=re.S
    )
    sources = [path for path in controller.paths if path.suffix == ".c"]
    build([compiler("clang"), *BITS, *STRICTER, "-Wdouble-promotion", *sources, "-o", tmp_path / "selftest", "-lm"])
    done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


@pytest.mark.study
def test_nothing_is_allocated_and_nothing_recurses(exported):
    """Only functions of <math.h> and memcpy are called from outside; a function calls those that stand before it."""
    code = exported("computed_torque").paths[1]
    text = re.sub(r"/\*.*?\*/", "", code.read_text(), flags=re.DOTALL)
    assert not re.search(r"\b(malloc|calloc|free|goto|while|setjmp)\b", text)
    known: set[str] = set()
    heads = r"^(?:static )?(?:NEVER_INLINED )?(?:void|double|int|uint32_t|uint64_t) (\w+)\([^;{]*\)\n\{\n(.*?)^\}"
    for head, body in re.findall(heads, text, re.M | re.S):
        called = {name for name in re.findall(r"\b(cmu_dd_controller_\w+)\(", body) if not name.endswith("_unsafe")}
        assert called <= known, head
        known.add(head)
    assert {"cmu_dd_controller_init", "cmu_dd_controller_reset", "cmu_dd_controller_step"} <= known


@pytest.mark.study
@settings(max_examples=2, deadline=None)
@given(loops())
def test_any_controller_of_the_library_s_blocks_has_the_bits_of_its_simulation(scenario):
    """The export itself compares; tools/random_controllers.py does it to as many as there is time for."""
    compiler("gcc")
    with tempfile.TemporaryDirectory() as folder:
        comparison = compared(scenario, folder)
    assert comparison is None or comparison.others == 0
    assert comparison is None or comparison.ticks == random_loops.TICKS


def branching(t, r, y):
    return -y.q if y.q[0] > 0.0 else y.q


def with_math(t, r, y):
    return np.array([math.sin(q) for q in y.q])


class Vectorised:
    vectorised = True

    def step(self, t, r, y, s):
        return y.q, s


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"controller": branching},
            r"^loop\.controller 'branching': .*\(test_controller\.py, line \d+\): ",
        ),
        (
            {"controller": with_math},
            r"^loop\.controller 'with_math': .*\(test_controller\.py, line \d+\): ",
        ),
        ({"controller": Vectorised()}, "lanes at once; "),
        ({"controller": None}, r"^loop\.controller: no controller; "),
        (
            {"controller": aw.JointPID(kp=aw.Batch([1.0, 2.0]))},
            "^lanes: 2 lanes; .*draws$",
        ),
    ],
)
def test_what_cannot_be_exported_is_refused(tmp_path, changes, message):
    with pytest.raises(ScenarioError, match=message):
        aw.export.export_controller(pid_loop(**changes), tmp_path / "out")
    assert not list(tmp_path.iterdir())


@dataclasses.dataclass(frozen=True)
class WholeGains:
    kp: float = 20
    every: int = 2

    def init(self, arm, y):
        return np.zeros(0)

    def step(self, t, r, y, s):
        return self.kp * (r.q - y.q), s


@pytest.mark.sample(1)
@pytest.mark.parametrize("law", [aw.JointPID(kp=20, kd=2), aw.JointPID(kp=[20, 30]), WholeGains()])
def test_gains_that_are_whole_numbers_become_parameters(tmp_path, law):
    exported = aw.export.export_controller(pid_loop(controller=law), tmp_path, gains="kp", ticks=20)
    assert exported.comparison is None or exported.comparison.others == 0
    assert "    double kp" in (tmp_path / f"{exported.name}.h").read_text()
    with pytest.raises(ScenarioError, match=r"^gains = 'every': "):
        aw.export.export_controller(pid_loop(controller=WholeGains()), tmp_path, gains=("every",))


def test_a_law_that_branches_is_told_what_to_write(tmp_path):
    message = r"cannot be traced \(test_controller\.py, line \d+\): a comparison of .* known yet; expected scalar\.less\(a, b\)$"
    with pytest.raises(ScenarioError, match=message):
        aw.export.export_controller(pid_loop(controller=branching), tmp_path)


def test_other_refusals(tmp_path):
    for options in ({"ticks": 0}, {"ticks": 1.5}, {"ram": "1k"}):
        (name,) = options
        with raises_at(ModelError, name, "whole number of 1 "):
            aw.export.export_controller(pid_loop(), tmp_path / "out", **options)
    with raises_at(ScenarioError, "scenario"):
        aw.export.export_controller(arm("two-link"), tmp_path / "out")
    with raises_at(ModelError, "real", "double, float$", value="half"):
        aw.export.export_controller(pid_loop(), tmp_path / "out", real="half")
    with raises_at(ScenarioError, "loop.controller", "no controller"):
        aw.export.export_controller(aw.Scenario(arm("two-link"), duration=1.0, command=[0.0, 0.0]), tmp_path / "out")
    with pytest.raises(ScenarioError, match=r"^gains = 'kq': .*\bkp\b"):
        aw.export.export_controller(pid_loop(), tmp_path / "out", gains=("kq",))
    with pytest.raises(ScenarioError, match=r"^gains = 'delay_ticks': "):
        aw.export.export_controller(pid_loop(), tmp_path / "out", gains=("delay_ticks",))
    (tmp_path / "file").write_text("")
    with raises_at(OutputError, file=tmp_path / "file"):
        aw.export.export_controller(pid_loop(), tmp_path / "file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_the_relative_error_is_in_parts_of_each_command_s_range():
    expected = np.array([[0.0, 5.0], [10.0, 5.0]])
    assert relative_error(expected + np.array([[0.1, 0.0], [0.0, 0.0]]), expected) == pytest.approx(0.01)
    assert relative_error(expected + np.array([[0.0, 0.1], [0.0, 0.0]]), expected) == pytest.approx(0.02)


@pytest.mark.parametrize("q", [[0.1, 0.1], [0.3, 0.4]])
def test_the_law_s_memory_begins_with_the_bits_of_the_simulation(q):
    """It is made of measured numbers alone, as in C: not of the pose that these are computed from, which rounds differently."""
    law = aw.Filtered(aw.ComputedTorque(kp=22.0, kd=2.5), [aw.LowPass(220.31593555201158, 0.4704730825397131)])
    stages = ControllerStages.of(replace(pid_loop(controller=law), start=q))
    begun = stages.loop.initial
    assert np.array_equal(interpret(stages.begin, begun["y"], np.zeros(0)), begun["s"])
    assert np.abs(begun["s"]).max() > 1.0

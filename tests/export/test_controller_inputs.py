"""What a firmware gives an exported controller: counts, parameters that are kept elsewhere, the command of another one."""

from __future__ import annotations

import re
import zlib
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ScenarioError
from export.controllers import CONTROLLERS
from export.running import pid_loop, run_c
from kernels.c_compilers import compiler
from raises_at import raises_at


def counted(scenario):
    """A scenario whose sensors give what its encoders count, whatever else they gave."""
    old = scenario.loop.sensors
    sensors = aw.Sensors(counts=old.counts, side=old.side, velocity=old.velocity, cutoff_hz=old.cutoff_hz)
    return replace(scenario, loop=replace(scenario.loop, sensors=sensors))


@pytest.mark.sample(1)
@pytest.mark.parametrize("which", CONTROLLERS)
def test_in_counts_every_command_has_the_bits_of_the_simulation(tmp_path, which):
    compiler("gcc")
    comparison = aw.export.export_controller(counted(CONTROLLERS[which](2000)), tmp_path, counts=True).comparison
    assert comparison is not None
    assert comparison.others == 0
    assert comparison.ticks == 2000


def test_counts_are_whole_numbers_of_the_encoders(tmp_path):
    """4096 in a turn of each joint: 1000 counts are 1000 · 2π / 4096 rad, which kp turns into the command."""
    loop = {"controller": aw.JointPID(kp=20.0), "sensors": aw.Sensors(counts=4096, side="link")}
    exported = aw.export.export_controller(pid_loop(**loop), tmp_path, counts=True)
    assert "int32_t counts[2]; /* [1]" in exported.paths[0].read_text()
    name = exported.name
    body = f"""
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    y.counts[1] = -1000;
    (void)STEP;
    printf("%.17g %.17g", u.u[0], u.u[1]);"""
    found = [float(word) for word in run_c(tmp_path, name, body)]
    assert found == pytest.approx([0.0, 20.0 * 1000 * 2.0 * np.pi / 4096], rel=1e-15)


def test_positions_that_are_no_counts_are_refused(tmp_path):
    with raises_at(ScenarioError, "loop.sensors.counts", "shoulder, elbow"):
        aw.export.export_controller(pid_loop(), tmp_path / "out", counts=True)
    with raises_at(ScenarioError, "loop.sensors.counts", "no whole counts"):
        aw.export.export_controller(CONTROLLERS["cascade"](300), tmp_path / "out", counts=True)  # its spikes are not
    assert not list(tmp_path.iterdir())


LOADER = """
    static uint8_t bytes[4096];
    static {name}_parameters mine;
    FILE *file = fopen("{path}", "rb");
    uint32_t count = (uint32_t)fread(bytes, 1u, sizeof bytes, file);
    (void)fclose(file);
    printf("%d ", {name}_load(&mine, bytes, count));"""


def test_parameters_of_another_scenario_are_loaded(tmp_path):
    """The code of one scenario, given the file of another with other gains, commands what the other one's code does."""
    files = {}
    for kp in (20.0, 35.0):
        law = aw.JointPID(kp=[kp, 10.0], kd=2.0)
        files[kp] = aw.export.export_controller(pid_loop(controller=law), tmp_path / f"{kp:g}", gains=("kp",), ticks=50)
    name, folder = files[20.0].name, tmp_path / "20"
    texts = [files[kp].paths[1].read_text() for kp in files]
    assert [line for line in texts[0].splitlines() if "20.0" not in line] == [
        line for line in texts[1].splitlines() if "35.0" not in line
    ]
    other = tmp_path / "35" / f"{name}.parameters"
    body = f"""{LOADER.format(name=name, path=other)}
    {name}_init(&state, &mine, &y, &u);
    r.q[0] = 1.0;
    (void){name}_step(&state, &mine, &r, &y, &u);
    printf("%.17g %d", u.u[0], memcmp(&mine, &{name}_default_parameters, sizeof mine) != 0);"""
    assert run_c(folder, name, body) == ["0", "35", "1"]
    own = folder / f"{name}.parameters"
    same = f"""{LOADER.format(name=name, path=own)}
    printf("%d", memcmp(&mine, &{name}_default_parameters, sizeof mine));"""
    assert run_c(folder, name, same) == ["0", "0"]


@pytest.mark.study
def test_damaged_or_foreign_parameters_change_nothing(tmp_path):
    exported = aw.export.export_controller(pid_loop(), tmp_path, gains=("kp",), ticks=20)
    name, good = exported.name, exported.paths[-1].read_bytes()
    ki = (
        aw.export.export_controller(pid_loop(), tmp_path / "ki", name=name, gains=("ki",), ticks=20)
        .paths[-1]
        .read_bytes()
    )
    damaged = bytearray(good)
    damaged[20] ^= 1
    for k, content in enumerate((good, good[:-1], bytes(damaged), ki)):
        (tmp_path / f"{k}.parameters").write_bytes(content)
    words = []
    for k in range(4):
        body = f"""{LOADER.format(name=name, path=tmp_path / f"{k}.parameters")}
    printf("%d", mine.kp[0] != 0.0);"""
        words.append(run_c(tmp_path, name, body))
    assert words == [["0", "1"], ["1", "0"], ["2", "0"], ["3", "0"]]


@pytest.mark.sample(1)
@pytest.mark.parametrize("real", ["double", "float"])
def test_parameters_that_no_controller_can_have_are_refused(tmp_path, real):
    """Each number in turn: gains are finite, limits are not negative and may be infinite, ranges of positions may be infinite."""
    compiler("gcc")
    law = aw.trajectories.ReferenceFilter(
        aw.JointPID(kp=20.0, limit=[30.0, 40.0]), velocity=2.0, acceleration=20.0, jerk=400.0
    )
    gains = ("controller.kp", "controller.limit", "velocity")
    exported = aw.export.export_controller(pid_loop(controller=law), tmp_path, gains=gains, ticks=20, real=real)
    name, good = exported.name, exported.paths[-1].read_bytes()
    dtype = np.dtype("<f8" if real == "double" else "<f4")
    numbers = np.frombuffer(good[4:-4], dtype)
    rows = {"position": 4, "limits": 4, "initial": 2, "kp": 2, "limit": 2, "velocity": 2}
    assert len(numbers) == sum(rows.values())
    kinds = np.repeat(list(rows), list(rows.values()))
    content = b""
    wrong = (np.nan, np.inf, -np.inf, -1.0)
    for k in range(len(numbers)):
        for value in wrong:
            changed = numbers.copy()
            changed[k] = value
            file = good[:4] + changed.tobytes()
            content += file + zlib.crc32(file).to_bytes(4, "little")
    (tmp_path / "all").write_bytes(content)
    body = f"""
    static uint8_t bytes[{len(good)}];
    static {name}_parameters mine;
    FILE *file = fopen("{tmp_path / "all"}", "rb");
    while (fread(bytes, sizeof bytes, 1u, file) == 1u) {{
        printf("%d ", {name}_load(&mine, bytes, {len(good)}u));
    }}
    (void)fclose(file);"""
    found = np.array(run_c(tmp_path, name, body), dtype=int).reshape(-1, len(wrong))
    expected = {
        "position": [4, 0, 0, 0],
        "limits": [4, 0, 5, 5],
        "initial": [4, 4, 4, 0],
        "velocity": [4, 4, 4, 5],
        "kp": [4, 4, 4, 0],
        "limit": [4, 0, 5, 5],
    }
    members = re.findall(
        r"^    (?:double|float) (\w+)\[2\]; /\* the controller's \*/", exported.paths[0].read_text(), re.M
    )
    assert members == ["controller_kp", "controller_limit", "law_velocity"]  # another member is called velocity
    assert [row.tolist() for row in found] == [expected[kind] for kind in kinds]


def test_a_command_in_force_that_is_no_number_is_taken_as_zero(tmp_path):
    """Of that joint alone, and the status says so; the rate limit, the bridge and a reset begin from it."""
    loop = {"controller": lambda t, r, y: 10.0 * r.q, "command_filter": aw.CommandFilter(rate=1e3)}
    name = aw.export.export_controller(pid_loop(**loop), tmp_path, ticks=5).name
    body = f"""
    u.u[0] = NAN;
    u.u[1] = 3.0;
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    printf("%u %g %g ", (unsigned)state.status, state.issued[0], state.issued[1]);
    r.q[0] = 1.0;
    r.q[1] = 1.0;
    (void)STEP;
    printf("%u %g %g ", (unsigned)state.status, u.u[0], u.u[1]);
    {name}_reset(&state, &{name}_default_parameters, &y);
    printf("%u ", (unsigned)state.status);
    u.u[0] = INFINITY;
    {name}_take_over(&state, &{name}_default_parameters, &r, &y, &u, 10u);
    printf("%u ", (unsigned)state.status);
    (void)STEP;
    printf("%u %g %g", (unsigned)state.status, u.u[0], u.u[1]);"""
    assert run_c(tmp_path, name, body) == ["4", "0", "3", "1", "1", "4", "0", "4", "0", "0", "4"]


def test_a_measurement_that_is_no_number_cannot_be_begun_from(tmp_path):
    """The law's memory would be none: the status says so until `init` is called with another one."""
    law = aw.JointPID(kp=20.0, kd=1.0, cutoff_hz=50.0)
    name = aw.export.export_controller(pid_loop(controller=law), tmp_path, ticks=5).name
    body = f"""
    y.q[1] = NAN;
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    printf("%u ", (unsigned)state.status);
    y.q[1] = 0.0;
    printf("%u ", (unsigned)STEP);
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    printf("%u %u", (unsigned)state.status, (unsigned)STEP);"""
    assert run_c(tmp_path, name, body) == ["4", "4", "0", "0"]


def test_it_takes_over_without_a_jump(tmp_path):
    """The first command is the one in force; the difference goes away evenly, and the law's integrator sees nothing of it."""
    law = aw.JointPID(kp=20.0, ki=40.0, limit=[30.0, 30.0], anti_windup="clamping")
    name = aw.export.export_controller(pid_loop(controller=law), tmp_path, ticks=20).name
    body = f"""
    static {name}_state plain;
    {name}_command other = {{{{0.0}}}};
    int k;
    r.q[0] = 0.5;
    r.q[1] = -0.2;
    u.u[0] = 3.0;
    u.u[1] = -1.0;
    {name}_take_over(&state, &{name}_default_parameters, &r, &y, &u, 10u);
    {name}_init(&plain, &{name}_default_parameters, &y, &u);
    memcpy(y.applied, u.u, sizeof y.applied);
    memcpy(other.u, u.u, sizeof other.u);
    for (k = 0; k < 15; k++) {{
        memcpy(y.applied, u.u, sizeof y.applied);
        (void)STEP;
        memcpy(y.applied, other.u, sizeof y.applied);
        (void){name}_step(&plain, &{name}_default_parameters, &r, &y, &other);
        printf("%.17g %.17g ", u.u[0], other.u[0]);
    }}"""
    ours, plain = np.array([float(word) for word in run_c(tmp_path, name, body)]).reshape(15, 2).T
    assert ours[0] == pytest.approx(3.0, rel=1e-15)
    assert plain[0] == pytest.approx(10.0)  # kp (0.5 - 0)
    np.testing.assert_allclose(ours - plain, -7.0 * np.clip(1.0 - np.arange(15) / 10.0, 0.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(np.diff(plain), 40.0 * 0.5 * 1e-3, rtol=1e-9)  # ki e T: clamping holds nothing up


@pytest.mark.sample(1)
@pytest.mark.parametrize("with_", ["arm-none-eabi-gcc", "gcc"])
def test_a_controller_that_does_not_fit_is_refused(tmp_path, monkeypatch, with_):
    """Its state is what its struct holds, its stack no less than the arrays of a step; limits below either are refused."""
    compiler("arm-none-eabi-gcc")
    monkeypatch.setattr("armwright.export.controller.footprint.CROSS", with_ if with_ != "gcc" else "nowhere-gcc")
    exported = aw.export.export_controller(pid_loop(), tmp_path / "c", ram=100_000, flash=100_000, ticks=5)
    took = exported.footprint
    assert took is not None
    body = 'printf("%d %d", (int)sizeof state, (int)(sizeof y + sizeof r + sizeof u + sizeof(two_link_controller_parameters)));'
    state, structs = map(int, run_c(tmp_path / "c", exported.name, body))
    assert (took.state, took.structs) == (state, structs)
    assert took.ram == took.state + took.structs + took.stack
    assert 8 * (6 + 8 + 2) + state < took.stack < 4000  # r, y, u_asked and the next state
    assert 1000 < took.flash < 10_000
    assert with_ in took.target
    for limit in ({"ram": took.ram - 1}, {"flash": took.flash - 1}):
        with raises_at(ModelError, next(iter(limit)), r"[\d,]+ bytes of RAM \(state "):
            aw.export.export_controller(pid_loop(), tmp_path / "out", **limit, ticks=5)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["gravity", "anti_windup"])
def test_what_is_no_number_is_no_parameter(tmp_path, name):
    with raises_at(ScenarioError, "gains", "kp", value=name):
        aw.export.export_controller(pid_loop(controller=aw.JointPID(kp=20.0)), tmp_path, gains=[name])


def test_gains_of_an_inner_controller_become_parameters(tmp_path):
    """Of a PID within feed-forward: the bits of a batch of one, and the names of where they stand."""
    compiler("gcc")
    law = aw.FeedForward(aw.JointPID(kp=20.0, kd=2.0), inertia="full")
    exported = aw.export.export_controller(pid_loop(controller=law), tmp_path, gains=("kp", "inner.kd"), ticks=100)
    assert exported.comparison is not None
    text = exported.paths[0].read_text()
    assert "double inner_kp; /* the controller's */" in text or "double inner_kp[2]; /* the controller's */" in text
    assert "inner_kd" in text
    with pytest.raises(ScenarioError, match=r"^gains = 'kq': .*\binner\.kp\b"):
        aw.export.export_controller(pid_loop(controller=law), tmp_path / "out", gains=("kq",))

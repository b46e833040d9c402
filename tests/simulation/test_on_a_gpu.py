"""Simulations on a GPU: the CUDA text, run on this processor, has the bits of the compiled loop; NVRTC takes it."""

from __future__ import annotations

import importlib.util
import itertools
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ArmwrightError, DivergenceError, ModelError, ScenarioError
from armwright.kernels import cuda_loop
from armwright.kernels.cuda_device import Gpu, cubin, nvrtc_can
from armwright.kernels.cuda_loop_printer import cuda_loop_source
from armwright.simulation import Simulation
from armwright.simulation.loop.compiled import compile_loop
from armwright.simulation.loop_runner import LoopRunner
from kernels.fake_cuda import FakeCuda
from physics.arms import arm

LANES = 40  # one warp and a quarter
NVRTC = all(importlib.util.find_spec(name) is not None for name in ("cuda", "cuda.bindings"))


@pytest.fixture
def gpu(tmp_path, monkeypatch) -> FakeCuda:
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", str(tmp_path / "cache"))
    return FakeCuda(tmp_path).install(monkeypatch)


def on(scenario: aw.Scenario, device: str = "cuda") -> aw.Scenario:
    return replace(scenario, solver=replace(scenario.solver, device=device))


def rows(n: int, seed: int, size: float = 1.0) -> aw.Batch:
    return aw.Batch(size * np.random.default_rng(seed).normal(size=(LANES, n)))


def pid(n: int) -> aw.JointPID:
    return aw.JointPID(kp=[100.0] * n, ki=[5.0] * n, kd=[10.0] * n)


def assert_same_bits(scenario: aw.Scenario) -> None:
    here, there = aw.simulate(scenario), aw.simulate(on(scenario))
    assert set(here.data_vars) == set(there.data_vars)
    for name, values in here.data_vars.items():
        assert np.array_equal(values, there[name], equal_nan=True), name
    assert here.attrs.get("notes") == there.attrs.get("notes")
    assert '"device": "cuda"' in there.attrs["made_with"]
    assert "device" not in here.attrs["made_with"]


def controlled() -> aw.Scenario:
    """A joint controller, its reference a table; motors of the record."""
    loop = aw.Loop(pid(6), aw.trajectories.Quintic([0.0] * 6, [0.3] * 6, duration=0.03), period=0.002)
    return aw.Scenario(arm("cmu-dd"), 0.04, start=rows(6, 0, 0.2), loop=loop, solver=aw.Solver(substeps=4))


def noisy() -> aw.Scenario:
    """Noise, delays by lane, jitter, losses, a mass by lane; a reduction beside the rows."""
    timing = aw.Timing(
        measurement_delay=aw.Batch(np.linspace(0.0, 0.004, LANES)), command_delay=0.0012, command_loss=0.1,
        measurement_loss=0.05, jitter=1e-4,
    )  # fmt: skip
    loop = aw.Loop(pid(6), [0.1] * 6, period=0.001, timing=timing, sensors=aw.Sensors(position_noise=1e-3))
    return aw.Scenario(
        arm("puma560"), 0.04, start=rows(6, 1, 0.2), vary={"link3.mass_kg": aw.Batch(np.linspace(5.0, 7.0, LANES))},
        loop=loop, solver=aw.Solver(substeps=2), seed=2**40 + 3,
        recording=aw.Recording(every=4, reduce=("rms_error", "peak_voltage")),
    )  # fmt: skip


def scheduled(solver: aw.Solver) -> aw.Scenario:
    """Every lane's own schedule, and a wrench for all."""
    model = arm("two-link")
    numbers = np.random.default_rng(2).normal(size=(LANES, 3, 2))
    own = [
        aw.Schedule(np.array([0.0, 0.0113, 0.02 + 3e-4 * k]), each, tuple(model.names))
        for k, each in enumerate(numbers)
    ]
    push = aw.Schedule(np.array([0.0, 0.0077]), numbers[:2].reshape(2, 6), ("fx", "fy", "fz", "mx", "my", "mz"))
    return aw.Scenario(model, 0.03, command=aw.Batch(own), inputs=aw.Inputs(wrench=push), solver=solver)


def commanded(name: str, solver: aw.Solver) -> aw.Scenario:
    model = arm(name)
    return aw.Scenario(model, 0.02, command=rows(model.n, 3, 2.0), solver=solver)


def sampled_auto() -> aw.Scenario:
    """Steps that every lane chooses, within the periods of a loop."""
    return replace(controlled(), duration=0.02, solver=aw.Solver())


QUICK: dict[str, Callable[[], aw.Scenario]] = {
    "a controller": controlled,
    "noise and delays": noisy,
    "schedules, RK4": lambda: scheduled(aw.Solver("rk4")),
    "schedules, own steps": lambda: scheduled(aw.Solver()),
    "a controller, own steps": sampled_auto,
    "one lane, state alone": lambda: aw.Scenario(
        arm("two-link"), 0.02, command=[1.0, 2.0], recording=aw.Recording(what="state", every=0)
    ),
}
SLOW: dict[str, Callable[[], aw.Scenario]] = {
    "sticking": lambda: commanded("rough", aw.Solver("semi_implicit_euler", step=2.5e-4)),
    "sticking, own steps": lambda: commanded("rough", aw.Solver()),
    "servos": lambda: commanded("open-manipulator-x", aw.Solver("rk3", step=2.5e-4)),
    "servos, own steps": lambda: commanded("open-manipulator-x", aw.Solver()),
    "mimic joints": lambda: commanded("gripper", aw.Solver("rk4", step=2.5e-4)),
    "a stiff rule": lambda: commanded("workshop", aw.Solver("rodas3")),
}


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", QUICK)
def test_a_run_has_the_bits_of_the_cpu_s(gpu, name):
    assert_same_bits(QUICK[name]())
    assert gpu.launches[-1] == ("loop", 1, 128, 0)
    assert not gpu.memory  # all given back


@pytest.mark.study
@pytest.mark.parametrize("name", SLOW)
def test_what_sticks_and_what_turns_by_itself_has_the_bits_of_the_cpu_s(gpu, name):
    assert_same_bits(SLOW[name]())


def test_few_rows_wait_on_the_gpu(gpu, monkeypatch):
    """A launch ends where its rows fill the room; no thread depends on the order of its warp."""
    scenario = on(replace(controlled(), recording=aw.Recording(every=2)))
    expected, launches = aw.simulate(scenario), len(gpu.launches)
    monkeypatch.setattr(cuda_loop, "MOST_RECORDED", 3 * 8 * 64 * 36)  # 36 numbers of two warps, three rows
    gpu.backwards = True
    found = aw.simulate(scenario)
    assert len(gpu.launches) > launches + 3
    for name, values in expected.data_vars.items():
        assert np.array_equal(found[name], values, equal_nan=True), name


def test_a_lane_that_diverges_is_frozen(gpu):
    start = aw.Start(qd=aw.Batch([[0.0, 0.0], [1e200, 0.0], [1.0, 1.0]]))
    scenario = aw.Scenario(arm("two-link"), 0.01, command=[0.0, 0.0], start=start, solver=aw.Solver("rk3"))
    assert_same_bits(scenario)
    single = replace(scenario, start=aw.Start(qd=[1e200, 0.0]))
    said = []
    for each in (single, on(single)):
        with pytest.raises(DivergenceError) as caught:
            aw.simulate(each)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_a_state_goes_on_where_the_other_device_left_it(gpu):
    scenario = noisy()
    whole = aw.simulate(scenario)
    first, second = Simulation(on(scenario)), Simulation(scenario)
    first.run(0.016)
    second.restore(first.state)
    rest = second.run(0.024)
    assert np.array_equal(rest["q"][:, -1], whole["q"][:, -1])
    stepped = Simulation(on(scenario))
    for _ in range(3):
        stepped.step()
    assert np.array_equal(stepped.plant_state["q"], _after(scenario, 3))


def _after(scenario: aw.Scenario, ticks: int) -> np.ndarray:
    simulation = Simulation(scenario)
    for _ in range(ticks):
        simulation.step()
    return simulation.plant_state["q"]


def follow(t, r, y):
    return np.asarray(float(y.q[0]) * r.q)  # which no trace can follow


@pytest.mark.parametrize(
    ("run", "error", "said"),
    [
        (lambda s: aw.simulate(on(s, "gpu")), ScenarioError, 'solver.device = \'gpu\': expected "cpu", "cuda"'),
        (lambda s: aw.simulate(on(s, "cuda:2")), ModelError, "device = 'cuda:2': .*1"),
        (
            lambda s: aw.simulate(on(replace(s, command=None, loop=aw.Loop(follow, [0.1, 0.1])))),
            ScenarioError, "solver.device = 'cuda': .*Python .*expected cpu",
        ),
        (
            lambda s: Simulation(on(replace(s, command=None))).step([0.0, 0.0]),
            ScenarioError, "solver.device = 'cuda': .*from outside",
        ),
        (lambda s: aw.simulate(on(replace(s, solver=aw.Solver("cvodes")))), ScenarioError, "'cvodes' runs on the CPU"),
        (
            lambda s: aw.simulate(on(replace(s, solver=aw.Solver("rk45", events={"past": lambda t, x: x.q[0] - 0.1})))),
            ScenarioError, "solver.events .*CPU",
        ),
        (
            lambda s: aw.simulation.sensitivities(on(s), ["forearm.mass_kg"]),
            ScenarioError, "solver.device = 'cuda': expected 'cpu', .*derivatives",
        ),
        (
            lambda s: aw.simulate(on(s), loop=compile_loop(s.arm)),
            ScenarioError, "device = cpu, .*cuda",
        ),
        (lambda s: aw.write_scenario(on(s), "x.scenario.toml"), ArmwrightError, "solver.device: .*scenario file"),
    ],
)  # fmt: skip
def test_what_a_gpu_does_not_simulate_is_refused(gpu, run, error, said):
    scenario = aw.Scenario(arm("two-link"), 0.01, command=[0.0, 0.0], solver=aw.Solver("rk3"))
    with pytest.raises(error, match=said):
        run(scenario)
    assert not gpu.launches


# --- with NVRTC, which needs no GPU ---------------------------------------------------------------------------------------


class _Stages(LoopRunner):
    """A loop whose stages alone are wanted."""

    def _compiled(self, target, *, outputs):
        from armwright.simulation.loop.compiled import CompiledLoop

        return CompiledLoop.of(self.config, target, outputs=False, runs=False)


@pytest.mark.study
@pytest.mark.skipif(not NVRTC, reason="the extra `cuda` is not installed")
@pytest.mark.parametrize(
    ("name", "architecture"),
    [
        *itertools.product(["a controller", "noise and delays", "schedules, own steps"], ["sm_75", "sm_90", "sm_100"]),
        *itertools.product(["servos, own steps", "sticking"], ["sm_90"]),
    ],
)
def test_nvrtc_compiles_the_loop(name, architecture, record_property):
    _, known = nvrtc_can()
    if int(architecture.removeprefix("sm_")) not in known:
        pytest.skip(f"this NVRTC has no {architecture}")
    stages = _Stages((QUICK | SLOW)[name]()).loop.loops[0].stages
    code, log = cubin(cuda_loop_source(*stages), architecture, "--ptxas-options=-v")
    assert code.startswith(b"\x7fELF")
    registers = max(map(int, re.findall(r"Used (\d+) registers", log)))
    spilled = sum(map(int, re.findall(r"(\d+) bytes spill stores", log)))
    record_property(f"{name} {architecture}", f"{registers} registers, {spilled} bytes spilled")
    print(f"{name:26} {architecture}: {registers} registers, {spilled} bytes spilled")


# --- on a GPU -------------------------------------------------------------------------------------------------------------


@pytest.mark.study
@pytest.mark.parametrize("name", QUICK | SLOW)
def test_on_a_gpu_a_run_has_the_bits_of_the_cpu_s(name):
    try:
        Gpu()
    except ModelError as error:
        pytest.skip(f"no GPU: {error}")
    assert_same_bits((QUICK | SLOW)[name]())

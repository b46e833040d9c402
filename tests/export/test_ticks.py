"""Ticks of an exported controller beyond what its real type counts: rates, the law's time, and what `init` begins with."""

from __future__ import annotations

import re
from fractions import Fraction

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.export.controller.header import STATUS
from armwright.export.controller.recording import record
from armwright.export.controller.sil import software_in_the_loop
from armwright.export.controller.stages import TIME_ERROR, ControllerStages
from export.controllers import POSITION, SPEED, three_rates
from export.running import pid_loop, run_c
from kernels.c_compilers import compiler

NOT_FINITE, TIME = (1 << list(STATUS).index(name) for name in ("NOT_FINITE", "TIME"))
STARTS = [2**k - 64 for k in range(22, 33)] + [2**53 - 64]  # before a float, a double, and 32 bits stop counting
ERROR = 3.5e-7  # of the command's range: what docs/export-controller.md says of these rates in float


def begun_at(code, tick):
    """Lets the exported C begin in another tick than 0."""
    text, count = re.subn(r"state->tick = \w+(\(\d+\))?;", f"state->tick = UINT64_C({tick});", code.read_text())
    assert count == 1
    code.write_text(text)


@pytest.mark.study
@pytest.mark.parametrize(("starts", "ticks"), [(STARTS, 4000), ([2**32 - 10**6], 10**6 + 1000)])
def test_a_float_cascade_commands_what_the_simulation_does(tmp_path, starts, ticks):
    """Whatever tick it begins in: all starts are a whole number of its cycles behind tick 0, where the simulation begins."""
    compiler("gcc")
    scenario = three_rates(ticks)
    stages = ControllerStages.of(scenario)
    recording = record(stages, ticks)
    exported = aw.export.export_controller(scenario, tmp_path, real="float", ticks=256)
    for start in starts:
        begun_at(exported.paths[1], start)
        compared = software_in_the_loop(stages, recording, tmp_path, "float")
        assert 0.0 < compared.error < ERROR, start
        assert not np.any(compared.status & (NOT_FINITE | TIME))


@pytest.mark.sample(1)
@pytest.mark.parametrize("real", ["double", "float"])
def test_each_loop_is_due_in_its_ticks(tmp_path, real):
    """Seen by the speed and the effort that are held in between, while reference and speed go on in every tick."""
    name = aw.export.export_controller(three_rates(64), tmp_path, real=real, ticks=64).name
    body = f"""
    static const uint64_t starts[] = {{{", ".join(f"UINT64_C({start})" for start in STARTS)}}};
    int k, j;
    for (j = 0; j < {len(STARTS)}; j++) {{
        {name}_init(&state, &{name}_default_parameters, &y, &u);
        state.tick = starts[j];
        for (k = 0; k < 128; k++) {{
            const {name}_state before = state;
            r.q[0] += ({real})0.001;
            y.qd[0] -= ({real})0.001;
            (void)STEP;
            printf("%d %d ", state.law[2] != before.law[2], state.law[4] != before.law[4]);
        }}
    }}"""
    found = np.array(run_c(tmp_path, name, body), dtype=int).reshape(len(STARTS), 128, 2)
    for start, changed in zip(STARTS, found, strict=True):
        for loop, (every, first) in enumerate((POSITION, SPEED)):
            due = [k for k in range(first, 128) if (start + k - first) % every == 0]
            assert np.flatnonzero(changed[:, loop]).tolist() == due, (start, every)


def test_rates_keep_their_phase_through_steps_that_are_not_finite(tmp_path):
    """Nothing of such a step is kept but its count of ticks."""
    name = aw.export.export_controller(three_rates(64), tmp_path, ticks=64).name
    body = f"""
    int k;
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    for (k = 0; k < 40; k++) {{
        const {name}_state before = state;
        const int broken = (k % 7) == 3;
        r.q[0] += 0.001;
        y.qd[0] = broken ? NAN : -0.001 * (double)k;
        (void)STEP;
        printf("%d %d ", (state.status & {NOT_FINITE}u) != 0u, state.law[2] != before.law[2]);
    }}"""
    broken, moved = np.array(run_c(tmp_path, name, body), dtype=int).reshape(-1, 2).T
    every, first = POSITION
    assert np.flatnonzero(broken).tolist() == list(range(3, 40, 7))
    assert np.flatnonzero(moved).tolist() == [k for k in range(first, 40, every) if k % 7 != 3]


def of_time(t, r, y):
    """A law with a sine of the time."""
    return 20.0 * (r.q - y.q) + scalar.array([scalar.sin(40.0 * t), 0.0])


@pytest.mark.parametrize(("real", "seconds"), [("float", (8.0, 32.0)), ("double", (3.6e6, 1e11))])
@pytest.mark.parametrize("period", [1e-3, 4e-3, 0.625e-4])
def test_the_law_s_time_is_right_as_long_as_it_is_said_to_be(real, seconds, period):
    """To 1 µs; 1,000 h are 3.6e6 s. In eight times the time it is not."""
    stages = ControllerStages.of(pid_loop(controller=of_time, period=period))
    last = stages.ticks_of_time(real)
    assert last is not None
    assert seconds[0] < last * period < seconds[1]
    number = np.dtype("f4" if real == "float" else "f8").type

    def error(ticks):
        exact = [Fraction(int(k)) * Fraction(period) for k in ticks]
        found = [Fraction(float(number(int(k)) * number(period))) for k in ticks]
        return [abs(float(a - b)) for a, b in zip(found, exact, strict=True)]

    assert max(error(np.random.default_rng(0).integers(0, last + 1, 1000))) <= TIME_ERROR
    assert max(error(range(last - 1000, last + 1))) <= TIME_ERROR
    assert max(error(range(8 * last, 8 * last + 1000))) > TIME_ERROR


def test_a_law_of_the_time_says_when_it_is_over(tmp_path):
    """By a note, a macro and a status bit; a law that does not read the time has none of them."""
    compiler("gcc")
    exported = aw.export.export_controller(pid_loop(controller=of_time), tmp_path, real="float", ticks=50)
    last = ControllerStages.of(pid_loop(controller=of_time)).ticks_of_time("float")
    assert last is not None
    assert f"#define TWO_LINK_CONTROLLER_TIME_TICKS UINT64_C({last})" in exported.paths[0].read_text()
    assert f"within 1 µs for {last * 1e-3:.4g} s" in exported.notes[0]
    name = exported.name
    body = f"""
    {name}_init(&state, &{name}_default_parameters, &y, &u);
    printf("%u ", (unsigned)STEP);
    state.tick = {name.upper()}_TIME_TICKS;
    printf("%u ", (unsigned)STEP);
    printf("%u ", (unsigned)STEP);
    {name}_reset(&state, &{name}_default_parameters, &y);
    printf("%u", (unsigned)STEP);"""
    assert run_c(tmp_path, name, body) == ["0", "0", str(TIME), "0"]
    without = aw.export.export_controller(pid_loop(), tmp_path / "without", real="float", ticks=50)
    assert without.notes == ()
    assert "_TIME_TICKS" not in without.paths[0].read_text()
    assert "(float)state->tick" not in without.paths[1].read_text()

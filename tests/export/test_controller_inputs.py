"""What a firmware gives an exported controller: counts of encoders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from export.controllers import CONTROLLERS
from export.running import pid_loop, run_c
from kernels.c_compilers import compiler


def counted(scenario):
    """A scenario whose sensors give what its encoders count, whatever else they gave."""
    old = scenario.loop.sensors
    sensors = aw.Sensors(counts=old.counts, side=old.side, velocity=old.velocity, cutoff_hz=old.cutoff_hz)
    return replace(scenario, loop=replace(scenario.loop, sensors=sensors))


@pytest.mark.parametrize("which", CONTROLLERS)
def test_in_counts_every_command_has_the_bits_of_the_simulation(tmp_path, which):
    compiler("gcc")
    comparison = aw.export_controller(counted(CONTROLLERS[which](2000)), tmp_path, counts=True).comparison
    assert comparison is not None
    assert comparison.others == 0
    assert comparison.ticks == 2000


def test_counts_are_whole_numbers_of_the_encoders(tmp_path):
    """4096 in a turn of each joint: 1000 counts are 1000 · 2π / 4096 rad, which kp turns into the command."""
    loop = {"controller": aw.JointPID(kp=20.0), "sensors": aw.Sensors(counts=4096, side="link")}
    exported = aw.export_controller(pid_loop(**loop), tmp_path, counts=True)
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
    with pytest.raises(
        ScenarioError, match=r"^loop\.sensors\.counts: shoulder, elbow: measured exactly, not in counts"
    ):
        aw.export_controller(pid_loop(), tmp_path / "out", counts=True)
    with pytest.raises(ScenarioError, match=r"^loop\.sensors\.counts: positions are no whole counts"):
        aw.export_controller(CONTROLLERS["cascade"](300), tmp_path / "out", counts=True)  # its spikes are not
    assert not list(tmp_path.iterdir())

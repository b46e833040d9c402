"""First difference of a run over a bus: every value of every tick is compared, and a run cut short is not equal."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.twin.difference import first_difference
from armwright.twin.rehearsal import rehearse
from armwright.twin.run import BusRun

CHANGED, AT = "payload", 0.033  # its second row, inside tick 8


@pytest.fixture(scope="module")
def run(scenario):
    """A run that is equal to its simulation, made of it; a body is taken up in tick 8."""
    body = aw.Payload(AT, 0.5, [0.0, 0.0, 0.1], [1e-3] * 3)
    found = rehearse(replace(scenario, duration=0.08, inputs=aw.Inputs(payload=body)))
    recording, units = found.recording, found.units
    applied = units.command(units.thousandths(recording.y[:, -2:]))
    return BusRun(found, found.stages.period * np.arange(20), found.q.copy(), recording.u.copy(), applied, None)


def test_what_is_the_same_has_no_difference(run):
    assert run.equal
    assert run.complete
    assert run.first_difference is None


@pytest.mark.parametrize(("field", "signal"), [("q", "position"), ("applied", "applied"), ("u", "command")])
@pytest.mark.parametrize("tick", [0, 8, 9, 19])
def test_one_bit_is_a_difference(run, field, signal, tick):
    values = getattr(run, field).copy()
    values[tick, 1] = np.nextafter(values[tick, 1], np.inf)
    other = replace(run, **{field: values})
    found = other.first_difference
    assert not other.equal
    assert (found.tick, found.joint, found.signal) == (tick, "elbow", signal)
    assert (found.value, found.simulated) == (values[tick, 1], getattr(run, field)[tick, 1])
    assert (found.changed, found.since) == ((CHANGED, AT) if tick > 8 else ("", 0.0))
    assert ("payload of the scenario changed, at 0.033 s" in str(found)) == (tick > 8)


def test_of_several_the_first_is_said_and_what_came_before_what_was_made_of_it(run):
    q, u, applied = (getattr(run, field).copy() for field in ("q", "u", "applied"))
    q[5], u[4], u[5], applied[5] = 1.0, 1.0, 1.0, 1.0
    found = replace(run, q=q, u=u, applied=applied).first_difference
    assert (found.tick, found.joint, found.signal) == (4, "shoulder", "command")
    u[4] = run.u[4]
    found = replace(run, q=q, u=u, applied=applied).first_difference
    assert (found.tick, found.joint, found.signal) == (5, "shoulder", "position")


@pytest.mark.parametrize(("speed", "body", "said"), [(0.5, True, 0.5), (0.5, False, 1.0), (1.0, True, 1.0)])
def test_the_speed_that_a_twin_needs_is_said_of_slow_runs_in_which_inputs_change(scenario, speed, body, said):
    inputs = aw.Inputs(payload=aw.Payload(AT, 0.5, [0.0, 0.0, 0.1], [1e-3] * 3) if body else None)
    found = rehearse(replace(scenario, duration=0.08, inputs=inputs), speed=speed)
    recording, units = found.recording, found.units
    applied = units.command(units.thousandths(recording.y[:, -2:]))
    difference = first_difference(found, found.q + 1.0, recording.u, applied)
    assert difference.speed == said
    assert (f"speed, {speed:g}" in str(difference)) == (said != 1.0)


def test_a_run_that_ended_before_is_not_equal(run):
    fields = {field: getattr(run, field)[:19] for field in ("time", "q", "u", "applied")}
    assert not replace(run, **fields).equal
    assert replace(run, **fields).first_difference is None

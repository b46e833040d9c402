"""Slower gains and a shorter period: they keep the margins, the next ones do not, and nothing is promised where none do."""

from dataclasses import replace

import numpy as np
import pytest

import armwright as aw
from armwright.control.analysis.linear_loop import LinearLoop

PID = aw.JointPID(kp=300.0, kd=40.0, gravity=True)
CASCADE = aw.Cascade(position_kp=8.0, speed_kp=40.0, speed_ki=100.0)


def scenario(law, period):
    arm = aw.load("lwa4p" if isinstance(law, aw.FeedForward) else "two-link")
    return aw.Scenario(
        arm.replace(gravity=[0, 0, 0]) if isinstance(law, aw.Cascade) else arm, 1.0,  # no weight that tips a soft joint over
        loop=aw.Loop(law, period=period, timing=aw.Timing("one-tick")),
    )  # fmt: skip


def keeps(changed, analysis):
    loop = LinearLoop(changed)
    return bool(loop.keeps(loop.slopes(analysis.poses), *analysis.asked).all())


@pytest.mark.study
@pytest.mark.parametrize(
    ("law", "period"), [(PID, 4e-3), (CASCADE, 8e-3), (aw.FeedForward(aw.Cascade(25.0, 15.0)), 8e-3)]
)
def test_remedies_keep_the_margins_and_less_does_not(law, period):
    one = scenario(law, period)
    analysis = aw.loops.analyse_loops(one, 300)
    assert not analysis.keeps_margins
    found = analysis.remedies
    assert found.factors.min() < 1.0
    assert keeps(found.slower, analysis)
    powers = {"kd": 1, "kp": 2, "ki": 3, "position_kp": 1, "speed_kp": 1, "speed_ki": 2}
    inner = law.inner if hasattr(law, "inner") else law
    for name, row in found.gains.items():
        np.testing.assert_allclose(row, getattr(inner, name) * found.factors ** powers[name])
    back = np.minimum(found.factors / 0.85, 1.0)  # one step
    nearly = {name: getattr(inner, name) * back ** powers[name] for name in found.gains}
    law_nearly = replace(law, inner=replace(inner, **nearly)) if hasattr(law, "inner") else replace(law, **nearly)
    assert not keeps(replace(one, loop=replace(one.loop, controller=law_nearly)), analysis)
    if found.faster is None:
        assert analysis.period_with_margin == 0.0  # sampling is not what these gains suffer from
    else:
        assert keeps(found.faster, analysis)
        parts = round(period / found.period)
        assert period / found.period == pytest.approx(parts)
        longer = period / (parts - 1)
        loop = replace(one.loop, period=longer)
        assert not keeps(replace(one, duration=1.0 // longer * longer, loop=loop), analysis)
        assert f"a period of {1e3 * found.period:.4g} ms" in found.sentences()[1]
    worst = one.arm.names[int(found.factors.argmin())]
    assert f"{worst} {found.factors.min():.3g} times" in found.sentences()[0]


def test_nothing_is_recommended_where_nothing_helps():
    """A gain of the wrong kind: position alone does not damp a joint without friction, at whatever bandwidth and period."""
    arm = aw.load("two-link").replace(friction=None, gravity=[0, 0, 0])
    loop = aw.Loop(aw.JointPID(kp=300.0), period=2e-3)
    found = aw.loops.analyse_loops(aw.Scenario(arm, 1.0, loop=loop), 100).remedies
    assert (found.factors, found.period, found.slower, found.faster) == (None, None, None, None)
    assert found.sentences()[0].startswith("neither slower gains nor a shorter period")

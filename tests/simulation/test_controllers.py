"""Control laws: what is no law is refused in one line, hidden state is found, Python means what the compiled loop means."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import armwright as aw
from armwright import scalar
from armwright.errors import ScenarioError
from physics.arms import arm
from simulation.fields import scenario_of

PERIOD = 2e-3
GOAL = [0.3, -0.2]


def simulated(law, **fields):
    """A run of the two-link arm under a law."""
    common = {"reference": GOAL, "period": PERIOD, "duration": 15 * PERIOD}
    return aw.simulate(scenario_of(arm("two-link"), controller=law, **(common | fields)))


def one_line(law, **fields):
    with pytest.raises(ScenarioError) as caught:
        simulated(law, **fields)
    assert "\n" not in str(caught.value)
    return str(caught.value)


class Remembers:
    """Laws that keep state of their own; those that branch on numbers run in Python."""

    def __init__(self):
        self.kept = {}

    def differences(self, t, r, y):
        last = self.kept.get("q", 0.0)
        self.kept["q"] = y.q[0]
        return 10.0 * (r.q - y.q) - 5.0 * (y.q[0] - last)

    def sums(self, t, r, y):
        self.kept["i"] = self.kept.get("i", 0.0) + 1e-3 * (r.q[0] - y.q[0])
        return 10.0 * (r.q - y.q) + self.kept["i"]

    def counts_in_python(self, t, r, y):
        self.kept["n"] = self.kept.get("n", 0) + 1
        return [self.kept["n"] * 1.0, 0.0] if y.q[0] > -9.0 else [0.0, 0.0]

    def differences_in_python(self, t, r, y):
        here = float(y.q[0])
        last = self.kept.get("q", here)
        self.kept["q"] = here
        return 10.0 * (r.q - y.q) - 5.0 * (here - last)

    def begins_anew_in_python(self, t, r, y):
        """Lane after lane it would go on from what the lane before had left, but for the first tick."""
        if float(t) == 0.0:
            self.kept["i"] = 0.0
        self.kept["i"] += float(r.q[0] - y.q[0])
        return 10.0 * (r.q - y.q) + self.kept["i"]

    def keeps_a_symbol(self, t, r, y):
        """What a trace that failed had left is no number."""
        self.kept.setdefault("q", y.q[0])
        return [10.0 * self.kept["q"], 0.0] if y.q[0] > -9.0 else [0.0, 0.0]


@pytest.mark.parametrize("how", [name for name in vars(Remembers) if not name.startswith("_")])
def test_hidden_state_is_found(how):
    law = getattr(Remembers(), how)
    message = f"loop.controller '{how}': keeps hidden state: two calls with the same arguments compute different things"
    assert one_line(law).startswith(message)
    assert one_line(law).startswith(message)  # again, with what the first run had left


class Begins:
    """A law whose `init` leaves symbols behind."""

    def init(self, arm, y):
        self.start = y.q
        return scalar.zeros(1)

    def step(self, t, r, y, s):
        return self.start - y.q, s


def test_hidden_state_of_the_beginning_is_found():
    assert "controller 'Begins': keeps hidden state" in one_line(Begins())


class Counts:
    """State of any kind, handed from call to call, and changed where it lies."""

    def init(self, arm, y):
        return {"ticks": 0, "first": y.q.copy()}

    def step(self, t, r, y, s):
        s["ticks"] += 1
        return 20.0 * (r.q - y.q) + s["ticks"] * s["first"], s


def test_state_that_is_handed_on_is_not_hidden():
    q0 = np.array([[0.1, 0.0], [0.0, -0.2], [0.3, 0.3]])
    run = simulated(Counts(), q0=aw.Batch(q0))
    assert run.attrs["controller"].startswith("called in Python")
    for lane, q in enumerate(q0):
        np.testing.assert_array_equal(simulated(Counts(), q0=q).q.values, run.q.values[lane])


def branching(t, r, y):
    """A law for one arm, in plain Python: what `y.q[0]` is must not depend on the number of lanes."""
    return [5.0 if y.q[0] > 0.15 else -5.0, 20.0 * (r.q[1] - y.q[1]) if t > 0.01 else 0.0]


def selecting(t, r, y):
    """The same, traced."""
    held = scalar.where(scalar.less(0.01, t), 20.0 * (r.q[1] - y.q[1]), 0.0)
    return scalar.array([scalar.where(scalar.less(0.15, y.q[0]), 5.0, -5.0), held])


@pytest.mark.parametrize("lanes", [1, 2, 5])  # 2: as many as there are joints
def test_a_law_in_python_means_in_lanes_what_it_means_alone(lanes):
    q0 = np.linspace([0.1, 0.0], [0.2, 0.1], 5)[:lanes]
    q0[-1] = [0.2, 0.1]
    called, compiled = simulated(branching, q0=aw.Batch(q0)), simulated(selecting, q0=aw.Batch(q0))
    assert called.attrs["controller"].startswith("called in Python once a tick: SymbolError")
    assert "called in Python once a tick for every lane" in called.attrs["notes"]
    assert compiled.attrs["controller"] == "compiled"
    np.testing.assert_array_equal(called.u.values, compiled.u.values)
    np.testing.assert_allclose(called.q.values, compiled.q.values, rtol=0, atol=1e-15)
    for lane in range(lanes):
        np.testing.assert_array_equal(simulated(branching, q0=q0[lane]).q.values, called.q.values[lane])


@dataclass(frozen=True, eq=False)
class Gains:
    """A law in Python, whose gains may be a batch; `vectorised` where it is to have all of them at once."""

    kp: np.ndarray | aw.Batch
    vectorised: bool = False

    def init(self, arm, y):
        assert y.q.ndim == self.kp.ndim == (2 if self.vectorised else 1)
        return np.zeros_like(y.q)

    def step(self, t, r, y, s):
        assert y.q.shape == s.shape == r.q.shape == self.kp.shape
        return np.asarray(self.kp * (r.q - y.q), dtype=float) + s, s + 0.1 * (r.q - y.q)


def test_all_lanes_may_be_called_at_once_where_a_law_asks_for_it():
    gains, q0 = np.linspace([10.0, 5.0], [30.0, 9.0], 7), np.random.default_rng(0).uniform(-0.2, 0.2, (7, 2))
    one_by_one, at_once = (simulated(Gains(aw.Batch(gains), each), q0=aw.Batch(q0)) for each in (False, True))
    assert at_once.attrs["controller"] == "called in Python once a tick: it asks for all lanes at once"
    np.testing.assert_array_equal(one_by_one.q.values, at_once.q.values)

    def traceable(t, r, y):
        return np.stack([y.q[:, 0], -y.q[:, 1]], axis=1)

    traceable.vectorised = True
    assert simulated(traceable).q.shape == (16, 2)  # (1, n) of a single run


def test_a_lane_that_diverged_is_not_asked_again():
    asked = []

    def law(t, r, y):
        if y.q[0] > 0.25:
            asked.append(float(t))
        return [np.nan if y.q[0] > 0.25 else 0.0, 0.0]

    run = simulated(law, q0=aw.Batch([[0.0, 0.0], [0.3, 0.0], [0.1, 0.0]]))
    np.testing.assert_array_equal(run.diverged_at.values, [np.nan, 0.0, np.nan])
    assert asked == [0.0]


def raising(error):
    def law(t, r, y):
        raise error

    return law


class Half:
    """`step` without a pair."""

    def init(self, arm, y):
        return {"of any": "kind"}

    def step(self, t, r, y, s):
        return np.zeros(2)  # two numbers are no pair


class TakesLess:
    """`init` of an arm alone."""

    def init(self, arm):
        return 0.0

    def step(self, t, r, y, s):
        return y.q, s


@pytest.mark.parametrize(
    ("law", "said"),
    [
        (5, "controller = 5: expected a function (t, r, y) → u, or an object with init(arm, y) and step(t, r, y, s)"),
        ("joint_pid", "controller = 'joint_pid': expected a function"),
        (aw.JointPID, "loop.controller = 'JointPID': a class; expected a controller that it makes, JointPID(…)"),
        (lambda t, r: r.q, "controller '<lambda>': takes (t, r); expected (t, r, y)"),
        (TakesLess(), "controller 'TakesLess.init': takes (arm); expected (arm, y)"),
        (
            lambda t, r, y: y.pos,
            "controller '<lambda>': AttributeError: no measured signal 'pos'; there is applied, current, q, qd (",
        ),
        (lambda t, r, y: kp * y.q, "NameError: name 'kp' is not defined"),  # noqa: F821
        (lambda t, r, y: y.q / (1 // 0), "ZeroDivisionError"),
        (raising(RuntimeError("first\nsecond")), "controller 'law': RuntimeError: first ("),
        (raising(OSError("gone")), "controller 'law': OSError: gone ("),
        (raising(type("Own", (Exception,), {})()), "controller 'law': Own:  ("),
        (lambda t, r, y: None, "returned u = None; expected (2,)"),
        (lambda t, r, y: ["a", "b"], "returned u = ['a', 'b']; expected (2,)"),
        (lambda t, r, y: [[1.0, 2.0], 3.0], "returned u = [[1.0, 2.0], 3.0]; expected (2,)"),
        (lambda t, r, y: [1.0 if y.q[0] > 0 else 2.0], "returned u of shape (1,); expected (2,)"),
        (Half(), "controller 'Half': step returned no pair; expected (u, s)"),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else "",
)
def test_what_is_no_law_is_refused_in_one_line(law, said):
    assert said in one_line(law)


def test_an_error_of_a_law_tells_where_it_is():
    law = raising(ValueError("no"))
    line = law.__code__.co_firstlineno + 1
    assert f"({__file__}:{line}); expected commands from t, r (q, qd, qdd) and y (q, qd, current, applied)" in one_line(
        law
    )

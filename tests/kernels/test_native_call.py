"""Native calls give what the general path gives, in bits, types and errors, and keep nothing of what they were given."""

from __future__ import annotations

import functools
import gc
import inspect
import pickle
import sys
import threading
import time
import weakref
from types import BuiltinFunctionType

import numpy as np
import pytest

import armwright as aw
from armwright.kernels import batch, engine, native_call
from armwright.kernels.signatures import SIGNATURES
from kernels.native_cases import LEADS, general, odd_calls, outcome, states

KERNELS = ("inverse_dynamics", "mass_matrix", "inverse_dynamics_derivatives", "energy", "forward_kinematics")

pytestmark = pytest.mark.skipif(
    native_call.native_function() is None, reason="this Python has no native calls: the general path serves all"
)


def compiled(name: str = "puma560", **settings) -> aw.CompiledArm:
    """An arm whose kernels of `KERNELS` are native functions."""
    dyn = aw.compile(aw.load(name), **settings)
    for kernel in KERNELS:
        for _ in range(2):
            getattr(dyn, kernel)(*states(dyn, kernel, (), np.random.default_rng(0)))
    return dyn


@pytest.fixture(scope="module")
def dyn():
    return compiled()


@pytest.mark.sample(4)
@pytest.mark.parametrize("name", sorted(SIGNATURES))
def test_every_kernel_has_the_general_bits(name):
    dyn, rng = aw.compile(aw.load("puma560")), np.random.default_rng(1)
    for _ in range(2):
        getattr(dyn, name)(*states(dyn, name, (), rng))
    assert isinstance(getattr(dyn, name), BuiltinFunctionType)
    for lead in LEADS:
        arrays = states(dyn, name, lead, rng)
        assert outcome(getattr(dyn, name), *arrays) == outcome(general(dyn, name), *arrays), lead


def test_a_method_that_is_held_before_its_first_call_is_native_from_then_on():
    dyn = aw.compile(aw.load("two-link"))
    held = [dyn.inverse_dynamics, dyn.inverse_dynamics]
    assert held[0] is held[1] is dyn.inverse_dynamics
    assert isinstance(held[0], BuiltinFunctionType)
    table = held[0].__self__[2]
    arrays = states(dyn, "inverse_dynamics", (3,), np.random.default_rng(14))
    assert table.most == 0  # nothing is compiled yet
    first = outcome(held[0], *arrays)
    assert table.most > 3
    assert outcome(held[0], *arrays) == first == outcome(general(dyn, "inverse_dynamics"), *arrays)
    with pytest.raises(aw.errors.ModelError):  # a kernel that there cannot be
        aw.compile(aw.load("two-link")).motor_voltage(*[np.zeros(2)] * 2)


def test_a_subclass_keeps_its_own_method():
    class Counted(aw.CompiledArm):
        def mass_matrix(self, *arrays, **named):
            self.calls = getattr(self, "calls", 0) + 1
            return super().mass_matrix(*arrays, **named)

    dyn = Counted(aw.load("two-link"))
    for _ in range(3):
        dyn.mass_matrix(np.zeros(2))
    assert dyn.calls == 3


def test_single_precision():
    dyn, rng = compiled("two-link", dtype="float32"), np.random.default_rng(2)
    assert isinstance(dyn.inverse_dynamics, BuiltinFunctionType)
    for lead in LEADS:
        arrays = states(dyn, "inverse_dynamics", lead, rng)
        wide = [array.astype(float) for array in arrays]
        expected = outcome(general(dyn, "inverse_dynamics"), *arrays)
        assert outcome(dyn.inverse_dynamics, *arrays) == outcome(dyn.inverse_dynamics, *wide) == expected
        assert expected[1][1] == np.dtype(np.float32).str


@pytest.mark.filterwarnings("ignore::RuntimeWarning", "ignore::PendingDeprecationWarning")
@pytest.mark.parametrize("name", KERNELS)
def test_odd_calls_give_the_general_answers_and_errors(dyn, name):
    native = getattr(dyn, name)
    assert isinstance(native, BuiltinFunctionType)
    seen = set()
    for what, arrays, named in odd_calls(dyn, name, np.random.default_rng(3)):
        expected = outcome(general(dyn, name), *arrays, **named)
        assert outcome(native, *arrays, **named) == expected, what
        seen.add(expected[0])
    assert aw.errors.ShapeError in seen
    assert RuntimeError in seen


@pytest.mark.study
def test_reference_counts_stay(dyn):
    rng = np.random.default_rng(4)
    for name in KERNELS:
        native, arrays = getattr(dyn, name), states(dyn, name, (3,), rng)
        short = [*arrays[:-1], arrays[-1][:2]]  # refused: unlike leading axes
        watched = [*arrays, native, np.ndarray, np.dtype(float), native.__self__, np.empty]

        def rounds(count, native=native, arrays=arrays, short=short):
            for _ in range(count):
                native(*arrays)
                native(arrays[0].tolist(), *arrays[1:])
                outcome(native, *short)

        rounds(20)
        gc.collect()
        before = [sys.getrefcount(each) for each in watched]
        rounds(500)
        gc.collect()
        assert all(abs(sys.getrefcount(a) - b) < 50 for a, b in zip(watched, before, strict=True)), name


def test_results_belong_to_the_caller(dyn):
    arrays = states(dyn, "inverse_dynamics_derivatives", (5,), np.random.default_rng(5))
    results = dyn.inverse_dynamics_derivatives(*arrays)
    for result in results:
        assert result.flags.owndata
        assert result.base is None
        assert sys.getrefcount(result) <= 4  # the tuple's, the loop's, the call's own
    gone = weakref.ref(results[0])
    del results, result
    assert gone() is None


def test_threads_and_exceptions(dyn):
    """Calls in several threads, within handlers of exceptions, in finalisers and in generators that are closed."""
    rng, problems = np.random.default_rng(6), []
    cases = [(name, states(dyn, name, lead, rng)) for name in KERNELS for lead in ((), (8,), (64,))]
    expected = [outcome(general(dyn, name), *arrays) for name, arrays in cases]

    class Last:
        def __del__(self):
            check(0)

    def check(k):
        name, arrays = cases[k]
        if outcome(getattr(dyn, name), *arrays) != expected[k]:
            problems.append(name)

    def generator(k):
        try:
            yield
        finally:
            check(k)

    def work():
        for turn in range(40):
            for k in range(len(cases)):
                try:
                    raise KeyError(turn)
                except KeyError:
                    check(k)
                closed = generator(k)
                next(closed)
                closed.close()
                if k % 5 == 0:
                    Last()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not problems


def test_arm_that_is_dropped_is_freed_at_once():
    dyn = compiled()
    call, arrays = dyn.mass_matrix, states(dyn, "mass_matrix", (), np.random.default_rng(7))
    expected = outcome(call, *arrays)
    kernel, whole = weakref.ref(dyn.kernel("energy")), weakref.ref(dyn)
    gc.collect()
    gc.disable()
    try:
        del dyn
        assert whole() is None
        assert kernel() is not None  # its function's other kernels, for the calls that it hands on
        assert outcome(call, *arrays) == expected
        assert outcome(call, arrays[0].tolist()) == expected
        del call
        assert kernel() is None
    finally:
        gc.enable()


def test_native_function_is_documented_and_pickled_as_the_method(dyn):
    method, native = aw.CompiledArm.inverse_dynamics, dyn.inverse_dynamics
    assert list(inspect.signature(native).parameters) == list(inspect.signature(method).parameters)[1:]
    assert str(inspect.signature(native)) == "(q, qd, qdd, wrench=None, *, out=None)"
    assert (native.__name__, native.__doc__) == (method.__name__, method.__doc__)
    arrays = states(dyn, "inverse_dynamics", (2,), np.random.default_rng(8))
    again = pickle.loads(pickle.dumps(native))
    assert outcome(again, *arrays) == outcome(native, *arrays)


def test_methods_of_a_subclass_stay():
    class Doubled(aw.CompiledArm):
        def mass_matrix(self, q, *, out=None):
            return 2.0 * super().mass_matrix(q, out=out)

    twice, once, q = Doubled(aw.load("two-link")), aw.compile(aw.load("two-link")), np.array([0.3, 0.4])
    for _ in range(3):
        np.testing.assert_array_equal(twice.mass_matrix(q), 2.0 * once.mass_matrix(q))
        np.testing.assert_array_equal(twice.gravity_torques(q), once.gravity_torques(q))


def test_arm_with_open_parameters_checks_them_in_every_call():
    varied = aw.compile(aw.load("two-link"), vary=["forearm.mass_kg"])
    for _ in range(3):
        varied.mass_matrix(np.zeros(2), varied.varied.nominal)
        with pytest.raises(aw.ArmwrightError):
            varied.mass_matrix(np.zeros(2), np.array([-1.0]))


def test_number_of_threads_reaches_the_calls_that_are_handed_on(dyn, monkeypatch):
    monkeypatch.setattr(batch, "PART", 1)
    arrays = states(dyn, "inverse_dynamics", (20_000,), np.random.default_rng(9))
    expected = outcome(dyn.inverse_dynamics, *arrays)
    before = dyn.threads
    dyn.threads = 2
    try:
        assert dyn.inverse_dynamics.__self__[1].threads == 2
        assert outcome(dyn.inverse_dynamics, *arrays) == expected
    finally:
        dyn.threads = before


def test_other_linker(monkeypatch, dyn):
    monkeypatch.setattr(engine, "linker", lambda _: engine.McjitLinked)
    function = native_call.native_function.__wrapped__()
    monkeypatch.setattr(native_call, "native_function", lambda: function)
    other, arrays = compiled(), states(dyn, "energy", (3,), np.random.default_rng(12))
    assert other.energy.__self__ is not dyn.energy.__self__
    assert outcome(other.energy, *arrays) == outcome(dyn.energy, *arrays)


def test_other_threads_run_while_long_calls_compute(monkeypatch, dyn):
    """A call of more than `HOLD` operations releases the GIL; here all do."""
    monkeypatch.setattr(native_call, "HOLD", 0)
    other, arrays = compiled(), states(dyn, "mass_matrix", (64,), np.random.default_rng(13))
    expected, wrong = outcome(dyn.mass_matrix, *arrays), []

    def work():
        wrong.extend(1 for _ in range(500) if outcome(other.mass_matrix, *arrays) != expected)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.parametrize("lacking", ["numpy_api", "native_function"])
def test_without_native_functions_methods_serve(monkeypatch, lacking):
    monkeypatch.setattr(native_call, lacking, lambda: None)
    dyn = compiled("two-link")
    assert not isinstance(dyn.mass_matrix, BuiltinFunctionType)
    assert outcome(dyn.mass_matrix, np.zeros(2)) == outcome(compiled("two-link").mass_matrix, np.zeros(2))


def fastest(calls, rounds=30, repeat=300):
    """The least seconds of each call [process time], all in turns."""
    best = [float("inf")] * len(calls)
    for _ in range(rounds):
        for k, (call, arrays) in enumerate(calls):
            start = time.process_time()
            for _ in range(repeat):
                call(*arrays)
            best[k] = min(best[k], time.process_time() - start)
    return best


@pytest.mark.parametrize("lead", [(), (8,)])
def test_plain_call_costs_little_more_than_a_bound_one(dyn, lead):
    """Measured: 0.7 times the bound call and a tenth of the general path; the factors leave room for any machine."""
    arrays = states(dyn, "inverse_dynamics", lead, np.random.default_rng(10))
    bound = dyn.bind("inverse_dynamics", lead=lead)
    plain, other, beside = fastest(
        [(dyn.inverse_dynamics, arrays), (general(dyn, "inverse_dynamics"), arrays), (bound, ())]
    )
    assert plain < 0.5 * other
    assert plain < 3.0 * beside


def test_plain_call_is_faster_than_pinocchio_from_python(dyn):
    """Measured: 4 to 5 times as fast."""
    pin = pytest.importorskip("pinocchio", exc_type=ImportError)
    model = pin.buildSampleModelManipulator()
    data, q, v = model.createData(), pin.neutral(model), np.zeros(model.nv)
    arrays = states(dyn, "inverse_dynamics", (), np.random.default_rng(11))
    ours, theirs = fastest([(dyn.inverse_dynamics, arrays), (functools.partial(pin.rnea, model, data), (q, v, v))])
    assert model.nv == dyn.arm.n
    assert ours < theirs

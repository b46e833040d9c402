"""Normal equations by the kernel of base columns against dense products and Pinocchio's regressor."""

import time

import numpy as np
import pytest

import armwright as aw
from armwright.identification.arm.normal import normal_equations


@pytest.mark.parametrize("name", ["lwa4p", "two-link"])
def test_normal_equations_are_the_dense_products(name):
    arm = aw.load(name)
    q, qd, qdd, tau = np.random.default_rng(0).normal(size=(4, 1500, arm.n))  # more than one block
    weights = np.arange(1.0, arm.n + 1)
    gram = normal_equations(arm)(q, qd, qdd, tau, weights)
    rows = np.concatenate([aw.compile(arm).regressor(q, qd, qdd), tau[:, :, None]], axis=2) * np.sqrt(weights)[:, None]
    rows = rows.reshape(-1, rows.shape[-1])
    np.testing.assert_allclose(gram, rows.T @ rows, atol=1e-11 * np.abs(gram).max())


def test_many_times_as_fast_as_pinocchios_loop():
    """Normal equations of a log's states beside Pinocchio's regressor and NumPy's product, both of six joints, in one run.

    Twenty times is what `benchmarks/rows_identification.py` asks for; a busy machine gets some slack here.
    """
    pin = pytest.importorskip("pinocchio", reason="the extra `bench` is not installed")
    arm, rows = aw.load("lwa4p"), 9000
    q, qd, qdd, tau = np.random.default_rng(0).normal(size=(4, rows, arm.n))
    model = pin.buildSampleModelManipulator()
    data = model.createData()
    assert model.nv == arm.n

    def loop() -> np.ndarray:
        total = np.zeros((61, 61))
        for k in range(rows):
            values = np.column_stack([pin.computeJointTorqueRegressor(model, data, q[k], qd[k], qdd[k]), tau[k]])
            total += values.T @ values
        return total

    ours = normal_equations(arm)
    ours(q[:10], qd[:10], qdd[:10], tau[:10])  # compiles

    def seconds(work) -> float:
        begin = time.process_time()  # of all threads: other work on the machine does not count
        work()
        return time.process_time() - begin

    peer = min(seconds(loop) for _ in range(2))
    assert peer > 14 * min(seconds(lambda: ours(q, qd, qdd, tau)) for _ in range(5))

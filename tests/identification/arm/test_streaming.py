"""Memory of a fit does not grow with the rows of its log."""

import subprocess
import sys

import pytest

SCRIPT = """
import sys, tracemalloc
import numpy as np
import armwright as aw
from armwright.identification.arm.equations import equations_of
from armwright.identification.arm.samples import Samples
from armwright.identification.arm.base import base_parameters
from armwright.identification.arm.fit import fit_arm, with_correlation
from armwright.identification.arm.torque_model import torque_model

model = torque_model(aw.load("two-link"))
base = base_parameters(model)

def source(blocks):
    generator = np.random.default_rng(0)
    for k in range(blocks):
        q, qd, qdd = generator.normal(size=(3, 5000, 2))
        tau = model.dyn.inverse_dynamics(q, qd, qdd) + generator.normal(size=(5000, 2))
        yield Samples("run", 0, 5000.0 * k + np.arange(5000), q, qd, qdd, tau)

def used(blocks):
    tracemalloc.start()
    fit = fit_arm(equations_of(source(blocks), model), base)
    with_correlation(lambda: source(blocks), fit)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak

used(1)
print(used(4), used(80))
"""


@pytest.mark.study
def test_twenty_times_the_rows_take_no_more_memory():
    result = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    short, long = map(int, result.stdout.split())
    assert long < 1.2 * short

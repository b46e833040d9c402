"""Threads that trace at the same time: CasADi gives up Python's lock, and crashed the process where two of them met."""

from __future__ import annotations

import subprocess
import sys

import pytest

ARMS = ("two-link", "cmu-dd", "lwa4p", "puma560")
WORK = f"""
import faulthandler, sys, threading
import numpy as np
import armwright as aw
from armwright.program import kept_programs
from armwright.program.turns import alone

sys.setswitchinterval(1e-5)
failed = []
faulthandler.enable()

def work(name):
    try:
        for _ in range(12):
            arm = aw.load(name)
            aw.simulate(aw.Scenario(arm, command=np.zeros(arm.n), duration=0.01))
            alone(kept_programs._made.clear)()
    except BaseException as error:
        failed.append(error)

threads = [threading.Thread(target=work, args=(name,)) for name in 2 * {ARMS!r}]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
if failed:
    raise failed[0]
"""


@pytest.mark.study
def test_threads_simulate_side_by_side() -> None:
    done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]

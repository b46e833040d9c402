"""Checksums by content: what was computed on the way does not count."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys

import casadi
import numpy as np

import armwright as aw
from armwright.content import checksum


class Holder:
    """A controller of a user's own that keeps a compiled arm."""

    def __init__(self, dyn, gain):
        self.dyn, self.gain = dyn, gain


def test_a_compiled_arm_counts_by_its_arm_and_settings_used_or_not():
    arm = aw.load("two-link")
    dyn = aw.compile(arm)
    fresh = checksum(dyn)
    dyn.inverse_dynamics(np.zeros(2), np.zeros(2), np.zeros(2))
    used = {checksum(dyn), checksum(copy.copy(dyn)), checksum(pickle.loads(pickle.dumps(dyn)))}
    assert used == {fresh}
    loaded = arm.with_payload(1.0, np.zeros(3), np.zeros((3, 3)))
    others = (aw.compile(arm, dtype="float32"), aw.compile(loaded), Holder(dyn, 1.0), Holder(dyn, 2.0))
    assert len({fresh, *map(checksum, others)}) == 5


def test_a_controller_that_keeps_a_used_arm_has_a_checksum():
    dyn = aw.compile(aw.load("two-link"))
    before = checksum(Holder(dyn, 1.0))
    dyn.gravity_torques(np.zeros(2))
    assert checksum(Holder(dyn, 1.0)) == before


def test_functions_of_casadi_count_by_what_they_compute():
    x = casadi.SX.sym("x")
    made = [casadi.Function("f", [x], [expression]) for expression in (x**2, x**2, x**3)]
    first, same, other = map(checksum, made)
    assert first == same != other


def test_an_arm_has_one_checksum_in_all_processes():
    """Sets of texts have another order in each process."""
    script = "import armwright as aw; print([aw.load(name).sha256 for name in aw.builtin_names()])"
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", script], env=os.environ | {"PYTHONHASHSEED": seed}, stdout=subprocess.PIPE
        )
        for seed in ("1", "2", "3")
    ]
    said = [process.communicate()[0] for process in processes]
    assert len(said[0]) > 1000
    assert said == said[:1] * 3

"""`make bench` in its smoke run: the table comes out, and no row without a passed check."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def run() -> subprocess.CompletedProcess:
    for module, package in (("pinocchio", "pin"), ("mujoco", "mujoco")):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is the peer here: pip install {package}")
    command = [sys.executable, str(BENCHMARKS / "run.py"), "--quick"]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=300)


def test_every_row_is_checked(run):
    assert run.returncode == 0, run.stdout + run.stderr
    assert "FAILED" not in run.stdout


@pytest.mark.parametrize("work", ["inverse_dynamics", "mass_matrix", "forward_dynamics", "final state", "trajectories"])
def test_the_table_has_the_work(run, work):
    rows = [line for line in run.stdout.splitlines() if work in line and "│" in line]
    assert rows
    assert all("≤" in row for row in rows)


def test_a_wrong_result_prints_no_time(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from run import cells  # type: ignore[import-not-found]
    from timing import Check, Contestant, Pair, race  # type: ignore[import-not-found]

    right = Contestant("right", lambda: None, 1, lambda _: Check(0.0, 1e-9))
    wrong = Contestant("wrong", lambda: None, 1, lambda _: Check(float("nan"), 1e-9))
    (row,) = race([Pair("nothing", wrong, right, 1.0)], repetitions=1, least=1e-6)
    assert not row.checked
    assert not row.ours.samples
    assert "FAILED" in cells(row)[2]
    assert cells(row)[5:7] == ["", ""]

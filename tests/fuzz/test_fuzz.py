"""A short part of the campaign, the same every time, and the cases that once failed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("resource", reason="the campaign limits memory as POSIX systems do")
for module, what in (
    ("mujoco", "MJCF"),
    ("mcap", "logs"),
    ("pyarrow", "logs"),
    ("zarr", "sweeps"),
    ("canopen", "buses"),
):
    pytest.importorskip(module, reason=f"its inputs are damaged too: {what}")

TESTS = Path(__file__).parents[1]


def fuzz(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The campaign in a process of its own, which it limits and watches."""
    command = [sys.executable, "-m", "fuzz", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=TESTS, timeout=300)


@pytest.mark.study
def test_a_short_campaign_finds_nothing(tmp_path):
    done = fuzz(
        "--cases", 1000, "--seed", 1, "--processes", 1, "--counts", tmp_path / "counts.json", "--failures", tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    kinds = json.loads((tmp_path / "counts.json").read_text())["kinds"]
    assert sum(sum(row.values()) for row in kinds.values()) == 1000
    assert {"robot", "urdf", "mesh", "csv dialect", "mcap", "parquet", "eds", "session", "kernel", "function"} <= set(
        kinds
    )


GOOD = """
import os, sys
import armwright as aw
from fuzz import calls
from fuzz.case import Case
for kind, sets, run in (("object", calls.OBJECTS, calls.run_object), ("other", calls.OTHERS, calls.run_other)):
    for target, arguments in sets.items():
        run(Case(kind, {}, {"target": target, "arguments": arguments}))
for fields in (calls.SCENARIO, {k: v for k, v in {**calls.SCENARIO, **calls.LOOP}.items() if k != "command"}):
    calls.run_scenario(Case("scenario-in-python", {}, {"fields": fields, "start": False}))
seeds = sys.argv[1]
for name in os.listdir(seeds):
    if name.endswith(".scenario.toml"):
        aw.read_scenario(os.path.join(seeds, name))
"""


@pytest.mark.study
def test_what_is_damaged_is_good_before(tmp_path):
    """Arguments and scenarios that are refused as they are would hide what their damage does."""
    (tmp_path / "torques.csv").write_text("t,shoulder,elbow\n0,1,2\n")
    command = [sys.executable, "-c", GOOD, TESTS / "fuzz" / "seeds"]
    path = os.pathsep.join([str(TESTS), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr


@pytest.mark.study
def test_what_once_failed_does_not_fail_again():
    done = fuzz("--replay")
    assert done.returncode == 0, done.stdout + done.stderr


FAULTS = {  # code that fails in each of the ways that are counted, and what is found
    "raise ValueError('x')": "ValueError",
    "raise type('Two', (aw.ArmwrightError,), {'__str__': lambda self: 'two\\nlines'})": "lines",
    "raise type('Red', (aw.ArmwrightError,), {'__str__': lambda self: '\\x1b[31m'})": "control",
    "warnings.warn('odd', stacklevel=1)": "warning",
    "open('/etc/hostname').close()": "outside open",
    "open('fifo.toml').close()": "hang",
    "bytearray(1 << 40)": "memory",
    "subprocess.run(['true'])": "outside subprocess.Popen",
    "pathlib.Path('.armwright-0.nc').touch()": "left behind",
}
PROGRAM = """
import pathlib, subprocess, tempfile, warnings
import armwright as aw
from fuzz import attempt
from fuzz.case import Case
attempt.LIMIT = 0.2
with tempfile.TemporaryDirectory() as folder:
    guard = attempt.Guard(pathlib.Path(folder))
    assert attempt.attempt(Case("fine"), lambda case: 1, guard).what == "accepted"
    for fault in FAULTS:
        print(attempt.attempt(Case("faulty"), lambda case: exec(fault), guard).signature)
"""


def test_it_sees_every_kind_of_failure():
    program = f"FAULTS = {[*FAULTS]!r}{PROGRAM}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=TESTS)
    assert done.returncode == 0, done.stderr
    found = done.stdout.splitlines()
    assert [line.startswith(wanted) for line, wanted in zip(found, FAULTS.values(), strict=True)] == [True] * len(
        FAULTS
    ), found


def test_the_page_of_the_docs_has_every_kind(monkeypatch):
    """Its table is made from the counts that were committed; a kind without a name there would be left out."""
    from fuzz.campaign import COUNTS, KINDS

    monkeypatch.syspath_prepend(str(TESTS.parent / "docs" / "ext"))
    import armwright_tables  # pyright: ignore[reportMissingImports]

    kinds = json.loads(COUNTS.read_text())["kinds"]
    assert set(kinds) == set(KINDS) == set(armwright_tables.KINDS_OF_INPUT)
    assert f"{sum(sum(row.values()) for row in kinds.values()):,} inputs" in armwright_tables.fuzz()
    assert not any(row["other"] for row in kinds.values())

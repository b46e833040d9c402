"""A long log is read, checked, prepared and fitted in the memory of a short one."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import armwright as aw
from identification.logs.example_logs import HEAD, POSITIONS, TORQUES, motion, written

SHORT, LONG = 250_000, 1_250_000  # rows: one row group of the Parquet file, and 40 MB of numbers more
ALLOWED, RATIO = 30.0, 1.5  # reading: MB beyond the short log; a fit, which keeps some rows: times its memory
PROGRAM = """
import re, sys
import armwright as aw
peak = lambda: int(re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
logs = []
for path in sys.argv[2:]:
    logs.append(aw.identification.read_log(path))
    print(logs[-1].runs[0].rows, peak())
for log in logs if sys.argv[1] == "parquet" else ():  # whatever a log was read from: once, where reading is quick
    fit = aw.identification.identify_arm(log, aw.load("two-link"), record=False, checks=()).fit
    print(fit.equations.rows[0], peak())
"""


@pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux says how much memory a process had at most since it began"
)
@pytest.mark.parametrize("ending", ["csv", "parquet"])
@pytest.mark.study
def test_a_long_log_needs_no_more_memory(tmp_path, ending):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import csv, parquet

    paths = []
    for name, rows in (("short", SHORT), ("long", LONG)):
        t = np.arange(rows) / 1000.0
        q, _, _, tau = motion(t)
        tau = tau + np.random.default_rng(1).normal(size=tau.shape)  # equal numbers would be stored once
        table = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "m1": tau[:, 0], "m2": tau[:, 1]}
        (tmp_path / name).mkdir()
        if ending == "csv":
            csv.write_csv(pyarrow.table(table), tmp_path / name / "arm.csv")
        else:
            parquet.write_table(pyarrow.table(table), tmp_path / name / "arm.parquet", row_group_size=SHORT)
        text = (HEAD + POSITIONS + TORQUES).replace("arm.csv", f"arm.{ending}")
        paths.append(written(tmp_path / name, text, {"unused.csv": {"t": t[:1]}}))
    command = [sys.executable, "-c", PROGRAM, ending, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    (few, before), (many, after), *fits = (map(int, line.split()) for line in done.stdout.splitlines())
    assert (few, many) == (SHORT, LONG)
    assert (after - before) / 1000 < ALLOWED  # of 40 MB more
    if ending == "parquet":
        (_, fitted), (prepared, both) = fits
        assert prepared > LONG // 100
        assert both < RATIO * fitted


def test_a_share_is_held_out_of_the_whole_run_not_of_its_first_block(tmp_path):
    t = np.arange(70_000) / 1000.0  # two blocks
    q, _, _, tau = motion(t)
    table = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "m1": tau[:, 0], "m2": tau[:, 1]}
    log = aw.identification.read_log(
        written(tmp_path, "hold_out = 0.2\n" + HEAD + POSITIONS + TORQUES, {"arm.csv": table})
    )
    assert [(run.name, run.use) for run in log.runs] == [("run1", "fit"), ("run1-held", "hold-out")]
    assert log.runs[1].begin == pytest.approx(0.8 * t[-1])
    assert abs(log.runs[1].rows - 14_000) <= 1

"""A long log is read, checked, prepared and fitted in the memory of a short one."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

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

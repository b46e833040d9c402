"""A long log is read, checked and prepared in the memory of a short one."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from identification.logs.example_logs import HEAD, POSITIONS, TORQUES, motion, written

SHORT, LONG = 200_000, 2_000_000  # rows: more than one block, and 80 MB of numbers
ALLOWED = 40.0  # MB beyond the short log
PROGRAM = """
import re, sys
import armwright as aw
from armwright.identification.logs.preparation import prepared_blocks
for path in sys.argv[1:]:
    log = aw.read_log(path)
    rows = sum(len(block.t) for _, block in prepared_blocks(log, "run1", aw.choose_preparation(log)))
    print(log.runs[0].rows, rows, re.search(r"VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1])
"""


@pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux says how much memory a process had at most since it began"
)
def test_a_long_log_needs_no_more_memory(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    import pyarrow

    paths = []
    for name, rows in (("short", SHORT), ("long", LONG)):
        t = np.arange(rows) / 1000.0
        q, _, _, tau = motion(t)
        tau = tau + np.random.default_rng(1).normal(size=tau.shape)  # equal numbers would be stored once
        table = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "m1": tau[:, 0], "m2": tau[:, 1]}
        (tmp_path / name).mkdir()
        parquet.write_table(pyarrow.table(table), tmp_path / name / "arm.parquet", row_group_size=250_000)
        text = (HEAD + POSITIONS + TORQUES).replace("arm.csv", "arm.parquet")
        paths.append(written(tmp_path / name, text, {"unused.csv": {"t": t[:1]}}))
    done = subprocess.run([sys.executable, "-c", PROGRAM, *map(str, paths)], capture_output=True, text=True, check=True)
    (few, _, before), (many, prepared, after) = (map(int, line.split()) for line in done.stdout.splitlines())
    assert (few, many) == (SHORT, LONG)
    assert prepared > LONG // 100
    assert (after - before) / 1000 < ALLOWED

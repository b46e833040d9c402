"""The measured logs of the examples are read without a note that nobody knows of, and have a licence and a source."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from identification.real_logs import DATA, LOGS

MOST = 3_000_000  # [bytes] of all of them
SHAPES = {"dc_motor": (1, 4595), "lwa4p": (6, 1088), "tx40": (6, 45000)}  # joints, rows


@pytest.mark.parametrize("name", SHAPES)
def test_they_are_read(name):
    if name == "tx40":
        pytest.importorskip("pyarrow", reason="the extra `logs` is not installed")
    log = aw.identification.read_log(LOGS / name / f"{name}.log.toml")
    joints, rows = SHAPES[name]
    assert len(log.joints) == joints
    assert sum(run.sizes["time"] for run in (log.dataset(each.name) for each in log.runs)) >= 0.8 * rows


def test_each_has_its_licence_and_source():
    about = (LOGS / "README.md").read_text(encoding="utf-8")
    for folder in (path for path in LOGS.iterdir() if path.is_dir()):
        assert f"| `{folder.name}` |" in about
        licences = sorted(path.name for path in folder.glob("LICENSE*"))
        assert licences
        assert all(f"`{name}`" in about for name in licences)


def test_they_are_small():
    assert sum(path.stat().st_size for path in LOGS.rglob("*") if path.is_file()) < MOST


def test_the_parquet_has_the_values_of_the_published_files():
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra `logs` is not installed")
    folder = DATA / "staubli_tx40"
    if not folder.is_dir():
        pytest.skip(f"the published files are not here: {folder}")
    table = parquet.read_table(LOGS / "tx40" / "tx40.parquet")
    for quantity, name in (("position", "pos_read_data.csv"), ("torque", "curr_data.csv")):
        published = np.loadtxt(folder / name, delimiter=",", skiprows=1)
        ours = np.stack([table[f"{quantity}_{k}"].to_numpy() for k in range(1, 7)], axis=1)
        np.testing.assert_array_equal(ours, published)


def test_copied_examples_have_them(tmp_path: Path):
    names = {path.relative_to(tmp_path).as_posix() for path in aw.copy_examples(tmp_path)}
    for path in LOGS.rglob("*"):
        assert not path.is_file() or f"logs/{path.relative_to(LOGS).as_posix()}" in names

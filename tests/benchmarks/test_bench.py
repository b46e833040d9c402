"""`make bench` in its smoke run: every table comes out, saved as well, and no row without a passed check."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
CHAPTERS = (
    "kernels",
    "variants",
    "simulation",
    "auto",
    "stiff",
    "control",
    "closed loops",
    "batch size",
    "threads",
    "ik",
    "planning",
    "start",
    "compile",
)
LARGEST = 150_000  # bytes of a picture


def bench(*words: str) -> subprocess.CompletedProcess:
    command = [sys.executable, str(BENCHMARKS / "run.py"), *words]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=300)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for module, package in (("pinocchio", "pin"), ("mujoco", "mujoco")):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is the peer here: pip install {package}")
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def run(folder: Path) -> subprocess.CompletedProcess:
    return bench("--quick", "--save", str(folder))


@pytest.fixture(scope="module")
def saved(run: subprocess.CompletedProcess, folder: Path) -> dict[str, Any]:
    assert run.returncode == 0, run.stdout + run.stderr
    (path,) = folder.glob("*.json")
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.study
@pytest.mark.parametrize("chapter", CHAPTERS)
def test_every_row_is_checked(saved, chapter):
    rows = saved["chapters"][chapter]["rows"]
    assert rows
    for row in rows:
        assert row["checked"]
        for timing in row["timings"].values():
            assert 0.0 <= timing["error"] <= timing["tolerance"]
            assert min(timing["samples"]) > 0.0


@pytest.mark.study
def test_ours_is_beside_every_peer_that_has_the_kernel(saved):
    rows = {row["labels"]["work"]: row for row in saved["chapters"]["kernels"]["rows"]}
    for work, row in rows.items():
        assert {"batch", "bound", "plain", "pinocchio_python", "peak"} <= set(row["timings"]), work
    assert set(rows) >= {"inverse_dynamics", "mass_matrix", "forward_dynamics"}
    assert all(row["facts"]["of_slots"] > 0.0 for row in rows.values())


@pytest.mark.study
def test_forms_of_a_kernel(saved):
    forms = {row["labels"]["form"].split("=")[0] for row in saved["chapters"]["variants"]["rows"]}
    assert forms >= {"float32", "vary", "with friction (the peer without)"}


@pytest.mark.study
def test_the_result_says_where_it_is_from(saved):
    machine = saved["machine"]
    assert machine["processor"]
    assert machine["commit"]
    assert {"python", "numpy", "casadi", "llvmlite", "pin", "mujoco"} <= set(machine["versions"])


@pytest.mark.study
def test_tables_and_pictures_are_saved(saved, run, folder):
    (path,) = folder.glob("*.md")
    text = path.read_text(encoding="utf-8")
    for title in ("Kernels", "Cost per joint", "Other forms", "Simulation", "Batch size", "Threads", "From nothing"):
        assert f"\n## {title}" in text
        assert title in run.stdout
    pictures = sorted(folder.glob("*.png"))
    assert [picture.stem for picture in pictures] == ["bench-batch", "bench-joints", "bench-threads"]
    assert all(1000 < picture.stat().st_size < LARGEST for picture in pictures)


@pytest.mark.study
def test_some_rows_only():
    done = bench("--quick", "--only", "fused threads")
    assert done.returncode == 0, done.stderr
    assert "Threads" in done.stdout
    assert "Kernels" not in done.stdout


@pytest.mark.study
def test_the_million_is_run_where_it_is_asked_for():
    done = bench("--quick", "--million", "--only", "million closed")
    assert done.returncode == 0, done.stderr
    assert "2 generations of 2 candidates and 500 arms" in done.stdout


def test_chapters_of_another_day_say_so(at_home, tmp_path):
    from report import markdown  # type: ignore[import-not-found]
    from run import as_json, merged  # type: ignore[import-not-found]

    machine = {
        "date": "2026-01-01", "processor": "P", "cpu": "c", "width": 8, "processors": 2, "cores": 2, "topology": "two",
        "load": [0.1], "system": "S", "versions": {"python": "3"}, "commit": "abc",
    }  # fmt: skip
    timing = {
        "name": "ours",
        "error": 0.0,
        "tolerance": 1.0,
        "passed": True,
        "median": 5.0,
        "best": 4.0,
        "samples": [5.0],
    }
    row = {"labels": {"arm": "x"}, "timings": {"ours": timing}, "ratios": {}, "facts": {}, "checked": True}
    other = row | {"labels": {"arm": "y"}}
    chapters = {"stiff": {"rows": [row], "notes": []}, "ik": {"rows": [row], "notes": ["old"]}}
    whole = {"machine": machine, "repetitions": 11, "quick": False, "chapters": chapters}
    (tmp_path / "2026-01-01-p.json").write_text(as_json(whole), encoding="utf-8")
    (tmp_path / "2026-02-01-q.json").write_text(as_json(whole | {"machine": machine | {"cpu": "d"}}), encoding="utf-8")
    today = {"machine": machine | {"date": "2026-03-01", "commit": "def"}, "repetitions": 3, "quick": False}
    made = merged(
        today | {"chapters": {"stiff": {"rows": [], "notes": []}, "ik": {"rows": [other], "notes": ["n"]}}}, tmp_path
    )
    assert made["machine"] == machine
    assert made["chapters"]["stiff"] == chapters["stiff"]
    assert made["chapters"]["ik"]["rows"] == [other]
    assert json.loads(as_json(made)) == made
    text = markdown(made)
    assert "- measured on 2026-03-01, commit def, on a machine of the same kind, load average when it began 0.1" in text
    assert text.count("measured on") == 1


@pytest.mark.sample(1)
@pytest.mark.parametrize("words", [("--only", "no such arm"), ("--quick", "--save"), ("--only", "puma560", "--save")])
def test_what_cannot_be_asked_for_is_refused(words):
    done = bench(*words)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


@pytest.fixture
def at_home(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))


def test_a_wrong_result_has_no_time(at_home):
    from records import record  # type: ignore[import-not-found]
    from report import CHAPTERS  # type: ignore[import-not-found]
    from timing import Check, Contestant, Entry, race  # type: ignore[import-not-found]

    right = Contestant("right", lambda: None, 1, lambda _: Check(0.0, 1e-9))
    wrong = Contestant("wrong", lambda: None, 1, lambda _: Check(float("nan"), 1e-9))
    entry = Entry({"work": "nothing"}, {"batch": wrong, "pinocchio_loop": right}, {"pinocchio_loop": "batch"})
    made = record(race([entry], repetitions=1, least=1e-6)[0])
    assert not made["checked"]
    assert "median" not in made["timings"]["batch"]
    assert not made["ratios"]
    cells = [column.cell(made) for column in CHAPTERS["kernels"][1]]
    assert sum(cell.startswith("FAILED") for cell in cells) == 1


def test_ratios_are_of_neighbours_in_time(at_home):
    from records import record  # type: ignore[import-not-found]
    from timing import Check, Entry, Row, Timing  # type: ignore[import-not-found]

    fine = Check(0.0, 1.0)
    timings = {"batch": Timing("a", fine, [1.0, 2.0, 4.0]), "pinocchio_loop": Timing("b", fine, [10.0, 10.0, 12.0])}
    entry = Entry({"work": "w"}, {}, {"pinocchio_loop": "batch"}, {"pinocchio_loop": 4.0})
    assert record(Row(entry, timings))["ratios"]["pinocchio_loop"] == {
        "beside": "batch",
        "median": 5.0,
        "lowest": 3.0,
        "highest": 10.0,
        "expected": 4.0,
    }


def test_share_of_the_machines_limit(at_home):
    from records import record  # type: ignore[import-not-found]
    from timing import Check, Entry, Row, Timing  # type: ignore[import-not-found]

    fine = Check(0.0, 1.0)
    timings = {"batch": Timing("a", fine, [4.0, 4.0, 8.0]), "peak": Timing("limit", fine, [0.1, 0.1, 0.2])}
    facts = record(Row(Entry({"work": "w"}, {}, facts={"slots": 10, "flops": 16}), timings))["facts"]
    assert facts["limit"] == pytest.approx(1.0)  # ns for the operations alone
    assert facts["of_slots"] == pytest.approx(0.25)
    assert facts["of_flops"] == pytest.approx(0.2)  # at the limit 20 flops a ns, here 16 in 4


def test_starts_are_judged_by_their_best(at_home):
    pytest.importorskip("pinocchio", exc_type=ImportError)
    from report import CHAPTERS  # type: ignore[import-not-found]
    from rows_start import WANTED, _record  # type: ignore[import-not-found]

    def cells(error: float, kernel: list[float]) -> dict[str, str]:
        row = _record({"work": "first kernel of puma560, warm cache"}, error, {"kernel": kernel})
        return {column.head: column.cell(row) for column in CHAPTERS["start"][1]}

    assert WANTED["first kernel of puma560, warm cache"] == {"kernel": 50.0}
    assert cells(0.0, [0.07, 0.05])["kernel"] == "50.0 ✓ ≤ 50"
    assert cells(0.0, [0.07, 0.051])["kernel"] == "51.0 ✗ ≤ 50"
    assert cells(float("nan"), [0.01])["kernel"].startswith("FAILED")
    assert cells(0.0, [0.01])["load"] == ""


@pytest.mark.study
def test_the_readme_gets_its_table(at_home, saved, tmp_path):
    from readme import MARKS, update  # type: ignore[import-not-found]

    page = tmp_path / "README.md"
    page.write_text(f"before\n\n{MARKS[0]}\n\nold\n\n{MARKS[1]}\n\nbehind\n", encoding="utf-8")
    text = update(saved, page).read_text(encoding="utf-8")
    assert text.startswith(f"before\n\n{MARKS[0]}\n\n| work, 6 joints |")
    assert text.endswith(f"|\n\n{MARKS[1]}\n\nbehind\n")
    assert "old" not in text
    assert "MuJoCo RK4" in text
    page.write_text("no marks", encoding="utf-8")
    with pytest.raises(ValueError, match="the marks"):
        update(saved, page)
    assert page.read_text(encoding="utf-8") == "no marks"


def test_the_readmes_table_names_the_processor(at_home):
    """It is the newest saved result's, and says of both columns on which processor they ran."""
    from readme import MARKS, README, speed_table  # type: ignore[import-not-found]

    saved = json.loads(sorted((BENCHMARKS / "results").glob("*.json"))[-1].read_text(encoding="utf-8"))
    table = README.read_text(encoding="utf-8").partition(MARKS[0])[2].partition(MARKS[1])[0].strip()
    assert table == speed_table(saved)
    columns = table.splitlines()[0].split(" | ")
    assert " on " in columns[1]
    assert columns[3].startswith("AVX2 on ")


def test_operations_are_counted_in_the_compiled_text(at_home):
    from peak import operations  # type: ignore[import-not-found]

    from armwright.program import trace

    ports = {"a": (1,), "b": (1,), "c": (1,)}
    program = trace("counted", lambda a, b, c: (a * b + c) / (a + b), ports, ("d",))
    assert operations(program, 4) == {"slots": 2, "flops": 3, "divisions": 1}


def test_chains_are_well_conditioned(at_home):
    import numpy as np
    from arms import random_states, timed_arm  # type: ignore[import-not-found]

    from armwright.dynamics import mass_matrix

    arm = timed_arm("chain-30")
    assert arm.n == 30
    assert all(np.linalg.cond(mass_matrix(arm, q)) < 1e4 for q in random_states(arm, 3)["q"])

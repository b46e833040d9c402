"""`armwright assemble`: an arm from its modules, all arms of a kit, the best one for a task; and what is refused."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import tomlkit
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from modules.modules_of_tests import assembly, library, put

TASK = """
name = "sort"
source = "definition"
payload_kg = 1.0
payload_com_m = [0.0, 0.0, 0.0]
cycle_time_s = 20.0
position_tolerance_m = 0.15
[[poses]]
name = "up"
xyz_m = [0.1, 0.05, 0.6]
[[poses]]
name = "side"
xyz_m = [0.3, 0.0, 0.5]
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the toy library, an assembly and a task."""
    monkeypatch.chdir(tmp_path)
    chain = assembly(put("foot"), put("elbow", "foot.top"), put("hand", "elbow.out"))
    (tmp_path / "toy.modules.toml").write_text(tomlkit.dumps(library()))
    (tmp_path / "arm.assembly.toml").write_text(tomlkit.dumps({**chain, "libraries": ["toy.modules.toml"]}))
    (tmp_path / "sort.task.toml").write_text(TASK)
    return tmp_path


def run(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, list(arguments))
    assert result.exit_code == code, result.output
    if code:
        assert result.stdout == ""
        first, *mistakes = result.stderr.splitlines()
        assert not mistakes or f": {len(mistakes)} mistakes" in first
        return result.stderr
    return result.stdout


@pytest.mark.study
def test_a_built_in_arm_is_made_and_simulated_without_an_edit() -> None:
    assert "wrote arm.toml" in run("assemble", "lwa4p.assembly.toml", "-o", "arm.toml")
    assert aw.load("arm.toml").description == aw.modules.assemble("lwa4p")
    assert "0.01 s in " in run("simulate", "arm.toml", "--current", "0", "--duration", "0.01")


def test_an_arm_older_than_its_modules_says_so(folder: Path) -> None:
    """The assembly and its library, from whatever folder the arm is written to; what is not there says nothing."""
    (folder / "out").mkdir()
    arm = folder / "out" / "arm.toml"
    run("assemble", "arm.assembly.toml", "-o", str(arm))
    before = aw.load(arm).warnings
    for name in ("toy.modules.toml", "arm.assembly.toml"):
        text = (folder / name).read_text()
        (folder / name).write_text(f"{text}\n# changed\n")
        (warning,) = set(aw.load(arm).warnings) - set(before)
        assert f"older than ../{name}" in warning or f"older than {name}" in warning
        (warning,) = (str(finding.problem) for finding in aw.robotfiles.check(arm).warnings if finding.check == "age")
        (folder / name).write_text(text)
        assert aw.load(arm).warnings == before
        (folder / name).rename(folder / "away")
        assert aw.load(arm).warnings == before
        (folder / "away").rename(folder / name)


def test_an_arm_of_built_in_modules_knows_them(folder: Path) -> None:
    run("assemble", "lwa4p", "-o", "arm.toml")
    origin = aw.load("arm.toml").description.built_from
    assert (origin.file, list(origin.libraries)) == ("armwright:lwa4p.assembly.toml", ["armwright:improv.modules.toml"])
    assert origin.changed(folder) == []
    text = (folder / "arm.toml").read_text()
    (folder / "arm.toml").write_text(text.replace(origin.libraries["armwright:improv.modules.toml"], "0" * 64))
    assert any("older than armwright:improv.modules.toml" in warning for warning in aw.load("arm.toml").warnings)


def test_a_file_beside_its_library(folder: Path) -> None:
    shown = run("assemble", "arm.assembly.toml")
    assert "arm: 1 joints" in shown
    assert "elbow_turn" in shown
    run("assemble", str(folder / "arm.assembly.toml"), "-o", "arm.toml")
    assert aw.load("arm.toml").names == ["elbow_turn"]


def test_all_arms_of_a_kit() -> None:
    shown = run(
        "assemble",
        "--all",
        "--modules",
        "toy.modules.toml",
        "--max-joints",
        "2",
        "--max-assemblies",
        "30",
        "--show",
        "5",
    )
    assert "toy: 30 of " in shown
    assert "foot-elbow" in shown
    assert "… and 25 more" in shown
    assert "longer ones were not computed (--max-assemblies 30)" in shown
    run("assemble", "--all", "--modules", "toy.modules.toml", "--max-joints", "1", "-o", "list.csv")
    with open("list.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["modules"] == "foot-elbow"
    assert float(rows[0]["mass [kg]"]) == pytest.approx(3.8)


def test_the_best_arm_for_a_task_is_written() -> None:
    options = (
        "--modules",
        "toy.modules.toml",
        "--task",
        "sort.task.toml",
        "--max-joints",
        "2",
        "--max-assemblies",
        "60",
    )
    shown = run("assemble", "--all", *options, "-o", "best.toml")
    assert "feasible" in shown
    assert "wrote best.toml" in shown
    best = next(line for line in shown.splitlines() if line.startswith("foot-")).split()[0]
    assert aw.load("best.toml").name == best


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "neither a file nor --all given"),
        (("arm.assembly.toml", "--all"), "--all and a file given"),
        (("--all",), "assemble --all: expected --modules FILE"),
        (("arm.assembly.toml", "--task", "sort.task.toml"), "assemble --task: goes with --all"),
        (("lwa5p",), "assembly = 'lwa5p': neither built in nor a file; did you mean lwa4p"),
        (("nowhere.assembly.toml",), "nowhere.assembly.toml: no such file"),
        (("--all", "--modules", "impro"), "module library = 'impro'"),
        (("arm.assembly.toml", "-o", "arm.csv"), "the ending '.csv' is not offered"),
        (("arm.assembly.toml", "-o", "nowhere/arm.toml"), "there is no folder 'nowhere'"),
        (("--all", "--modules", "toy.modules.toml", "-o", "best.toml"), "needs --task FILE"),
        (("--all", "--modules", "toy.modules.toml", "--max-assemblies", "0"), "limit = 0: expected 1 or more"),
        (("--all", "--modules", "toy.modules.toml", "--task", "none.toml"), "none.toml: no such file"),
        (("--all", "--modules", "sort.task.toml"), "sort.task.toml: "),
        (("toy.modules.toml",), "toy.modules.toml: "),
    ],
)
def test_refused(arguments: tuple[str, ...], message: str, folder: Path) -> None:
    before = sorted(folder.iterdir())
    assert message in run("assemble", *arguments, code=2)
    assert sorted(folder.iterdir()) == before


def test_nothing_is_written_where_no_arm_does_it(folder: Path) -> None:
    (folder / "sort.task.toml").write_text(TASK.replace("payload_kg = 1.0", "payload_kg = 1000.0"))
    options = (
        "--modules",
        "toy.modules.toml",
        "--task",
        "sort.task.toml",
        "--max-joints",
        "2",
        "--max-assemblies",
        "10",
    )
    assert "no arm does it; the best, foot-" in run("assemble", "--all", *options, "-o", "best.toml", code=2)
    assert not (folder / "best.toml").exists()


def test_what_does_not_fit_names_the_file(folder: Path) -> None:
    text = (folder / "arm.assembly.toml").read_text()
    (folder / "arm.assembly.toml").write_text(text.replace('module = "hand"', 'module = "either"'))
    error = run("assemble", "arm.assembly.toml", "-o", "arm.toml", code=2)
    assert error.startswith(
        "armwright: error: arm.assembly.toml: module 'either' on = 'elbow.out': the module has no connector that fits"
    )


def test_help_teaches_by_example() -> None:
    shown = run("assemble", "--help")
    assert "armwright assemble lwa4p.assembly.toml -o arm.toml" in shown

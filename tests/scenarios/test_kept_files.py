"""Files that a scenario names: they stay in its folder, go with the run, and are not read when it is reproduced."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import armwright as aw
from armwright.description import content
from armwright.errors import ArmwrightError, RunError, ScenarioError
from cli.test_bad_input import refused
from cli.test_commands import run
from raises_at import raises_at

DRIVEN = 'robot = "{robot}"\nduration_s = 0.02\nsolver.step_s = 1e-3\n[commands]\nschedule = "{schedule}"\n'
SECRET = "t,root\n0,toor\n"
OPENED = """
import sys, armwright as aw
aw.simulate, aw.reproduce, aw.load_run  # imports them
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
assert aw.reproduce(sys.argv[1]).same
print("\\n".join(opened))
"""


@pytest.fixture
def folder(tmp_path):
    """A scenario with its robot and schedule, beside a folder with others."""
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    for each in (inside, outside):
        each.mkdir()
        (each / "arm.toml").write_text(aw.robotfiles.to_toml(aw.load("two-link").record))
        (each / "u.csv").write_text("t,shoulder,elbow\n0,20,5\n0.01,0,0\n")
    (tmp_path / "secret.txt").write_text(SECRET)
    written(inside)
    return inside


def written(folder, robot="arm.toml", schedule="u.csv"):
    path = folder / "one.scenario.toml"
    path.write_text(DRIVEN.format(robot=robot, schedule=schedule))
    return path


def saved(folder, change=None, **named):
    """The run of the scenario, what it keeps changed."""
    done = aw.simulate(aw.read_scenario(written(folder, **named)))
    if change is not None:
        kept = json.loads(done.attrs["scenario"])
        change(kept)
        done.attrs["scenario"] = json.dumps(kept)
    aw.save(done, folder / "run.nc")
    return folder / "run.nc"


def test_a_run_is_reproduced_where_nothing_else_is_left(folder, tmp_path):
    moved = tmp_path / "elsewhere" / "run.nc"
    moved.parent.mkdir()
    saved(folder).rename(moved)
    shutil.rmtree(folder)
    assert aw.reproduce(moved).same


@pytest.mark.study
def test_reproducing_opens_no_other_file(folder, tmp_path):
    path = saved(folder)
    done = subprocess.run([sys.executable, "-c", OPENED, path], capture_output=True, text=True, check=True)
    opened = {line for line in done.stdout.splitlines() if line.startswith(str(tmp_path))}
    assert opened <= {str(path)}


@pytest.mark.sample(2)
@pytest.mark.parametrize("way", ["..", "absolute", "link"])
@pytest.mark.parametrize(("key", "file"), [("robot", "arm.toml"), ("schedule", "u.csv")])
def test_a_path_that_leads_out_needs_the_users_word(folder, key, file, way):
    outside = folder.parent / "outside"
    (folder / f"link-{file}").symlink_to(outside / file)
    name = {"..": f"../outside/{file}", "absolute": str(outside / file), "link": f"link-{file}"}[way]
    path = written(folder, **{key: name})
    with pytest.raises(ScenarioError, match="--allow") as error:
        aw.read_scenario(path)
    assert (error.value.file.rpartition(":")[0], error.value.value) == (str(path), name)
    assert error.value.place.endswith(key)
    assert f"--allow {outside}" in error.value.expected
    assert "leads out of" in refused(("simulate", path))
    again = aw.read_scenario(path, allow=[outside])
    run("simulate", path, "--allow", outside, "-o", folder / "run.nc")
    assert aw.reproduce(folder / "run.nc").same
    assert json.loads(again.document)["files"].keys() >= {name}


def test_a_drive_file_beside_the_robot_stays_in_the_folder_too(folder):
    aw.robotfiles.convert("two-link", folder / "arm.urdf")
    (folder / "arm.drive.toml").rename(folder.parent / "outside" / "arm.drive.toml")
    (folder / "arm.drive.toml").symlink_to(folder.parent / "outside" / "arm.drive.toml")
    with raises_at(ScenarioError, "robot", "--allow", value="arm.drive.toml") as error:
        aw.read_scenario(written(folder, robot="arm.urdf"))
    assert error.value.value == "arm.drive.toml"
    path = written(folder, robot="arm.urdf")
    assert aw.read_scenario(path, allow=[folder.parent / "outside"]).arm.names == ["shoulder", "elbow"]


@pytest.mark.parametrize("name", ["/etc/passwd", "secret", "../secret.txt", "arm.toml"])
def test_a_forged_run_makes_nothing_be_read(folder, name):
    def forge(kept):
        text = DRIVEN.format(robot="arm.toml", schedule=name)
        kept["scenario"] = content.Content.of(text).model_dump()
        del kept["files"]["u.csv"]
        if name == "arm.toml":
            kept["files"][name] = content.Content.of('name = "x"\njoints = []\nlinks = []\nx = 1\n').model_dump()

    path = saved(folder, forge)
    (folder.parent / "secret").write_text(SECRET)
    with pytest.raises(ArmwrightError) as error:
        aw.reproduce(path)
    assert "toor" not in str(error.value)
    assert str(path) in error.value.file


def _damage(kept):
    kept["files"]["u.csv"]["text"] = kept["files"]["u.csv"]["text"].replace("20", "21")


def _drop(kept):
    del kept["files"]["arm.toml"]


def _old(kept):
    files = {name: each["text"] for name, each in kept["files"].items()}
    text = kept["scenario"]["text"]
    kept.clear()
    kept.update(scenario=text, files=files)


def _without_text(kept):
    del kept["files"]["u.csv"]["text"]


def _number(kept):
    kept["files"]["u.csv"] = 5


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_damage, "run.nc: content of 'u.csv': .*checksum"),
        (_drop, "run.nc: robot = 'arm.toml': not kept"),
        (_old, "run.nc: .*Armwright 0.1"),
        (_without_text, "run.nc: content of 'u.csv': .* large"),
        (_number, r"run.nc: scenario.files..u.csv. = 5: expected a table"),
    ],
)
def test_what_does_not_keep_its_files_is_refused_in_one_line(folder, change, said):
    path = saved(folder, change)
    with pytest.raises(RunError, match=said):
        aw.reproduce(path)


def test_what_is_too_large_leaves_its_checksum_and_a_note(folder, monkeypatch):
    monkeypatch.setattr("armwright.scenarios.files.LARGEST", 1000)
    done = aw.simulate(aw.read_scenario(written(folder)))
    kept = json.loads(done.attrs["scenario"])["files"]
    assert "text" not in kept["arm.toml"]
    assert len(kept["arm.toml"]["sha256"]) == 64
    assert "arm.toml has 0.00" in done.attrs["notes"]
    aw.save(done, folder / "run.nc")
    with raises_at(RunError, "content of 'arm.toml'", r"[\d.]+ MiB"):
        aw.reproduce(folder / "run.nc")


def test_assembly_and_modules_of_the_robot_are_kept(folder):
    builtin = Path(aw.__file__).parent / "robots" / "modules"
    library = folder / "mine.modules.toml"
    shutil.copy(builtin / "improv.modules.toml", library)
    text = (builtin / "lwa4p.assembly.toml").read_text(encoding="utf-8")
    (folder / "mine.assembly.toml").write_text(text.replace('"improv"', '"mine.modules.toml"'))
    run("assemble", folder / "mine.assembly.toml", "-o", folder / "arm.toml")
    text = 'robot = "arm.toml"\nduration_s = 0.001\nsolver.step_s = 1e-3\n[commands]\nconstant = 0\n'
    path = folder / "built.scenario.toml"
    path.write_text(text)
    kept = json.loads(aw.read_scenario(path).document)
    assert kept["origins"].keys() == {"mine.assembly.toml", "mine.modules.toml"}
    assert kept["origins"]["mine.modules.toml"]["text"] == library.read_text(encoding="utf-8")
    library.write_text("# another library now\n")  # not what the robot was built from
    assert json.loads(aw.read_scenario(path).document)["origins"].keys() == {"mine.assembly.toml"}

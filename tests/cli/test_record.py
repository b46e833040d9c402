"""`armwright check`, `diff`, `convert` and `show`: what they print, write and refuse."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.description.database import parse
from armwright.description.writer import write_toml
from physics.arms import workshop


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result


@pytest.mark.parametrize("command", ["check", "diff", "convert", "show"])
def test_help_teaches_by_example(command):
    shown = run(command, "--help").stdout
    assert f"armwright {command} " in shown
    assert "Examples:" in shown


def test_check_shows_what_it_looked_at():
    shown = run("check", "cmu-dd").stdout
    assert "cmu-dd: 6 links, 6 joints that move" in shown
    assert re.search(r"^mass properties +.* +nothing", shown, re.M)
    assert shown.endswith("0 errors, 0 warnings\n")


def test_one_is_not_many(tmp_path):
    robot = aw.load("two-link").description
    path = aw.robotfiles.write_toml(
        robot.replace(links=robot.links[:1], joints=robot.joints[:1], frames=(), tip=None), tmp_path / "a.toml"
    )
    assert "two-link: 1 link, 1 joint that moves" in run("check", path).stdout


def test_check_ends_by_what_it_found(tmp_path):
    assert "2 warnings" in run("check", "puma560").stdout
    assert "accepted: published so" in run("check", "puma560", "--strict", code=1).stdout
    data = workshop()
    data["links"][0]["inertia_kg_m2"]["xx"] = 5.0
    path = write_toml(parse(data, "workshop"), tmp_path / "arm.toml")
    shown = run("check", path, code=1).stdout
    assert "link 'link1' inertia_kg_m2: an impossible inertia" in shown
    assert "1 error, " in shown


def test_diff_of_the_same():
    assert run("diff", "panda", "panda").stdout == "panda and panda: every parameter and every source is the same\n"


def test_diff_lists_parameters_and_consequence(tmp_path):
    new = aw.load("lwa4p").with_values({"link6.mass_kg": 2.0}, "estimate").with_payload(1.0, [0, 0, 0.1], [0, 0, 0])
    assert new.description is not None
    path = aw.robotfiles.write_toml(new.description, tmp_path / "new.toml")
    shown = run("diff", "lwa4p", path).stdout
    assert re.search(r"^link6\.mass_kg +1\.5 +2 +\+33\.3 +publication: .* → estimate", shown, re.M)
    assert re.search(r"^payload +absent +link of 1 kg", shown, re.M)
    assert "mass 13.72 → 15.22 kg (+10.9 %)" in shown
    assert re.search(r"^joint5 +1\.8544 +[\d.]+ +[\d.]+ +0\.19526 +[\d.]+ +\+[\d.]+ %", shown, re.M)
    assert re.search(r"^joint1 +0 +0 +0 ", shown, re.M)


def test_diff_gathers_sources(tmp_path):
    run("convert", "puma560", "-o", tmp_path / "puma.urdf")
    shown = run("diff", "puma560", tmp_path / "puma.urdf").stdout
    assert "Same value, other source or deviation" in shown
    assert re.search(r"and \d+ more", shown)
    assert "no joint is in both" in run("diff", "puma560", "panda").stdout


def test_convert_tells_what_it_wrote_and_lost(tmp_path):
    shown = run("convert", "panda", "-o", tmp_path / "panda.urdf").stdout
    assert f"wrote {tmp_path / 'panda.urdf'}\nwrote {tmp_path / 'panda.drive.toml'}\n" in shown
    assert "lost: friction by the law 'sigmoid' (its viscous part is written): joints joint1" in shown
    assert run("convert", "panda", "-o", tmp_path / "panda.toml").stdout == f"wrote {tmp_path / 'panda.toml'}\n"


@pytest.mark.parametrize("ending", ["html", "glb"])
def test_show(ending, tmp_path):
    path = tmp_path / f"arm.{ending}"
    assert run("show", "two-link", "--q", "30deg,pi/2", "-o", path).stdout == f"wrote {path}\n"
    assert path.stat().st_size > 1000


REFUSED = [
    (("check", "nowhere.toml"), "nowhere.toml: no such file"),
    (("check", "broken.toml"), "broken.toml:1: "),
    (("diff", "panda"), "Missing argument 'B'"),
    (("diff", "panda", "pnda"), "did you mean panda?"),
    (("convert", "panda", "-o", "panda.stl"), "the ending '.stl' is not offered; expected .toml, .urdf, .xml or .mjcf"),
    (("convert", "panda", "-o", "nowhere/panda.toml"), "there is no folder 'nowhere'"),
    (("convert", "panda", "-o", "p.toml", "--smoothing", "0.1"), "smoothing: unknown option"),
    (("show", "panda"), "--output: missing; expected .png, .html or .glb"),
    (("show", "panda", "-o", "arm.jpg"), "the ending '.jpg' is not offered; expected .png, .html or .glb"),
    (("show", "panda", "-o", "arm.png", "--q", "1,2"), "--q = '1,2': expected 7 numbers"),
]


@pytest.mark.parametrize(("arguments", "message"), REFUSED, ids=lambda v: " ".join(v) if isinstance(v, tuple) else "")
def test_refused_in_one_line(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.toml").write_text("name = [", encoding="utf-8")
    result = run(*arguments, code=2)
    assert message in result.stderr
    assert result.stderr.count("\n") == (3 if arguments == ("check", "broken.toml") else 1)
    assert [path.name for path in tmp_path.iterdir()] == ["broken.toml"]

"""Example programs and files are found, have titles, and are copied without overwriting anything."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

import armwright as aw
from armwright import examples
from armwright.cli.app import app
from armwright.errors import OutputError

ROOT = Path(__file__).parents[1]


def test_every_example_of_the_checkout_is_copied(tmp_path: Path) -> None:
    copied = aw.copy_examples(tmp_path / "new" / "folder")
    names = {path.relative_to(tmp_path / "new" / "folder").as_posix() for path in copied}
    assert {"01_first_motion.py", "scara.toml", "motions/throw.motion.toml", "cmu-dd-steps.csv"} <= names
    for name in names:
        assert (tmp_path / "new" / "folder" / name).read_bytes() == (ROOT / "examples" / name).read_bytes()


def test_nothing_is_overwritten_and_nothing_else_is_copied(tmp_path: Path) -> None:
    (tmp_path / "scara.toml").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError) as caught:
        aw.copy_examples(tmp_path)
    assert str(caught.value).startswith(str(tmp_path / "scara.toml"))
    assert [path.name for path in tmp_path.iterdir()] == ["scara.toml"]
    assert (tmp_path / "scara.toml").read_text(encoding="utf-8") == "mine"


def test_a_file_in_the_folder_s_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError):
        aw.copy_examples(tmp_path / "file")
    assert (tmp_path / "file").read_text(encoding="utf-8") == "mine"


def test_programs_and_files_have_titles() -> None:
    files = examples.example_files()
    assert len(files) > 20
    for name, path in files.items():
        if path.suffix in (".py", ".toml"):
            assert len(examples.example_title(path)) > 5, name
    assert examples.example_title(files["scara.toml"]).startswith("Small SCARA")


def test_an_installation_without_examples_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(examples, "FOLDERS", (tmp_path,))
    with pytest.raises(OutputError, match="no examples"):
        examples.example_files()


def test_the_wheel_has_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where `examples.py` of an installed wheel looks for them."""
    wheel = pytest.importorskip("hatchling.builders.wheel")
    built = next(iter(wheel.WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])))
    assert Path(built).stat().st_size < 8e6
    with zipfile.ZipFile(built) as archive:
        archive.extractall(tmp_path / "site")
    monkeypatch.setattr(examples, "FOLDERS", (tmp_path / "site" / "armwright" / "example_files",))
    assert "01_first_motion.py" in examples.example_files()
    assert {"motions/throw.motion.toml", "logs/tx40/tx40.parquet", "logs/README.md"} <= set(examples.example_files())


def test_the_command_lists_and_copies(tmp_path: Path) -> None:
    listed = CliRunner().invoke(app, ["examples", "list"])
    assert "motions/throw.motion.toml" in listed.stdout
    assert "Voltages in, motion out" in listed.stdout
    copied = CliRunner().invoke(app, ["examples", "copy", str(tmp_path / "new")])
    assert copied.exit_code == 0
    assert f"try: python {tmp_path / 'new' / '01_first_motion.py'}" in " ".join(copied.stdout.split())
    again = CliRunner().invoke(app, ["examples", "copy", str(tmp_path / "new")])
    assert again.exit_code == 2

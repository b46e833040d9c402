"""The site builds without a warning, every source that is cited is listed, every key of a robot file has a meaning."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from armwright import errors
from docs.pages import ROOT, page

KEY = re.compile(r"\[([A-Z][A-Za-z]+(?:\d{4})?)\]")
LISTED = re.compile(r"^\((\w+)\)=\n\*\*(\w+)\.\*\*", re.MULTILINE)


def test_it_builds_without_warnings(tmp_path: Path) -> None:
    pytest.importorskip("sphinx")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", str(tmp_path / "trees")]
    done = subprocess.run([*command, str(ROOT / "docs"), str(tmp_path / "site")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    site = tmp_path / "site"
    assert "generated:" not in "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.html"))
    kernels = (site / "conventions.html").read_text(encoding="utf-8")
    assert "forward_kinematics" in kernels
    assert "viscous_n_m_s_per_rad" in (site / "reference" / "robot-file.html").read_text(encoding="utf-8")
    assert str(ROOT) not in "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.html"))


def _docstrings() -> Iterator[str]:
    for path in sorted((ROOT / "src").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                yield ast.get_docstring(node) or ""


def test_every_citation_is_listed_and_every_listed_source_is_cited() -> None:
    in_source = {key for text in _docstrings() for key in KEY.findall(text)}
    in_pages = {
        key
        for path in (ROOT / "docs").rglob("*.md")
        if path.name != "references.md"
        for key in re.findall(r"\[\\\[(\w+)\\\]\]", path.read_text(encoding="utf-8"))
    }
    listed = LISTED.findall(page("docs/references.md"))
    keys = [key for _, key in listed]
    assert [target for target, _ in listed] == [key.lower() for key in keys]
    assert keys == sorted(keys, key=str.lower)
    assert len(in_source) > 10
    assert in_source | in_pages == set(keys)


def test_every_public_name_is_in_the_reference() -> None:
    import armwright

    shown = set(re.findall(r"auto\w+:: armwright\.(?:errors\.)?(\w+)", page("docs/reference/api.md")))
    assert set(armwright.__all__) <= shown


def test_every_key_of_a_robot_file_has_a_meaning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "ext"))
    import armwright_record  # pyright: ignore[reportMissingImports]

    for _, _, records in armwright_record.TABLES:
        for record in records:
            for name, field in record.model_fields.items():
                assert armwright_record.meaning(name, field), f"{record.__name__}.{name} says nothing of itself"


def test_links_between_pages_lead_somewhere() -> None:
    """Sphinx checks those of docs/; README, CHANGELOG and CONTRIBUTING are read on their own."""
    for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md"):
        for link in re.findall(r"\]\((?!https?://)([^)#]+)\)", page(name)):
            assert (ROOT / link).exists(), f"{name} links to {link}"


def test_every_exception_is_in_the_reference() -> None:
    listed = re.findall(r"autoexception:: armwright\.errors\.(\w+)", page("docs/reference/api.md"))
    ours = [
        name for name, thing in vars(errors).items() if isinstance(thing, type) and thing.__module__ == errors.__name__
    ]
    assert listed == ours

"""The site builds without a warning, every source that is cited is listed, every key of a robot file has a meaning."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path

import pydantic
import pytest

from armwright.kernels.signatures import SIGNATURES
from docs.pages import ROOT, page
from public_names import GROUPS, PUBLIC

KEY = re.compile(r"\[([A-Z][A-Za-z]+(?:\d{4})?)\]")
LISTED = re.compile(r"^\((\w+)\)=\n\*\*(\w+)\.\*\*", re.MULTILINE)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the site, which builds without a warning and without a network."""
    pytest.importorskip("sphinx")
    folder = tmp_path_factory.mktemp("docs")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", str(folder / "trees")]
    done = subprocess.run([*command, str(ROOT / "docs"), str(folder / "site")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder / "site"


@pytest.mark.study
def test_its_pages_have_their_generated_parts_and_no_path_of_this_machine(site: Path) -> None:
    kernels = (site / "conventions.html").read_text(encoding="utf-8")
    assert "forward_kinematics" in kernels
    assert kernels.count("<math ") > 5
    assert "mathjax" not in kernels.lower()
    assert "viscous_n_m_s_per_rad" in (site / "reference" / "robot-file.html").read_text(encoding="utf-8")
    assert str(ROOT) not in "".join(path.read_text(encoding="utf-8") for path in site.rglob("*.html"))


@pytest.mark.study
def test_every_public_object_can_be_linked_to(site: Path) -> None:
    """`objects.inv`, which other projects' documentation reads, has all public names, their members and the groups."""
    from sphinx.util.inventory import InventoryFile

    found = InventoryFile.loads((site / "objects.inv").read_bytes(), uri="").data
    kinds = {name: kind for kind, names in found.items() if kind.startswith("py:") for name in names}
    for name, value in PUBLIC.items():
        assert kinds.get(f"armwright.{name}") in _kinds(value), name
        for member in _methods(value) if isinstance(value, type) else ():
            assert kinds.get(f"armwright.{name}.{member}") == "py:method", f"{name}.{member}"
    assert {kinds.get(f"armwright.CompiledArm.{name}") for name in SIGNATURES} == {"py:method"}
    for group, module in GROUPS.items():
        assert kinds[f"armwright.{group}"] == "py:module"
        assert all(f"armwright.{group}.{name}" in kinds for name in module.__all__)


def _kinds(value: object) -> tuple[str, ...]:
    return ("py:class", "py:exception") if isinstance(value, type) else ("py:function",)


def _methods(thing: type) -> set[str]:
    """Public methods of a class that we wrote, inherited ones too."""
    ours = [owner for owner in thing.__mro__ if owner.__module__.startswith("armwright")]
    return {n for owner in ours for n, value in [*vars(owner).items()] if n[0] != "_" and inspect.isfunction(value)}


@pytest.mark.study
def test_a_public_type_in_a_signature_is_a_link_and_its_source_is_shown(site: Path) -> None:
    text = (site / "reference" / "python" / "index.html").read_text(encoding="utf-8")
    entry = re.search(r'<dt[^>]* id="armwright\.load">.*?</dt>', text, re.DOTALL)
    assert entry is not None
    assert 'href="#armwright.Model"' in entry[0]
    assert "_modules/armwright/model/load.html#load" in entry[0]
    assert (site / "_modules" / "armwright" / "model" / "load.html").exists()


def _docstrings() -> Iterator[str]:
    for path in sorted((ROOT / "src").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                yield ast.get_docstring(node) or ""


@pytest.mark.study
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


def test_every_key_of_a_robot_file_has_a_meaning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "ext"))
    import armwright_record  # pyright: ignore[reportMissingImports]

    for _, _, records in armwright_record.TABLES:
        for record in records:
            for name, field in record.model_fields.items():
                assert armwright_record.meaning(name, field), f"{record.__name__}.{name} says nothing of itself"


def test_the_reference_of_scenario_files_tells_what_each_key_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "ext"))
    import armwright_record  # pyright: ignore[reportMissingImports]

    rows = [[cell.strip() for cell in line.split(" | ")] for line in armwright_record.scenario_file().splitlines()]
    takes = {row[0].strip("| `"): (row[1], row[3]) for row in reversed(rows) if len(row) >= 5}
    whole, texts, by_joint = "a whole number", "a list of texts", "a number, numbers, or a table by joint"
    assert takes["substeps"] == (whole, "")
    assert takes["seed"][0] == f"{whole}, 0 or more"
    assert takes["every"] == (f"{whole}, 0 or more", "")
    assert takes["max_substeps"] == (whole, "")
    assert takes["reduce"] == (texts, "")
    assert takes["duration_s"] == takes["rtol"] == takes["cutoff_hz"] == ("a number", "")
    assert takes["jitter_s"] == ("a number", "default `0.0`")
    assert takes["q"] == takes["limit"] == takes["resolution"] == (by_joint, "")
    assert takes["counts"] == ("a number, or numbers", "")
    assert takes["normal"] == ("2 numbers", "")
    assert takes["wrench"] == ("6 numbers, or text", "")
    assert takes["payload"][0] == "tables"
    assert takes["title"] == ("text", "")


def test_every_key_takes_what_pydantic_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A value of each kind that the reference names is read, and none of the other kinds."""
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "ext"))
    import armwright_record  # pyright: ignore[reportMissingImports]

    examples = {"a whole number": 1, "a number": 1.5, "text": "x", "numbers": [1.5, 2.5, 3.5, 4.5]}
    known = {*examples, "a table by joint", "0 or more", "1 or more"}
    for _, _, records in armwright_record.SCENARIO_TABLES:
        for name, field in (item for record in records for item in record.model_fields.items()):
            kinds = set(re.split(", or |, ", armwright_record.expected(field.annotation, field.metadata)))
            if kinds <= known:
                read = pydantic.TypeAdapter(typing.Annotated[field.annotation, *field.metadata, None])
                found = {kind for kind, value in examples.items() if takes(read, value)}
                if "a number" in kinds:  # as which a whole one may be written
                    found -= {"a whole number"}
                assert found == kinds & set(examples), name


def takes(read: pydantic.TypeAdapter[object], value: object) -> bool:
    try:
        read.validate_python(value)
    except pydantic.ValidationError:
        return False
    return True


def test_links_between_pages_lead_somewhere() -> None:
    """Sphinx checks those of docs/; README, CHANGELOG and CONTRIBUTING are read on their own."""
    for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md"):
        for link in re.findall(r"\]\((?!https?://)([^)#]+)\)", page(name)):
            assert (ROOT / link).exists(), f"{name} links to {link}"

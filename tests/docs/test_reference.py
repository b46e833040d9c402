"""Reference pages are plain Markdown, made from the source as it is now, and leave nothing public out."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from armwright import errors
from docs.pages import ROOT, page
from public_names import GROUPS, PUBLIC

TOOL = ROOT / "docs" / "ext" / "armwright_pages.py"
DIRECTIVE = re.compile(r"^(?:`{3,}|:{3,})\{([\w-]+)\}|^\(([\w-]+)\)=$", re.MULTILINE)
SITE_ONLY = {"docs/index.md": {"toctree"}, "docs/changelog.md": {"include"}}


def _printed(code: str) -> str:
    """Standard output of a program that finds the tool's modules."""
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(TOOL.parent)!r}); {code}"],
        capture_output=True,
        text=True,
        timeout=120,
        encoding="utf-8",
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.study
def test_generated_parts_are_current() -> None:
    done = subprocess.run(
        [sys.executable, str(TOOL), "--check"], capture_output=True, text=True, timeout=120, encoding="utf-8"
    )
    assert done.returncode == 0, f"{done.stdout}{done.stderr}Run `make reference` and commit what it writes."


@pytest.mark.study
def test_an_outdated_page_is_found_and_written_anew(tmp_path: Path) -> None:
    """A page with another word in its table, and one without its generated part."""
    old = page("docs/reference/scenario-file.md")
    mark, folder = "<!-- generated: scenario-file -->", tmp_path / "reference"  # as deep as the page itself
    folder.mkdir()
    for name, text in {
        "a.md": old.replace("a whole number", "a fraction"),
        "b.md": f"{old.partition(mark)[0]}{mark}\n",
    }.items():
        assert text != old
        (folder / name).write_text(text, encoding="utf-8")
    docs = f"import pathlib, armwright_pages as tool; tool.DOCS = pathlib.Path({str(tmp_path)!r})"
    printed = _printed(f"{docs}; print(tool.main(['--check'])); tool.main([])")
    for name in ("a.md", "b.md"):
        assert f"{name} is out of date: run make reference" in printed
        assert (folder / name).read_text(encoding="utf-8") == old
    assert "\n1\n" in printed


def _pages() -> Iterator[str]:
    for path in sorted((ROOT / "docs").rglob("*.md")):
        yield path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("name", [name for name in _pages() if name != "docs/references.md"])
def test_a_page_is_plain_markdown(name: str) -> None:
    """A code host shows it as the site does: nothing is filled in by Sphinx."""
    found = {directive or target for directive, target in DIRECTIVE.findall(page(name))}
    assert found <= SITE_ONLY.get(name, set())
    assert "/home/" not in page(name)
    assert not re.search(r" at 0x[0-9a-f]{6}", page(name))


def test_every_public_name_is_in_the_reference() -> None:
    shown = [name for text in _python().values() for name in re.findall(r"^### `aw\.([\w.]+)`$", text, re.MULTILINE)]
    assert sorted(shown) == sorted(PUBLIC)


def test_each_group_is_a_page() -> None:
    for group in GROUPS:
        shown = re.findall(r"^### `aw\.([\w.]+)`$", page(f"docs/reference/python/{group}.md"), re.MULTILINE)
        assert {name.partition(".")[0] for name in shown} == {group}


def _python() -> dict[str, str]:
    """Pages of the Python reference by their paths."""
    return {name: page(name) for name in _pages() if name.startswith("docs/reference/python/")}


def test_every_exception_is_in_the_reference() -> None:
    listed = re.findall(r"^### `armwright\.errors\.(\w+)`$", page("docs/reference/python/errors.md"), re.MULTILINE)
    ours = [
        name
        for name, thing in vars(errors).items()
        if isinstance(thing, type) and issubclass(thing, BaseException) and thing.__module__ == errors.__name__
    ]
    assert [name for name in listed if name != "Problem"] == ours


def test_entries_of_the_reference_say_what_they_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """Signature, arguments with units, result, exceptions and sources of a docstring are all there."""
    monkeypatch.syspath_prepend(str(TOOL.parent))
    import armwright_api  # pyright: ignore[reportMissingImports]

    text = armwright_api.api("CompiledArm: inverse_dynamics", "load", "simulation.Simulation: step")
    assert "### `aw.load`" in text
    assert "- `q`: (…, n) [rad | m]" in text
    assert "- `tau`: (…, n) [N m | N]" in text
    assert "- `ModelError`: " in text
    assert "[\\[LuhWalkerPaul1980\\]](@references.md#luhwalkerpaul1980)" in text
    assert "self" not in "".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))


def test_docstrings_become_markdown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(TOOL.parent))
    import armwright_api  # pyright: ignore[reportMissingImports]

    doc = """Ratio a*b of two_words_ and `x*y`, if x < 3.

    tau = M(q) qdd
        + g(q)

Args:
    a, b: (n,) [m].   c: more of
        the same.
    one that has no name
Raises:
    ModelError: never.
"""
    assert list(armwright_api.markdown(doc)) == [
        "Ratio a\\*b of two_words\\_ and `x*y`, if x < 3.",
        "```equation\ntau = M(q) qdd\n    + g(q)\n```",
        "**Arguments**",
        "- `a, b`: (n,) [m].\n- `c`: more of the same.\n- one that has no name",
        "**Raises**",
        "- `ModelError`: never.",
    ]


def test_the_page_of_units_has_those_of_every_key() -> None:
    """Endings of keys in the tables of all reference pages stand in the page of units, with the same unit."""
    endings = dict(re.findall(r"^\| `(\w+)` \| (\S.*?) \|$", page("docs/reference/units.md"), re.MULTILINE))
    found = 0
    for path in sorted((ROOT / "docs" / "reference").glob("*-file*.md")):
        for key, unit in re.findall(
            r"^\| `(\w+)` \| [^|]* \| ([^|]+?) \|[^|\n]*\|.", path.read_text(encoding="utf-8"), re.MULTILINE
        ):
            if unit.strip() and key not in ("xx", "xy", "xz", "yy", "yz", "zz"):
                matching = max((ending for ending in endings if key.endswith(ending)), key=len)
                assert endings[matching].replace(" ", "\u00a0") == unit, key
                found += 1
    assert found > 100

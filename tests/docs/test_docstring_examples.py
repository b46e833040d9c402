"""The example in the docstring of a public name runs, and prints what it shows."""

from __future__ import annotations

import doctest
import inspect
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from docs.pages import ROOT
from export.fmu.fmus import this_platform
from public_names import PUBLIC

MOST_LINES = 6
WIDEST = 88

# What users call or make: functions, and classes that say what they are made from.
USED = [
    name
    for name, value in PUBLIC.items()
    if inspect.isfunction(value) or (inspect.isclass(value) and "\nArgs:" in (inspect.getdoc(value) or ""))
]

# Libraries that not every environment of the tests has.
NEEDS = {"interop.jax": "jax", "interop.torch": "torch"}


def _example(thing: object) -> str:
    return (inspect.getdoc(thing) or "").partition("\nExample:\n")[2]


WITH = {name: PUBLIC[name] for name in PUBLIC if _example(PUBLIC[name])}
KERNELS = {
    f"CompiledArm.{name}": getattr(aw.CompiledArm, name)
    for name in dir(aw.CompiledArm)
    if not name.startswith("_") and _example(getattr(aw.CompiledArm, name))
}


def test_every_public_name_that_users_call_has_an_example() -> None:
    assert [name for name in USED if name not in WITH] == []


@pytest.mark.parametrize("name", [*WITH, *KERNELS])
def test_an_example_is_short(name: str) -> None:
    lines = _example({**WITH, **KERNELS}[name]).splitlines()
    assert sum(line.strip().startswith((">>> ", "... ")) for line in lines) <= MOST_LINES
    assert all(len(line.strip()) <= WIDEST for line in lines)


@pytest.mark.parametrize("name", [*WITH, *KERNELS])
def test_an_example_prints_what_it_shows(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder with the examples of the repository, with `aw` and `np` imported."""
    if name in NEEDS:
        pytest.importorskip(NEEDS[name], reason=f"{NEEDS[name]} is not installed")
    if name == "export.export_fmu":
        this_platform()
    (tmp_path / "examples").symlink_to(ROOT / "examples", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    test = doctest.DocTestParser().get_doctest(_example({**WITH, **KERNELS}[name]), {"aw": aw, "np": np}, name, name, 0)
    report: list[str] = []
    failed, tried = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test, out=report.append)
    assert tried > 0
    assert not failed, "".join(report)

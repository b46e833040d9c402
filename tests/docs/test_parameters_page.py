"""The page about parameters runs as it stands, and prints what it says."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.pages import blocks, python

PAGE = "docs/how-to/parameters.md"


@pytest.mark.study
def test_the_page_runs(tmp_path: Path) -> None:
    code = "".join(text for kind, text in blocks(PAGE) if kind == "python")
    (table,) = (text for kind, text in blocks(PAGE) if kind == "text")
    assert python(code, tmp_path) == table + "True\n"

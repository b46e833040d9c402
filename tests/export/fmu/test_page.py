"""The page on FMUs: its program prints what it says."""

from docs.pages import blocks, python
from export.fmu.fmus import this_platform


def test_the_program_prints_what_the_page_shows(tmp_path):
    this_platform()
    found = blocks("docs/export-fmu.md")
    (program,) = (text for kind, text in found if kind == "python")
    (shown,) = (text for kind, text in found if kind == "text")
    assert python(program, tmp_path) == shown

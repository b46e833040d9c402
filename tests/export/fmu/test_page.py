"""The page on FMUs: its program prints what it says."""

from docs.pages import blocks, python


def test_the_program_prints_what_the_page_shows(tmp_path):
    found = blocks("docs/export-fmu.md")
    (program,) = (text for kind, text in found if kind == "python")
    (shown,) = (text for kind, text in found if kind == "text")
    assert python(program, tmp_path) == shown

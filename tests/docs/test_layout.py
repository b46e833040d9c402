"""Pages fit a narrow window, pictures suit light and dark, and figures of comparisons have a source."""

from __future__ import annotations

import ast
import re

import pytest

from docs.pages import ROOT, blocks, page
from pictures.gallery import IMAGES, TABLE
from pictures.paper import has_transparent_ground

COLUMNS, ROWS = 88, 100  # of code; of a row of numbers in TOML, which cannot be broken
FENCE = re.compile(r"^ *```(?P<kind>\w+)\n(?P<text>.*?)^ *```", re.DOTALL | re.MULTILINE)
PAGES = ["README.md", *sorted(p.relative_to(ROOT).as_posix() for p in (ROOT / "docs").rglob("*.md"))]
WIDTHS = dict.fromkeys(("python", "py", "sh", "bash", "c", "xml"), COLUMNS) | {"toml": ROWS}
PHOTOGRAPHS = {picture.file for picture in TABLE if picture.opened}  # of pages, in light and in dark colours
PROGRAM = re.compile(r"```python\n(?P<code>.*?)```.*?`(?P<path>examples/\S+\.py)`", re.DOTALL)


@pytest.mark.parametrize("name", [name for name in PAGES if "/reference/" not in name])
def test_code_fits_a_narrow_window(name: str) -> None:
    """Output that a program prints may be wider: its block scrolls."""
    long = []
    for block in FENCE.finditer(page(name)):
        for line in block["text"].splitlines():
            typed = line.startswith("$ ") or block["kind"] in WIDTHS
            if typed and len(line) > WIDTHS.get(block["kind"], COLUMNS):
                long.append(f"{len(line)} columns: {line}")
    assert not long, "\n".join(long)


@pytest.mark.parametrize("path", sorted(IMAGES.iterdir()), ids=lambda path: path.name)
def test_a_picture_suits_light_and_dark_pages(path) -> None:
    if path.name in PHOTOGRAPHS:
        other = path.name.replace("-dark", "") if "-dark" in path.name else f"{path.stem}-dark.png"
        assert other in PHOTOGRAPHS
    else:
        assert has_transparent_ground(path), "make pictures draws it without paper"


def test_the_gallery_shows_lines_of_the_programs() -> None:
    """Every statement of a block is one of the program that the text below it names, in another layout."""
    found = list(PROGRAM.finditer(page("docs/gallery.md")))
    assert len(found) == len([kind for kind, _ in blocks("docs/gallery.md") if kind == "python"]) >= 5
    for each in found:
        program = {ast.dump(node) for node in ast.walk(ast.parse(page(each["path"]))) if isinstance(node, ast.stmt)}
        shown = ast.parse(each["code"]).body
        assert len(shown) >= 2
        assert not [ast.unparse(node) for node in shown if ast.dump(node) not in program], each["path"]


def test_figures_of_the_comparison_stand_on_the_page_that_each_row_names() -> None:
    rows = [line.split(" | ") for line in page("docs/compared.md").splitlines() if re.search(r"\]\([\w-]+\.md#", line)]
    measured = [row for row in rows if len(row) == 5]
    assert len(measured) >= 10
    for row in measured:
        source = re.search(r"\((?P<page>[\w-]+\.md)#", row[-1])
        assert source is not None
        text = page(f"docs/{source['page']}")
        for number in re.findall(r"\d[\d,]*\.\d+|\d[\d,]{2,}", " ".join(row[1:4])):
            assert number in text, f"{source['page']} does not have {number} of: {row[0]}"


def test_quantities_in_cells_are_joined_and_words_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "ext"))
    from armwright_cells import joined

    assert joined("1.1 (0.94–1.4) ✓ ≥ 0.83") == "1.1 (0.94\u2060–\u20601.4) ✓ ≥\u00a00.83"
    assert joined("2.9e-15") == "2.9e\u2060-\u206015"
    assert joined("0.55 mm, 9 N m, 4 joints, 2 as one") == "0.55\u00a0mm, 9\u00a0N m, 4 joints, 2 as one"


def test_tables_of_words_become_paragraphs_on_a_telephone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Columns of numbers stay columns; of words each cell has its head, but for the first and for what needs none."""
    pytest.importorskip("sphinx")
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "ext"))
    from armwright_cells import arrange_cells, stack_rows
    from docutils.core import publish_doctree

    words = "\n".join(
        f"   * - {row}" for row in ("key\n     - default\n     - meaning", f"mass\n     - 3\n     - {50 * 'm'}")
    )
    numbers = "\n".join(f"   * - {row}" for row in ("n\n     - time\n     - ratio", "6\n     - 1.5\n     - 2.0"))
    tree = publish_doctree(
        f".. list-table::\n   :header-rows: 1\n\n{words}\n\n.. list-table::\n   :header-rows: 1\n\n{numbers}\n"
    )
    arrange_cells(None, tree)
    stack_rows(None, tree)
    stacked, plain = tree.findall(lambda node: node.tagname == "table")
    assert (stacked["classes"], plain["classes"]) == (["stacked"], [])
    assert [cell.astext()[:10] for cell in stacked.findall(lambda node: node.tagname == "entry")][3:] == [
        "mass",
        "default: 3",
        "m" * 10,
    ]

"""Equations that docstrings and pages show are drawn as formulas, and nothing else is."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from docs.pages import ROOT

pytest.importorskip("sphinx")
sys.path.insert(0, str(ROOT / "docs" / "ext"))
import armwright_formulas

FENCE = re.compile(r"^```(equation|text)\n(.*?)^```", re.DOTALL | re.MULTILINE)
PAGES = sorted((ROOT / "docs").rglob("*.md"))
EQUATIONS = {
    f"{path.relative_to(ROOT)}:{match.start()}": match[2]
    for path in PAGES
    for match in FENCE.finditer(path.read_text(encoding="utf-8"))
    if match[1] == "equation"
}


def drawn(text: str) -> str:
    """A formula without the rows of its table and their first group."""
    return re.sub(r"^<mrow>|</mrow>$", "", armwright_formulas.Formula(text).drawn)


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        ("q̈", "<mover accent='true'><mi>q</mi><mo stretchy='false'>¨</mo></mover>"),
        ("ẏ", "<mover accent='true'><mi>y</mi><mo stretchy='false'>˙</mo></mover>"),
        ("tau_ext", "<msub><mi>τ</mi><mrow><mi>ext</mi></mrow></msub>"),
        ("Kt", "<msub><mi>K</mi><mrow><mi>t</mi></mrow></msub>"),
        ("σ0", "<msub><mi>σ</mi><mrow><mn>0</mn></mrow></msub>"),
        ("H⁻¹", "<msup><mi>H</mi><mrow><mo form='prefix'>−</mo><mn>1</mn></mrow></msup>"),
        ("Bᵢᵀ", "<msubsup><mi>B</mi><mrow><mi>i</mi></mrow><mrow><mi>T</mi></mrow></msubsup>"),
        ("e^{-x}", "<msup><mi>e</mi><mrow><mrow><mo form='prefix'>−</mo><mi>x</mi></mrow></mrow></msup>"),
        ("δ'", "<msup><mi>δ</mi><mrow><mo>′</mo></mrow></msup>"),
        ("Φ", "<mi mathvariant='normal'>Φ</mi>"),
        ("√2", "<msqrt><mn>2</mn></msqrt>"),
        ("Σ_k", "<munder><mo movablelimits='false'>∑</mo><mrow><mi>k</mi></mrow></munder>"),
        ("a b", "<mi>a</mi><mspace width='0.17em'/><mi>b</mi>"),
        ("a - b", "<mi>a</mi><mo>−</mo><mi>b</mi>"),
        ("sin x", "<mi>sin</mi><mspace width='0.17em'/><mi>x</mi>"),
        ("at rest", "<mtext>at\u00a0rest</mtext>"),
        ("`kp_gain` < dead_band", '<mtext class="code">kp_gain</mtext><mo>&lt;</mo><mtext class="code">dead_band</mtext>'),
    ],
)  # fmt: skip
def test_a_sign_is_drawn_as_the_field_writes_it(text: str, formula: str) -> None:
    assert drawn(text) == formula


def test_an_exponent_of_a_bracket_is_that_of_the_whole_bracket() -> None:
    (power,) = ElementTree.fromstring(f"<mrow>{drawn('(q̇/vs)²')}</mrow>")
    assert (power.tag, power[1].findtext("mn")) == ("msup", "2")
    assert [each.tag for each in power[0]] == ["mo", "mrow", "mo"]


def test_rows_columns_and_paragraphs() -> None:
    text = "G = t,   σ = 1      the motor drives\nG = 0      at rest\n\nx = y"
    first, second = ElementTree.fromstring(f"<div>{armwright_formulas.mathml(text)}</div>")
    assert [len(row) for row in first[0]] == [2, 2]  # a gap after the comma, then a column
    assert [len(row) for row in second[0]] == [1]
    assert second.get("alttext") == "x = y"


@pytest.mark.parametrize("text", ["(a + b", "a + b)", "|a", "_x", "{a"])
def test_an_equation_that_cannot_be_read_fails_the_build(text: str) -> None:
    with pytest.raises(ValueError, match=re.escape(text)):
        armwright_formulas.mathml(text)


@pytest.mark.parametrize("place", EQUATIONS)
def test_every_equation_is_well_formed_and_none_of_its_signs_is_lost(place: str) -> None:
    text = EQUATIONS[place]
    root = ElementTree.fromstring(f"<div>{armwright_formulas.mathml(text)}</div>")
    shown = "".join("".join(each.itertext()) for each in root)
    assert re.findall(r"\d|[=≤≥<>()\[\]/+|]", "".join(re.findall(r"[^_^]", text))) == re.findall(
        r"\d|[=≤≥<>()\[\]/+|]", shown
    ) or re.search(r"[√⁰-₟²³¹]", text)


def test_pages_leave_no_equation_as_text() -> None:
    assert len(EQUATIONS) > 25
    for path in (ROOT / "docs").glob("*.md"):
        page = path.read_text(encoding="utf-8")
        assert not [
            text for kind, text in FENCE.findall(page) if kind == "text" and re.search("[\u0307\u0308]", text)
        ], path


def test_no_other_fence_is_drawn() -> None:
    from docutils import nodes
    from docutils.utils import new_document

    tree = new_document("page")
    for language in ("python", "text", "equation", "console"):
        tree += nodes.literal_block("", "x = a b", language=language)
    armwright_formulas.draw_fences(None, tree)  # type: ignore[arg-type]
    assert [type(each).__name__ for each in tree] == ["literal_block", "literal_block", "raw", "literal_block"]
    assert "<math" in tree[2].astext()

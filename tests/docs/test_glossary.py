"""The glossary has the words that a newcomer meets, and pages link to it where they use one first."""

from __future__ import annotations

import re

import pytest

from docs.pages import ROOT, page

TERMS = re.findall(r"^## (.+)$", page("docs/glossary.md"), re.MULTILINE)
WORDS = {
    *("Draw", "End effector", "Hold", "Kernel", "Lane", "Reference", "Robot record", "Rows", "Run", "Scenario", "Tick"),
    *("Verdict", "Wrench"),
}


def test_it_is_in_alphabetical_order_and_has_the_words() -> None:
    assert sorted(TERMS, key=str.lower) == TERMS
    assert set(TERMS) >= WORDS


@pytest.mark.parametrize(
    "name", ["docs/at-a-glance.md", "docs/how-to/batches.md", "docs/how-to/scenarios.md", "docs/sweeps.md"]
)
def test_the_first_lane_of_a_page_leads_to_it(name: str) -> None:
    prose = re.sub(r"```.*?```|<!--.*?-->|`[^`]*`|^\|.*?$|^#.*?$", "", page(name), flags=re.DOTALL | re.MULTILINE)
    first = re.search(r"(\[?)\b(?<!\*\*)lanes?\b(\]\([./\w-]*glossary\.md#lane\))?", prose)
    assert first is not None
    assert first[2], prose[max(0, first.start() - 80) : first.end() + 40]


def test_links_into_it_lead_to_a_term() -> None:
    """Sphinx checks those of docs/; README is read on its own."""
    known = {term.lower().replace(" ", "-") for term in TERMS}
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        assert set(re.findall(r"glossary\.md#([\w-]+)", path.read_text(encoding="utf-8"))) <= known, path.name

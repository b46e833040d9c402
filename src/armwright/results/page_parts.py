"""Parts of pages that show results: sections, tables, lists, verdicts, definitions; and the page around them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from armwright.output import check_destination, write_whole
from armwright.results.plot_page import PAGES, page
from armwright.results.table import Table

ENDINGS = (".html",)
NAME = re.compile(r"\w*[\d_]")  # at the beginning of a remark: of a joint or a parameter


def write_page(path: str | os.PathLike[str], title: str, body: Iterable[str], subtitle: str = "") -> Path:
    """Writes a page of sections as one file that needs no network; light or dark as the reader's system is.

    Args:
        path: ending in .html.   title: of the page.   body: its sections, as HTML.   subtitle: beside the title.
    Returns:
        path: of the page.
    Raises:
        OutputError: the file cannot be written.
    """
    path = check_destination(path, ENDINGS)
    html = report_html(title, body, subtitle)
    write_whole(path, html, ENDINGS)
    return path


def report_html(title: str, body: Iterable[str], subtitle: str = "") -> str:
    """HTML of a page of sections; see `write_page`."""
    words = {"title": title, "heading": title, "subtitle": subtitle}
    styles = [PAGES / "page.css", PAGES / "report.css"]
    return page(PAGES / "report.html", [PAGES / "unpack.js"], styles, words, body="\n".join(body))


def section(heading: str, inner: str, anchor: str = "") -> str:
    """A section under a heading."""
    where = f' id="{escape(anchor)}"' if anchor else ""
    return f"<section{where}><h2>{escape(heading)}</h2>\n{inner}\n</section>"


def bullets(texts: Iterable[str]) -> str:
    """A list of texts; nothing of none."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else ""


def said(sentences: Sequence[str], good: bool | None) -> str:
    """Sentences, the first of which is the verdict.

    Args:
        sentences: of a result.   good: whether the verdict is good; None: there is none.
    """
    if not sentences or good is None:
        return bullets(map(sentence, sentences))
    first, *others = map(sentence, sentences)
    return f'<p class="verdict{" good" * good}">{escape(first)}</p>{bullets(others)}'


def sentence(text: str) -> str:
    """A remark as a sentence: with a full stop, and a capital letter unless it begins with a name."""
    begun = text if NAME.match(text) else f"{text[:1].upper()}{text[1:]}"
    return f"{begun}{'' if text.endswith(('.', '?')) else '.'}"


def plotted(svg: str) -> str:
    """A picture that scrolls sideways where the page is narrow."""
    return f'<div class="plot">{svg}</div>'


def definitions(heading: str, pairs: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """A section with names and their meanings; none without pairs."""
    rows = [[escape(name), escape(about)] for name, about in pairs]
    table = html_table(("", ""), rows, (0, 1)).replace('</td><td class="word">', '</td><td class="word wrap">')
    return [(heading, table)] if rows else []


def shown_table(table: Table) -> str:
    """A table of a result, the columns with any entry."""
    used = table.used
    rows = [[escape(str(row[k])) for k in used] for row in table.cells]
    return html_table([table.heads[k] for k in used], rows, [at for at, k in enumerate(used) if k in table.words])


def html_table(heads: Sequence[str], rows: Iterable[Sequence[str]], words: Sequence[int]) -> str:
    """A table of cells that are HTML already; columns in `words` are left-aligned."""

    def cells(row: Sequence[str], tag: str) -> str:
        return "".join(
            f'<{tag} class="word">{c}</{tag}>' if k in words else f"<{tag}>{c}</{tag}>" for k, c in enumerate(row)
        )

    body = "\n".join(f"<tr>{cells(row, 'td')}</tr>" for row in rows)
    heads = [re.sub(r" (?=[^\[]*\]|[×÷]$)", "&nbsp;", head) for head in heads]  # a unit stays on one line
    return (
        f'<div class="table"><table><thead><tr>{cells(heads, "th")}</tr></thead><tbody>\n{body}\n</tbody></table></div>'
    )

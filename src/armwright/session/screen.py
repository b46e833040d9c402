"""Lines and sheets on a terminal in colour, or as plain text where there is none."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armwright.session.listing import Drawing, Line, Sheet, Shown, plain

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

STYLES = {"plain": "", "good": "green", "note": "yellow", "bad": "bold red", "dim": "dim", "head": "bold"}


class Screen:
    """Shows what a session says."""

    def __init__(self, console: Console | None = None):
        """Args:
        console: where to; by default standard output.
        """
        if console is None:
            from rich.console import Console

            console = Console(highlight=False, markup=False, emoji=False)
        self.console = console

    def __call__(self, shown: Shown) -> None:
        """Shows one thing."""
        if isinstance(shown, Line):
            from rich.text import Text

            self.console.print(Text(shown.text, STYLES[shown.style]), soft_wrap=not self.console.is_terminal)
        elif isinstance(shown, Drawing):
            from armwright.pictures.terminal import show_runs

            show_runs(shown.run, self.console, joints=shown.joints, quantities=shown.quantities)
        elif self.console.is_terminal:
            self.console.print(_table(shown, self.console.width))
            self.console.print()
        else:
            self.console.file.write(plain(shown) + "\n")

    def error(self, told: str) -> None:
        """An error, in one line."""
        self(Line(f"error: {' '.join(told.split())}", "bad"))


def _table(sheet: Sheet, width: int) -> Table:
    """Heads dim, names in colour; words wrap, numbers never do, so a table too wide for the screen is shown in parts."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    parts = []
    for columns in _parts(sheet, width):
        table = Table(box=None, header_style="dim", pad_edge=False, padding=(0, 2, 0, 0))
        for k in columns:
            words = k < sheet.words
            table.add_column(
                Text(sheet.heads[k]),
                justify="left" if words else "right",
                style="cyan" if words and k == 0 else "",
                no_wrap=not words or k == 0,
                overflow="fold",
            )
        for row in sheet.rows:
            table.add_row(*(Text(row[k]) for k in columns))
        parts.append(table)
    title = [Text(sheet.title, "bold")] if sheet.title else []
    return Group(*title, *parts)  # type: ignore[return-value]


def _parts(sheet: Sheet, width: int) -> list[list[int]]:
    """Columns that fit beside each other, the first one with each of them."""
    if sheet.words > 1:
        return [list(range(len(sheet.heads)))]
    widths = [max(len(row[k]) for row in (sheet.heads, *sheet.rows)) + 2 for k in range(len(sheet.heads))]
    parts = [[0]]
    for k in range(1, len(widths)):
        if sum(widths[j] for j in parts[-1]) + widths[k] > width and len(parts[-1]) > 1:
            parts.append([0])
        parts[-1].append(k)
    return parts

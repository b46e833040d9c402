"""A matplotlib figure without pyplot that notebooks show by themselves."""

from __future__ import annotations

import io

from matplotlib.figure import Figure

DPI = 90  # of the picture in a notebook


class InlineFigure(Figure):
    """A figure that is its own PNG where IPython displays it; pyplot's list of open figures does not hold it."""

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=DPI)
        return content.getvalue()

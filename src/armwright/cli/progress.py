"""A bar on stderr for anything over a second, and nothing at all for what is quicker or has no terminal to see it."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator

from armwright.terminal import console

PATIENCE = 1.0  # [s] before there is anything to see


@contextlib.contextmanager
def progress(words: str, unit: str = "") -> Iterator[Callable[[int, int], None]]:
    """Shows `words` and how far the work in the block is, which may call what it is given with (done, total).

    Args:
        words: what is done.   unit: of what is counted; where it is given, the rate is shown too.
    """
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        Task,
        TaskProgressColumn,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    class Rate(ProgressColumn):
        """Units of work per second."""

        def render(self, task: Task) -> Text:
            return Text(rate(task.speed, unit), style="progress.data.speed")

    screen = console(stderr=True)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    columns = (*columns, Rate()) if unit else columns
    bar = Progress(*columns, console=screen, transient=True, disable=not screen.is_terminal)
    task = bar.add_task(words, total=None)  # until someone tells, the bar only shows that it lives
    timer = threading.Timer(PATIENCE, bar.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda done, total: bar.update(task, completed=done, total=total)
    finally:
        timer.cancel()
        timer.join()
        bar.stop()


def rate(speed: float | None, unit: str) -> str:
    """Units of work per second, in words: `rate(2.4e6, "steps")` → "2.4 M steps/s"."""
    if speed is None:
        return ""
    for least, letter in ((1e9, "G "), (1e6, "M "), (1e3, "k ")):
        if speed >= least:
            return f"{speed / least:.3g} {letter}{unit}/s"
    return f"{speed:.3g} {unit}/s"

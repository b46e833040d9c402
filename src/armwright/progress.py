"""Progress bars in terminals and notebooks, for work that takes over a second.

A library must not write into other people's pipes: a bar is shown only where standard error is a terminal, or in a notebook, by
the main thread, one at a time. Every function with an argument `progress` reads it through `automatic`: True or None is that
bar, False is none, and a function is called in place of it.
"""

from __future__ import annotations

import contextlib
import contextvars
import sys
import threading
from collections.abc import Callable, Iterator
from datetime import timedelta
from html import escape
from time import perf_counter
from typing import Any

from armwright.errors import ScenarioError
from armwright.terminal import console, is_quiet

PATIENCE = 1.0  # [s] before there is anything to see
OFTEN = 0.1  # [s] between two pictures of a bar in a notebook

Progress = Callable[[int, int], object]
Shown = Progress | bool | None  # of an argument `progress`
_shown = threading.local()  # whether a bar of this thread is open: what it calls shows none


@contextlib.contextmanager
def progress(words: str, unit: str = "") -> Iterator[Progress]:
    """Shows `words` and the progress of the block, which reports it by calling the yielded function with (done, total).

    Args:
        words: what is done.   unit: of what is counted; where it is given, the rate is shown too.
    """
    bar = _bar(words, unit)
    if bar is None:
        yield _silent
        return
    # a cell's output follows its context
    patience = threading.Timer(PATIENCE, contextvars.copy_context().run, [bar.start])
    patience.daemon = True
    patience.start()
    _shown.open = True
    try:
        yield bar.tell
    finally:
        _shown.open = False
        patience.cancel()
        patience.join()
        bar.stop()


@contextlib.contextmanager
def automatic(shown: Shown, words: str, unit: str = "") -> Iterator[Progress]:
    """Progress function (done, total) for an argument `progress`; what the block calls shows no bar of its own.

    Args:
        shown: the argument. True or None: a bar, where one is seen; False: none; a function: called in place of a bar.
        words, unit: of the bar.
    Raises:
        ScenarioError: another value.
    """
    if shown is None or shown is True:
        with progress(words, unit) as tell:
            yield tell
        return
    if shown is not False and not callable(shown):
        raise ScenarioError(place="progress", value=shown, expected="True, False or a function of (done, total)")
    before, _shown.open = getattr(_shown, "open", False), True
    try:
        yield shown or _silent
    finally:
        _shown.open = before


def _silent(done: int, total: int) -> None:
    """Shows nothing."""


def _target() -> str | None:
    """Place of the progress bar: "notebook" or "terminal"; None if it cannot be seen, if all shall be quiet, or
    within another bar."""
    if is_quiet() or getattr(_shown, "open", False) or threading.current_thread() is not threading.main_thread():
        return None
    ipython: Any = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if getattr(shell, "kernel", None) is not None:
        return "notebook"
    return "terminal" if sys.stderr is not None and sys.stderr.isatty() else None


def _bar(words: str, unit: str) -> _TerminalBar | _NotebookBar | None:
    target = _target()
    if target is None:
        return None
    return _NotebookBar(words, unit) if target == "notebook" else _TerminalBar(words, unit)


class _TerminalBar:
    """A bar of rich on standard error, which disappears at its end."""

    def __init__(self, words: str, unit: str):
        self.words, self.unit = words, unit
        self.bar: Any = None
        self.at: tuple[int, int | None] = (0, None)  # until someone tells, the bar only shows that it lives

    def start(self) -> None:
        from rich.progress import (
            BarColumn,
            Progress as Bar,
            ProgressColumn,
            Task,
            TaskProgressColumn,
            TextColumn,
            TimeRemainingColumn,
        )
        from rich.text import Text

        unit = self.unit

        class Rate(ProgressColumn):
            """Units of work per second."""

            def render(self, task: Task) -> Text:
                return Text(rate(task.speed, unit), style="progress.data.speed")

        words = TextColumn("{task.description}", markup=False)
        columns = (words, BarColumn(), TaskProgressColumn(), TimeRemainingColumn(), *([Rate()] if unit else []))
        bar = Bar(*columns, console=console(stderr=True), transient=True)
        self.task = bar.add_task(self.words, completed=self.at[0], total=self.at[1])
        bar.start()
        self.bar = bar

    def tell(self, done: int, total: int) -> None:
        self.at = done, total
        if self.bar is not None:
            self.bar.update(self.task, completed=done, total=total)

    def stop(self) -> None:
        if self.bar is not None:
            self.bar.stop()


class _NotebookBar:
    """HTML's own bar below a cell, which disappears at its end; rich would need ipywidgets for one."""

    def __init__(self, words: str, unit: str):
        self.words, self.unit = words, unit
        self.handle: Any = None
        self.at: tuple[int, int | None] = (0, None)
        self.began = self.drawn = perf_counter()

    def start(self) -> None:
        from IPython.display import HTML, display  # there is one: a notebook runs us

        self.handle = display(HTML(self._page()), display_id=True)

    def tell(self, done: int, total: int) -> None:
        self.at, now = (done, total), perf_counter()
        if self.handle is not None and now > self.drawn + OFTEN:
            self._draw(self._page())
            self.drawn = now

    def stop(self) -> None:
        if self.handle is not None:
            self._draw("")

    def _draw(self, page: str) -> None:
        from IPython.display import HTML

        self.handle.update(HTML(page))

    def _page(self) -> str:
        done, total = self.at
        value = f' value="{done}" max="{total}"' if total else ""
        spent = max(perf_counter() - self.began, 1e-9)
        speed = rate(done / spent, self.unit) if total and self.unit else ""
        left = f"{timedelta(seconds=round(spent * (total - done) / done))} left" if total and 0 < done < total else ""
        return f"<div>{escape(self.words)} <progress{value}></progress> {left} {escape(speed)}</div>"


def rate(speed: float | None, unit: str) -> str:
    """Units of work per second, in words: `rate(2.4e6, "steps")` → "2.4 M steps/s"."""
    if speed is None:
        return ""
    for least, letter in ((1e9, "G "), (1e6, "M "), (1e3, "k ")):
        if speed >= least:
            return f"{speed / least:.3g} {letter}{unit}/s"
    return f"{speed:.3g} {unit}/s"

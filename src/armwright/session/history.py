"""Lines of earlier sessions, beside the cache of compiled code; in memory alone where nothing is kept, or can be."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

from prompt_toolkit.history import FileHistory, History, InMemoryHistory

FILE = "sim.history"


class Lines(History):
    """What the arrow keys bring back; the file is looked for once the prompt stands."""

    @cached_property
    def kept(self) -> History:
        """Where the lines are."""
        from armwright.kernels.cache import cache_folder  # brings LLVM, which a prompt need not wait for

        place = cache_folder()
        return InMemoryHistory() if place is None else FileHistory(str(place / FILE))

    def load_history_strings(self) -> Iterable[str]:
        """Lines of earlier sessions, the last one first."""
        try:
            return list(self.kept.load_history_strings())
        except OSError:
            self.kept = InMemoryHistory()
            return []

    def store_string(self, string: str) -> None:
        """Keeps a line; a disk that takes none ends no session."""
        try:
            self.kept.store_string(string)
        except OSError:
            self.kept = InMemoryHistory()

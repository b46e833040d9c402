"""Progress bar on stderr for work that takes over a second, in a terminal."""

from armwright.progress import PATIENCE, progress, rate

__all__ = ["PATIENCE", "progress", "rate"]

"""A bar on stderr for anything over a second, and nothing at all for what is quicker or has no terminal to see it."""

from armwright.progress import PATIENCE, progress, rate

__all__ = ["PATIENCE", "progress", "rate"]

"""One commit, one verdict: hypothesis draws the same examples everywhere, and a busy machine fails nothing."""

from hypothesis import settings

settings.register_profile("armwright", deadline=None, derandomize=True)
settings.load_profile("armwright")

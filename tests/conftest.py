"""One commit, one verdict: hypothesis draws the same examples everywhere, and a busy machine fails nothing."""

import os
import shutil
import tempfile

import pytest
from hypothesis import settings

settings.register_profile("armwright", deadline=None, derandomize=True)
settings.load_profile("armwright")

# Before NumPy is imported: workers fill the cores already, and threads for small matrices only wait for each other there.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

CACHE = pytest.StashKey[str]()


def pytest_configure(config):
    """Compiled code is kept in a folder of this run, shared by its workers; the user's own is not touched."""
    if not hasattr(config, "workerinput"):
        config.stash[CACHE] = os.environ["ARMWRIGHT_CACHE_DIR"] = tempfile.mkdtemp(prefix="armwright-tests-")


def pytest_unconfigure(config):
    """The folder of this run goes with it."""
    if not hasattr(config, "workerinput"):
        shutil.rmtree(config.stash[CACHE], ignore_errors=True)

"""One commit, one verdict: hypothesis draws the same examples everywhere, and a busy machine fails nothing."""

import collections
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
KEPT = "ARMWRIGHT_TESTS_CACHE"


def pytest_configure(config):
    """Compiled code is kept in a folder of this run, shared by its workers; the user's own is not touched.

    `ARMWRIGHT_TESTS_CACHE` names one that stays, for several runs on the same code.
    """
    if not hasattr(config, "workerinput"):
        config.stash[CACHE] = "" if (kept := os.environ.get(KEPT)) else tempfile.mkdtemp(prefix="armwright-tests-")
        os.environ["ARMWRIGHT_CACHE_DIR"] = kept or config.stash[CACHE]


def pytest_unconfigure(config):
    """The folder of this run goes with it."""
    if not hasattr(config, "workerinput") and config.stash[CACHE]:
        shutil.rmtree(config.stash[CACHE], ignore_errors=True)


def pytest_addoption(parser):
    parser.addoption("--part", metavar="K/N", help="of each file's studies every Nth, from the Kth on: 0/N to N-1/N")


@pytest.fixture(autouse=True)
def new_names(request, monkeypatch):
    """Old names of options belong into the test about them: elsewhere their notes stand between what is compared."""
    if request.path.name != "test_vocabulary.py":
        monkeypatch.setattr("armwright.cli.spelling._say", lambda old, new: pytest.fail(f"{old} is now {new}"))


@pytest.hookimpl(tryfirst=True)  # before `-m` chooses
def pytest_collection_modifyitems(config, items):
    """Of the cases of a test that is marked `sample(n)`, n that are spread evenly stay; the others are `study`.

    Of the studies those of `--part` stay.
    """
    families = collections.defaultdict(list)
    for item in items:
        if mark := item.get_closest_marker("sample"):
            families[item.path, item.originalname, *mark.args].append(item)
    for (*_, count), cases in families.items():
        kept = {round(k * (len(cases) - 1) / max(count - 1, 1)) for k in range(count)}
        for k, item in enumerate(cases):
            if k not in kept:
                item.add_marker(pytest.mark.study)
    if part := config.getoption("--part"):
        first, step = map(int, part.split("/"))
        studies = collections.defaultdict(list)
        for item in items:
            if item.get_closest_marker("study"):
                studies[item.path].append(item)
        left = {item for each in studies.values() for k, item in enumerate(each) if k % step != first}
        config.hook.pytest_deselected(items=sorted(left, key=lambda item: item.nodeid))
        items[:] = [item for item in items if item not in left]

"""Engines: the same bits by either linker and wherever in memory, kept as long as they are called, gone when dropped."""

import ctypes
import gc
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from llvmlite import binding

from armwright import scalar
from armwright.errors import ModelError
from armwright.kernels import cache, engine
from armwright.kernels.batch import Kernel, batch_module
from armwright.kernels.target import WIDTHS, select_target
from armwright.program import trace

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc, or forks")
TYPES = ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p  # of a function over whole arrays: count, in, out
X = np.array([[0.1, -2.0, 3e7], [1e300, -0.7, 40.0], [5.0, 6.0, -7.5]])  # with angles that only libm can reduce


def program(factor: float = 2.0):
    """Constants in memory, calls inside the module, and calls of libm."""
    return trace("wave", lambda x: factor * scalar.tan(x) + scalar.fmod(scalar.sin(x), 0.3), {"x": (3,)})


def kernel(factor: float = 2.0, target: str | None = None) -> Kernel:
    return Kernel(program(factor), select_target(target))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.mark.parametrize(
    ("triple", "expected"),
    [
        ("x86_64-unknown-linux-gnu", engine.JitLinked),
        ("aarch64-unknown-linux-gnu", engine.JitLinked),
        ("x86_64-apple-darwin23.0.0", engine.JitLinked),
        ("arm64-apple-darwin23.0.0", engine.JitLinked),
        ("x86_64-pc-windows-msvc", engine.McjitLinked),
        ("powerpc64le-unknown-linux-gnu", engine.McjitLinked),
    ],
)
def test_linker_of_a_platform(triple, expected):
    assert engine.linker(triple) is expected


@pytest.mark.parametrize("target", [None, *WIDTHS])
def test_linkers_agree_and_share_no_entry(folder, monkeypatch, target):
    try:
        select_target(target)
    except ModelError as error:
        pytest.skip(str(error))
    found = []
    for linked in {engine.linker(binding.get_default_triple()), engine.McjitLinked}:
        monkeypatch.setattr(engine, "linker", lambda _, linked=linked: linked)
        found += [kernel(target=target)(X).tobytes() for _ in range(2)]  # compiled, and from the cache
    assert len(set(found)) == 1
    assert len(list(folder.glob("*.code"))) == len(found) // 2


@pytest.mark.study
def test_function_keeps_its_engine():
    function = engine.Engine(select_target(), batch_module, program(), "float64").function("wave.separate", *TYPES)
    gc.collect()
    others = [kernel(factor)(X) for factor in (3.0, 4.0)]  # which would take its place
    y = np.empty_like(X)
    function(len(X), X.ctypes.data, y.ctypes.data)
    np.testing.assert_array_equal(y, kernel()(X))
    assert not any(np.array_equal(y, other) for other in others)


@pytest.mark.skipif(
    engine.linker(binding.get_default_triple()) is engine.McjitLinked, reason="MCJIT finds nothing at 0"
)
def test_unknown_function_is_refused():
    made = engine.Engine(select_target(), batch_module, program(), "float64")
    with pytest.raises(RuntimeError, match="no_such"):
        made.function("no_such")


@pytest.mark.study
@LINUX
def test_dropped_engines_leave_nothing(folder):
    def pages() -> int:
        gc.collect()
        with open("/proc/self/statm") as file:
            return int(file.read().split()[0])

    def make(count: int) -> None:
        for _ in range(count):
            kernel()(X)

    make(20)
    before = pages()
    make(300)
    assert pages() - before < 150  # half a page each; an engine is some ten


def test_threads_make_engines_at_the_same_time():
    factors = [1.0 + k / 8 for k in range(12)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda factor: kernel(factor)(X).tobytes(), factors))
    assert found == [kernel(factor)(X).tobytes() for factor in factors]
    assert len(set(found)) == len(factors)


def finish(script: str) -> str:
    """Output of a script that begins with this file's names; its exit code must be 0."""
    head = f"import sys; sys.path.insert(0, {os.path.dirname(__file__)!r}); from test_engine import *\n"
    # Nothing is kept: every engine is compiled and linked there.
    environment = os.environ | {cache.VARIABLE: ""}
    done = subprocess.run(
        [sys.executable, "-c", head + script], capture_output=True, text=True, env=environment, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


CROWDED = """
import mmap
libm = ctypes.cast(ctypes.CDLL("libm.so.6").tan, ctypes.c_void_p).value  # CDLL(None) may hold a stub of it
libc = ctypes.CDLL(None)
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long]

def reserve(size):
    address = libc.mmap(None, size, 0, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, -1, 0)  # memory that nobody may touch
    assert address != 2**64 - 1
    return address

def distance(address):
    return abs(address - libm) / 2**30

kept, total = [], 0
for size in (4, 8, 6):
    reserve(size << 30)
    total += size
    while distance(reserve(4096)) < total: pass  # every hole on this side of it
    for k in range(4):
        kept.append(kernel(1.0 + len(kept) / 4))
        assert kept[-1](X).tobytes() == bytes.fromhex({expected}[len(kept) - 1])
far = [distance(ctypes.cast(each.bound_entry, ctypes.c_void_p).value) for each in kept]
assert min(far) > 4, far
assert max(far) - min(far) > 12, far
assert [each(X).tobytes().hex() for each in kept] == {expected}
"""


@pytest.mark.study
@LINUX
def test_code_reaches_libm_from_anywhere(folder):
    """Between arrays of several GB, further from libm and from each other than a near call reaches."""
    expected = [kernel(1.0 + k / 4)(X).tobytes().hex() for k in range(12)]
    finish(CROWDED.replace("{expected}", repr(expected)))


FORKED = """
parent = kernel()
right = parent(X).tobytes()
child = os.fork()
if child == 0:
    same = parent(X).tobytes() == right and kernel()(X).tobytes() == right
    del parent
    gc.collect()
    os._exit(0 if same else 1)
assert os.waitpid(child, 0)[1] == 0
assert parent(X).tobytes() == right
"""


@LINUX
def test_a_forked_process_has_engines_of_its_own():
    """It calls its parent's, makes its own, and drops both; the parent's is still there."""
    finish(FORKED)

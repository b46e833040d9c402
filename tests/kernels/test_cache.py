"""Code comes from the cache where it can be believed, and is compiled again where not: the same bits, and never a crash."""

import errno
import hashlib
import hmac
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest
from llvmlite import binding

import armwright as aw
from armwright import scalar
from armwright.kernels import cache, engine
from armwright.kernels.batch import Kernel, batch_module
from armwright.kernels.target import Target, select_target
from armwright.program import trace

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="modes and links as POSIX has them")
X = np.linspace(-3.0, 3.0, 33).reshape(11, 3)


def program(factor: float = 2.0, name: str = "wave", port: str = "x"):
    """tan and fmod are calls of libm, which code from the cache must find too."""
    return trace(name, lambda x: factor * scalar.tan(x) + scalar.fmod(scalar.sin(x), 0.3), {port: (3,)})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    place = tmp_path / "cache"
    monkeypatch.setenv(cache.VARIABLE, str(place))
    monkeypatch.setattr(cache, "_emitter", lambda: cache._EMITTER)  # whoever edits a source while the tests run
    cache._say_once.cache_clear()
    return place


@pytest.fixture
def compiled(monkeypatch):
    """Names of the functions that were compiled, a set a module."""
    done = []
    original = engine.compiled
    monkeypatch.setattr(engine, "compiled", lambda module, machine: done.append(module) or original(module, machine))
    return done


def bits(target: Target | None = None) -> bytes:
    return Kernel(program(), target or select_target())(X).tobytes()


def entry(folder):
    (path,) = folder.glob("*.code")
    return path


def test_second_time_nothing_is_compiled_and_bits_are_the_same(folder, compiled):
    first, second = bits(), bits()
    assert first == second
    assert len(compiled) == 1
    assert entry(folder).stat().st_size > cache.HEAD.size
    assert not list(folder.glob("*.tmp"))


def test_simulation_loop_is_kept_too(folder, compiled):
    scenario = aw.Scenario(aw.load("two-link"), command=[1.0, 0.5], duration=0.01)
    first = aw.simulate(scenario)
    before = len(compiled)
    second = aw.simulate(scenario)
    assert before == 2  # the loop and the outputs
    assert len(compiled) == before
    assert all(first[name].to_numpy().tobytes() == second[name].to_numpy().tobytes() for name in first.data_vars)


def damage_byte(at: int):
    def damage(path):
        data = bytearray(path.read_bytes())
        data[at] ^= 1
        path.write_bytes(data)

    return damage


def rewrite(change):
    return lambda path: path.write_bytes(change(path.read_bytes()))


DAMAGES = {
    "magic": damage_byte(0),
    "key": damage_byte(20),
    "length": damage_byte(48),
    "digest": damage_byte(60),
    "first byte of code": damage_byte(cache.HEAD.size),
    "middle of code": damage_byte(cache.HEAD.size + 700),
    "last byte": damage_byte(-1),
    "empty": rewrite(lambda data: b""),
    "half a head": rewrite(lambda data: data[:30]),
    "head alone": rewrite(lambda data: data[: cache.HEAD.size]),
    "truncated": rewrite(lambda data: data[:-100]),
    "longer": rewrite(lambda data: data + b"\0"),
    "zeros": rewrite(lambda data: bytes(len(data))),
    "text": rewrite(lambda data: b"not code\n" * 100),
}


@pytest.mark.sample(1)
@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
def test_damaged_entry_is_compiled_again_and_healed(folder, compiled, damage):
    right = bits()
    damage(entry(folder))
    assert bits() == right
    assert len(compiled) == 2
    assert bits() == right
    assert len(compiled) == 2  # whole again


def forged_with_hash(path):
    """What version 2 of the format took for its own: everybody can make a checksum."""
    data = path.read_bytes()
    magic, key, _, _ = cache.HEAD.unpack_from(data)
    code = data[cache.HEAD.size :].replace(b"wave", b"evil")
    path.write_bytes(cache.HEAD.pack(magic, key, len(code), hashlib.sha256(code).digest()) + code)


def forged_with_other_secret(path):
    data = path.read_bytes()
    magic, key, _, _ = cache.HEAD.unpack_from(data)
    code = data[cache.HEAD.size :].replace(b"wave", b"evil")
    path.write_bytes(cache.HEAD.pack(magic, key, len(code), hmac.digest(b"guess", key + code, "sha256")) + code)


def without_its_secret(path):
    path.with_name(cache.SECRET).unlink()


def with_an_empty_secret(path):
    path.with_name(cache.SECRET).write_bytes(b"")


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    "forge", [forged_with_hash, forged_with_other_secret, without_its_secret, with_an_empty_secret]
)
def test_forged_entry_is_made_again_and_not_trusted(folder, compiled, forge):
    right = bits()
    forge(entry(folder))
    assert bits() == right
    assert len(compiled) == 2
    assert bits() == right
    assert len(compiled) == 2
    assert len((folder / cache.SECRET).read_bytes()) == cache.SECRET_BYTES


@POSIX
def test_secret_is_its_owners_alone(folder, compiled):
    bits()
    assert (folder / cache.SECRET).stat().st_mode & 0o777 == 0o600
    (folder / cache.SECRET).chmod(0o666)
    bits()
    assert len(compiled) == 2  # whoever may write it could have signed the entry
    assert (folder / cache.SECRET).stat().st_mode & 0o777 == 0o600


def test_entry_under_another_name_is_not_used(folder, compiled):
    """A whole entry, of another program: the key inside says so."""
    right = bits()
    Kernel(program(3.0), select_target())
    mine = folder / f"{key_of().hex()}.code"
    (other,) = set(folder.glob("*.code")) - {mine}
    other.replace(mine)
    assert bits() == right
    assert len(compiled) == 3


def key_of(made=None, machine=None) -> bytes:
    target = machine or select_target()
    triple = binding.get_default_triple()
    found = cache.key(batch_module, (made or program(), "float64"), engine.linker(triple).__name__, triple, target)
    assert found is not None
    return found


def test_key_of_the_same_program_is_the_same(folder):
    bits()
    assert entry(folder).stem == key_of().hex()


@pytest.mark.parametrize(
    "other",
    [program(2.0000000000000004), program(name="ripple"), program(port="y")],
    ids=["last bit of a constant", "name", "input's name"],
)
def test_key_follows_the_program(other):
    assert key_of(other) != key_of()


@pytest.mark.parametrize(
    "change",
    [
        lambda t: Target(t.cpu, t.features + ",+none", t.width),
        lambda t: Target("x86-64-v3", t.features, t.width),
        lambda t: Target(t.cpu, t.features, 2 * t.width),
    ],
    ids=["features", "cpu", "width"],
)
def test_key_follows_the_processor(change):
    assert key_of(machine=change(select_target())) != key_of()


def test_code_of_another_processor_is_not_used(folder, compiled):
    host = select_target()
    right = bits()
    assert bits(Target(host.cpu, host.features, 1)) == right
    assert len(compiled) == 2


@pytest.mark.parametrize("place", ["armwright.kernels.cache.llvmlite.__version__", "armwright.kernels.cache._EMITTER"])
def test_other_versions_compile_again(folder, compiled, monkeypatch, place):
    right = bits()
    monkeypatch.setattr(place, b"other" if "EMITTER" in place else "0.1")
    assert bits() == right
    assert len(compiled) == 2


def test_unknown_sources_keep_nothing(folder, monkeypatch):
    monkeypatch.setattr(cache, "_EMITTER", None)
    assert bits() == bits()
    assert not folder.exists()


def test_sources_that_changed_under_a_session_keep_nothing(folder, monkeypatch):
    """What prints code is imported late: then it may be another than the key says."""
    monkeypatch.setattr(cache, "_emitter", lambda: b"edited")
    assert bits() == bits()
    assert not list(folder.iterdir())


def test_empty_variable_keeps_nothing(tmp_path, monkeypatch, compiled):
    monkeypatch.setenv(cache.VARIABLE, "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    assert bits() == bits()
    assert len(compiled) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="where Linux keeps caches")
def test_usual_folder_is_private(tmp_path, monkeypatch):
    monkeypatch.delenv(cache.VARIABLE)
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "not/absolute")
    assert cache._usual_folder() == tmp_path / ".cache" / "armwright"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    bits()
    place = tmp_path / "xdg" / "armwright"
    assert place.stat().st_mode & 0o777 == 0o700
    assert entry(place).stat().st_mode & 0o777 == 0o600


@pytest.mark.sample(1)
@POSIX
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o722])
def test_folder_that_others_can_write_is_not_used_and_says_so_once(folder, compiled, mode):
    right = bits()
    folder.chmod(mode)
    with pytest.warns(RuntimeWarning, match=f"mode {mode:o}") as said:
        assert [bits() for _ in range(2)] == 2 * [right]
    assert len(said) == 1
    assert len(compiled) == 3


@POSIX
def test_folder_of_another_user_is_not_used(folder, compiled, monkeypatch):
    right = bits()
    me = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: me + 1)
    with pytest.warns(RuntimeWarning, match=f"owner {me}"):
        assert bits() == right
    assert len(compiled) == 2


@POSIX
def test_file_that_others_can_write_is_not_used(folder, compiled):
    right = bits()
    entry(folder).chmod(0o666)
    assert bits() == right
    assert len(compiled) == 2


@pytest.mark.sample(1)
@POSIX
@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_entry_that_is_no_file_is_not_used(folder, tmp_path, compiled, kind):
    right = bits()
    path = entry(folder)
    if kind == "link":
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    else:
        path.unlink()
        os.mkfifo(path) if kind == "pipe" else path.mkdir()
    assert bits() == right
    assert len(compiled) == 2
    assert not list(folder.glob("*.tmp"))


NO_FOLDERS = {
    "in a file": ("file/cache", "compiled code is not kept"),
    "a file": ("file", "file': not a folder; compiled code is not kept"),
    "of nobody": ("~nobody-of-that-name/cache", "no home of that user is known; compiled code is not kept"),
}


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "why"), NO_FOLDERS.values(), ids=NO_FOLDERS.keys())
def test_name_of_no_folder_says_so_once(tmp_path, monkeypatch, compiled, name, why):
    (tmp_path / "file").write_text("a file, not a folder")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(cache.VARIABLE, name)
    cache._say_once.cache_clear()
    with pytest.warns(RuntimeWarning, match=f"ARMWRIGHT_CACHE_DIR = .*{why}") as said:
        assert bits() == bits()
    assert len(said) == 1
    assert len(compiled) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_home_may_be_written_short(tmp_path, monkeypatch):
    for variable in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(variable, str(tmp_path))
    monkeypatch.setenv(cache.VARIABLE, os.path.join("~", "kept"))
    bits()
    assert entry(tmp_path / "kept").exists()


@pytest.mark.sample(1)
@pytest.mark.parametrize("fault", [errno.EROFS, errno.EACCES, errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize("call", ["tempfile.mkstemp", "os.replace"])
def test_what_cannot_be_written_is_left(folder, compiled, monkeypatch, fault, call):
    def refuse(*_, **__):
        raise OSError(fault, os.strerror(fault))

    monkeypatch.setattr(f"armwright.kernels.cache.{call}", refuse)
    with pytest.warns(RuntimeWarning, match=f"ARMWRIGHT_CACHE_DIR = .*cache': {os.strerror(fault)}; compiled") as said:
        assert bits() == bits()
    assert len(said) == 1
    assert len(compiled) == 2
    assert not list(folder.iterdir())


def test_who_named_no_folder_is_told_nothing(folder, tmp_path, monkeypatch, compiled):
    """A home without room is nobody's surprise."""

    def refuse(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.delenv(cache.VARIABLE)
    for variable in ("XDG_CACHE_HOME", "LOCALAPPDATA", "HOME"):
        monkeypatch.setenv(variable, str(tmp_path))
    monkeypatch.setattr("armwright.kernels.cache.tempfile.mkstemp", refuse)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert bits() == bits()
    assert len(compiled) == 2


def test_read_only_folder_is_read(folder, compiled, monkeypatch):
    right = bits()

    def refuse(*_, **__):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    for call in ("tempfile.mkstemp", "os.utime", "os.unlink"):
        monkeypatch.setattr(f"armwright.kernels.cache.{call}", refuse)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing had to be written
        assert bits() == right
    assert len(compiled) == 1


def test_size_is_bounded_and_the_longest_unused_go(folder, monkeypatch):
    keys = [bytes([k]) * 32 for k in range(4)]
    for k, key in enumerate(keys[:3]):
        cache.store(key, bytes(1000))
        os.utime(folder / f"{key.hex()}.code", (1000 + k, 1000 + k))
    assert cache.load(keys[0]) == bytes(1000)  # used just now: the second is the oldest
    left_behind = folder / "dead.tmp"
    left_behind.write_bytes(b"half an entry")
    os.utime(left_behind, (1000, 1000))
    (folder / "notes.txt").write_text("somebody's")
    monkeypatch.setattr(cache, "MOST_BYTES", 3 * (1000 + cache.HEAD.size))
    cache.store(keys[3], bytes(1000))
    assert [cache.load(key) is not None for key in keys] == [True, False, True, True]
    assert not left_behind.exists()
    assert (folder / "notes.txt").exists()


SCRIPT = """
import sys
from pathlib import Path
import numpy as np
sys.path.insert(0, {tests!r})
from test_cache import bits, cache, engine
cache._EMITTER = bytes.fromhex({emitter!r})  # or who edits a source while the tests run would fail them
cache._emitter = lambda: cache._EMITTER
done, original = [], engine.compiled
engine.compiled = lambda *given: done.append(1) or original(*given)
{before}
print(len(done), bits().hex(), len(done))
"""


def process(folder, before: str = "") -> subprocess.Popen:
    assert cache._EMITTER is not None
    given = {"tests": os.path.dirname(__file__), "emitter": cache._EMITTER.hex(), "before": before}
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT.format(**given)],
        env=os.environ | {cache.VARIABLE: str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(running: subprocess.Popen) -> tuple[str, int]:
    """The bits and how often it compiled, of a process that ended well."""
    out, error = running.communicate(timeout=120)
    assert running.returncode == 0, error
    _, found, count = out.split()
    return found, int(count)


@pytest.mark.study
def test_eight_processes_that_start_cold_together(folder):
    """Each waits until all are there, so that they miss, compile and write at the same time."""
    meet = "Path({0!r}).mkdir(exist_ok=True, mode=0o700); import os, time; open(os.path.join({0!r}, str(os.getpid())), 'w')\n"
    meet += "while len(os.listdir({0!r})) < 8: time.sleep(0.001)"
    running = [process(folder, meet.format(str(folder.with_name("meeting")))) for _ in range(8)]
    found = {finish(one)[0] for one in running}
    assert found == {bits().hex()}
    assert entry(folder)
    assert not list(folder.glob("*.tmp"))
    assert finish(process(folder)) == (found.pop(), 0)  # and one that comes later compiles nothing


def test_damaged_entry_crashes_no_process(folder):
    right = bits().hex()
    DAMAGES["middle of code"](entry(folder))
    assert finish(process(folder)) == (right, 1)


@POSIX
def test_full_disk_crashes_no_process(folder):
    """No file may grow beyond 1000 bytes: the entry is cut off in the middle of being written."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))"
    assert finish(process(folder, limit)) == (bits().hex(), 1)
    assert len(list(folder.glob("*.code"))) == len(list(folder.iterdir())) - 1 == 1  # ours, from here; and the secret

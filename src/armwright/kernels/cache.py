"""Native code kept on disk, so that a program is compiled once and not once a process.

An entry is the object code of one module. Its name is its key: a digest of everything the code follows from, so that it is
known from a traced program alone, before any LLVM text is printed. In its file,

    magic | key | length | HMAC-SHA-256 of key and code | code

all of which is checked before the code is linked: a linker takes a flipped byte without a word. The HMAC is made with random
bytes that the folder's owner keeps in it, so that an entry which somebody else made is not taken for ours. An entry is written
to a temporary file and renamed, so that of many processes each sees a whole entry or none. What cannot be read, written or
believed is compiled again; nothing here raises.

Code is executed, so it is read only from a folder, and a file, that belongs to this user and that no other can write.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import hmac
import os
import secrets
import stat
import struct
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path

import casadi
import llvmlite
from llvmlite import binding

from armwright.program.turns import alone

VARIABLE = "ARMWRIGHT_CACHE_DIR"  # the folder; empty: nothing is kept
MAGIC = b"armwright code 3"
HEAD = struct.Struct(f"<{len(MAGIC)}s32sQ32s")
SUFFIX = ".code"
SECRET = "secret"  # file of random bytes, which no entry can be made without
SECRET_BYTES = 32
MOST_BYTES = 256 << 20  # of all entries; the least recently used ones go
STALE = 3600.0  # [s] after which a temporary file is one that its writer left behind
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
TAKEN = (  # what says of one entry that it cannot be replaced, and nothing of the folder: on Windows it is just being read
    PermissionError if sys.platform == "win32" else IsADirectoryError
)


@alone
def key(build: Callable[..., object], ingredients: tuple[object, ...], *machine: object) -> bytes | None:
    """The digest of everything that the code of `build(…, *ingredients)` follows from, or None where that is not known.

    Args:
        build: a function of the emitter, at the top level of its file.
        ingredients: programs, stages, numbers and strings that it makes the module of.
        machine: what the code is made for: linker, triple, processor, features, width.
    """
    assert build.__module__.startswith("armwright.kernels."), build
    assert "<" not in build.__qualname__, build
    if _EMITTER is None:
        return None
    versions = casadi.CasadiMeta.version(), llvmlite.__version__, binding.llvm_version_info
    parts = [MAGIC, _EMITTER, repr((versions, build.__module__, build.__qualname__, machine)).encode()]
    for ingredient in ingredients:
        parts += _content(ingredient)
    digest = hashlib.sha256()
    for part in parts:
        digest.update(struct.pack("<Q", len(part)) + part)
    return digest.digest()


def _content(ingredient: object) -> Iterator[bytes]:
    if isinstance(ingredient, casadi.Function):
        yield ingredient.serialize().encode()
    elif isinstance(ingredient, tuple):
        yield f"{len(ingredient)} parts".encode()
        for part in ingredient:
            yield from _content(part)
    elif is_dataclass(ingredient):  # programs, their ports, stages of a loop
        yield type(ingredient).__name__.encode()
        for field in fields(ingredient):
            yield from _content(getattr(ingredient, field.name))
    else:
        assert ingredient is None or isinstance(ingredient, (str, int, float)), ingredient
        yield repr(ingredient).encode()


def _emitter() -> bytes | None:
    """Digest of the sources that turn a program into code, of whatever version; None where they cannot be read."""
    digest = hashlib.sha256()
    here = Path(__file__).parent
    try:
        for path in sorted([*here.glob("*.py"), *(here.parent / "program").glob("*.py")]):
            digest.update(f"{path.parent.name}/{path.name}\n".encode() + hashlib.sha256(path.read_bytes()).digest())
    except OSError:
        return None
    return digest.digest() if here.joinpath("llvm.py").exists() else None


_EMITTER = _emitter()  # once: a developer may change the sources under a session


def load(key: bytes | None) -> bytes | None:
    """The cached code of a key; None without a trustworthy entry."""
    folder = cache_folder() if key is not None else None
    if key is None or folder is None:
        return None
    path = _path(folder, key)
    try:
        data, secret = _read(path), _secret(folder)
    except OSError:
        return None
    if len(data) < HEAD.size:
        return None
    code = data[HEAD.size :]
    if HEAD.unpack_from(data) != (MAGIC, key, len(code), _signature(secret, key, code)):
        return None
    with contextlib.suppress(OSError):  # a read-only file system does not remember which entries are used
        os.utime(path)
    return code


def store(key: bytes | None, code: bytes) -> None:
    """Keeps code for next time, where that is possible.

    The code generator is imported when there is something to compile. If its file has changed since the key was hashed, the
    code is not stored.
    """
    folder = cache_folder() if key is not None else None
    if key is None or folder is None or _emitter() != _EMITTER:
        return
    try:
        signature = _signature(_secret(folder, create=True), key, code)
        _write(_path(folder, key), HEAD.pack(MAGIC, key, len(code), signature) + code)
    except OSError as error:  # read-only, full, over a quota, or TAKEN
        if not isinstance(error, TAKEN):
            _say_if_named(str(error.strerror))
        return
    _trim(folder)


def _signature(secret: bytes, key: bytes, code: bytes) -> bytes:
    return hmac.digest(secret, key + code, "sha256")


def _secret(folder: Path, *, create: bool = False) -> bytes:
    """The folder's random bytes. Of processes that create them at the same time one wins; what the others stored is made again.

    Raises:
        OSError: there are none, and none can be written.
    """
    path = folder / SECRET
    with contextlib.suppress(OSError):
        if len(secret := _read(path)) == SECRET_BYTES:
            return secret
    if not create:
        raise FileNotFoundError(path)
    _write(path, secrets.token_bytes(SECRET_BYTES))
    return _read(path)


def _write(path: Path, content: bytes) -> None:
    """Writes a file whole or not at all, readable and writable by its owner only."""
    number, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    try:
        with open(number, "wb") as file:
            file.write(content)
        os.replace(temporary, path)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def _path(folder: Path, key: bytes) -> Path:
    return folder / f"{key.hex()}{SUFFIX}"


def _read(path: Path) -> bytes:
    """The bytes of a regular file that is ours alone to write: no link, no pipe to wait for."""
    flags = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"))
    with open(os.open(path, os.O_RDONLY | flags), "rb") as file:
        about = os.fstat(file.fileno())
        if not stat.S_ISREG(about.st_mode) or not _is_private(about) or about.st_size > MOST_BYTES:
            raise PermissionError(path)
        return file.read()


def _is_private(about: os.stat_result) -> bool:
    """True if this user owns it and nobody else can write it. On Windows the user's profile is private."""
    if sys.platform == "win32":
        return True
    return about.st_uid == os.geteuid() and not about.st_mode & OTHERS_WRITE


def cache_folder() -> Path | None:
    """Folder of the entries, created if it is missing; None if none can be stored."""
    named = os.environ.get(VARIABLE)
    if named == "":
        return None
    try:
        place = _usual_folder() if named is None else Path(named).expanduser().absolute()
        if place.exists() and not place.is_dir():
            raise OSError(errno.ENOTDIR, "not a folder")
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = place.stat()
    except OSError as error:
        _say_if_named(str(error.strerror))
        return None
    except RuntimeError:  # a user without a home; of "~name", no user at all
        _say_if_named("no home of that user is known")
        return None
    if not _is_private(about):
        rights = f"mode {stat.S_IMODE(about.st_mode):o}, owner {about.st_uid}"
        _say_once(
            f"{str(place)!r}: {rights}; compiled code is kept only in a folder that you own and nobody else can write"
        )
        return None
    return place


def _usual_folder() -> Path:
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA")
        return (Path(local) if local else Path.home() / "AppData" / "Local") / "armwright"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "armwright"
    base = Path(os.environ.get("XDG_CACHE_HOME") or "~")
    return (base if base.is_absolute() else Path.home() / ".cache") / "armwright"


def _say_if_named(why: str) -> None:
    """Warns only if the user named the folder; a home that cannot be written is common."""
    named = os.environ.get(VARIABLE)
    if named:
        _say_once(f"{VARIABLE} = {named!r}: {why}; compiled code is not kept")


@functools.cache
def _say_once(sentence: str) -> None:
    warnings.warn(sentence, RuntimeWarning, stacklevel=2)


def _trim(folder: Path) -> None:
    """Takes the least recently used entries away until the rest fits, and what dead writers left behind."""
    entries = []
    with contextlib.suppress(OSError), os.scandir(folder) as files:
        for file in files:
            with contextlib.suppress(OSError):
                about = file.stat(follow_symlinks=False)
                if file.name.endswith(".tmp") and about.st_mtime < time.time() - STALE:
                    os.unlink(file.path)
                elif file.name.endswith(SUFFIX) and stat.S_ISREG(about.st_mode):
                    entries.append((about.st_mtime, about.st_size, file.path))
    size = sum(bytes_ for _, bytes_, _ in entries)
    for _, bytes_, path in sorted(entries):
        if size <= MOST_BYTES:
            break
        with contextlib.suppress(OSError):  # another process was faster
            os.unlink(path)
        size -= bytes_

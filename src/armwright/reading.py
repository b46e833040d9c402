"""Reading of files named by a user or by a user's file: regular files of limited size only."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from armwright.errors import ArmwrightError

LARGEST = 256 << 20  # bytes of a file
KINDS = {  # entries of a file system that are no files; a pipe is never waited for, a device may never end
    stat.S_IFIFO: "a pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
FLAGS = os.O_RDONLY | sum(getattr(os, name, 0) for name in ("O_NONBLOCK", "O_CLOEXEC", "O_NOCTTY", "O_BINARY"))


def read_file(path: Any, expected: str, error: type[ArmwrightError], most: int = LARGEST) -> bytes:
    """The content of a regular file.

    Args:
        path: of the file.   expected: what it should be, for errors, such as "a TOML file".
        error: what is raised.   most: bytes that it may have.
    Raises:
        error: no path, no such file, a folder, a pipe, a device, a link to itself, a name that no file system takes, no
            permission, too large; with the file.
    """
    with opened(path, expected, error) as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise error("too large", value=len(content), expected=f"{most} bytes at most", file=os.fsdecode(path))
    return content


@contextlib.contextmanager
def opened(path: Any, expected: str, error: type[ArmwrightError]) -> Iterator[BinaryIO]:
    """A regular file, open for reading in parts, however large it is.

    Args:
        path: of the file.   expected: what it should be, for errors, such as "a TOML file".   error: what is raised.
    Raises:
        error: no path, no such file, a folder, a pipe, a device, a link to itself, a name that no file system takes, no
            permission; an error of the operating system while it is read; with the file.
    """
    if not isinstance(path, (str, os.PathLike)):
        raise error(value=path, expected=f"the path of {expected}")
    name, what, descriptor = os.fsdecode(path), "", -1
    try:
        what = _kind_of_entry(os.stat(path).st_mode)
        if not what:
            descriptor = os.open(path, FLAGS)
            what = _kind_of_entry(os.fstat(descriptor).st_mode)  # by now it may be another one
    except FileNotFoundError:
        raise error("no such file", file=name) from None
    except (OSError, ValueError) as fault:  # ValueError: a zero byte in the name
        raise _unreadable(fault, name, error) from None
    with contextlib.ExitStack() as stack:
        file = stack.enter_context(os.fdopen(descriptor, "rb")) if descriptor >= 0 else None
        if what or file is None:
            raise error(what, expected=expected, file=name)
        try:
            yield file
        except OSError as fault:
            raise _unreadable(fault, name, error) from None


def _unreadable(fault: OSError | ValueError, name: str, error: type[ArmwrightError]) -> ArmwrightError:
    """The operating system's refusal as an error."""
    reason = fault.strerror if isinstance(fault, OSError) else None
    return error(f"cannot be read: {reason or fault}", file=name)


def real_path(path: Path) -> Path:
    """The absolute path with symbolic links resolved; for a link to itself, the link."""
    return Path(os.path.realpath(path))  # Path.resolve raises where links go round


def refuse_other_entries(path: Any, expected: str, error: type[ArmwrightError]) -> None:
    """Refuses a pipe, a device or a folder where a file should be, before another library opens it; an absent one passes.

    Raises:
        error: with the file.
    """
    try:
        what = _kind_of_entry(os.stat(path).st_mode)
    except (OSError, ValueError):
        return
    if what:
        raise error(what, expected=expected, file=os.fsdecode(path))


def _kind_of_entry(mode: int) -> str:
    """Kind of an entry that is no regular file; "" of a regular one."""
    return "a folder" if stat.S_ISDIR(mode) else KINDS.get(stat.S_IFMT(mode), "" if stat.S_ISREG(mode) else "no file")

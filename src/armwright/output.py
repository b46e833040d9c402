"""Output files: checked before long work, and written completely or not at all.

A file is written under a temporary name, `.armwright-HOST-PROCESS-RANDOM.ending`, and then takes its place. What a killed process
left under such a name is removed by the next write into that folder.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import secrets
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from armwright.entry import as_path
from armwright.errors import OutputError

TEMPORARY = re.compile(r"\.armwright-((?P<host>[0-9a-f]{8})-(?P<process>\d{1,10})-)?[0-9a-f]{16}(\..*)?")
STALE = 86400.0  # [s] after which a temporary file is nobody's, where its process cannot be asked


def check_destination(
    path: str | os.PathLike[str], endings: Sequence[str] = (), *, read: Sequence[str | os.PathLike[str] | None] = ()
) -> Path:
    """The path, if a file can be written there; to be called before long work.

    Args:
        path: where a result should go; a file that is there already will be replaced.
        endings: what the name may end in, such as (".png", ".svg"); none: anything.
        read: files that the work reads, which the result must not replace.
    Raises:
        OutputError: an unknown ending, a file that is read, a missing folder, a folder in the file's place, no permission.
    """
    path = Path(as_path(path, "path", OutputError))
    if endings and path.suffix.lower() not in endings:
        what = f"the ending {path.suffix!r} is not offered" if path.suffix else "has no ending"
        raise OutputError(what, file=path, expected=" or ".join(filter(None, (", ".join(endings[:-1]), endings[-1]))))
    what = expected = ""
    with _as_output_error(path):
        if "\0" in str(path):
            what = "no file has such a name"
        elif path.is_dir():
            what, expected = "is a folder", "the name of a file"
        elif not path.parent.is_dir():
            what = f"there is no folder {str(path.parent)!r} to write it in"
        elif path.exists() and not path.is_file():
            what = "is no plain file, and would have to be replaced by one"
        elif not os.access(path.parent, os.W_OK | os.X_OK) or (path.exists() and not os.access(path, os.W_OK)):
            what = "no permission to write there"
    if not what and any(os.path.realpath(path) == os.path.realpath(each) for each in read if each is not None):
        what, expected = "is read, and would be replaced", "another file"
    if what:
        raise OutputError(what, file=path, expected=expected)
    return path


def file_stem(name: str) -> str:
    """The name of a file for something of that name, such as an arm: no separator of folders or mark of a system in it."""
    return re.sub(r'[/\\:*?"<>|\x00-\x1f]+', "_", name).strip(". ") or "_"


@contextlib.contextmanager
def whole_file(
    path: str | os.PathLike[str], endings: Sequence[str] = (), *, follow_link: bool = True
) -> Iterator[Path]:
    """A temporary path in the same folder, renamed to `path` if the block succeeds.

    If the block fails, the temporary file is removed, and a file that was at `path` stays as it was.

    Args:
        path: where the file should be.   endings: as of `check_destination`.
        follow_link: whether a symbolic link there stays, and the file that it leads to is replaced, as other programs do it
            with a name that the user typed; False for names that the user did not type: the link itself is replaced.
    Raises:
        OutputError: the file cannot be written, or could not be finished: a full disk, a folder that has gone.
    """
    path = check_destination(path, endings)
    target = Path(os.path.realpath(path if follow_link else path.parent))
    target = target if follow_link else target / path.name
    temporary = target.with_name(f".armwright-{_host()}-{os.getpid()}-{secrets.token_hex(8)}{target.suffix}")
    _remove_left_behind(target.parent)
    with _as_output_error(path):
        try:
            yield temporary
            os.replace(temporary, target)
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)


def write_whole(path: str | os.PathLike[str], text: str, endings: Sequence[str] = ()) -> None:
    """Writes a text in UTF-8, its lines ended as on every system, by `whole_file`, whose arguments and errors these are."""
    with whole_file(path, endings) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


@contextlib.contextmanager
def working_folder(texts: Mapping[str, str] | None = None) -> Iterator[Path]:
    """A temporary folder, for compilers and the like, which is gone behind the block.

    Args:
        texts: in ASCII, of files to begin with, by their names.
    Raises:
        OutputError: a file cannot be written there: a full disk.
    """
    place = Path(tempfile.gettempdir())
    with _as_output_error(place), tempfile.TemporaryDirectory(prefix="armwright-", ignore_cleanup_errors=True) as name:
        place = Path(name)
        for file, text in (texts or {}).items():
            (place / file).write_text(text, encoding="ascii", newline="\n")
        yield place


def _remove_left_behind(folder: Path) -> None:
    """Removes temporary files of processes that are gone, or older than a day."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            match = TEMPORARY.fullmatch(entry.name)
            with contextlib.suppress(OSError):  # another process was faster, or it is not ours to remove
                if match and (_writer_is_gone(match) or entry.stat().st_mtime < time.time() - STALE):
                    os.unlink(entry.path)


def _writer_is_gone(name: re.Match[str]) -> bool:
    """True if the process that began a temporary file ran on this machine and does not run now."""
    if name["host"] != _host() or os.name == "nt":  # where signal 0 would end the process
        return False
    try:
        os.kill(int(name["process"]), 0)
    except ProcessLookupError:
        return True
    except (OSError, OverflowError):  # it runs, and belongs to somebody else
        return False
    return False


def _host() -> str:
    """Short digest of the machine's name: several machines may write into one folder."""
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


@contextlib.contextmanager
def _as_output_error(path: Path) -> Iterator[None]:
    """Turns errors of the operating system into ours."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or (str(error).splitlines() or ["unknown error"])[0]
        raise OutputError(f"cannot be written: {reason}", file=path) from error

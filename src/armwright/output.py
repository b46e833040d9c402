"""Files that are written whole or not at all, and refused before the work where they cannot be written."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator, Sequence
from pathlib import Path

from armwright.errors import OutputError


def check_destination(path: str | os.PathLike[str], endings: Sequence[str] = ()) -> Path:
    """The path, if a file can be written there; to be asked before long work.

    Args:
        path: where a result should go; a file that is there already will be replaced.
        endings: what the name may end in, such as (".png", ".svg"); none: anything.
    Raises:
        OutputError: an unknown ending, a missing folder, a folder in the file's place, no permission.
    """
    path = Path(path)
    if endings and path.suffix.lower() not in endings:
        has = f"the ending {path.suffix!r} is not offered" if path.suffix else "has no ending"
        raise OutputError(f"{path}: {has}; expected {', '.join(endings[:-1])} or {endings[-1]}")
    with _told(path):
        folder = path.parent
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; expected the name of a file")
        if not folder.is_dir():
            raise OutputError(f"{path}: there is no folder {str(folder)!r} to write it in")
        if path.exists() and not path.is_file():
            raise OutputError(f"{path}: is no plain file, and would have to be replaced by one")
        if not os.access(folder, os.W_OK | os.X_OK) or (path.exists() and not os.access(path, os.W_OK)):
            raise OutputError(f"{path}: no permission to write there")
    return path


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str], endings: Sequence[str] = ()) -> Iterator[Path]:
    """A temporary path in the same folder, which takes the place of `path` when the block ends well.

    Where the block fails, the temporary file is taken away and what was at `path` before stays as it was.

    Raises:
        OutputError: the file cannot be written, or could not be finished: a full disk, a folder that has gone.
    """
    path = check_destination(path, endings)
    target = Path(os.path.realpath(path))  # behind a symbolic link the file is replaced, not the link
    temporary = target.with_name(f".armwright-{secrets.token_hex(8)}{target.suffix}")
    with _told(path):
        try:
            yield temporary
            os.replace(temporary, target)
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """The operating system's errors in our words."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or (str(error).splitlines() or ["unknown error"])[0]
        raise OutputError(f"{path}: cannot be written: {reason}") from error

"""Output files: checked before long work, and written whole or not at all."""

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
        what = f"the ending {path.suffix!r} is not offered" if path.suffix else "has no ending"
        raise OutputError(what, file=path, expected=f"{', '.join(endings[:-1])} or {endings[-1]}")
    what = expected = ""
    with _as_output_error(path):
        if path.is_dir():
            what, expected = "is a folder", "the name of a file"
        elif not path.parent.is_dir():
            what = f"there is no folder {str(path.parent)!r} to write it in"
        elif path.exists() and not path.is_file():
            what = "is no plain file, and would have to be replaced by one"
        elif not os.access(path.parent, os.W_OK | os.X_OK) or (path.exists() and not os.access(path, os.W_OK)):
            what = "no permission to write there"
    if what:
        raise OutputError(what, file=path, expected=expected)
    return path


@contextlib.contextmanager
def whole_file(path: str | os.PathLike[str], endings: Sequence[str] = ()) -> Iterator[Path]:
    """A temporary path in the same folder, which replaces `path` when the block ends well.

    If the block fails, the temporary file is removed, and a file that was at `path` stays as it was.

    Raises:
        OutputError: the file cannot be written, or could not be finished: a full disk, a folder that has gone.
    """
    path = check_destination(path, endings)
    target = Path(os.path.realpath(path))  # behind a symbolic link the file is replaced, not the link
    temporary = target.with_name(f".armwright-{secrets.token_hex(8)}{target.suffix}")
    with _as_output_error(path):
        try:
            yield temporary
            os.replace(temporary, target)
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def _as_output_error(path: Path) -> Iterator[None]:
    """Turns errors of the operating system into ours."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or (str(error).splitlines() or ["unknown error"])[0]
        raise OutputError(f"cannot be written: {reason}", file=path) from error

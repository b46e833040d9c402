"""Attempt: a case is done under guard; its outcome is accepted, refused in one line, or something else."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armwright.errors import ArmwrightError
from armwright.kernels.cache import cache_folder
from armwright.output import TEMPORARY
from fuzz.case import Case

LIMIT = 10.0  # s of the processor's time that a case may take
WAIT = 6.0  # times that: s of the clock, of which other programs may take some
LONGEST = 3000  # characters of a refusal
ACCEPTED, REFUSED, OTHER = "accepted", "refused", "other"
ROOT = Path(__file__).parents[2]
LOCAL = "'127.0.0.1'"  # a sweep's own cluster
RUNS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "socket.connect", "socket.getaddrinfo")
OPENS = ("open", "os.remove", "os.rename", "os.mkdir", "os.rmdir", "shutil.rmtree", "os.symlink", "os.truncate")
OF_THE_MACHINE = ("/dev/null", "/dev/urandom", "/dev/tty", "/proc/", "/sys/", "/usr/share/", "/usr/lib/")


class Hang(BaseException):
    """The case took longer than the limit."""


@dataclass(frozen=True)
class Outcome:
    """Result of a case: `what` of the three it is, in words, the signature that like outcomes share, and its time [s]."""

    what: str
    detail: str = ""
    signature: str = ""
    seconds: float = 0.0


class Guard:
    """A folder for cases, and what may be opened while they are done.

    The folder has odd entries: a pipe, a link to itself, a link to an endless device, a folder, a link that leads nowhere, and
    one that leads to a file outside, each with every ending that is read.
    """

    def __init__(self, outside: Path):
        self.outside = outside
        self.root = outside / "worker"
        self.folder = self.root / "pkg" / "case"
        self.folder.mkdir(parents=True)
        (self.root / "tmp").mkdir()
        (self.root / "pkg" / "package.xml").write_text("<package/>")
        secret = outside / "secret"
        secret.mkdir()
        seeds = Path(__file__).parent / "seeds"
        for ending in ("toml", "stl", "csv", "sim", "urdf", "xml", "nc", "eds", "zarr"):
            content = (seeds / "box.stl").read_bytes() if ending == "stl" else b"secret = 1\n"
            (secret / f"secret.{ending}").write_bytes(content)
            os.mkfifo(self.folder / f"fifo.{ending}")
            (self.folder / f"loop.{ending}").symlink_to(f"loop.{ending}")
            (self.folder / f"zero.{ending}").symlink_to("/dev/zero")
            (self.folder / f"folder.{ending}").mkdir()
            (self.folder / f"gone.{ending}").symlink_to("nowhere")
            (self.folder / f"out.{ending}").symlink_to(secret / f"secret.{ending}")
        self.secret = os.path.realpath(secret)
        self.kept = set(os.listdir(self.folder))
        tempfile.tempdir = str(self.root / "tmp")
        allowed = [self.root, sys.prefix, sys.base_prefix, ROOT, cache_folder() or self.root]
        self.allowed = (*(os.path.realpath(path) + os.sep for path in allowed), *OF_THE_MACHINE)
        self.named = ""  # text of the user, who may name any file in it
        self.seen: list[str] = []
        self.watching = False
        sys.addaudithook(self._hook)

    def _hook(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.watching:
            return
        local = event.startswith("socket.") and LOCAL in str(arguments)
        if event in RUNS and arguments[0] != sys.executable and not local:  # runs are opened in a process of their own
            self.seen.append(f"{event} {arguments[:1]}"[:200])
        elif event in OPENS and not isinstance(arguments[0], int) and arguments[0] is not None:
            try:
                place = os.path.realpath(os.fsdecode(arguments[0]))
            except (ValueError, TypeError):  # a zero byte: nothing was opened
                return
            is_allowed = f"{place}{os.sep}".startswith(self.allowed) or self.root.is_relative_to(place)
            if is_allowed or self._is_named(os.fsdecode(arguments[0]), place):
                return
            if TEMPORARY.fullmatch(os.path.basename(place)) and f"{os.path.dirname(place)}{os.sep}" in self.named:
                # the case may, this machine's files stay
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), place)
            self.seen.append(f"{event} {os.fsdecode(arguments[0])}"[:200])

    def _is_named(self, path: str, place: str) -> bool:
        """True of a file that the user named, and of the temporary file of a write to one, or to what a named link leads to."""
        name = os.path.basename(path)
        is_write = TEMPORARY.fullmatch(name) is not None and os.path.dirname(place) == self.secret
        return name in self.named or (is_write and ("out." in self.named or "secret." in self.named))

    @contextmanager
    def files(self, case: Case) -> Iterator[None]:
        """The case's files in the folder, which is the working directory; everything new is removed afterwards."""
        os.chdir(self.folder)
        for name, content in case.files.items():
            os.makedirs(os.path.dirname(name) or ".", exist_ok=True)
            with open(name, "wb") as file:
                file.write(content)
        try:
            yield
        finally:
            for entry in os.scandir(self.folder):
                if entry.name not in self.kept and entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path)
                elif entry.name not in self.kept:
                    os.unlink(entry.path)

    def left_over(self) -> list[str]:
        """Temporary files that the case left in the folder."""
        return [name for name in os.listdir(self.folder) if name.startswith(".armwright")]


def attempt(case: Case, run: Callable[[Case], Any], guard: Guard) -> Outcome:
    """Outcome of a case.

    Args:
        case: the input.   run: what its kind does with it; may return an `Outcome` itself.   guard: where.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGALRM, _hang)
        signal.signal(signal.SIGPROF, _hang)
    guard.seen.clear()
    scripts = [
        content.decode("utf-8", "replace")
        for name, content in case.files.items()
        if name.endswith((".sim", ".log.toml"))
    ]
    guard.named = "\n".join([*map(str, case.call if case.kind == "command" else []), *scripts])
    start = time.perf_counter()
    with guard.files(case), warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        outcome = _guarded(case, run, guard)
        if outcome.what != OTHER and guard.seen:
            outcome = Outcome(OTHER, f"not named by the user: {guard.seen[0]}", f"outside {guard.seen[0].split()[0]}")
        elif outcome.what != OTHER and guard.left_over():
            outcome = Outcome(OTHER, f"left behind {guard.left_over()}", "left behind")
        elif outcome.what != OTHER and warned:
            text = (
                f"{warned[0].category.__name__}: {warned[0].message} ({_short(warned[0].filename)}:{warned[0].lineno})"
            )
            outcome = Outcome(OTHER, f"a warning: {text}", f"warning {_short(warned[0].filename)}:{warned[0].lineno}")
    return Outcome(outcome.what, outcome.detail, outcome.signature, time.perf_counter() - start)


def _guarded(case: Case, run: Callable[[Case], Any], guard: Guard) -> Outcome:
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    signal.setitimer(signal.ITIMER_REAL, LIMIT * WAIT)
    guard.watching = True
    try:
        result = run(case)
    except ArmwrightError as error:
        guard.watching = False
        try:
            return refusal(str(error), _place(error))
        except Exception as second:  # noqa: BLE001 - an error that cannot be shown
            return Outcome(OTHER, f"str() of the error fails: {second!r}", f"str {_place(error)}")
    except Hang as error:
        return Outcome(OTHER, f"no end after {LIMIT:g} s", f"hang {_place(error)}")
    except MemoryError as error:
        if '"huge"' in json.dumps(case.call):  # NumPy's own line says how many TiB were asked for
            return Outcome(REFUSED, str(error))
        return Outcome(OTHER, f"MemoryError: {error}", f"memory {_place(error)}")
    except (Exception, SystemExit) as error:  # noqa: BLE001 - what it is, is the result
        return Outcome(
            OTHER, "".join(traceback.format_exception(error))[-3000:], f"{type(error).__name__} {_place(error)}"
        )
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        guard.watching = False
    return result if isinstance(result, Outcome) else Outcome(ACCEPTED)


def refusal(text: str, place: str = "") -> Outcome:
    """The outcome of an error of ours: refused, if it is one line, or one a mistake, that a terminal can show."""
    lines = text.splitlines()
    if not lines or len(lines) == 2 or not all(line.startswith("  ") for line in lines[1:]):
        return Outcome(OTHER, f"{len(lines)} lines: {text!r}"[:3000], f"lines {place}")
    if max(map(len, lines)) > LONGEST:
        return Outcome(OTHER, f"{len(text)} characters: {text!r}"[:3000], f"long {place}")
    if any(ord(mark) < 32 or 127 <= ord(mark) < 160 for mark in "".join(lines)):
        return Outcome(OTHER, f"control characters: {text!r}"[:3000], f"control {place}")
    return Outcome(REFUSED, text)


def _hang(*_: Any) -> None:
    raise Hang


def _place(error: BaseException) -> str:
    """The innermost line of ours that an error came through."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if f"{os.sep}armwright{os.sep}" in frame.filename] or frames
    return f"{_short(ours[-1].filename)}:{ours[-1].name}" if ours else ""


def _short(path: str) -> str:
    return os.sep.join(path.split(os.sep)[-2:])

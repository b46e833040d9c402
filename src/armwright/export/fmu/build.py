"""Binaries of an FMU: shared libraries built by zig for every platform, or by a local compiler for this computer."""

from __future__ import annotations

import importlib.util
import os
import platform
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from armwright.errors import ModelError
from armwright.export.controller.sil import find_compiler, run_program

HOST = "host"  # this computer, by its own compiler where it has one
#: Equal bits need that products and sums stay apart; without math errno square roots are one instruction.
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden", "-shared", "-DNDEBUG")
TIMEOUT = 3600.0  # [s] that a compiler may take; zig compiles Windows' C library first, on a busy computer for minutes


@dataclass(frozen=True)
class Platform:
    """A kind of computer.

    Attributes:
        name: in FMI 3.0, which is the folder of its binaries.   older: the same in FMI 2.0.
        triple: zig's name.   level: processor that is asked for, with its multiply-add.   ending: of shared libraries.
    """

    name: str
    older: str
    triple: str
    level: str
    ending: str


X86, ARM = "x86_64_v3", "generic"
PLATFORMS = {
    each.name: each
    for each in (
        Platform("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", X86, ".so"),
        Platform("aarch64-linux", "aarch64-linux", "aarch64-linux-gnu.2.17", ARM, ".so"),
        Platform("x86_64-windows", "win64", "x86_64-windows-gnu", X86, ".dll"),
        Platform("aarch64-windows", "aarch64-windows", "aarch64-windows-gnu", ARM, ".dll"),
        Platform("x86_64-darwin", "darwin64", "x86_64-macos.11.0", X86, ".dylib"),
        Platform("aarch64-darwin", "aarch64-darwin", "aarch64-macos.11.0", ARM, ".dylib"),
    )
}


def host_platform() -> str:
    """The FMI name of this computer's platform: "x86_64-linux"."""
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(), platform.machine().lower())
    system = {"win32": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
    return f"{machine}-{system}"


def has_zig() -> bool:
    """True if the wheel `ziglang` is installed."""
    return importlib.util.find_spec("ziglang") is not None


def chosen_platforms(asked: Sequence[str] | None) -> tuple[str, ...]:
    """Platforms to build for: the requested ones; by default all with zig, `HOST` with a local compiler, else none.

    Raises:
        ModelError: an unknown platform, or one that nothing here compiles for.
    """
    own, zig = host_platform(), has_zig()
    here = own in PLATFORMS and find_compiler() is not None
    if asked is None:
        return tuple(PLATFORMS) if zig else (HOST,) if here else ()
    asked = [asked] if isinstance(asked, str) else asked
    for name in asked:
        if name not in (*PLATFORMS, HOST):
            raise ModelError(place="platforms", value=name, choices=[*PLATFORMS, HOST])
        if not zig and not (here and name in (own, HOST)):
            what, expected = "nothing here compiles for it", "pip install 'armwright[fmu]', which brings zig"
            raise ModelError(what, place="platforms", value=name, expected=expected)
    if HOST in asked and own in asked:
        raise ModelError(f"is {own}, which is asked for too", place="platforms", value=HOST, expected="one of them")
    return tuple(dict.fromkeys(asked))


def build(folder: Path, sources: Sequence[str], name: str, targets: Sequence[str]) -> dict[str, Path]:
    """Shared libraries of the sources in a folder, one for each platform, by its name in FMI 3.0.

    Raises:
        ModelError: a compiler ends with an error, which the message has.
    """
    if not targets:
        return {}
    with ThreadPoolExecutor(max(1, min(len(targets), (os.cpu_count() or 2) // 2))) as pool:
        jobs = {target: pool.submit(_build_one, folder, sources, name, target) for target in targets}
        return {host_platform() if target == HOST else target: job.result() for target, job in jobs.items()}


def _build_one(folder: Path, sources: Sequence[str], name: str, asked: str) -> Path:
    target = PLATFORMS[host_platform() if asked == HOST else asked]
    binary = folder / target.name / f"{name}{target.ending}"
    binary.parent.mkdir(parents=True, exist_ok=True)
    compiler = find_compiler() if asked == HOST or not has_zig() else None
    environment = dict(os.environ)
    if compiler is not None:
        march = ["-march=x86-64-v3"] if target.level == X86 else []
        command = [compiler, *FLAGS, *march]
    else:
        command = [sys.executable, "-m", "ziglang", "cc", *FLAGS]
        command += ["-target", target.triple, f"-mcpu={target.level}", "-s"]
        environment["ZIG_LOCAL_CACHE_DIR"] = str(folder / "zig")  # its global one keeps the systems' C libraries
    if target.ending == ".so":
        command.append("-fPIC")
    command += [str(folder / file) for file in sources]
    command += ["-o", str(binary), *([] if target.ending == ".dll" else ["-lm"])]
    run_program(command, f"compiler for {target.name}", TIMEOUT, environment)
    return binary

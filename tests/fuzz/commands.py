"""Command lines, each done in a forked process: exit code 0 or 2, one line on stderr, no traceback, no half-written file."""

from __future__ import annotations

import os
import re
import signal
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from random import Random
from typing import Any

from fuzz import files
from fuzz.attempt import ACCEPTED, LIMIT, OTHER, WAIT, Guard, Outcome, refusal
from fuzz.case import Case
from fuzz.mutation import FORMULAS, NUMBERS, WORDS

DIFFERENT = (
    "check",
    "diff",
    "reproduce",
    "identify",
    "validate",
    "ik",
    "plan",
    "loops",
    "tune",
    "sweep",
)  # whose exit code 1 means: there is something to say
SHORT = ("--torque", "0", "--duration", "0.01")
LINES: tuple[tuple[str, ...], ...] = (
    ("robots",),
    ("servos", "mx-64"),
    ("--version",),
    ("info", "arm.toml"),
    ("info", "arm.urdf"),
    ("info", "two-link", "--operations"),
    ("show", "two-link", "-o", "arm.png", "--size", "120", "--q", "0,30deg"),
    ("show", "arm.toml", "-o", "arm.glb"),
    ("check", "arm.toml"),
    ("check", "arm.urdf", "--strict"),
    ("check", "arm.xml"),
    ("diff", "arm.toml", "two-link"),
    ("convert", "arm.toml", "-o", "new.urdf"),
    ("convert", "arm.urdf", "-o", "new.toml", "--smoothing", "0.01"),
    ("inverse-dynamics", "two-link", "sets.csv", "-o", "new.csv"),
    ("forward-dynamics", "two-link", "sets.csv"),
    ("simulate", "two-link", *SHORT, "-o", "new.nc"),
    ("simulate", "arm.toml", "--command", "0", "--duration", "0.01", "--start", "0,1"),
    ("simulate", "two-link", "--schedule", "torques.csv", "--step", "1e-3", "--integrator", "rk4", "-o", "new.csv"),
    ("simulate", "one.scenario.toml", "-o", "new.nc"),
    ("plot", "one.nc", "--quantities", "q,tau", "--joints", "elbow", "-o", "run.html"),
    ("plot", "one.nc"),
    ("animate", "one.nc", "-o", "run.glb", "--lane", "0"),
    ("reproduce", "one.nc"),
    ("assemble", "toy.assembly.toml", "-o", "new.toml"),
    ("assemble", "--all", "--modules", "toy.modules.toml", "--max-joints", "2", "--max-assemblies", "5"),
    ("parts", "build", "arm.parts.toml", "-o", "new.toml"),
    ("export", "c", "two-link", "--functions", "mass_matrix", "-o", "firmware"),
    ("export", "c", "arm.toml", "--functions", "inverse_dynamics,forward_dynamics", "-o", "firmware", "--float"),
    ("sim", "two-link", "--script", "day.sim"),
    ("sim", "arm.toml", "--script", "day.sim", "--echo"),
    ("log", "bench.log.toml"),
    ("step-study", "two-link", *SHORT, "--step-count", "2", "--integrator", "rk4", "--accuracies", "1e-3"),
    ("simulate", "one.scenario.toml", "--allow", "..", "--record-every", "2"),
    ("convert", "arm.toml", "-o", "new.xml"),
    ("forward-dynamics", "arm.toml", "sets.csv", "-o", "out.csv"),
    ("animate", "one.nc", "-o", "run.html"),
    ("identify", "motor", "bench.log.toml"),
    ("identify", "arm", "two-link", "bench.log.toml", "-o", "new.toml"),
    ("identify", "payload", "two-link", "bench.log.toml"),
    ("identify", "friction", "two-link", "bench.log.toml"),
    ("identify", "linear", "bench.log.toml", "--joint", "elbow", "--model", "arx"),
    ("validate", "two-link", "bench.log.toml"),
    (
        "excite",
        "motor",
        "prbs",
        "-o",
        "new.csv",
        "--motor-gain",
        "12",
        "--time-constant",
        "0.05",
        "--max-command",
        "12",
    ),
    ("excite", "arm", "two-link", "-o", "new.csv", "--max-velocity", "2,2", "--starts", "1", "--harmonics", "2"),
    ("ik", "two-link", "poses.csv", "-o", "new.csv"),
    ("ik", "puma560", "poses.csv", "--all"),
    ("plan", "one.motion.toml"),
    ("plan", "one.motion.toml", "-o", "motion.csv", "--plot", "motion.html", "--record-period", "0.01"),
    ("simulate", "tuned.scenario.toml", "--reference", "one.motion.toml", "--duration", "0.02", "-o", "new.nc"),
    ("workspace", "two-link", "-o", "work.png", "--samples", "200", "--aim", "position"),
    ("workspace", "arm.toml", "--samples", "200", "--seed", "1"),
    ("loops", "tuned.scenario.toml", "--poses", "5", "--report", "loops.html"),
    ("tune", "tuned.scenario.toml", "-o", "new.scenario.toml", "--generations", "1", "--candidates", "3"),
    ("sweep", "tuned.scenario.toml", "--lanes", "4", "--chunk", "2", "-o", "runs.zarr"),
    (
        "compare-controllers",
        "tuned.scenario.toml",
        "--reference",
        "one.motion.toml",
        "--lanes",
        "2",
        "--settle",
        "0.01",
    ),
)
MAKERS = {  # what makes each of the files that a line may name
    "arm.toml": files.make_robot, "arm.urdf": files.make_urdf, "arm.xml": files.make_mjcf, "arm.parts.toml": files.make_parts,
    "toy.assembly.toml": files.make_assembly, "toy.modules.toml": files.make_assembly, "one.scenario.toml": files.make_scenario,
    "torques.csv": files.make_csv, "sets.csv": files.make_csv, "poses.csv": files.make_poses,
    "one.nc": files.make_run, "day.sim": files.make_session,
    "bench.log.toml": files.make_log, "one.motion.toml": files.make_motion, "tuned.scenario.toml": files.make_tuned,
}  # fmt: skip
LENGTHS = (
    "--duration",
    "--max-joints",
    "--max-assemblies",
    "--step-count",
    "--size",
    "--show",
    "--record-every",
    "--starts",
    "--harmonics",
    "--record-period",
    "--samples",
    "--poses",
    "--lanes",
    "--chunk",
    "--generations",
    "--candidates",
    "--settle",
)  # of work


def make_command(rng: Random) -> Case:
    words = list(rng.choice(LINES))
    contents: dict[str, bytes] = {}
    for name in words:
        if name in MAKERS:
            made = MAKERS[name](rng).files
            while name not in made:  # a maker of several kinds of files
                made = MAKERS[name](rng).files
            contents |= made
    for _ in range(rng.choice((0, 0, 1, 1, 2))):
        k = rng.randrange(len(words)) if words else 0
        if not words:
            words.append("")
        if words[k - 1] in LENGTHS:
            words[k] = rng.choice(("0", "-1", "nan", "", "x", "1e-300", "0.02", "3"))
        elif rng.random() < 0.6:
            words[k] = rng.choice(
                rng.choice((WORDS, NUMBERS, FORMULAS, ("--help", "-o", "fifo.toml", "zero.nc", "loop.csv")))
            )
        else:
            words[k : k + 1] = rng.choice(([], [words[k]] * 2, [words[k], rng.choice(("--help", "-x", "--", "x"))]))
    words = [word.replace("\0", "") or "x" for word in words]  # no program can be given a zero byte
    return Case("command", contents, words)


def run_command(case: Case, guard: Guard) -> Outcome:
    """Outcome of `armwright WORDS…`."""
    signal.setitimer(signal.ITIMER_REAL, 0.0)  # the time is watched here
    reading, writing = os.pipe()
    with open(guard.root / "stdout", "w+b") as out, open(guard.root / "stderr", "w+b") as err:
        child = os.fork()
        if child == 0:
            _child(case.call, guard, out.fileno(), err.fileno(), writing)
        os.close(writing)
        code = _waited(child)
        with os.fdopen(reading, "rb") as pipe:
            leaks = pipe.read().decode("utf-8", "replace").split("\n")
        out.seek(0)
        err.seek(0)
        return judged(
            case.call, code, out.read().decode("utf-8", "replace"), err.read().decode("utf-8", "replace"), leaks
        )


def _child(words: list[str], guard: Guard, out: int, err: int, leaks: int) -> None:
    """Becomes the command; never returns."""
    code = 70
    try:
        warnings.showwarning = lambda message, category, file, line, *_: guard.seen.append(
            f"warning {message} {file}:{line}"
        )
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(out, 1)
        os.dup2(err, 2)
        sys.stdin, sys.stdout, sys.stderr = (
            os.fdopen(k, mode, encoding="utf-8", closefd=False) for k, mode in enumerate("rww")
        )
        sys.argv = ["armwright", *words]
        from armwright.cli import main

        try:
            main()
            code = 0
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 1
        except BaseException:  # noqa: BLE001 - what Python itself would print
            traceback.print_exc()
            code = 1
        sys.stdout.flush()
        sys.stderr.flush()
        os.write(leaks, "\n".join(guard.seen).encode("utf-8", "replace")[:4000])
    finally:
        os._exit(code)


def _waited(child: int) -> int | None:
    """The exit code of a process, negative for a signal; None if it does not end."""
    end = time.monotonic() + LIMIT * WAIT
    while time.monotonic() < end:
        pid, status = os.waitpid(child, os.WNOHANG)
        if pid:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.002)
    os.kill(child, 9)
    os.waitpid(child, 0)
    return None


def judged(words: list[str], code: int | None, out: str, err: str, leaks: list[str]) -> Outcome:
    """Outcome of a process, from its exit code and what it wrote."""
    command = next((word for word in words if word in COMMANDS), "")
    last = (err.strip().splitlines() or [""])[-1]
    if code is None:
        return Outcome(OTHER, f"no end after {LIMIT:g} s", f"hang {command}")
    if leaks != [""]:
        return Outcome(OTHER, f"leak: {leaks}", f"leak {command} {leaks[0].split()[0]}")
    if code == 2:
        if not err.startswith("armwright: error: ") or not err.endswith("\n"):
            return Outcome(OTHER, f"exit code 2, stderr {err!r}"[:3000], f"stderr {command}")
        return refusal(err.removesuffix("\n"), command)
    if code not in (0, 1 if command in DIFFERENT else 0) or re.search(r"Traceback|Warning: |\.py:\d", err):
        return Outcome(OTHER, f"exit code {code}: {err[-3000:]}", f"exit {code} {command} {last[:80]}")
    if re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", out + err):
        return Outcome(OTHER, f"control characters in {out + err!r}"[:3000], f"control {command}")
    return Outcome(ACCEPTED)


COMMANDS = {line[0] for line in LINES}
COMMAND: dict[str, tuple[float, Callable[[Random], Case], Callable[[Case, Guard], Any]]] = {
    "command": (1, make_command, run_command),
}

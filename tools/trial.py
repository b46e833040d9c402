"""Install the wheel alone, with the lowest or the newest versions that pyproject.toml allows, and run what a newcomer runs.

    python tools/trial.py lowest | newest [--python 3.13] [--extra control] [--wheel FILE] [--quick]

uv picks the versions: `lowest` is the lowest of every package that pyproject.toml names, with the newest of what those ask
for. Wheels only; the environment is made in build/trial. Then, in a folder without the source: the demo, the commands below
and the numbered examples (`--quick` leaves these out). Exit code 1 if one fails or warns.
"""

import argparse
import os
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "build" / "trial"
RESOLUTION = {"lowest": "lowest-direct", "newest": "highest"}
PARTS = shlex.quote(str(ROOT / "src" / "armwright" / "robots" / "cmu-dd.parts.toml"))
DEMO = "simulate cmu-dd --schedule cmu-dd-feedforward.csv --start 0,0.35,0,0.6,0,0.4 --duration 2 -o demo.nc --plot demo.png"
SMOKE = (  # a command of each kind, in a folder with the examples
    DEMO,
    "info puma560",
    "info so101",
    "new robot own.toml --joint-count 3",
    "check scara.toml",
    f"parts build {PARTS} -o parts.toml",
    "assemble chain/arm.assembly.toml -o assembled.toml",
    "plan motions/pick-and-place.motion.toml",
    "simulate swing.scenario.toml -o run.nc",
    "plot run.nc -o run.html",
    "animate run.nc -o moves.html",
    "loops bus-4ms.scenario.toml",
    "show panda -o panda.html",
    "export c puma560 --functions inverse_dynamics -o c",
    "export controller swing.scenario.toml -o c",
    "convert cmu-dd -o cmu-dd.urdf",
    "info cmu-dd.urdf",
)


def environment(words: argparse.Namespace) -> Path:
    """Python of a new environment with the wheel and those versions of what it needs."""
    uv = str(Path(sys.executable).parent / "uv")
    python = FOLDER / words.versions / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    versions = FOLDER / f"{words.versions}.txt"
    wheel = words.wheel
    subprocess.run([uv, "venv", "--quiet", "--clear", "--python", words.python, FOLDER / words.versions], check=True)
    if wheel is None:
        subprocess.run([uv, "build", "--quiet", "--wheel", "--clear", "--out-dir", FOLDER / "wheel", ROOT], check=True)
        (wheel,) = (FOLDER / "wheel").glob("*.whl")
    extras = [word for extra in words.extra for word in ("--extra", extra)]
    resolve = [
        uv,
        "pip",
        "compile",
        "--quiet",
        "--no-python-downloads",
        "--resolution",
        RESOLUTION[words.versions],
        "--python",
        python,
        *extras,
    ]
    wheels = ["--only-binary", ":all:"]
    subprocess.run([*resolve, *wheels, "--no-header", "--output-file", versions, ROOT / "pyproject.toml"], check=True)
    install = [uv, "pip", "install", "--quiet", "--python", python, "--no-deps"]
    subprocess.run([*install, *wheels, "--requirement", versions, wheel], check=True)
    return python


def run(python: Path, words: list[str], folder: str) -> bool:
    """True if a program ends with 0 and without a warning; its words and, if it does not, its output are printed."""
    began = time.monotonic()
    kept = os.environ | {"ARMWRIGHT_CACHE_DIR": str(Path(folder) / "cache"), "MPLBACKEND": "agg"}
    kept.pop("PYTHONPATH", None)
    done = subprocess.run([python, *words], cwd=folder, env=kept, capture_output=True, text=True, encoding="utf-8")
    well = done.returncode == 0 and "Warning" not in done.stderr
    print(f"{'ok' if well else 'FAILED':6} {time.monotonic() - began:6.1f} s  {shlex.join(words)}", flush=True)
    if not well:
        print(done.stdout + done.stderr)
    return well


def main() -> int:
    """Exit code: 0 if everything ran."""
    parser = argparse.ArgumentParser()
    parser.add_argument("versions", choices=RESOLUTION)
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--extra", action="append", default=[])
    parser.add_argument("--wheel", type=Path)
    parser.add_argument("--quick", action="store_true")
    words = parser.parse_args()
    python = environment(words)
    with tempfile.TemporaryDirectory() as folder:
        command = ["-m", "armwright"]
        rows = [[*command, "examples", "copy", "."], *([*command, *shlex.split(row)] for row in SMOKE)]
        if not words.quick:
            rows += [[path.name] for path in sorted((ROOT / "examples").glob("[0-9]*.py"))]
        failed = sum(not run(python, row, folder) for row in rows)
    print(f"{len(rows) - failed} of {len(rows)} ran; versions: {FOLDER / words.versions}.txt")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())

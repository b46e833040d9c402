"""Write the tables of docs/install.md anew: which platforms have wheels, and what the core takes.

    python tools/install_page.py platforms | sizes

`platforms`: uv resolves pyproject.toml as it would for a platform and a Python, with wheels only (`uv pip compile
--python-platform`); nothing is installed, so "resolves" is not "was run". Where the whole does not resolve, requirements are
tried one by one, and those that do not are named. It asks the package index.

`sizes`: of the files that a package's RECORD lists, in the environment that `make newest` leaves in build/trial/newest.
"Loaded" are files that a process has imported or mapped (Linux), after a kernel call, and after a simulation with its picture.
"""

import json
import re
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "install.md"
TRIED = ROOT / "build" / "trial" / "newest" / "bin" / "python"
TRIES = 4  # of a question to the package index
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
PLATFORMS = {
    "Linux x86-64": "x86_64-manylinux_2_28",
    "Linux arm64": "aarch64-manylinux_2_28",
    "Windows x64": "x86_64-pc-windows-msvc",
    "macOS arm64": "aarch64-apple-darwin",
    "macOS Intel": "x86_64-apple-darwin",
    "Windows arm64": "aarch64-pc-windows-msvc",
    "Linux x86-64, musl": "x86_64-unknown-linux-musl",
    "Linux arm64, musl": "aarch64-unknown-linux-musl",
}
LEAST = 1.0  # [MB] of a package that has a row of its own
KERNEL = 'import armwright as aw; aw.compile(aw.load("puma560")).gravity_torques([0.0] * 6)'
PICTURE = 'import armwright as aw; aw.plot(aw.simulate(aw.Scenario("cmu-dd", 0.1, command=[0.0] * 6)), "run.png")'
COUNT = """
import importlib.metadata, json, os, sys
from pathlib import Path
loaded = {os.path.realpath(m.__file__) for m in list(sys.modules.values()) if getattr(m, "__file__", None)}
maps = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
loaded |= {os.path.realpath(line.split(None, 5)[5]) for line in maps if "/" in line.split(None, 5)[-1]}
found = {}
for package in importlib.metadata.distributions():
    files = {os.path.realpath(package.locate_file(file)) for file in package.files or ()}
    sizes = {file: os.path.getsize(file) for file in files if os.path.isfile(file)}
    found[package.name.lower()] = [sum(sizes.values()) / 1e6, sum(sizes[file] for file in sizes.keys() & loaded) / 1e6]
print(json.dumps(found))
"""


def resolves(requirements: list[str], platform: str, python: str, *options: str) -> bool:
    """True if uv finds wheels of all of them, and of what they need.

    Raises:
        SystemExit: uv ended TRIES times without an answer, as without a network; that is not a "no".
    """
    words = ["pip", "compile", "-", "--quiet", "--no-python-downloads", "--only-binary", ":all:"]
    command = [str(Path(sys.executable).parent / "uv"), *words, "--python-platform", platform, *options]
    command += ["--python", sys.executable, "--python-version", python]  # so that uv looks for no other
    said = ""
    for _ in range(TRIES):
        done = subprocess.run(
            command, input="\n".join(requirements), encoding="utf-8", capture_output=True, check=False
        )
        if done.returncode == 0:
            return True
        said = done.stderr
        if "No solution found" in said:
            return False
    raise SystemExit(f"uv does not answer for {requirements} on {platform}, Python {python}: {said}")


def lacking(requirements: list[str], platform: str, python: str) -> str:
    """Requirements that do not resolve there; empty if all do, together."""
    if resolves(requirements, platform, python):
        return ""
    for options in (["--no-deps"], []):  # the quick question first: is there a wheel of the thing itself
        if found := [each for each in requirements if not resolves([each], platform, python, *options)]:
            return ", ".join(f"`{each.split(';')[0].strip()}`" for each in found)
    return "no versions that fit together"


def platforms(project: dict) -> str:
    """Rows of the table, as Markdown."""
    parts = {"": project["dependencies"], **project["optional-dependencies"]}
    del parts["all"]
    asked = [(platform, python, part) for platform in PLATFORMS for python in PYTHONS for part in parts]
    with ThreadPoolExecutor(8) as pool:  # which wait for the index
        answers = pool.map(lambda ask: lacking(parts[ask[2]], PLATFORMS[ask[0]], ask[1]), asked)
        said = dict(zip(asked, answers, strict=True))
    rows = [f"| platform | Python {PYTHONS[0]} to {PYTHONS[-1]} | extras without a wheel |", "|---|---|---|"]
    for platform in PLATFORMS:
        core = _by_pythons(
            {python: f"no {lack}" if (lack := said[platform, python, ""]) else "yes" for python in PYTHONS}
        )
        lacks = {part: {python: said[platform, python, part] for python in PYTHONS} for part in list(parts)[1:]}
        extras = [f"{part} ({_by_pythons(missing)})" for part, missing in lacks.items() if any(missing.values())]
        rows.append(f"| {platform} | {core} | {'; '.join(extras) or '–'} |")
    return "\n".join(rows) + "\n"


def _by_pythons(said: dict[str, str]) -> str:
    """Answers with the Pythons that they hold for; without them if all have the same."""
    if len(set(said.values())) == 1:
        return next(iter(said.values()))
    return "; ".join(
        f"{', '.join(p for p in said if said[p] == each)}: {each}" for each in dict.fromkeys(said.values()) if each
    )


def counted(python: Path, script: str) -> dict[str, list[float]]:
    """[MB on disk, MB of files loaded] of each package, after a script."""
    with tempfile.TemporaryDirectory() as folder:
        words = [python, "-I", "-c", script + "\n" + COUNT]
        done = subprocess.run(words, cwd=folder, capture_output=True, encoding="utf-8", check=True)
    return json.loads(done.stdout.splitlines()[-1])


def sizes(python: Path) -> str:
    """Rows of the table, as Markdown: the largest first."""
    kernel, picture = counted(python, KERNEL), counted(python, PICTURE)
    rows = [(name, size, kernel[name][1], loaded) for name, (size, loaded) in picture.items()]
    own = sorted((row for row in rows if row[1] >= LEAST), key=lambda row: -row[1])
    small = [row for row in rows if row[1] < LEAST]
    own.append((f"{len(small)} smaller ones", *(sum(row[k] for row in small) for k in (1, 2, 3))))
    own.append(("**all**", *(sum(row[k] for row in rows) for k in (1, 2, 3))))
    head = (
        "| package | on disk [MB] | loaded by a kernel call | by a simulation and its picture |\n|---|---:|---:|---:|\n"
    )
    return head + "".join(f"| {name} | {size:.1f} | {few:.1f} | {more:.1f} |\n" for name, size, few, more in own)


def written(name: str, rows: str) -> None:
    """Puts rows between the page's marks of that name."""
    text, begin, end = PAGE.read_text(encoding="utf-8"), f"<!-- {name} -->\n", f"<!-- /{name} -->"
    found = re.sub(re.escape(begin) + ".*?" + re.escape(end), begin + "\n" + rows + "\n" + end, text, flags=re.DOTALL)
    PAGE.write_text(found, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    if sys.argv[1:] == ["platforms"]:
        written("platforms", platforms(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]))
    elif sys.argv[1:] == ["sizes"]:
        written("sizes", sizes(TRIED))
    else:
        raise SystemExit("expected one word: platforms or sizes")

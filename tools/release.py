"""Build sdist and wheel into dist, check them, try the wheel in a bare environment, and list what to tag. Nothing is uploaded.

    python tools/release.py [--quick]

Checks: `twine check --strict`, in an environment of its own, and `tools/trial.py newest` with the wheel (`--quick`: without
the examples).
"""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DIST, TWINE = ROOT / "dist", ROOT / "build" / "twine"


def to_do(version: str) -> list[str]:
    """Steps that are missing before the tag."""
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    tree = subprocess.run(["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, encoding="utf-8", check=True)
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    found = []
    if not re.search(rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d$", changes, re.MULTILINE):
        found.append(f"CHANGELOG.md has no section `## [{version}] - YYYY-MM-DD`")
    if not cited or cited[1] != version:
        found.append(f"CITATION.cff has another version than {version}")
    if tree.stdout:
        found.append("the working tree has changes that are not committed")
    return found


def main() -> None:
    """Builds, checks, tries and lists."""
    uv = str(Path(sys.executable).parent / "uv")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    shutil.rmtree(DIST, ignore_errors=True)
    subprocess.run([uv, "build", "--quiet", "--out-dir", DIST, ROOT], check=True)
    files = sorted(path for path in DIST.iterdir() if path.suffix in (".whl", ".gz"))
    wheel = next(path for path in files if path.suffix == ".whl")
    python = TWINE / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    subprocess.run([uv, "venv", "--quiet", "--clear", "--python", sys.executable, TWINE], check=True)
    subprocess.run([uv, "pip", "install", "--quiet", "--python", python, "--only-binary", ":all:", "twine"], check=True)
    subprocess.run([python, "-m", "twine", "check", "--strict", *files], check=True)
    trial = [sys.executable, ROOT / "tools" / "trial.py", "newest", "--wheel", wheel, *sys.argv[1:]]
    subprocess.run(trial, check=True)
    for path in files:
        print(f"built   {path.relative_to(ROOT)}  {path.stat().st_size / 1e6:.1f} MB")
    for each in to_do(version):
        print(f"to do   {each}")
    print(f'then    git tag -a v{version} -m "Armwright {version}"')


if __name__ == "__main__":
    main()

"""The chain from modules to C in one script: every stage's number, the files that it leaves, and its picture."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import armwright as aw
from docs.pages import ROOT, blocks
from kernels.c_compilers import BITS, build, compiler
from pictures.alike import unlike

pytestmark = pytest.mark.study  # half a minute

STAGES = ["modules", "measure", "identify", "validate", "plan", "tune", "drive", "C", "SIL", "twin"]
WORDS_OF_FOUR = {  # searches end elsewhere where NumPy and OpenBLAS take the words of eight of some processors
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Haswell",
    "OPENBLAS_NUM_THREADS": "1",
}
NUMBER = re.compile(r"\d+\.?\d*")


@pytest.fixture(scope="module")
def chain(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, str], Path]:
    """Output of each stage, and the folder with all files."""
    for extra in ("cma", "canopen", "can"):
        pytest.importorskip(extra)
    folder = tmp_path_factory.mktemp("chain")
    command = [sys.executable, str(ROOT / "examples" / "chain" / "chain.py"), str(folder / "out")]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | WORDS_OF_FOUR, capture_output=True, encoding="utf-8", timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    assert [path.name for path in folder.iterdir()] == ["out"]
    lines = dict(line.split(maxsplit=1) for line in done.stdout.splitlines())
    assert list(lines) == STAGES
    return lines, folder / "out"


def numbers(text: str) -> list[float]:
    return [float(number) for number in NUMBER.findall(text)]


def test_each_stage_does_what_it_is_for(chain: tuple[dict[str, str], Path]) -> None:
    """The arm's own numbers are found, the record passes, gains and feed-forward each make the error smaller."""
    said, folder = chain
    assert said["modules"].endswith("6 joints, 13.72 kg")  # of the LWA 4P with its gripper, as published
    assert said["identify"].startswith("58 of 58 base parameters")
    friction = re.search(r"joint 1 ([\d.]+) N m s/rad", said["identify"])
    assert friction is not None
    assert float(friction[1]) == pytest.approx(19.0, rel=0.02)  # of [values] in bench.scenario.toml
    off, before = numbers(said["validate"])[:2]
    assert said["validate"].startswith("passes")
    assert off < 0.2 < 1.0 < before
    assert said["plan"].endswith("every limit is kept")
    assert numbers(said["tune"])[0] < 80  # % of the first gains' error
    first, tuned, modules, identified = (
        float(number) for number in re.findall(r" (\d[\d.]*)(?:,| mrad)", said["drive"])
    )
    assert first > tuned > modules > identified
    assert identified < 2.0
    assert said["twin"].startswith("1510 cycles of 6 drives on a virtual CAN bus, equal to the simulation to the bit")
    verdict = aw.identification.stored_verdict(folder / "identified.toml")
    assert verdict is not None
    assert verdict.passed


def test_the_code_has_the_bits_of_the_simulation(chain: tuple[dict[str, str], Path]) -> None:
    """By its own comparison, and by the self-test that lies beside it."""
    said, folder = chain
    if shutil.which("gcc") is None:
        assert said["SIL"].startswith("no C compiler here")
    same, ticks = (int(number) for number in numbers(said["SIL"])[:2])
    assert same == ticks == 1510
    build([compiler("gcc"), *BITS, *(folder / "c").glob("*.c"), "-o", folder / "selftest", "-lm"])
    done = subprocess.run([folder / "selftest"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_its_picture_and_its_page_are_true(chain: tuple[dict[str, str], Path]) -> None:
    """The README's picture is the one that the script draws; the page shows what it prints, but for the last digits."""
    said, folder = chain
    difference = unlike(folder / "chain.png", ROOT / "docs" / "images" / "chain.png")
    assert difference is None, f"{difference}; if it is meant to: copy it there, and look at it"
    shown = next(text for kind, text in blocks("docs/chain.md") if kind == "text")
    printed = dict(line.split(maxsplit=1) for line in shown.splitlines())
    assert {k: NUMBER.sub("#", v) for k, v in printed.items()} == {k: NUMBER.sub("#", v) for k, v in said.items()}
    for stage, text in said.items():
        assert numbers(text) == pytest.approx(numbers(printed[stage]), rel=0.1, abs=0.1), stage

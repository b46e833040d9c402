"""Compiler options that change bits are refused, switched off, or noticed by the self-test, as the page's table says."""

from __future__ import annotations

import ctypes
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.export.c import write_c
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from docs.pages import page
from kernels.c_compilers import FMA, batch_function, build, compiler, run_batch
from kernels.harness import same_bits
from physics.arms import arm

KERNELS = ("inverse_dynamics", "forward_dynamics", "mass_matrix")
ROW = re.compile(r"^\| `(?P<option>-[^|]+)` \| (?P<gcc>[^|]+) \| (?P<clang>[^|]+) \|$", re.MULTILINE)
TABLE = {
    row["option"]: {"gcc": row["gcc"], "clang": row["clang"]}
    for row in ROW.finditer(page("docs/how-to/microcontroller.md"))
}
VERSIONS = {"gcc": "12", "clang": "14"}  # that the table is about
CASES = [(which, option) for which in VERSIONS for option in TABLE]


@pytest.fixture(scope="module")
def library(tmp_path_factory) -> Path:
    """The C file of an arm with losses and every friction law, with a driver that runs it over rows."""
    header, source, _ = write_c(arm("workshop"), KERNELS, tmp_path_factory.mktemp("flags"))
    drivers = [f'#include "{header.name}"\n']
    for kernel in KERNELS:
        program = trace_kernel(arm("workshop"), SIGNATURES[kernel])
        sizes = [port.size for port in (*program.inputs, *program.outputs)]
        drivers.append(batch_function(f"workshop_{kernel}", sizes, len(program.inputs)))
    source.with_name("driver.c").write_text("".join(drivers), encoding="ascii")
    return source


def outcome(which: str, options: list[str], source: Path, folder: Path) -> str:
    """The table's word for a compiler's options."""
    command = [compiler(which), "-std=c99", "-O2", *FMA, *options, "-fPIC"]
    done = subprocess.run([*command, "-c", source, "-o", folder / "arm.o"], capture_output=True, text=True)
    if done.returncode:
        return (
            "refused"
            if re.search(r"IEEE 754|infinities and NaN|literals_are_double|unsafe", done.stderr)
            else "unknown"
        )
    selftest = source.with_name("workshop_selftest.c")
    done = subprocess.run(
        [*command, selftest, folder / "arm.o", "-o", folder / "selftest", "-lm"], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return (
        "same bits" if subprocess.run([folder / "selftest"], capture_output=True).returncode == 0 else "self-test fails"
    )


def differences(which: str, source: Path, folder: Path) -> int:
    """Number of states, some of zeros of both signs, in which the compiled C has other bits than the kernels."""
    build(
        [
            compiler(which),
            "-shared",
            "-fPIC",
            source.with_name("driver.c"),
            folder / "arm.o",
            "-o",
            folder / "arm.so",
            "-lm",
        ]
    )
    loaded, random, wrong = ctypes.CDLL(str(folder / "arm.so")), np.random.default_rng(0), 0
    for kernel in KERNELS:
        program = trace_kernel(arm("workshop"), SIGNATURES[kernel])
        inputs = [random.normal(scale=1.5, size=(2000, *port.shape)) for port in program.inputs]
        for array in inputs:
            array[-500:] = random.choice([0.0, -0.0, 1.0, -1.0], array[-500:].shape)
        (found,) = run_batch(loaded, f"workshop_{kernel}", inputs, [port.shape for port in program.outputs])
        expected = getattr(aw.compile(arm("workshop")), kernel)(*inputs)
        wrong += int(np.count_nonzero(~same_bits(found, expected).reshape(2000, -1).all(axis=1)))
    return wrong


@pytest.mark.parametrize(("which", "option"), CASES)
@pytest.mark.sample(1)
def test_no_option_changes_bits_unnoticed(library, tmp_path, which, option):
    """Whatever the compiler's version; the words of the table hold for the versions that it names."""
    seen = outcome(which, option.split(), library, tmp_path)
    if seen == "same bits":
        assert differences(which, library, tmp_path) == 0
    version = subprocess.run([compiler(which), "-dumpversion"], capture_output=True, text=True).stdout
    if version.split(".")[0].strip() == VERSIONS[which]:
        assert seen == TABLE[option][which]


@pytest.mark.sample(1)
@pytest.mark.parametrize("which", VERSIONS)
@pytest.mark.parametrize("level", ["-O0", "-Os", "-O3"])
def test_the_usual_options_are_accepted(library, tmp_path, which, level):
    for dialect in ("-std=c99", "-std=gnu99", "-std=gnu11"):
        assert outcome(which, [dialect, level], library, tmp_path) == "same bits"


def test_every_option_of_the_issue_is_in_the_table():
    parts = ("unsafe-math-optimizations", "associative-math", "reciprocal-math", "finite-math-only", "no-signed-zeros")
    assert {"-ffast-math", "-Ofast", "-ffp-contract=fast", *(f"-f{part}" for part in parts)} <= set(TABLE)


@pytest.mark.parametrize("which", VERSIONS)
def test_a_link_that_flushes_subnormals_is_noticed(library, tmp_path, which):
    """-ffast-math where a program is linked sets the processor's mode, if every file was compiled without it."""
    objects = [tmp_path / "arm.o", tmp_path / "selftest.o"]
    for source, result in zip((library, library.with_name("workshop_selftest.c")), objects, strict=True):
        build([compiler(which), "-std=c99", "-O2", *FMA, "-c", source, "-o", result])
    build([compiler(which), *objects, "-ffast-math", "-o", tmp_path / "selftest", "-lm"])
    done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert done.returncode == 1
    assert re.search(r"^arithmetic +subnormal numbers are flushed to zero: .*: FAILED$", done.stdout, re.MULTILINE)


@pytest.mark.parametrize("real", ["double", "float"])
def test_without_fused_hardware_and_library_bits_are_not_compared(tmp_path, real):
    """An fma() that rounds twice, as some small C libraries have: results are within the tolerances, and that is said."""
    _, source, selftest = write_c(arm("two-link"), ["inverse_dynamics", "jacobian"], tmp_path, real)
    naive = "".join(f"\n#undef fma{s}\n#define fma{s}(a, b, c) ((a) * (b) + (c))\n" for s in ("", "f"))
    source.write_text(
        source.read_text().replace("#include <math.h>\n", f"#include <math.h>\n{naive}"), encoding="ascii"
    )
    build(
        [compiler("gcc"), "-std=c99", "-O2", "-ffp-contract=off", source, selftest, "-o", tmp_path / "selftest", "-lm"]
    )
    done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert re.search(r"^arithmetic +fma\(\) rounds twice: .*kernels$", done.stdout, re.MULTILINE)
    assert done.stdout.count("bits not compared: ok") == 2


def test_one_other_bit_is_noticed(tmp_path):
    """A result that is wrong by one rounding is within every tolerance, and fails."""
    _, source, selftest = write_c(arm("two-link"), ["gravity_torques"], tmp_path)
    text = re.sub(r"(tau\[0\]|g\[0\]|h\[0\]) = (\w+);", r"\1 = nextafter(\2, INFINITY);", source.read_text())
    assert text != source.read_text()
    source.write_text(text, encoding="ascii")
    build([compiler("gcc"), "-std=c99", "-O2", *FMA, source, selftest, "-o", tmp_path / "selftest", "-lm"])
    done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert done.returncode == 1
    assert re.search(
        r"^gravity_torques +error 0\.\d+ of the tolerance, [78] results with other bits: FAILED$", done.stdout, re.M
    )

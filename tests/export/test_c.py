"""The C library of an arm: the bits of the compiled kernels, clean under strict compilers, and its self-test."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess

import numpy as np
import pytest

import armwright as aw
from armwright.description.database import parse
from armwright.errors import ModelError, OutputError
from armwright.export.c import c_library, write_c
from armwright.export.c_comment import comment, plain
from armwright.export.c_selftest import ROUNDINGS
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import Model, build_model
from docs.pages import blocks, shell
from kernels.c_compilers import BITS, CORTEX_M7, STRICT, batch_function, build, compiler, run_batch
from kernels.harness import same_bits
from physics.arms import arm, workshop

ARMS = ("puma560", "panda", "cmu-dd", "workshop")  # workshop: a prismatic joint, branches, losses, every friction law


def offered(model: Model) -> list[str]:
    """The functions whose constants an arm's record gives."""
    names = []
    for name, signature in SIGNATURES.items():
        try:
            trace_kernel(model, signature)
        except ModelError:
            continue
        names.append(name)
    return names


KERNELS = [(name, kernel) for name in ARMS for kernel in offered(arm(name))]


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    """For an arm: its library in double, as gcc compiles it, every function over rows of arrays; made when first asked."""
    made: dict[str, ctypes.CDLL] = {}

    def library(name: str) -> ctypes.CDLL:
        if name not in made:
            folder = tmp_path_factory.mktemp(name)
            _, source, _ = write_c(arm(name), offered(arm(name)), folder)
            drivers = [f'#include "{source.stem}.h"\n']
            for kernel in offered(arm(name)):
                program = trace_kernel(arm(name), SIGNATURES[kernel])
                sizes = [port.size for port in (*program.inputs, *program.outputs)]
                drivers.append(batch_function(f"{source.stem}_{kernel}", sizes, len(program.inputs)))
            (folder / "driver.c").write_text("".join(drivers), encoding="ascii")
            shared = ("-shared", "-fPIC", source, folder / "driver.c", "-o", folder / "library.so", "-lm")
            build([compiler("gcc"), *BITS, *STRICT, *shared])
            made[name] = ctypes.CDLL(str(folder / "library.so"))
        return made[name]

    return library


@pytest.mark.parametrize(("name", "kernel"), KERNELS)
def test_c_has_the_bits_of_the_compiled_kernel(libraries, name, kernel):
    """On 10,000 random states, and on zeros of both signs, far angles, subnormals, infinities and NaN in every input."""
    model = arm(name)
    program = trace_kernel(model, SIGNATURES[kernel])
    random = np.random.default_rng(0)
    inputs = [random.normal(scale=1.5, size=(10_000 + 200, *port.shape)) for port in program.inputs]
    for k, array in enumerate(inputs):
        edges = (0.0, -0.0, np.nan, np.inf, -np.inf, 5e-324, 2.0**20 + 1, -1e22, np.pi / 2, 1e300)
        for j, value in enumerate(edges):
            array[10_000 + 20 * k + j] = value
            array[10_000 + 20 * k + 10 + j, random.integers(0, array.shape[1])] = value
    for array in inputs:
        array[-60:] = random.choice([0.0, -0.0, 1.0, -1.0], array[-60:].shape)
    found = run_batch(libraries(name), f"{name.replace('-', '_')}_{kernel}", inputs, [p.shape for p in program.outputs])
    expected = getattr(aw.compile(model), kernel)(*inputs)
    for ours, theirs in zip(found, expected if isinstance(expected, tuple) else (expected,), strict=True):
        wrong = ~same_bits(ours, np.ascontiguousarray(theirs))
        assert not wrong.any(), np.argwhere(wrong)[:5]
        assert np.isfinite(ours[:10_000]).all()


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("which", ["gcc", "clang"])
def test_strict_compilers_have_nothing_to_say_and_the_self_test_passes(tmp_path, which, name, real):
    paths = write_c(arm(name), offered(arm(name)), tmp_path, real)
    program = tmp_path / "selftest"
    build([compiler(which), *BITS, *STRICT, *paths[1:], "-o", program, "-lm"])
    done = subprocess.run([program], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == offered(arm(name))
    assert lines[-1] == f"{paths[0].stem}: ok"


def test_the_self_test_finds_what_is_wrong(tmp_path):
    """Another number in the code, or one that is not finite, and it ends with 1."""
    paths = write_c(arm("puma560"), ["gravity_torques", "jacobian"], tmp_path)
    text = paths[1].read_text()
    for wrong in ("9.8101", "NAN"):
        paths[1].write_text(re.sub(r"\b9\.81\b", wrong, text))
        build([compiler("gcc"), *BITS, *paths[1:], "-o", tmp_path / "selftest", "-lm"])
        done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
        assert done.returncode == 1
        assert re.search(r"^gravity_torques .* FAILED$", done.stdout, re.MULTILINE)
        assert re.search(r"^jacobian .* ok$", done.stdout, re.MULTILINE)
        assert done.stdout.endswith("puma560: FAILED\n")


@pytest.mark.parametrize(
    "kernel", ["inverse_dynamics", "mass_matrix", "gravity_torques", "forward_kinematics", "jacobian"]
)
def test_float_is_double_rounded(tmp_path, kernel):
    """Single precision stays within 16 roundings of the largest entry where nothing is solved."""
    model = arm("puma560")
    _, source, _ = write_c(model, [kernel], tmp_path, "float")
    program = trace_kernel(model, SIGNATURES[kernel])
    sizes = [port.size for port in (*program.inputs, *program.outputs)]
    name = f"puma560_{kernel}"
    (tmp_path / "driver.c").write_text(
        f'#include "puma560.h"\n{batch_function(name, sizes, len(program.inputs), "float")}'
    )
    shared = ("-shared", "-fPIC", source, tmp_path / "driver.c", "-o", tmp_path / "library.so", "-lm")
    build([compiler("gcc"), *BITS, *STRICT, "-Wdouble-promotion", *shared])
    random = np.random.default_rng(0)
    inputs = [random.uniform(-np.pi, np.pi, (10_000, *port.shape)).astype(np.float32) for port in program.inputs]
    (found,) = run_batch(ctypes.CDLL(str(tmp_path / "library.so")), name, inputs, [p.shape for p in program.outputs])
    expected = getattr(aw.compile(model), kernel)(*(array.astype(float) for array in inputs))
    axes = tuple(range(1, expected.ndim))
    error = np.abs(found - expected).max(axis=axes) / np.abs(expected).max(axis=axes)
    assert 0.0 < error.max() < ROUNDINGS / 4 * np.finfo(np.float32).eps


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("name", ["puma560", "workshop"])
def test_cortex_m7(tmp_path, name, real):
    """Clean for a microcontroller too, and fused multiply-add is an instruction there."""
    paths = write_c(arm(name), offered(arm(name)), tmp_path, real)
    flags = ("-std=c99", "-O2", *CORTEX_M7, "-ffp-contract=off", *STRICT)
    build([compiler("arm-none-eabi-gcc"), *flags, "-c", paths[1], "-o", tmp_path / "library.o"])
    build([compiler("arm-none-eabi-gcc"), *flags, "-c", paths[2], "-o", tmp_path / "selftest.o"])
    names = subprocess.run([compiler("arm-none-eabi-nm"), "-u", tmp_path / "library.o"], capture_output=True, text=True)
    assert not {"fma", "fmaf", "malloc", "printf"} & set(names.stdout.split())


def test_nothing_is_allocated_and_nothing_recurses(tmp_path):
    """Only libm's functions are called from outside, and each function of ours only calls those that stand before it."""
    model = arm("workshop")
    paths = write_c(model, offered(model), tmp_path)
    text = paths[1].read_text()
    assert set(re.findall(r"#include (\S+)", text)) == {
        '"workshop.h"',
        "<float.h>",
        "<math.h>",
        "<stdint.h>",
        "<string.h>",
    }
    assert not re.search(r"\b(malloc|free|goto|while|for)\b", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL))
    known: set[str] = set()
    for head, body in re.findall(
        r"^(?:static )?(?:void|double|uint64_t) (\w+)\([^;{]*\)\n\{\n(.*?)^\}", text, re.M | re.S
    ):
        called = set(re.findall(r"\b(workshop_\w+)\(", body))
        assert called <= known, head
        known.add(head)
    assert len(known) > len(offered(model))
    build([compiler("gcc"), *BITS, "-c", paths[1], "-o", tmp_path / "library.o"])
    names = subprocess.run([compiler("nm"), "-u", tmp_path / "library.o"], capture_output=True, text=True)
    libm = {
        "sin",
        "cos",
        "sincos",
        "tan",
        "pow",
        "fma",
        "sqrt",
        "floor",
        "ceil",
        "_GLOBAL_OFFSET_TABLE_",
        "__stack_chk_fail",
    }
    assert set(names.stdout.split()) - {"U"} <= libm


def test_the_header_tells_of_every_function(tmp_path):
    """Equation, shapes, units and the joints' names; it also serves C++."""
    header, _, _ = write_c(arm("panda"), offered(arm("panda")), tmp_path)
    text = header.read_text(encoding="ascii")
    assert "#define PANDA_JOINTS 7" in text
    for k, name in enumerate(arm("panda").names):
        assert f"[{k}] {name} (revolute)" in text
    for kernel in offered(arm("panda")):
        assert re.search(rf"\*/\nvoid panda_{kernel}\(", text)
        equation = (SIGNATURES[kernel].function.__doc__ or "").splitlines()[0]
        assert plain(equation).rstrip() in text
    assert re.search(r"\*   tau +\(PANDA_JOINTS\) +\[N m \| N\]  result", text)
    (tmp_path / "user.cpp").write_text('#include "panda.h"\nint main() { return PANDA_JOINTS - 7; }\n')
    build([compiler("g++"), "-Wall", "-Wextra", "-Werror", tmp_path / "user.cpp", "-o", tmp_path / "user"])


def test_any_name_is_a_name_in_c(tmp_path):
    """Names of arms and joints that would end a comment, begin a trigraph, or are no identifier."""
    record = workshop() | {"name": "3-Achs-Größe"}
    for k, word in enumerate(("*/int_x;/*", "a??/", "größe\u202e", "q\\", "v1")):
        record["joints"][k]["name"] = word
    model = build_model(parse(record, "odd"))
    paths = write_c(model, ["inverse_dynamics"], tmp_path)
    assert [path.name for path in paths] == ["arm_3_Achs_Gr_e.h", "arm_3_Achs_Gr_e.c", "arm_3_Achs_Gr_e_selftest.c"]
    build([compiler("gcc"), *BITS, *STRICT, *paths[1:], "-o", tmp_path / "selftest", "-lm"])
    assert subprocess.run([tmp_path / "selftest"], capture_output=True).returncode == 0


def test_comments_are_ascii():
    assert plain("Ṁ = ∂M/∂q q̇,  M⁻¹ Jᵀ  [kg m²]  µ") == "Mdot = dM/dq qd,  M^-1 J^T  [kg m^2]  \\xb5"
    assert comment(["a", "", "*/ b"]) == "/*\n * a\n *\n * * / b\n */"


def test_the_text_is_always_the_same():
    assert c_library(arm("panda"), ["jacobian"]) == c_library(arm("panda"), ["jacobian"])


@pytest.mark.parametrize(
    ("functions", "message"),
    [
        (["gravity"], r"no function 'gravity'; there is inverse_dynamics, forward_dynamics, .*, forward_arm"),
        (["jacobian", "Jacobian"], r"no function 'Jacobian'; there is"),
        ([], r"no function is named; there is inverse_dynamics"),
        (["motor_voltage"], r"panda: motor_voltage needs motor\.\w+ of joint 'joint1'"),
    ],
)
def test_refusals(tmp_path, functions, message):
    with pytest.raises(ModelError, match=message):
        write_c(arm("panda"), functions, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_it_is_written_whole_or_not_at_all(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/sub: cannot be made or is no folder"):
        write_c(arm("two-link"), ["jacobian"], tmp_path / "file" / "sub")
    with pytest.raises(OutputError, match=r"file: cannot be made or is no folder"):
        write_c(arm("two-link"), ["jacobian"], tmp_path / "file")
    (tmp_path / "out" / "two_link.c").mkdir(parents=True)  # a folder where the C file should go
    with pytest.raises(OutputError, match=r"two_link\.c: is a folder"):
        write_c(arm("two-link"), ["jacobian"], tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["two_link.c"]
    with pytest.raises(ModelError, match="real = 'half'"):
        write_c(arm("two-link"), ["jacobian"], tmp_path / "new", "half")
    assert not (tmp_path / "new").exists()


def test_the_page_s_commands_run(tmp_path):
    """Every command of the how-to, in one folder, for the compilers that are here."""
    commands = [text.strip() for kind, text in blocks("docs/how-to/microcontroller.md") if kind == "sh"]
    assert len(commands) == 3
    for command in commands:
        if "gcc" in command:
            compiler(next(word for word in command.split() if word.endswith("gcc")))
        done = shell(command, tmp_path)
        assert done.returncode == 0, done.stderr
        assert "FAILED" not in done.stdout


def test_it_replaces_what_was_there(tmp_path):
    first = write_c(arm("two-link"), ["jacobian"], tmp_path / "a" / "b")
    again = write_c(arm("two-link"), ["jacobian", "mass_matrix"], tmp_path / "a" / "b")
    assert first == again
    assert "two_link_mass_matrix" in again[0].read_text()
    assert len(list((tmp_path / "a" / "b").iterdir())) == 3
    shutil.rmtree(tmp_path / "a")

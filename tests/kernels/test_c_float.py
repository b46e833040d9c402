"""C in float against LLVM's code in single precision: the same bits, for every operation and for whole kernels."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

import armwright as aw
from armwright.kernels.c import c_source
from armwright.kernels.c_syntax import C_FLOAT
from armwright.kernels.format import SINGLE
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.program.operations import OPERATIONS
from kernels.c_compilers import BITS, STRICT, batch_function, build, compiler, run_batch
from kernels.harness import same_bits
from kernels.test_c import COMPILERS, operations
from kernels.test_operations import COMPUTED, arguments, compiled
from physics.arms import arm

STATES = 10_000
CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")


@pytest.fixture(
    scope="module",
    params=[*((c, False) for c in COMPILERS), ("gcc, contracting by default", True)],
    ids=str,
)
def library(request, tmp_path_factory) -> ctypes.CDLL:
    """All operations of floats, as one shared library."""
    which, inline = request.param
    folder = tmp_path_factory.mktemp("operations")
    (folder / "operations.c").write_text(operations(inline, C_FLOAT), encoding="ascii")
    command = [compiler(COMPILERS[which][0]), *COMPILERS[which][1:], "-shared", "-fPIC", folder / "operations.c"]
    warnings = () if inline else STRICT
    build([*command, *warnings, "-Wno-unused-parameter", "-o", folder / "operations.so", "-lm"])
    return ctypes.CDLL(str(folder / "operations.so"))


@pytest.mark.sample(43)
@pytest.mark.parametrize("name", COMPUTED)
def test_every_operation_has_llvm_s_bits(library, name):
    """All special values and six thousand others."""
    values = arguments(OPERATIONS[name], SINGLE)
    (found,) = run_batch(library, f"wrap_{name}", values, [()])
    wrong = ~same_bits(found, compiled(name, 16, SINGLE)(*values))
    assert not wrong.any(), [(*(float(v[k]) for v in values), float(found[k])) for k in np.flatnonzero(wrong)[:5]]


@pytest.mark.sample(1)
@pytest.mark.parametrize("command", ["gcc", "clang"])
@pytest.mark.parametrize(
    ("name", "kernel"),
    [
        *(("puma560", kernel) for kernel in ("inverse_dynamics", "forward_dynamics", "mass_matrix", "jacobian")),
        ("panda", "forward_kinematics"),
        ("workshop", "inverse_dynamics"),
        ("workshop", "motor_voltage"),
        ("workshop", "forward_arm"),
    ],
)
def test_a_kernel_in_c_has_the_bits_of_the_compiled_one(tmp_path, name, kernel, command):
    """Ten thousand states, some with angles that libm is asked for."""
    model = arm(name)
    program = trace_kernel(model, SIGNATURES[kernel])
    ports = (*program.inputs, *program.outputs)
    driver = batch_function(program.name, [port.size for port in ports], len(program.inputs), "float")
    (tmp_path / "k.c").write_text(c_source(program, "float") + driver, encoding="ascii")
    build(
        [
            compiler(command),
            *BITS,
            "-Wdouble-promotion",
            "-shared",
            "-fPIC",
            tmp_path / "k.c",
            "-o",
            tmp_path / "k.so",
            "-lm",
        ]
    )
    random = np.random.default_rng(0)
    inputs = [random.normal(size=(STATES, *port.shape)).astype(np.float32) for port in program.inputs]
    inputs[0][::97] *= np.float32(2.0**20)
    found = run_batch(ctypes.CDLL(str(tmp_path / "k.so")), program.name, inputs, [p.shape for p in program.outputs])
    expected = getattr(aw.compile(model, dtype="float32"), kernel)(*inputs)
    assert np.isfinite(expected).all()
    assert same_bits(found[0], expected).all()


def test_nothing_is_computed_in_double_on_a_cortex_m4(tmp_path):
    """Its unit knows floats only: a double would be a call of the compiler's own library."""
    text = c_source(trace_kernel(arm("workshop"), SIGNATURES["inverse_dynamics"]), "float")
    assert "double" not in text
    assert "sinf(" in text  # for angles beyond 2^17 only, where the mask is true
    (tmp_path / "k.c").write_text(text, encoding="ascii")
    flags = ("-std=c99", "-O2", *CORTEX_M4, "-ffp-contract=off", *STRICT, "-Wno-missing-prototypes")
    build([compiler("arm-none-eabi-gcc"), *flags, "-S", tmp_path / "k.c", "-o", tmp_path / "k.s"])
    assembly = (tmp_path / "k.s").read_text()
    assert "vfma.f32" in assembly
    assert "__aeabi_d" not in assembly
    assert "__aeabi_f2d" not in assembly

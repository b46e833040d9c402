"""The C text against LLVM's code: the same bits for every operation of the table, whatever the compiler does with it."""

from __future__ import annotations

import ctypes
import re

import numpy as np
import pytest

from armwright.kernels import lowering
from armwright.kernels.c import Unit, c_source, c_text
from armwright.kernels.c_syntax import C_DOUBLE, C_FLOAT, Dialect, identifier, literal
from armwright.program import call, trace
from armwright.program.operations import OPERATIONS
from armwright.scalar import sin
from kernels.c_compilers import BITS, FMA, STRICT, batch_function, build, compiler, run_batch
from kernels.harness import ArrayFunction, same_bits
from kernels.test_operations import COMPUTED, arguments, compiled

NAMES = ("a", "b", "c")
COMPILERS = {
    "gcc": ("gcc", *BITS),
    "gcc, contracting by default": ("gcc", "-std=gnu99", "-O3", *FMA),
    "gcc, without optimising": ("gcc", "-std=c99", "-O0"),
    "clang": ("clang", *BITS),
}
INLINE = ("gcc, contracting by default", "clang")  # which may see what stands beside a polynomial in the line


def operations(inline: bool, dialect: Dialect = C_DOUBLE) -> str:
    """A function for every operation of the table; with its polynomials called, or in the line."""
    unit, real = Unit(dialect, "t_"), dialect.real
    for name in COMPUTED:
        m, values = unit.machine(), NAMES[: OPERATIONS[name].arity]
        lower = lowering.lower if inline else unit.lower
        body = m.text([f"*result = {lower(m, name, *values)};"])
        head = f"void op_{name}({', '.join([*(f'{real} {v}' for v in values), f'{real} *result'])})"
        unit.functions[f"op_{name}"] = f"{head};\n{head}\n{{\n{body}\n}}"
    drivers = []
    for name in COMPUTED:
        arity = OPERATIONS[name].arity
        wrapped = f"#define wrap_{name}({', '.join([*NAMES[:arity], 'r'])}) "
        wrapped += f"op_{name}({', '.join([*(f'*({v})' for v in NAMES[:arity]), 'r'])})\n"
        drivers.append(wrapped + batch_function(f"wrap_{name}", [1] * (arity + 1), arity, real))
    return "\n".join([c_text(unit), *drivers])


@pytest.fixture(scope="module", params=[*((c, False) for c in COMPILERS), *((c, True) for c in INLINE)], ids=str)
def library(request, tmp_path_factory) -> ctypes.CDLL:
    """All operations, as one shared library."""
    which, inline = request.param
    folder = tmp_path_factory.mktemp("operations")
    (folder / "operations.c").write_text(operations(inline), encoding="ascii")
    command = [compiler(COMPILERS[which][0]), *COMPILERS[which][1:], "-shared", "-fPIC", folder / "operations.c"]
    warnings = () if inline else STRICT  # a line may compute a cosine that nobody asked for
    build([*command, *warnings, "-Wno-unused-parameter", "-o", folder / "operations.so", "-lm"])
    return ctypes.CDLL(str(folder / "operations.so"))


@pytest.mark.sample(6)
@pytest.mark.parametrize("name", COMPUTED)
def test_every_operation_has_llvm_s_bits(library, name):
    """All special values and six thousand others; where the row is exact these are NumPy's bits too."""
    values = arguments(OPERATIONS[name])
    (found,) = run_batch(library, f"wrap_{name}", values, [()])
    wrong = ~same_bits(found, compiled(name, 8)(*values))
    assert not wrong.any(), [(*(float(v[k]) for v in values), float(found[k])) for k in np.flatnonzero(wrong)[:5]]
    if OPERATIONS[name].ulp == 0.0:
        with np.errstate(all="ignore"):
            assert same_bits(found, np.asarray(OPERATIONS[name].numpy(*values), dtype=float)).all()


def all_integers(m):
    """Every operation on integers, which no single polynomial uses; on the bits of a and b."""

    def body(a, b):
        i, j = m.bits(a), m.bits(b)
        mixed = m.int_xor(m.int_add(i, j), m.int_sub(i, m.int_constant(-7)))
        mixed = m.int_or(m.int_and(mixed, j), m.shift_left(i, 3))
        mixed = m.int_xor(m.arithmetic_shift_right(mixed, 5), m.shift_right(j, 9))
        mixed = m.int_add(mixed, m.arithmetic_shift_right(j, 0))
        p = m.either(m.int_lt(mixed, i), m.inverse(m.int_eq(m.int_and(j, m.int_constant(1)), m.int_constant(0))))
        whole = m.select(p, m.trunc(a), m.rint(b))
        return m.flip_sign(m.from_bits(m.int_and(mixed, m.int_constant((1 << 62) - 1))), i), whole

    return body


def test_integers_and_rounding_have_llvm_s_bits(tmp_path):
    unit = Unit(C_DOUBLE)
    m = unit.machine()
    first, second = all_integers(m)("a[0]", "b[0]")
    head = "void integers(const double *a, const double *b, double *x, double *y)"
    unit.functions["integers"] = f"{head};\n{head}\n{{\n{m.text([f'*x = {first};', f'*y = {second};'])}\n}}"
    (tmp_path / "i.c").write_text(c_text(unit) + batch_function("integers", [1, 1, 1, 1], 2), encoding="ascii")
    build([compiler("gcc"), *BITS, *STRICT, "-shared", "-fPIC", tmp_path / "i.c", "-o", tmp_path / "i.so", "-lm"])
    values = np.random.default_rng(0).normal(size=(2, 1000)) * 10.0 ** np.random.default_rng(1).integers(
        -300, 300, 1000
    )
    found = run_batch(ctypes.CDLL(str(tmp_path / "i.so")), "integers", values, [(), ()])
    expected = ArrayFunction(lambda m, a, b: all_integers(m)(a, b), 2, 4)(*values)
    assert all(same_bits(f, e).all() for f, e in zip(found, expected, strict=True))


def test_a_negated_fused_sum_keeps_its_zero(tmp_path):
    """-(a b - c) is -0 where a b = c; GCC would make it c - a b, which is +0."""
    program = trace("turned", lambda a, b, c: -(a * b - c), {"a": (), "b": (), "c": ()})
    (tmp_path / "t.c").write_text(c_source(program) + batch_function("turned", [1] * 4, 3), encoding="ascii")
    for name in ("gcc", "clang"):
        build([compiler(name), *BITS, "-shared", "-fPIC", tmp_path / "t.c", "-o", tmp_path / f"{name}.so", "-lm"])
        (found,) = run_batch(
            ctypes.CDLL(str(tmp_path / f"{name}.so")), "turned", [np.array([x]) for x in (1.0, 2.0, 2.0)], [()]
        )
        assert np.signbit(found[0]), name
        assert found[0] == 0.0


def test_programs_call_programs(tmp_path):
    """A program that is not inlined becomes a function of its own, printed once and before its callers."""
    inner = trace("inner", lambda x: np.array([sin(x[0]) * x[1], x[0] + x[1]]), {"x": (2,)}, ("y",), noinline=True)

    def twice(x):
        return call(inner, call(inner, x))

    text = c_source(trace("outer", twice, {"x": (2,)}, ("y",)))
    assert text.count("static void outer_inner(") == 1
    assert text.index("static void outer_inner(") < text.index("void outer(const")
    (tmp_path / "o.c").write_text(text + batch_function("outer", [2, 2], 1), encoding="ascii")
    build([compiler("gcc"), *BITS, "-shared", "-fPIC", tmp_path / "o.c", "-o", tmp_path / "o.so", "-lm"])
    x = np.random.default_rng(0).normal(size=(50, 2))
    (found,) = run_batch(ctypes.CDLL(str(tmp_path / "o.so")), "outer", [x], [(2,)])
    y = np.stack([np.sin(x[:, 0]) * x[:, 1], x.sum(axis=1)], axis=1)
    np.testing.assert_allclose(found, np.stack([np.sin(y[:, 0]) * y[:, 1], y.sum(axis=1)], axis=1), rtol=1e-14)


def test_arrays_may_overlap(tmp_path):
    """All results are stored when everything is computed, also an input that is handed through."""
    program = trace("swap", lambda x: np.array([x[1], x[0], -x[0]]), {"x": (3,)}, ("y",))
    (tmp_path / "s.c").write_text(c_source(program), encoding="ascii")
    build([compiler("gcc"), *BITS, "-shared", "-fPIC", tmp_path / "s.c", "-o", tmp_path / "s.so", "-lm"])
    x = np.array([1.0, 2.0, 3.0])
    ctypes.CDLL(str(tmp_path / "s.so")).swap(ctypes.c_void_p(x.ctypes.data), ctypes.c_void_p(x.ctypes.data))
    assert x.tolist() == [2.0, 1.0, -1.0]


def test_only_what_is_used_is_printed():
    text = c_source(trace("f", lambda x, _: x + 1.0, {"x": (), "unused": (2,)}, ("y",)))
    assert "(void)unused;" in text
    assert "sincos" not in text
    assert "memcpy" not in text
    m = Unit().machine()
    m.mul("a", "b")
    assert m.text([f"return {m.add('a', 'b')};"]).split("\n") == ["    const double v2 = a + b;", "    return v2;"]


@pytest.mark.parametrize(
    ("value", "double", "single"),
    [
        (0.1, "0.1", "0.1f"),
        (1.0, "1.0", "1.0f"),
        (-0.0, "-0.0", "-0.0f"),
        (1e22, "1e+22", "1e+22f"),
        (1 / 3, "0.3333333333333333", "0.33333334f"),
        (5e-324, "0x0.0000000000001p-1022", "0.0f"),
        (1e300, "1e+300", "INFINITY"),
        (-np.inf, "-(double)INFINITY", "-INFINITY"),
        (np.nan, "(double)NAN", "NAN"),
    ],
)
def test_numbers_read_back_to_the_bit(value, double, single):
    assert literal(value, C_DOUBLE) == double
    assert literal(value, C_FLOAT) == single


@pytest.mark.parametrize(
    ("name", "word"),
    [("cmu-dd", "cmu_dd"), ("7 bot", "arm_7_bot"), ("Größe", "Gr_e"), ("--", "arm"), ("double", "arm_double")],
)
def test_names_become_identifiers(name, word):
    assert identifier(name) == word


def test_no_product_stands_beside_a_sum():
    """Nothing in the text could be contracted within an expression, as the standard allows."""
    for line in operations(False).splitlines():
        if line.startswith("    const double"):
            assert not re.search(r"\*.*[+-] |[+-] .*\*", line.partition("=")[2]), line

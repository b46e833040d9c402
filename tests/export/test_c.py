"""The C library of an arm: the bits of the compiled kernels, clean under strict compilers, and its self-test."""

from __future__ import annotations

import ctypes
import functools
import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armwright as aw
from armwright.description.database import parse
from armwright.errors import ModelError, OutputError
from armwright.export.c import c_library, write_c
from armwright.export.c_function import parse_form
from armwright.export.c_header import CALLS, comment, described, plain, stack
from armwright.export.c_selftest import ROUNDINGS
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import Model, build_model
from docs.pages import blocks, shell
from dynamics.gear_tables import worn
from export.cortex import CORTEX_M4, run_on_board
from export.running import pid_loop
from kernels.c_compilers import BITS, CORTEX_M7, STRICT, batch_function, build, compiler, run_batch
from kernels.harness import same_bits
from physics.arms import arm, workshop
from raises_at import raises_at

ARMS = ("panda", "cmu-dd", "sprung")  # sprung: a prismatic joint, branches, losses, every friction law, springs
QUICK = "cmu-dd"  # soon built: `make test` has all of its functions, `make test-all` those of the others
ONCE = ("inverse_dynamics+wrench",)  # with a wrench in float too
WHOLE = ("sprung",)  # all functions; of the others those that compilers are done with soon
LONG = ("inverse_dynamics_derivatives", "forward_dynamics_derivatives", "forward_arm_linearised", "coriolis_matrix")


@functools.cache
def offered(model: Model) -> list[str]:
    """Every form of the functions that an arm's record has the constants and joints for, `frame` at one that is no tip."""
    frame = [each for each in model.frames if each != model.tip][-1]
    forms = []
    for name, signature in SIGNATURES.items():
        if name in LONG and model.name not in WHOLE:
            continue
        forms += [name, *(f"{name}+{each.name}" for each in signature.optional)]
        forms += [f"{name}:{option}={frame}" for option in signature.options]
    return [form for form in forms if has_what_it_needs(model, form)]


def has_what_it_needs(model: Model, form: str) -> bool:
    """True if the plain function has a value for that arm, which is sooner known than its program."""
    parsed = parse_form(form)
    random = np.random.default_rng(0)
    inputs = [random.normal(size=a.sized(model)) for a in (*parsed.signature.inputs, *parsed.optional)]
    try:
        parsed.evaluate(model, *inputs)
    except ModelError:
        return False
    return True


def printed(model: Model, real: str) -> list[str]:
    """Forms of a library: all in double; in float each function once, as what an input adds is the same text in both."""
    return [form for form in offered(model) if real == "double" or form in ONCE or not re.search("[+:]", form)]


def short_name(form: str) -> str:
    """A form's name in C behind the arm's."""
    return re.sub(r"\W+", "_", re.sub(r":\w+=", "_", form))


FORMS = [(name, form) for name in ARMS for form in offered(arm(name))]
MARKED = [pytest.param(*each, marks=() if each[0] == QUICK else pytest.mark.study) for each in FORMS]


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """An arm's header, C file and self-test with all its functions, written when a test first asks for them."""

    @functools.cache
    def files(name: str, real: str = "double") -> list[Path]:
        return write_c(arm(name), printed(arm(name), real), tmp_path_factory.mktemp(f"{name}-{real}"), real)

    return files


@pytest.fixture(scope="module")
def objects(written):
    """An arm's C file, compiled when a test first asks for it by a compiler that has nothing to say about it."""

    @functools.cache
    def compiled(which: str, name: str, real: str = "double") -> Path:
        _, source, _ = written(name, real)
        path = source.with_name(f"{which}.o")
        build([compiler(which), *BITS, *STRICT, "-fPIC", "-c", source, "-o", path])
        return path

    return compiled


@pytest.fixture(scope="module")
def libraries(written, objects):
    """For an arm: its library in double, as gcc compiles it, every function over rows of arrays."""

    @functools.cache
    def library(name: str) -> ctypes.CDLL:
        _, source, _ = written(name)
        drivers = [f'#include "{source.stem}.h"\n']
        for form in offered(arm(name)):
            program = parse_form(form).trace(arm(name))
            sizes = [port.size for port in (*program.inputs, *program.outputs)]
            drivers.append(batch_function(f"{source.stem}_{short_name(form)}", sizes, len(program.inputs)))
        driver, shared = source.with_name("driver.c"), source.with_name("library.so")
        driver.write_text("".join(drivers), encoding="ascii")
        build([compiler("gcc"), *BITS, *STRICT, "-shared", "-fPIC", driver, objects("gcc", name), "-o", shared, "-lm"])
        return ctypes.CDLL(str(shared))

    return library


def test_every_form_of_every_kernel_is_among_them():
    """All rows of the table, with every optional input and every option."""
    forms = {form.partition("=")[0] for _, form in FORMS}
    for signature in SIGNATURES.values():
        assert {signature.name, *(f"{signature.name}+{a.name}" for a in signature.optional)} <= forms
        assert {f"{signature.name}:{option}" for option in signature.options} <= forms


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "form"), MARKED)
def test_c_has_the_bits_of_the_compiled_kernel(libraries, name, form):
    """On 10,000 random states, and on zeros of both signs, far angles, subnormals, infinities and NaN in every input."""
    model, parsed = arm(name), parse_form(form)
    program = parsed.trace(model)
    random = np.random.default_rng(0)
    inputs = [random.normal(scale=1.5, size=(10_000 + 200, *port.shape)) for port in program.inputs]
    for k, array in enumerate(inputs):
        edges = (0.0, -0.0, np.nan, np.inf, -np.inf, 5e-324, 2.0**20 + 1, -1e22, np.pi / 2, 1e300)
        for j, value in enumerate(edges):
            array[10_000 + 20 * k + j] = value
            array[10_000 + 20 * k + 10 + j, random.integers(0, array.shape[1])] = value
    for array in inputs:
        array[-60:] = random.choice([0.0, -0.0, 1.0, -1.0], array[-60:].shape)
    function = f"{name.replace('-', '_')}_{short_name(form)}"
    found = run_batch(libraries(name), function, inputs, [p.shape for p in program.outputs])
    kernel = aw.compile(model).kernel(parsed.signature.name, *(a.name for a in parsed.optional), **dict(parsed.options))
    expected = kernel(*inputs)
    for ours, theirs in zip(found, expected if isinstance(expected, tuple) else (expected,), strict=True):
        wrong = ~same_bits(ours, np.ascontiguousarray(theirs))
        assert not wrong.any(), np.argwhere(wrong)[:5]
        assert np.isfinite(ours[:10_000]).all()


#: Every arm with both compilers, every compiler with both reals.
PAIRS = [
    *((which, "cmu-dd", real) for which, real in (("gcc", "double"), ("clang", "float"))),
    *((which, name, real) for name in ("panda", "sprung") for which, real in (("gcc", "float"), ("clang", "double"))),
]


@pytest.mark.parametrize(("which", "name", "real"), PAIRS)
@pytest.mark.study
def test_strict_compilers_have_nothing_to_say_and_the_self_test_passes(written, objects, which, name, real):
    header, _, test = written(name, real)
    program = test.with_name(f"{which}-selftest")
    build([compiler(which), *BITS, *STRICT, test, objects(which, name, real), "-o", program, "-lm"])
    done = subprocess.run([program], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines[:-1]] == [
        "arithmetic",
        *(short_name(form) for form in printed(arm(name), real)),
    ]
    assert lines[-1] == f"{header.stem}: ok"


@pytest.mark.study
def test_the_self_test_of_gears_with_tables_passes(tmp_path):
    """Efficiency tables, and friction by load on either side, in C."""
    forms = ["inverse_dynamics", "forward_dynamics", "forward_dynamics_derivatives"]
    _, source, test = write_c(worn(), forms, tmp_path)
    build([compiler("gcc"), *BITS, *STRICT, test, source, "-o", tmp_path / "selftest", "-lm"])
    done = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert [line.split()[0] for line in done.stdout.splitlines()[1:-1]] == forms


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


@pytest.mark.sample(1)
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
    build([compiler("gcc"), *BITS, *STRICT, *shared])
    random = np.random.default_rng(0)
    inputs = [random.uniform(-np.pi, np.pi, (10_000, *port.shape)).astype(np.float32) for port in program.inputs]
    (found,) = run_batch(ctypes.CDLL(str(tmp_path / "library.so")), name, inputs, [p.shape for p in program.outputs])
    expected = getattr(aw.compile(model), kernel)(*(array.astype(float) for array in inputs))
    axes = tuple(range(1, expected.ndim))
    error = np.abs(found - expected).max(axis=axes) / np.abs(expected).max(axis=axes)
    assert 0.0 < error.max() < ROUNDINGS / 4 * np.finfo(np.float32).eps


@pytest.mark.study
@pytest.mark.parametrize(
    ("name", "core", "real"),
    [("cmu-dd", CORTEX_M7, "double"), ("cmu-dd", CORTEX_M4, "float")],
)
def test_microcontrollers(written, tmp_path, name, core, real):
    """Clean for them too, and fused multiply-add is an instruction there."""
    _, source, test = written(name, real)
    flags = ("-std=c99", "-O2", *core, "-ffp-contract=off", *STRICT)
    build([compiler("arm-none-eabi-gcc"), *flags, "-c", source, "-o", tmp_path / "library.o"])
    build([compiler("arm-none-eabi-gcc"), *flags, "-c", test, "-o", tmp_path / "selftest.o"])
    names = subprocess.run([compiler("arm-none-eabi-nm"), "-u", tmp_path / "library.o"], capture_output=True, text=True)
    assert not {"fma", "fmaf", "malloc", "printf"} & set(names.stdout.split())


@pytest.mark.study
@pytest.mark.parametrize(("board", "real"), [("mps2-an500", "double"), ("mps2-an386", "float")])
def test_the_self_test_passes_on_a_microcontroller(tmp_path, board, real):
    """On an emulated Cortex-M7 in double and a Cortex-M4 in float; a wrong number is told there too."""
    forms = [
        "inverse_dynamics+wrench",
        "forward_dynamics",
        "mass_matrix",
        "forward_kinematics:frame=link3",
        "regressor",
    ]
    _, source, test = write_c(arm("panda"), forms, tmp_path, real)
    done = run_on_board(board, [source, test], tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()[:-1]
    assert [line.split()[0] for line in lines] == ["arithmetic", *(short_name(form) for form in forms)]
    assert all(line.endswith(" 0 results with other bits: ok") for line in lines[1:])
    assert done.stdout.endswith("panda: ok\n")
    source.write_text(re.sub(r"\b9\.8\d*", "9.7", source.read_text()))
    done = run_on_board(board, [source, test], tmp_path)
    assert done.returncode == 1, done.stderr
    assert done.stdout.endswith("panda: FAILED\n")


def stack_usage(command: list[Any], source: Path, folder: Path) -> dict[str, int]:
    """[bytes] by function, as GCC says."""
    build([*command, "-fstack-usage", "-c", source, "-o", folder / "usage.o"])
    rows = [line.split("\t") for line in (folder / "usage.su").read_text().splitlines()]
    return {place.split(":")[-1]: int(size) for place, size, _ in rows}


@pytest.mark.study
@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("which", ["gcc", "arm-none-eabi-gcc"])
def test_the_stack_is_what_the_header_says(tmp_path, which, real):
    """Within a half and two and a half times, as it says."""
    forms = ["inverse_dynamics+wrench", "forward_dynamics", "mass_matrix", "forward_kinematics", "jacobian", "energy"]
    forms += ["gravity_torques", "inverse_dynamics_derivatives"]
    header, source, _ = write_c(arm("cmu-dd"), forms, tmp_path, real)
    flags = BITS if which == "gcc" else ("-std=c99", "-O2", *CORTEX_M7, "-ffp-contract=off")
    used = stack_usage([compiler(which), *flags], source, tmp_path)
    said = re.findall(r"Stack: about (\d+) bytes\.\n \*/\nvoid (\w+)\(", header.read_text())
    assert len(said) == len(forms)
    calls = max((size for name, size in used.items() if name not in {name for _, name in said}), default=0)
    assert calls <= CALLS
    for size, name in said:
        assert 0.5 * int(size) <= used[name] + calls <= 2.5 * int(size), name


def long_arm(joints: int) -> Model:
    """The Panda's links again and again, one behind the other."""
    panda = arm("panda")
    bodies = [
        replace(panda.bodies[k % panda.n], parent=k - 1, joint=f"joint{k + 1}", link=f"link{k + 1}")
        for k in range(joints)
    ]
    tip = replace(panda.frame(), body=joints - 1)
    return replace(panda, name=f"long{joints}", bodies=tuple(bodies), frames={"tip": tip}, tip="tip", description=None)


@pytest.mark.study
def test_a_long_arm_compiles_in_seconds(tmp_path):
    """Sixty joints, in pieces: clean, the kernels' bits, outputs over inputs, and the stack that the header says."""
    model = long_arm(60)
    header, source, test = write_c(model, ["inverse_dynamics"], tmp_path)
    text = source.read_text()
    assert text.count("static NEVER_INLINED void long60_piece") > 5
    assert not re.search(r"\b(malloc|free|goto|while|for)\b", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL))
    began = os.times().children_user
    used = stack_usage([compiler("gcc"), *BITS, *STRICT], source, tmp_path)
    assert os.times().children_user - began < 30.0  # [s] of the processor, of which it takes a few
    (said,) = map(int, re.findall(r"Stack: about (\d+) bytes", header.read_text()))
    deepest = max(size for name, size in used.items() if "piece" in name)
    assert 0.5 * said <= used["long60_inverse_dynamics"] + deepest <= 1.1 * said
    shared = ("-shared", "-fPIC", source, "-o", tmp_path / "library.so", "-lm")
    build([compiler("clang"), *BITS, *STRICT, *shared])
    function = ctypes.CDLL(str(tmp_path / "library.so")).long60_inverse_dynamics
    expected = aw.compile(model).inverse_dynamics
    for seed in range(5):
        q, qd, qdd = np.random.default_rng(seed).normal(size=(3, 60))
        wanted = expected(q, qd, qdd)
        function(*(ctypes.c_void_p(array.ctypes.data) for array in (q, qd, qdd, q)))
        assert same_bits(q, wanted).all()
    build([compiler("gcc"), *BITS, *STRICT, source, test, "-o", tmp_path / "selftest", "-lm"])
    assert subprocess.run([tmp_path / "selftest"], capture_output=True).returncode == 0


@pytest.mark.study
def test_a_hundred_joints_are_printed():
    """The longest arm that is offered; what waits between the pieces is on the stack, beside copies of the inputs."""
    texts = c_library(long_arm(100), ["inverse_dynamics+wrench"], "float")
    names = re.findall(r"static NEVER_INLINED void (long100_piece\d+_of_inverse_dynamics_wrench)\(", texts["long100.c"])
    called = re.findall(r"^    (long100_piece\d+_of_inverse_dynamics_wrench)\(", texts["long100.c"], re.MULTILINE)
    assert len(names) > 15
    assert called == names
    for copy in ("float copy_of_q[100];", "float copy_of_wrench[6];", "memcpy(copy_of_q, q, sizeof copy_of_q);"):
        assert copy in texts["long100.c"]


@pytest.mark.parametrize(
    ("functions", "frames", "name", "other"),
    [
        (["jacobian:frame=dot_qd"], ["dot_qd"], "panda_jacobian_dot_qd", "jacobian_dot_qd"),
        (["jacobian:frame=a-b", "jacobian:frame=a b"], ["a-b", "a b"], "panda_jacobian_a_b", "jacobian:frame=a-b"),
        (["jacobian:frame=ö"], ["ö"], "panda_jacobian", "jacobian"),
    ],
)
def test_no_name_in_c_is_another_s(functions, frames, name, other):
    panda = arm("panda")
    model = replace(panda, frames={**panda.frames, **dict.fromkeys(frames, panda.frame())})
    with pytest.raises(ModelError) as error:
        c_library(model, functions)
    assert error.value.value == functions[-1]
    assert f"{name}, as that of {other};" in error.value.what


def test_a_form_named_twice_is_written_once():
    texts = c_library(arm("two-link"), ["inverse_dynamics+wrench", "jacobian", "inverse_dynamics+wrench"])
    assert texts["two_link.h"].count("void two_link_inverse_dynamics_wrench(") == 1


def test_the_stack_is_a_whole_number_of_words():
    assert stack(0, "float") == CALLS
    assert stack(1, "float") == CALLS + 8
    assert stack(3, "double") == CALLS + 24


def test_what_a_docstring_says_of_an_array():
    doc = """A law.

    Args:
        model: the arm.   q: (n,) [rad | m].   tau: (n,) [N m | N] motor
            torque, before friction.   u: (n,) [V]
    Returns:
        T: (4, 4) homogeneous; [-] and [m].
        Y: (n, 10n) [N m] per [kg], [kg m].
    """
    assert [described(doc, name) for name in ("q", "tau", "u", "T", "Y", "v")] == [
        "",
        "motor torque, before friction",
        "",
        "homogeneous",
        "",
        "",
    ]


@pytest.mark.study
def test_nothing_is_allocated_and_nothing_recurses(written, objects):
    """Only libm's functions are called from outside, and each function of ours only calls those that stand before it."""
    text = written("sprung")[1].read_text()
    assert set(re.findall(r"#include (\S+)", text)) == {
        '"sprung.h"',
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
        called = set(re.findall(r"\b(sprung_\w+)\(", body))
        assert called <= known, head
        known.add(head)
    assert len(known) > len(offered(arm("sprung")))
    names = subprocess.run([compiler("nm"), "-u", objects("gcc", "sprung")], capture_output=True, text=True)
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


@pytest.mark.study
def test_the_header_tells_of_every_function(written, tmp_path):
    """Equation, shapes, units and the joints' names; it also serves C++."""
    header, _, _ = written("panda")
    text = header.read_text(encoding="ascii")
    assert "#define PANDA_JOINTS 7" in text
    for k, name in enumerate(arm("panda").names):
        assert f"[{k}] {name} (revolute, rad)" in text
    for form in offered(arm("panda")):
        assert re.search(rf"\*/\nvoid panda_{short_name(form)}\(", text)
        equation = (parse_form(form).signature.function.__doc__ or "").splitlines()[0]
        assert plain(equation).rstrip() in text
    assert re.search(
        r"\*   out  tau +\(PANDA_JOINTS\) +\[N m \| N\]\n \* +torques of the motors, each referred to", text
    )
    assert re.search(r"\*   in   wrench  \(6\) +\[N, N m\]\n \* +force and moment .* in base axes\n", text)
    forms = [parse_form(form) for form in offered(arm("panda"))]
    assert text.count("Here wrench = 0.\n") == len([form for form in forms if form.left_out])
    assert "Here frame = 'flange', the arm's tip.\n" in text
    assert "Here frame = 'link7'.\n" in text
    assert "\\x" not in text  # every sign of every equation has a word
    assert "\\u" not in text
    (tmp_path / "user.cpp").write_text('#include "panda.h"\nint main() { return PANDA_JOINTS - 7; }\n')
    flags = ("-Wall", "-Wextra", "-Werror", "-I", header.parent)
    build([compiler("g++"), *flags, tmp_path / "user.cpp", "-o", tmp_path / "user"])


def test_any_name_is_a_name_in_c(tmp_path):
    """Names of arms and joints that would end a comment, begin a trigraph, or are no identifier."""
    record: dict[str, Any] = workshop() | {"name": "3-Achs-Größe"}
    for k, word in enumerate(("*/int_x;/*", "a??/", "größe²", "q\\", "v1")):
        record["joints"][k]["name"] = word
    model = build_model(parse(record, "odd"))
    paths = write_c(model, ["inverse_dynamics"], tmp_path)
    assert [path.name for path in paths] == ["arm_3_Achs_Gr_e.h", "arm_3_Achs_Gr_e.c", "arm_3_Achs_Gr_e_selftest.c"]
    build([compiler("gcc"), *BITS, *STRICT, *paths[1:], "-o", tmp_path / "selftest", "-lm"])
    assert subprocess.run([tmp_path / "selftest"], capture_output=True).returncode == 0


def test_a_name_that_is_too_long_for_a_file_is_refused(tmp_path):
    """Of an arm, or of a controller: the files would be named after it."""
    record: dict[str, Any] = workshop() | {"name": "a" * 300}
    model = build_model(parse(record, "long"))
    with raises_at(ModelError, "name", value="a" * 300):
        write_c(model, ["inverse_dynamics"], tmp_path)
    scenario = pid_loop()
    for export in (aw.export.export_controller, aw.export.export_ros2):
        with raises_at(ModelError, "name", value="b" * 201):
            export(scenario, tmp_path, name="b" * 201)
    assert not list(tmp_path.iterdir())


def test_comments_are_ascii():
    assert plain("Ṁ = ∂M/∂q q̇,  M⁻¹ Jᵀ  [kg m²]  µ") == "Mdot = dM/dq qd,  M^-1 J^T  [kg m^2]  \\xb5"
    assert comment(["a", "", "*/ b"]) == "/*\n * a\n *\n * * / b\n */"


def test_the_text_is_always_the_same():
    assert c_library(arm("panda"), ["jacobian"]) == c_library(arm("panda"), ["jacobian"])


@pytest.mark.parametrize(
    ("functions", "message"),
    [
        (["gravity"], r"^function = 'gravity': .*gravity_torques\?$"),
        (["jacobian", "Jacobian"], "^function = 'Jacobian': .*jacobian"),
        (
            [],
            r"^functions: .*NAME\+INPUT or NAME:OPTION=VALUE.* inverse_dynamics, ",
        ),
        (["jacobian:frame=hand"], "frame = 'hand': .*base, flange, link1"),
        (["motor_voltage"], r"joint1\.motor\.\w+: motor_voltage needs it"),
    ],
)
def test_refusals(tmp_path, functions, message):
    with pytest.raises(ModelError, match=message):
        write_c(arm("panda"), functions, tmp_path / "out")
    assert not list(tmp_path.iterdir())


def test_it_is_written_whole_or_not_at_all(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in (tmp_path / "file" / "sub", tmp_path / "file"):
        with raises_at(OutputError, file=folder) as error:
            write_c(arm("two-link"), ["jacobian"], folder)
    (tmp_path / "out" / "two_link.c").mkdir(parents=True)  # a folder where the C file should go
    with raises_at(OutputError, file=tmp_path / "out" / "two_link.c"):
        write_c(arm("two-link"), ["jacobian"], tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["two_link.c"]
    with pytest.raises(ModelError) as error:
        write_c(arm("two-link"), ["jacobian"], tmp_path / "new", "half")
    assert (error.value.place, error.value.value, error.value.choices) == ("real", "half", ("double", "float"))
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

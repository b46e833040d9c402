"""Arms on a GPU: a fake driver that runs the CUDA text on this processor, NVRTC, and a GPU where there is one."""

from __future__ import annotations

import copy
import importlib.util
import itertools
import pickle
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.kernels import cuda_arrays, cuda_device
from armwright.kernels.cuda import cuda_source
from armwright.kernels.cuda_device import Gpu, cubin, nvrtc_can
from armwright.kernels.signatures import SIGNATURES, trace_kernel
from armwright.model import Model
from kernels.fake_cuda import FakeCuda, fake_cupy, fake_torch
from kernels.harness import same_bits
from physics.arms import arm
from raises_at import raises_at
from reference.chains import chain

NVRTC = all(importlib.util.find_spec(name) is not None for name in ("cuda", "cuda.bindings"))


@pytest.fixture
def gpu(tmp_path, monkeypatch) -> FakeCuda:
    monkeypatch.setenv("ARMWRIGHT_CACHE_DIR", str(tmp_path / "cache"))
    return FakeCuda(tmp_path).install(monkeypatch)


def states(model: Model, *lead: int, rows: int = 3) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(rows, *lead, model.n))


def test_numpy_arrays_go_there_and_come_back(gpu):
    model = arm("puma560")
    dyn, here = aw.compile(model, device="cuda"), aw.compile(model)
    q, qd, qdd = states(model, 5, 40)
    found = dyn.inverse_dynamics(q, qd[0, 0], qdd)
    assert found.shape == (5, 40, 6)
    assert type(found) is np.ndarray
    assert np.array_equal(found, here.inverse_dynamics(q, qd[0, 0], qdd))
    assert np.array_equal(
        dyn.inverse_dynamics(q, qd[:1], qdd[0, 0].tolist()), here.inverse_dynamics(q, qd[:1], qdd[0, 0])
    )
    gpu.backwards = True
    assert np.array_equal(
        dyn.inverse_dynamics(q[0, 0], qd[0, 0], qdd[0, 0]), here.inverse_dynamics(q[0, 0], qd[0, 0], qdd[0, 0])
    )
    assert gpu.launches == [("inverse_dynamics", 2, 128, 0)] * 2 + [("inverse_dynamics", 1, 128, 0)]
    assert not gpu.memory  # all given back
    assert gpu.compiled == ["sm_90"]
    assert repr(dyn) == "<compiled puma560 for cuda:0, compute capability 9.0, in float64>"


def test_optional_inputs_options_and_derivatives(gpu):
    model = arm("puma560")
    dyn, here = aw.compile(model, device="cuda"), aw.compile(model)
    q, qd, qdd = states(model, 33)
    wrench = np.random.default_rng(1).normal(size=(33, 6))
    assert np.array_equal(dyn.inverse_dynamics(q, qd, qdd, wrench), here.inverse_dynamics(q, qd, qdd, wrench=wrench))
    assert np.array_equal(dyn.jacobian(q, frame="link3"), here.jacobian(q, frame="link3"))
    slopes, expected = (each.derivative("gravity_torques", "q")(q) for each in (dyn, here))
    assert all(same_bits(a, b).all() for a, b in zip(slopes, expected, strict=True))
    energies = dyn.energy(q, qd)
    assert [each.shape for each in energies] == [(33,), (33,)]
    assert all(np.array_equal(a, b) for a, b in zip(energies, here.energy(q, qd), strict=True))
    assert dyn.mass_matrix(np.zeros((0, 6))).shape == (0, 6, 6)


def test_parameters_left_open(gpu):
    model, vary = arm("two-link"), ["forearm.mass_kg"]
    dyn, here = aw.compile(model, vary=vary, device="cuda"), aw.compile(model, vary=vary)
    q, masses = states(model, 50, rows=1)[0], np.linspace(1.0, 2.0, 50)[:, None]
    assert np.array_equal(dyn.gravity_torques(q, masses), here.gravity_torques(q, masses))
    with pytest.raises(ModelError, match="mass_kg"):
        dyn.gravity_torques(q, -masses)


def test_single_precision(gpu):
    model = arm("puma560")
    dyn, here = aw.compile(model, dtype="float32", device="cuda"), aw.compile(model, dtype="float32")
    q, qd, qdd = states(model, 50)
    found = dyn.inverse_dynamics(q, qd, qdd)
    assert found.dtype == np.float32
    assert np.array_equal(found, here.inverse_dynamics(q, qd, qdd))


def test_cupy_arrays(gpu, monkeypatch):
    """Results are CuPy's, the stream is its current one, nothing is copied; NumPy's arrays beside them are."""
    cupy = fake_cupy(gpu)
    monkeypatch.setitem(sys.modules, "cupy", cupy)
    model = arm("puma560")
    dyn, here = aw.compile(model, device="cuda"), aw.compile(model)
    q, qd, qdd = states(model, 300)
    found = dyn.inverse_dynamics(cupy.asarray(q), cupy.asarray(qd), qdd[0])
    assert type(found).__module__ == "cupy"
    assert np.array_equal(found, here.inverse_dynamics(q, qd, qdd[0]))
    assert gpu.launches == [("inverse_dynamics", 3, 128, 7)]
    assert not gpu.memory
    assert np.array_equal(
        dyn.bias_torques(cupy.asarray(q[:, None]), cupy.asarray(qd[:4])), here.bias_torques(q[:, None], qd[:4])
    )
    with pytest.raises(ShapeError, match="complex"):
        dyn.gravity_torques(cupy.asarray(q + 0j))
    with raises_at(ShapeError, "gravity_torques: q", r"\(300, 5\).*\(…, 6\)"):
        dyn.gravity_torques(cupy.asarray(q[:, :5]))


def test_torch_tensors(gpu, monkeypatch):
    torch = fake_torch(gpu)
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setitem(sys.modules, "cupy", cupy := fake_cupy(gpu))
    model = arm("puma560")
    dyn, here = aw.compile(model, device="cuda"), aw.compile(model)
    q, qd, qdd = states(model, 300)
    found = dyn.inverse_dynamics(torch.Tensor(q), torch.Tensor(qd), torch.Tensor(qdd[0]))
    assert isinstance(found, torch.Tensor)
    assert np.array_equal(found.array, here.inverse_dynamics(q, qd, qdd[0]))
    assert gpu.launches == [("inverse_dynamics", 3, 128, 9)]
    with raises_at(ShapeError, "gravity_torques: q", r"gradient.*tensor\.detach"):
        dyn.gravity_torques(torch.Tensor(q, requires_grad=True))
    with raises_at(ModelError, "gravity_torques", "on cuda:0"):
        dyn.gravity_torques(torch.Tensor(q, "cpu"))
    with raises_at(ModelError, "bias_torques", "CuPy and PyTorch"):
        dyn.bias_torques(torch.Tensor(q), cupy.asarray(qd))


@pytest.mark.study
def test_jax_arrays(gpu, monkeypatch):
    """JAX's own arrays, in the memory of this processor."""
    jax = pytest.importorskip("jax")
    monkeypatch.setattr(cuda_arrays, "ON_A_GPU", 1)
    monkeypatch.setattr(gpu, "_room", lambda address: 1)  # XLA does not tell which memory is its own
    model = arm("puma560")
    dyn, here = aw.compile(model, device="cuda"), aw.compile(model)
    q, qd, qdd = states(model, 300)
    with pytest.raises(ShapeError, match="jax_enable_x64"), jax.enable_x64(False):
        dyn.gravity_torques(jax.numpy.asarray(q))
    with jax.enable_x64(True):
        first = dyn.inverse_dynamics(jax.numpy.asarray(q), jax.numpy.asarray(qd), qdd[0])
        second = dyn.inverse_dynamics(jax.numpy.asarray(qd), jax.numpy.asarray(q), qdd[0])
        assert isinstance(first, jax.Array)
        assert np.array_equal(first, here.inverse_dynamics(q, qd, qdd[0]))
        assert np.array_equal(second, here.inverse_dynamics(qd, q, qdd[0]))
        with raises_at(ShapeError, "gravity_torques: q", "traced"):
            jax.jit(dyn.gravity_torques)(jax.numpy.asarray(q))


def test_arrays_that_only_say_where_they_are(gpu):
    """Our own, and another library's, such as Numba's."""
    model = arm("puma560")
    dyn, here = aw.compile(model, device="cuda"), aw.compile(model)
    device, (q, qd, _) = Gpu(), states(model, 40)
    ours = device.put(q)
    found = dyn.bias_torques(ours, qd[0])
    assert isinstance(found, cuda_device.DeviceArray)
    assert np.array_equal(found.numpy(), here.bias_torques(q, qd[0]))
    theirs = SimpleNamespace(__cuda_array_interface__=ours.__cuda_array_interface__ | {"strides": (48, 8)})
    assert np.array_equal(dyn.gravity_torques(theirs).numpy(), here.gravity_torques(q))
    reversed_ = SimpleNamespace(__cuda_array_interface__=ours.__cuda_array_interface__ | {"strides": (-48, 8)})
    with raises_at(ShapeError, "gravity_torques: q", r"\(40, 6\).*rows of float64"):
        dyn.gravity_torques(reversed_)
    with raises_at(ShapeError, "gravity_torques: q", "<f4.*rows of float64"):
        dyn.gravity_torques(device.put(q.astype("f")))
    with raises_at(ShapeError, "bias_torques: q", r"\(40, 1, 6\).*float64 \(40, 4, 6\)"):
        dyn.bias_torques(device.put(q[:, None]), device.put(qd[:4]))
    del found, ours, theirs, reversed_
    assert not gpu.memory


def test_compiled_kernels_are_kept(gpu):
    model = arm("two-link")
    first = aw.compile(model, device="cuda").gravity_torques(np.ones(2))
    again = aw.compile(model, device="cuda").gravity_torques(np.ones(2))
    assert gpu.compiled == ["sm_90"]
    assert np.array_equal(first, again)
    gpu.CAPABILITY = (8, 6)
    aw.compile(model, device="cuda").gravity_torques(np.ones(2))
    assert gpu.compiled == ["sm_90", "sm_80"]  # which an 8.6 runs, too
    gpu.CAPABILITY = (7, 5)
    with raises_at(ModelError, "device", r"NVRTC 13\.0 .* 7\.5, .* 8\.0, 9\.0"):
        aw.compile(model, device="cuda").gravity_torques(np.ones(2))


def test_copies_and_pickles_compile_anew(gpu):
    dyn = aw.compile(arm("two-link"), vary=["forearm.mass_kg"], dtype="float32", device="cuda:0")
    for other in (copy.copy(dyn), pickle.loads(pickle.dumps(dyn))):
        assert repr(other) == repr(dyn)
        assert other.gravity_torques(np.ones(2), [1.0]).dtype == np.float32


def test_what_a_gpu_does_not_have_is_refused(gpu):
    model = arm("two-link")
    with raises_at(ModelError, "target of device 'cuda'", value="x86-64-v3"):
        aw.compile(model, "x86-64-v3", device="cuda")
    dyn = aw.compile(model, device="cuda")
    with raises_at(ModelError, "gravity_torques: out"):
        dyn.gravity_torques(np.ones(2), out=np.ones(2))
    with raises_at(ModelError, "gravity_torques: bind"):
        dyn.bind("gravity_torques")
    gpu.room = 100
    with raises_at(ModelError, "device", "cuMemAlloc"):
        dyn.gravity_torques(np.ones((20, 2)))
    for device in ("gpu", "cuda:", "cuda:x", 0):
        with raises_at(ModelError, "device", '"cpu", "cuda"', value=device):
            aw.compile(model, device=device)
    with raises_at(ModelError, "device", "there are 1", value="cuda:3"):
        aw.compile(model, device="cuda:3")


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ("bindings", r'cuda-bindings, .* install "armwright\[cuda\]"'),
        ("driver", r"\(libcuda\) .*NVIDIA GPU"),
        ("device", "no CUDA-capable device.*NVIDIA GPU"),
    ],
)
def test_without_a_gpu_it_says_what_to_get(tmp_path, monkeypatch, missing, message):
    fake = FakeCuda(tmp_path, 0).install(monkeypatch)

    def no_library(flags: int) -> tuple:
        raise RuntimeError('"cuda" is an NVIDIA driver library and can only be found via system search.')

    if missing == "bindings":
        monkeypatch.setitem(sys.modules, "cuda.bindings.driver", None)
    elif missing == "driver":
        monkeypatch.setattr(sys.modules["cuda.bindings.driver"], "cuInit", no_library)
    with pytest.raises(ModelError, match=f"device = 'cuda': .*{message}"):
        aw.compile(arm("two-link"), device="cuda")
    assert not fake.launches


def test_without_nvrtc_it_says_what_to_get(gpu, monkeypatch):
    def no_library() -> tuple:
        raise RuntimeError('Failure finding "libnvrtc.so.13"')

    monkeypatch.setattr(sys.modules["cuda.bindings.nvrtc"], "nvrtcVersion", no_library)
    with raises_at(ModelError, "device", r'NVRTC.*pip install "armwright\[cuda\]"'):
        aw.compile(arm("two-link"), device="cuda").gravity_torques(np.ones(2))


# --- with NVRTC, which needs no GPU ---------------------------------------------------------------------------------------

ARCHITECTURES = ("sm_80", "sm_90", "sm_100")
IN_REGISTERS = ("inverse_dynamics", "forward_dynamics", "mass_matrix", "forward_kinematics")
OPEN, CHAIN = "puma560 with open parameters", "chain of 12 joints"
VARIED = ("link3.mass_kg", "link4.com_m", "waist.motor.rotor_inertia_kg_m2")


def _programs(name: str) -> list:
    """Every kernel that an arm has."""
    model = {OPEN: lambda: arm("puma560"), CHAIN: lambda: chain(12)}.get(name, lambda: arm(name))()
    varied = aw.compile(model, vary=VARIED).varied if name == OPEN else None
    has_motors = all(body.drive.resistance is not None for body in model.coordinates)
    signatures = [each for each in SIGNATURES.values() if has_motors or not each.name.startswith("motor")]
    return [trace_kernel(model, each, varied=varied) for each in signatures]


@pytest.mark.study
@pytest.mark.skipif(not NVRTC, reason="the extra `cuda` is not installed")
@pytest.mark.parametrize(
    ("name", "architecture"), [*itertools.product(["puma560", "panda", OPEN], ARCHITECTURES), (CHAIN, "sm_90")]
)
def test_nvrtc_compiles_every_kernel(name, architecture, record_property):
    _, known = nvrtc_can()
    if int(architecture.removeprefix("sm_")) not in known:
        pytest.skip(f"this NVRTC has no {architecture}")
    for program in _programs(name):
        code, log = cubin(cuda_source(program), architecture, "--ptxas-options=-v")
        assert code.startswith(b"\x7fELF")
        registers = max(map(int, re.findall(r"Used (\d+) registers", log)))
        spilled = sum(map(int, re.findall(r"(\d+) bytes spill stores", log)))
        record_property(f"{name} {program.name} {architecture}", f"{registers} registers, {spilled} bytes spilled")
        print(f"{name:24} {program.name:30} {architecture}: {registers} registers, {spilled} bytes spilled")
        assert spilled == 0 or name == CHAIN or program.name not in IN_REGISTERS, program.name


@pytest.mark.study
@pytest.mark.skipif(not NVRTC, reason="the extra `cuda` is not installed")
def test_nvrtc_fuses_nothing_by_itself():
    """A product and a sum that the program has apart stay apart: in the machine code, DMUL and DADD."""
    with pytest.raises(ModelError, match=r"NVRTC: .*--gpu-architecture"):
        cubin("", "sm_5")
    text = 'extern "C" __global__ void f(double *x) { x[0] = x[0] * x[1] + x[2]; }'
    fused, separate = (b"fma.rn" in _ptx(text, option) for option in ("--fmad=true", "--fmad=false"))
    assert fused
    assert not separate


def _ptx(text: str, option: str) -> bytes:
    from cuda.bindings import nvrtc

    _, program = nvrtc.nvrtcCreateProgram(text.encode(), b"f.cu", 0, [], [])
    nvrtc.nvrtcCompileProgram(program, 2, [option.encode(), b"--gpu-architecture=compute_90"])
    _, size = nvrtc.nvrtcGetPTXSize(program)
    ptx = bytearray(size)
    nvrtc.nvrtcGetPTX(program, ptx)
    return bytes(ptx)


# --- on a GPU -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def real_gpu() -> Gpu:
    try:
        return Gpu()
    except ModelError as error:
        pytest.skip(f"no GPU: {error}")


@pytest.mark.study
@pytest.mark.parametrize("name", ["puma560", "panda"])
def test_on_a_gpu_the_bits_are_the_cpu_s(real_gpu, name):
    """Every kernel, where nothing needs libm."""
    model = arm(name)
    dyn, here = aw.compile(model, device="cuda"), aw.compile(model)
    for program in _programs(name):
        inputs = [np.random.default_rng(k).normal(size=(10_001, *port.shape)) for k, port in enumerate(program.inputs)]
        found, expected = (getattr(each, program.name)(*inputs) for each in (dyn, here))
        pairs = zip(*(each if isinstance(each, tuple) else (each,) for each in (found, expected)), strict=True)
        assert all(np.array_equal(a, b) for a, b in pairs), program.name


@pytest.mark.study
@pytest.mark.parametrize("name", ["cupy", "torch", "jax"])
def test_on_a_gpu_with_the_arrays_of(real_gpu, name):
    library = pytest.importorskip(name)
    model = arm("puma560")
    q, qd, qdd = states(model, 1001)
    if name == "jax":
        library.config.update("jax_enable_x64", True)
        if library.default_backend() != "gpu":
            pytest.skip("this JAX has no GPU")
    put = {
        "cupy": lambda x: library.asarray(x),
        "torch": lambda x: library.as_tensor(x, device="cuda"),
        "jax": lambda x: library.numpy.asarray(x),
    }[name]
    found = aw.compile(model, device="cuda").inverse_dynamics(put(q), put(qd), put(qdd[0]))
    assert type(found) is type(put(q))
    back = {"cupy": lambda x: x.get(), "torch": lambda x: x.cpu().numpy(), "jax": np.asarray}[name](found)
    assert np.array_equal(back, aw.compile(model).inverse_dynamics(q, qd, qdd[0]))

"""Kernels in JAX and PyTorch: the bits of NumPy's calls, and derivatives that finite differences confirm."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ModelError, ShapeError
from armwright.kernels.signatures import SIGNATURES
from docs.pages import blocks, comparable, python
from interop.packages import PACKAGES
from raises_at import raises_at

# PyTorch's own, in jacfwd
pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.script.*is deprecated:FutureWarning")
STEP = 1e-6
FORMS = {  # kernel, optional inputs, options
    "inverse dynamics": ("inverse_dynamics", ("wrench",), {}),
    "forward dynamics": ("forward_dynamics", (), {}),
    "forward kinematics": ("forward_kinematics", (), {"frame": "link3"}),
    "mass matrix": ("mass_matrix", (), {}),
    "energy": ("energy", (), {}),  # scalars, and several
    "voltages": ("forward_arm", (), {}),
}


@pytest.fixture(scope="module", params=PACKAGES)
def package(request):
    return PACKAGES[request.param]()


@pytest.fixture(scope="module")
def dyn():
    return aw.compile(aw.load("puma560"))


def inputs_of(dyn, name, optional=(), lead=(), seed=0):
    rng = np.random.default_rng(seed)
    ports = dyn.kernel(name, *optional).program.inputs
    return [rng.normal(scale=0.5, size=(*lead, *port.shape)) for port in ports]


def as_list(found):
    return list(found) if isinstance(found, tuple) else [found]


def differences(call, arrays, place):
    """Central differences of every output by one input, (*shape of y, *shape of b)."""
    columns = []
    for entry in np.ndindex(arrays[place].shape):
        moved = [[array.copy() for array in arrays] for _ in range(2)]
        for side, sign in zip(moved, (1.0, -1.0), strict=True):
            side[place][entry] += sign * STEP
        above, below = (as_list(call(*side)) for side in moved)
        columns.append([(a - b) / (2.0 * STEP) for a, b in zip(above, below, strict=True)])
    outputs = zip(*columns, strict=True)
    return [np.stack(each, axis=-1).reshape(*np.shape(each[0]), *arrays[place].shape) for each in outputs]


@pytest.mark.study
@pytest.mark.parametrize("name", SIGNATURES)
def test_every_kernel_has_the_bits_of_numpy(package, dyn, name):
    arrays = inputs_of(dyn, name, lead=(3,))
    function, vmap = package.function(dyn, name), package.transforms()[2]
    tensors = [package.array(each) for each in arrays]
    expected = as_list(dyn.kernel(name)(*arrays))
    one = as_list(dyn.kernel(name)(*(each[0] for each in arrays)))
    for found, wanted in (
        (function(*tensors), expected),
        (vmap(function)(*tensors), expected),
        (function(*(each[0] for each in tensors)), one),
    ):
        for ours, theirs in zip(as_list(found), wanted, strict=True):
            np.testing.assert_array_equal(np.asarray(ours), theirs)


@pytest.mark.study
@pytest.mark.parametrize("form", FORMS)
def test_derivatives_are_those_of_finite_differences(package, dyn, form):
    name, optional, options = FORMS[form]
    arrays = inputs_of(dyn, name, optional)
    function = package.function(dyn, name, *optional, **options)
    tensors = [package.array(each) for each in arrays]
    jacfwd, jacrev, *_ = package.transforms()
    kernel = dyn.kernel(name, *optional, **options)
    for place in range(len(arrays)):
        expected = differences(kernel, arrays, place)
        for transform in (jacfwd, jacrev):
            found = as_list(transform(function, place)(*tensors))
            for ours, theirs in zip(found, expected, strict=True):
                np.testing.assert_allclose(
                    np.asarray(ours), theirs, rtol=1e-6, atol=1e-6 * (1.0 + np.abs(theirs).max())
                )


@pytest.mark.study
def test_second_derivatives_and_batches_of_them(package, dyn):
    arm = aw.compile(aw.load("two-link"))
    function = package.function(arm, "forward_dynamics")
    arrays = inputs_of(arm, "forward_dynamics", lead=(4,), seed=2)
    _, jacrev, vmap, hessian = package.transforms()

    def cost(q, qd, tau):
        return (function(q, qd, tau) ** 2).sum()

    found = np.asarray(vmap(hessian(cost))(*map(package.array, arrays)))
    slope = jacrev(cost)
    for row in range(4):
        state = [each[row] for each in arrays]
        (expected,) = differences(lambda *given: np.asarray(slope(*map(package.array, given))), state, 0)
        np.testing.assert_allclose(found[row], expected, rtol=1e-5, atol=1e-5 * np.abs(expected).max())


@pytest.mark.study
def test_leading_axes_broadcast_and_their_gradients_add_up(package, dyn):
    """One q for a batch of speeds, inside and outside of vmap; nested vmap."""
    (q,), (qd, qdd) = inputs_of(dyn, "gravity_torques"), inputs_of(dyn, "inverse_dynamics", lead=(2, 3))[1:]
    function = package.function(dyn, "inverse_dynamics")
    _, jacrev, vmap, _ = package.transforms()
    expected = dyn.inverse_dynamics(q, qd, qdd)
    tensors = [package.array(each) for each in (q, qd, qdd)]
    np.testing.assert_array_equal(np.asarray(function(*tensors)), expected)
    np.testing.assert_array_equal(np.asarray(vmap(function, (None, 0, 0))(*tensors)), expected)
    np.testing.assert_array_equal(np.asarray(vmap(vmap(function, (None, 0, 0)), (None, 0, 0))(*tensors)), expected)
    gradient = np.asarray(jacrev(lambda *given: function(*given).sum())(*tensors))
    slopes = dyn.inverse_dynamics_derivatives(q, qd, qdd)[0]
    np.testing.assert_allclose(gradient, slopes.sum(axis=(0, 1, 2)), rtol=1e-12, atol=1e-12)


@pytest.mark.study
def test_parameters_of_the_record_have_gradients(package):
    varying = aw.compile(aw.load("two-link"), vary=["forearm.mass_kg"])
    function = package.function(varying, "gravity_torques")
    q, mass = np.array([0.3, -0.4]), np.array([4.5])
    _, jacrev, *_ = package.transforms()
    found = np.asarray(jacrev(function, 1)(package.array(q), package.array(mass)))
    (expected,) = differences(varying.gravity_torques, [q, mass], 1)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-8)


@pytest.mark.study
def test_wrong_calls_are_ours(package, dyn):
    function = package.function(dyn, "inverse_dynamics")
    q, wrong = package.array(np.zeros(6)), package.array(np.zeros(5))
    with raises_at(ShapeError, "inverse_dynamics: qd", r"\(5,\).*\(…, 6\)"):
        function(q, wrong, q)
    with raises_at(ShapeError, "inverse_dynamics", "2 arrays.*3: q, qd, qdd"):
        function(q, q)
    with raises_at(ShapeError, "inverse_dynamics", "broadcast"):
        function(*(package.array(np.zeros((count, 6))) for count in (2, 3, 2)))
    with raises_at(ModelError, "dyn"):
        package.function(dyn.arm, "inverse_dynamics")
    with pytest.raises(ShapeError, match="inverse_dynamics"):
        package.function(dyn, "inverse_dynamic")


@pytest.mark.study
def test_jax_in_its_usual_single_precision():
    jax = PACKAGES["jax"]().jax
    dyn = aw.compile(aw.load("two-link"))
    q = np.array([0.3, -0.4])
    jax.config.update("jax_enable_x64", False)
    try:
        found = jax.jit(aw.interop.jax(dyn, "gravity_torques"))(q)
        slope = jax.jacrev(aw.interop.jax(dyn, "gravity_torques"))(q)
    finally:
        jax.config.update("jax_enable_x64", True)
    assert found.dtype == slope.dtype == np.float32
    given = q.astype(np.float32).astype(float)
    np.testing.assert_array_equal(np.asarray(found), dyn.gravity_torques(given).astype(np.float32))


@pytest.mark.study
def test_torch_trains_through_a_kernel():
    torch = PACKAGES["torch"]().torch
    dyn = aw.compile(aw.load("two-link"))
    q = torch.tensor([0.3, -0.4], dtype=torch.float64, requires_grad=True)
    function = aw.interop.torch(dyn, "gravity_torques")
    function(q).square().sum().backward()
    g = dyn.gravity_torques(q.detach().numpy())
    (slope,) = differences(dyn.gravity_torques, [q.detach().numpy()], 0)
    np.testing.assert_allclose(q.grad.numpy(), 2.0 * g @ slope, rtol=1e-7)
    assert torch.autograd.gradcheck(function, (q,))
    assert torch.autograd.gradgradcheck(function, (q,))


@pytest.mark.study
def test_the_page_prints_what_it_shows(tmp_path):
    PACKAGES["jax"]()
    found = blocks("docs/how-to/jax-and-torch.md")
    first, then = (text for kind, text in found if kind == "python")
    shown, more = (text for kind, text in found if kind == "text")
    assert comparable(python(first, tmp_path).splitlines()) == comparable(shown.splitlines())
    pytest.importorskip("torch")
    assert comparable(python(f"{first}\n{then}", tmp_path).splitlines()) == comparable((shown + more).splitlines())


@pytest.mark.parametrize("name", PACKAGES)
def test_without_the_package_one_line_says_what_to_install(name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    with raises_at(ModelError, f"aw.interop.{name}", f"pip install {name}"):
        getattr(aw.interop, name)(aw.compile(aw.load("two-link")), "gravity_torques")


def test_nothing_is_imported_before_it_is_used():
    text = "import sys, armwright as aw; aw.interop.jax, aw.interop.torch; print({'jax', 'torch'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"

"""Input shapers: the impulses of the literature, and an elastic joint that stands still after the motion."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.errors import ScenarioError
from simulation.plants import pendulum

MOVE = aw.trajectories.Quintic([0.0], [0.5], 0.25)


def vibration(shaper, w, damping):
    """Residual vibration of a mode after the impulses, as a share of that after one impulse."""
    amplitudes, times = shaper.impulses
    phasors = amplitudes * np.exp((damping + 1j * np.sqrt(1.0 - damping**2)) * w * times)
    return np.abs(phasors.sum()) * np.exp(-damping * w * times[-1])


@pytest.mark.parametrize("damping", [0.0, 0.05, 0.4])
def test_the_residual_vibration_is_zero_and_zvd_forgives_a_wrong_frequency(damping):
    w = 2.0 * np.pi * 3.0
    zv, zvd = (aw.trajectories.InputShaper(MOVE, 3.0, damping, kind) for kind in ("zv", "zvd"))
    for each in (zv, zvd):
        assert vibration(each, w, damping) < 1e-12
        assert each.impulses[0].sum() == pytest.approx(1.0)
    slopes = [(vibration(each, 1.001 * w, damping) - vibration(each, w, damping)) / 0.001 for each in (zv, zvd)]
    assert slopes[0] > 0.1  # of first order
    assert slopes[1] < 0.02 * slopes[0]
    if damping == 0.0:  # |cos(π/2 · ω/ω0)|, and its square
        away = vibration(zv, 1.2 * w, 0.0)
        assert away == pytest.approx(abs(np.cos(0.6 * np.pi)))
        assert vibration(zvd, 1.2 * w, 0.0) == pytest.approx(away**2)


@pytest.mark.parametrize("kind", ["zv", "zvd"])
def test_it_is_a_convolution_that_ends_where_the_motion_ends(kind):
    shaper = aw.trajectories.InputShaper(MOVE, 3.0, 0.1, kind)
    amplitudes, times = shaper.impulses
    t = np.linspace(-0.1, 1.0, 60)
    q, qd, qdd = shaper.at(t)
    np.testing.assert_allclose(q, sum(a * MOVE.at(t - late)[0] for a, late in zip(amplitudes, times, strict=True)))
    for given, expected in zip(shaper.at(shaper.time + shaper.duration), ([0.5], [0.0], [0.0]), strict=True):
        np.testing.assert_allclose(given, expected, atol=1e-12)
    np.testing.assert_allclose([np.concatenate(shaper(each)) for each in t], np.hstack([q, qd, qdd]), atol=1e-12)
    assert shaper.breaks[0] == 0.0
    assert shaper.breaks[-1] == pytest.approx(shaper.duration)


STIFFNESS, DAMPING, INERTIA, ROTOR = 120.0, 0.4, 0.1 + 3.0 * 0.3**2, 2e-4 * 50.0**2
KP, KD = 4000.0, 120.0


def mode():
    """Natural frequency [1/s] and damping of the slow pole pair of link and servo."""
    k, d = STIFFNESS, DAMPING
    stiffness, damping = np.array([[k + KP, -k], [-k, k]]), np.array([[d + KD, -d], [-d, d]])
    inverse = np.diag([1.0 / ROTOR, 1.0 / INERTIA])
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ stiffness, -inverse @ damping]])
    poles = np.linalg.eigvals(a)
    slow = poles[(poles.imag > 0.0)]
    slow = slow[np.argmin(np.abs(slow))]
    return abs(slow) / (2.0 * np.pi), -slow.real / abs(slow)


def residual(motion):
    """Largest swing of the link after the motion has ended."""
    motor = {"gear_ratio": 50.0, "rotor_inertia_kg_m2": 2e-4}
    soft = {"stiffness_n_m_per_rad": STIFFNESS, "damping_n_m_s_per_rad": DAMPING}
    model = pendulum("torque", gravity=0.0, motor=motor, elasticity=soft)
    loop = aw.Loop(aw.JointPID(kp=KP, kd=KD), motion, 5e-4)
    run = aw.simulate(aw.Scenario(model, duration=1.5, loop=loop))
    late = run.time.values > motion.duration + 0.05  # the servo itself has settled
    return np.abs(run.q.values[late] - 0.5).max()


def test_an_elastic_joint_stands_still_after_a_shaped_motion():
    hz, damping = mode()
    plain = residual(MOVE)
    assert plain > 0.01
    assert residual(aw.trajectories.InputShaper(MOVE, hz, damping)) < 0.01 * plain
    assert residual(aw.trajectories.InputShaper(MOVE, hz, damping, "zvd")) < 0.01 * plain
    off = [residual(aw.trajectories.InputShaper(MOVE, 1.1 * hz, damping, kind)) for kind in ("zv", "zvd")]
    assert off[1] < 0.3 * off[0] < 0.1 * plain


def test_a_loop_follows_a_shaped_motion_compiled_and_from_a_file(tmp_path):
    path = tmp_path / "a.scenario.toml"
    path.write_text(
        'robot = "two-link"\nduration_s = 0.05\n[loop]\nperiod_s = 0.001\n'
        'controller = { kind = "joint_pid", kp = 30.0, kd = 6.0 }\n'
        '[loop.reference]\nkind = "input_shaper"\nhz = 30.0\ndamping = 0.1\n'
        'reference = { kind = "quintic", start = [0, 0], goal = [0.1, 0.1], duration = 0.02 }\n'
    )
    run = aw.simulate(aw.read_scenario(path))
    motion = aw.trajectories.InputShaper(aw.trajectories.Quintic([0, 0], [0.1, 0.1], 0.02), 30.0, 0.1)
    np.testing.assert_allclose(run.q_reference.values, motion.at(run.time.values)[0], atol=1e-12)
    text = path.read_text()
    for old, new, said in (
        ('"quintic"', '"nonsense"', r"loop\.reference\.reference\.kind = 'nonsense': unknown"),
        ("hz = 30.0", "hz = -1.0", r"loop\.reference\.hz = -1\.0"),
        ("hz = 30.0\n", "", "input_shaper needs hz"),
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(ScenarioError, match=said):
            aw.read_scenario(path)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"reference": [0.0]}, r"InputShaper\.reference"),
        ({"damping": 1.0}, r"InputShaper\.damping = 1\.0: .* below 1"),
        ({"kind": "ei"}, r"InputShaper\.kind = 'ei'"),
        ({"hz": aw.Batch([1.0, 2.0])}, r"InputShaper\.hz"),
    ],
)
def test_bad_fields_are_refused(fields, said):
    with pytest.raises(ScenarioError, match=said):
        aw.trajectories.InputShaper(**{"reference": MOVE, "hz": 3.0, **fields})

"""identify_arm with its own choice of filters has errors of its own standard deviations, for arms and motions of every kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import armwright as aw
from armwright.identification.arm.options import FitRows
from identification.arm.moved_arm import moved, multisine, written_log

AXES = ("0 0 1", "0 1 0", "1 0 0")
MOTIONS = {  # seconds, rows in a second, highest harmonic of the motion, its size [rad], noise of the encoders [rad]
    "slow rows": (8.0, 100.0, 5, 1.1, 0.0),
    "fast motion": (8.0, 250.0, 20, 0.8, 0.0),
    "long log": (20.0, 250.0, 20, 0.9, 0.0),
    "noisy encoders": (8.0, 250.0, 20, 1.2, 1e-5),
}


def random_arm(folder: Path, seed: int) -> aw.Arm:
    """Two or three links of random axes, places, masses and friction."""
    rng = np.random.default_rng(seed)
    text = ['<robot name="random"><link name="base"/>']
    for k in range(1, rng.integers(2, 4) + 1):
        mass, centre, place = rng.uniform(1, 8), rng.uniform(-0.3, 0.3, 3), rng.uniform(-0.4, 0.4, 3)
        moment = mass * rng.uniform(0.01, 0.05)
        moments = " ".join(
            f'i{each}="{moment if each[0] == each[1] else 0.0}"' for each in ["xx", "xy", "xz", "yy", "yz", "zz"]
        )
        text.append(
            f'<link name="link{k}"><inertial><origin xyz="{" ".join(map(str, centre))}"/><mass value="{mass}"/>'
            f'<inertia {moments}/></inertial></link><joint name="joint{k}" type="continuous">'
            f'<parent link="{f"link{k - 1}" if k > 1 else "base"}"/><child link="link{k}"/>'
            f'<origin xyz="{" ".join(map(str, place))}"/><axis xyz="{AXES[rng.integers(3)]}"/>'
            f'<dynamics damping="{rng.uniform(0.5, 3)}" friction="{rng.uniform(0.5, 3)}"/></joint>'
        )
    path = folder / "random.urdf"
    path.write_text("\n".join([*text, "</robot>"]))
    return aw.load(path)


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", MOTIONS)
def test_errors_are_those_of_the_stated_deviations(tmp_path, kind):
    seconds, rate, harmonics, size, noise = MOTIONS[kind]
    seed = 3 + 2 * list(MOTIONS).index(kind)
    arm = random_arm(tmp_path, seed)
    motion = {"seconds": seconds, "rate": rate, "harmonics": harmonics, "size": size, "seed": seed}
    log = moved(tmp_path, "moved", arm, **motion, torque_noise=0.02, position_noise=noise)
    found = aw.identification.identify_arm(log, arm, record=False, checks=())
    truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
    z = (found.fit.values - truth) / found.fit.std
    assert np.sqrt(np.mean(z**2)) < 1.7
    assert found.fit.r2.min() > 0.999


def test_a_motion_as_fast_as_its_low_pass_leaves_no_bias(tmp_path):
    """Lines just below the cut-off, made smaller by a twentieth there, and products of them above it."""
    arm = random_arm(tmp_path, 1)
    log = moved(tmp_path, "fast", arm, seconds=8.0, rate=250.0, harmonics=20, torque_noise=0.02, seed=1)
    found = aw.identification.identify_arm(log, arm, rows=FitRows(cutoff=2.8, decimate=20), record=False, checks=())
    truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
    assert (np.abs(found.fit.values - truth) < 0.02 * np.maximum(np.abs(truth), 1.0)).all()


def test_signs_of_a_joint_at_rest_are_no_direction(tmp_path):
    """Joints that stand for two thirds of a log; their speeds there are rounding, which has a sign."""
    arm = random_arm(tmp_path, 1)
    t, q, qd, qdd = multisine(arm.n, 8.0, 250.0, 1, 0.5, 10)
    stop = np.clip((t - 6.0) / 0.8, 0, 1)  # from 6 to 6.8 s slower and slower
    share = 1 - stop**3 * (10 - 15 * stop + 6 * stop**2)
    when = np.concatenate([np.cumsum(share) / 250.0, np.full(3000, np.sum(share) / 250.0)])
    t = np.arange(len(when)) / 250.0
    moves = CubicSpline(t, np.stack([np.interp(when, np.arange(2000) / 250.0, each) for each in q.T], axis=1))
    q, qd, qdd = (moves(t, order) for order in range(3))
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    del qd, qdd
    log = written_log(tmp_path, "stops", arm.names, t, q, tau)
    found = aw.identification.identify_arm(log, arm, record=False, checks=())
    truth = found.fit.base.of(np.nan_to_num(found.fit.equations.model.prior))
    coulomb = [k for k, name in enumerate(found.fit.base.names) if name.startswith("fc")]
    np.testing.assert_allclose(found.fit.values[coulomb], truth[coulomb], rtol=0.05)

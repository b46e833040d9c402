"""Dynamics, kinematics, and what models say of themselves."""

from __future__ import annotations

import numpy as np

import armwright as aw

RNG = np.random.default_rng(7)
Q6 = RNG.uniform(-1.5, 1.5, (5, 6))

CASES = {
    "manipulability": lambda _: aw.kinematics.manipulability("puma560", Q6[0]),
}

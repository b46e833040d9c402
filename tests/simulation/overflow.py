"""An arm whose equations leave the range of floating-point numbers in a fall: CVODES cannot go on."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw


def overflowing_panda(monkeypatch: pytest.MonkeyPatch) -> aw.Model:
    """The Panda without a limit of its friction's exponent, whose derivative is NaN from 42 rad/s on.

    Its payload makes it an arm of its own: what is traced of it is kept for no other test.
    """
    monkeypatch.setattr("armwright.friction_laws.sigmoid.MOST", np.inf)
    return aw.load("panda").with_payload(1e-6, np.zeros(3), np.zeros(3))

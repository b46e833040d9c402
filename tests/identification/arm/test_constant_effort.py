"""A joint that moves under an effort that never changes: an offset and a slope over speed would explain it, whatever moved it."""

import numpy as np
import pytest

import armwright as aw
from armwright.errors import IdentificationError
from identification.validation.made_logs import motor_file, written_log
from raises_at import raises_at


@pytest.mark.parametrize("effort", ["voltage", "torque"])
def test_a_constant_effort_identifies_nothing(effort, tmp_path):
    t = 0.002 * np.arange(1000)
    table = {"t": t, "position": np.sin(5 * t)[:, None], effort: np.full((1000, 1), 3.0)}
    log = aw.identification.read_log(written_log(tmp_path, ["motor"], {"fit": table, "held": table}))
    with raises_at(IdentificationError, f"signal {'tau' if effort == 'torque' else effort}", "'motor'"):
        aw.identification.identify_arm(log, aw.load(motor_file(tmp_path)))

"""Where SO-101's shoulder rests: in Armwright, in the MJCF that it writes, and with the gains of files in circulation."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest

from docs.pages import ROOT, run_here
from pictures.gallery import TABLE

pytestmark = pytest.mark.study  # half a minute


def test_the_shoulder_sags_and_rests_by_its_approach(tmp_path):
    pytest.importorskip("mujoco", reason="of the extra bench")
    done = run_here([sys.executable, str(ROOT / "examples" / "servo_arm" / "settle.py"), "out"], tmp_path)
    assert done.returncode == 0, done.stderr
    found = [[float(x) for x in re.findall(r"([\d.]+)°", line)] for line in done.stdout.splitlines()]
    armwright, ours, gain_18, gain_998 = np.reshape(found, (4, 2, 4)).transpose(2, 0, 1)  # by case and side
    assert np.abs(ours - armwright).max() < 0.2
    # lower from below
    assert ((armwright[:, 1] - armwright[:, 0] > 0.1) & (armwright[:, 1] - armwright[:, 0] < 0.7)).all()
    assert (gain_998 < 0.1).all()
    assert np.abs(gain_18[2:] - armwright[2:]).max() < 0.2  # made for P = 32
    assert (armwright[:2] / gain_18[:2] > 1.8).all()  # and so half of what P = 16 does
    picture = next(each for each in TABLE if each.file == "servo_arm.png")
    assert picture.changed(tmp_path / "out" / "servo_arm.png") is None

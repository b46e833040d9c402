"""The page on motion files: its drill is planned as shown, and drills where it says."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from docs.pages import blocks, sessions, shell, write_files


@pytest.mark.study
def test_the_drill_is_planned_and_goes_along_its_axis(tmp_path):
    write_files("docs/motion-files.md", tmp_path)
    shown = [
        session for kind, text in blocks("docs/motion-files.md") if kind == "console" for session in sessions(text)
    ]
    ((command, lines),) = [each for each in shown if "drill" in each[0]]
    assert shell(command, tmp_path).stdout.splitlines() == lines
    plan = aw.trajectories.plan(tmp_path / "drill.motion.toml")
    motion = plan.motion
    s = np.linspace(0.0, motion.duration, 501)
    poses = aw.compile(plan.arm).forward_kinematics(motion.at(s)[0])
    np.testing.assert_allclose(poses[-1, :3, 3], [0.45, 0.04, 0.18], atol=2e-6)
    corner = int(np.linalg.norm(poses[:, :3, 3] - [0.45, 0.1, 0.1], axis=1).argmin())
    drilling = poses[corner + 1 :]
    assert len(drilling) > 50
    np.testing.assert_allclose(drilling[:, :3, 2], np.tile([0.0, -0.6, 0.8], (len(drilling), 1)), atol=2e-6)
    turned = poses[0, :3, :3].T @ poses[-1, :3, :3]
    assert np.abs(turned - np.eye(3)).max() > 0.1

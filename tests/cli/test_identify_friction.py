"""`armwright identify friction`: a table, a robot file, and exit codes that scripts can read."""

from __future__ import annotations

import pytest

import armwright as aw
from cli.test_commands import run
from identification.arm.moved_arm import moved


@pytest.mark.study
def test_friction_is_found_and_written(tmp_path):
    arm = aw.load("two-link")
    moved(tmp_path, "arm", arm, torque_noise=0.01, position_noise=1e-5)
    log, output = str(tmp_path / "arm.log.toml"), str(tmp_path / "rubbed.toml")
    page = str(tmp_path / "friction.html")
    shown = run("identify", "friction", "two-link", log, "--table", "-o", output, "--report", page).stdout
    assert "viscous" in (tmp_path / "friction.html").read_text(encoding="utf-8")
    assert "Friction over velocity" in shown
    assert "friction.viscous_n_m_s_per_rad" in shown
    assert aw.load(output).record.fits["friction"].verdict == "identified"
    refused = run("identify", "friction", "lwa4p", log, code=2)
    assert refused.stderr.count("\n") == 1

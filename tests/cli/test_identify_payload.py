"""`armwright identify payload`: a table, a robot file, and exit codes that scripts can read."""

from __future__ import annotations

import pytest

import armwright as aw
from cli.test_commands import run
from identification.arm.moved_arm import moved


@pytest.mark.study
def test_a_payload_is_found_and_written(tmp_path):
    arm = aw.load("lwa4p")
    noise = {"torque_noise": 0.3, "position_noise": 1e-5}
    moved(tmp_path, "loaded", arm.with_payload(1.5, (0.0, 0.02, 0.05), (0.01, 0.01, 0.01)), **noise)
    moved(tmp_path, "empty", arm, **noise)
    loaded, empty, output = (str(tmp_path / name) for name in ("loaded.log.toml", "empty.log.toml", "carrying.toml"))
    page = str(tmp_path / "payload.html")
    shown = run("identify", "payload", "lwa4p", loaded, "--cutoff", "20", "-o", output, "--report", page).stdout
    assert "payload.mass_kg" in (tmp_path / "payload.html").read_text(encoding="utf-8")
    assert "payload.mass_kg" in shown
    assert "wrote" in shown
    mass = aw.load(output).record.link("payload").mass_kg
    assert abs(float(mass) - 1.5) < 0.03
    assert 0 < mass.std < 0.05
    assert aw.load(output).provenance("payload.mass_kg").kind == "fit"
    both = run("identify", "payload", "lwa4p", empty, "--loaded-log", loaded, "--cutoff", "20").stdout
    assert "two logs" in both
    nothing = run("identify", "payload", "lwa4p", empty, "--cutoff", "20", "-o", output + "x", code=2)
    assert nothing.stderr.count("\n") == 1
    nothing = run("identify", "payload", "lwa4p", empty, "--cutoff", "20", code=1)
    assert "not identified" in nothing.stdout

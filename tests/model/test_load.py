"""From a name or a file to an arm."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from armwright.description import builtin_names
from armwright.dynamics import inverse_dynamics
from armwright.errors import DescriptionError
from armwright.model.load import load
from raises_at import raises_at


@pytest.mark.parametrize("name", builtin_names())
def test_builtin(name):
    """Every built-in arm loads, bears its file's name, has a tip and keeps its record."""
    arm = load(name)
    assert arm.name == name
    assert arm.tip in arm.frames
    assert arm.description is not None
    assert arm.n == len(arm.names) == sum(joint.type != "fixed" for joint in arm.description.joints)


def test_the_report_s_arm_hangs():
    """g = -9.80621 where z₀ points down, v̇₀ = [0 0 g]: free fall is along +z₀, and joints 2 and 4 swing back to 0."""
    arm = load("cmu-dd")
    np.testing.assert_array_equal(arm.gravity, [0.0, 0.0, 9.80621])
    still, small = np.zeros(6), 1e-4
    weight = lambda q: inverse_dynamics(arm, q, still, still)  # noqa: E731
    stiffness = np.array([(weight(small * e) - weight(-small * e)) / (2 * small) for e in np.eye(6)])
    assert (np.diag(stiffness)[[1, 3]] > 10.0).all()


def test_numbers_of_the_report_s_arm_are_the_report_s_or_estimates():
    """The report states gravity; sizes, masses, motors, friction and limits it does not."""
    record = load("cmu-dd").description
    assert record.source == "estimate"
    assert record.gravity_m_s2.source == "report"
    sources = record.sources
    assert {source.kind for name, source in sources.items() if name != "report"} == {"estimate"}
    assert "z₀ points down" in sources["report"].text
    assert "states no size, mass, motor constant" in sources["estimate"].text
    of_links = {link.source for link in record.links}
    assert "report" not in of_links


def test_errors_name_the_file(tmp_path):
    """What only the model finds out, an impossible inertia, names the file as well; the caller's word lets it pass."""
    path = tmp_path / "mine.toml"
    text = (resources.files("armwright.robots") / "puma560.toml").read_text(encoding="utf-8")
    path.write_text("\n".join(line for line in text.splitlines() if "accept_impossible" not in line), encoding="utf-8")
    with raises_at(DescriptionError, "link 'link1' inertia_kg_m2", "impossible inertia", file=f"{path}:49"):
        load(path)
    assert len(load(path, on_impossible="warn").warnings) == 2


def test_a_built_in_name_is_that_arm(tmp_path, monkeypatch):
    """Whatever in the working directory is called so; with a separator it is the path."""
    (tmp_path / "panda").mkdir()
    (tmp_path / "two-link").write_text("no TOML")
    monkeypatch.chdir(tmp_path)
    assert load("panda").name == "panda"
    assert load("two-link").name == "two-link"
    assert load(Path("puma560")).name == "puma560"
    with raises_at(DescriptionError, file="panda"):
        load("./panda")
    with pytest.raises(DescriptionError, match="not TOML"):
        load(Path("./two-link"))


@pytest.mark.parametrize("thing", [None, 3, b"panda", ["panda"]])
def test_what_is_no_path_is_refused(thing):
    with raises_at(DescriptionError, "robot", value=thing):
        load(thing)


def test_a_gear_without_loss(tmp_path):
    """η = 1 is no loss, and needs no friction table to smooth it."""
    path = tmp_path / "arm.toml"
    text = (resources.files("armwright.robots") / "cmu-dd.toml").read_text(encoding="utf-8")
    assert "gear_efficiency" not in text
    path.write_text(text.replace("gear_ratio = 1", "gear_efficiency = 1.0\ngear_ratio = 1"), encoding="utf-8")
    model, plain = load(path), load("cmu-dd")
    assert "gear_efficiency = 1.0" in path.read_text(encoding="utf-8")
    assert all(body.drive.efficiency is None for body in model.bodies)
    q = np.linspace(0.1, 0.6, 6)
    np.testing.assert_array_equal(inverse_dynamics(model, q, q, q), inverse_dynamics(plain, q, q, q))


def test_a_name_of_thousands_of_letters():
    with pytest.raises(DescriptionError, match="5000 letters"):
        load("x" * 5000)

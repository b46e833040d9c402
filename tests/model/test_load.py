"""From a name or a file to an arm."""

from __future__ import annotations

from importlib import resources

import pytest

from armwright.description import builtin_names
from armwright.errors import DescriptionError
from armwright.model.load import load


@pytest.mark.parametrize("name", builtin_names())
def test_builtin(name):
    """Every built-in arm loads, bears its file's name, has a tip and keeps its record."""
    arm = load(name)
    assert arm.name == name
    assert arm.tip in arm.frames
    assert arm.description is not None
    assert arm.n == len(arm.names) == sum(joint.type != "fixed" for joint in arm.description.joints)


def test_errors_name_the_file(tmp_path):
    """What only the model finds out, an impossible inertia, names the file as well; the caller's word lets it pass."""
    path = tmp_path / "mine.toml"
    text = (resources.files("armwright.robots") / "puma560.toml").read_text(encoding="utf-8")
    path.write_text("\n".join(line for line in text.splitlines() if "accept_impossible" not in line), encoding="utf-8")
    with pytest.raises(DescriptionError, match=r"mine\.toml: puma560: link 'link1' has an impossible inertia"):
        load(path)
    assert len(load(path, on_impossible="warn").warnings) == 2

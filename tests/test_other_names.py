"""Names of other toolboxes are answered with the name here."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

import armwright as aw
from armwright.kernels.signatures import SIGNATURES
from armwright.other_names import HERE, OTHERS
from docs.pages import page
from public_names import GROUPS, PUBLIC


def test_every_name_that_is_told_is_there():
    assert set(OTHERS) <= {name.rpartition(".")[2] for name in (*PUBLIC, *SIGNATURES)}
    assert len(HERE) == sum(len(others.split()) + 1 for others in OTHERS.values())  # none stands for two things


@pytest.mark.parametrize(
    ("name", "here"),
    [
        ("fkine", "forward_kinematics"),
        ("ikine_LM", "inverse_kinematics"),
        ("buildModelFromUrdf", "load"),
        ("inverseDynamics", "inverse_dynamics"),
        ("SerialLink", "load"),
        ("identify_arm", "identification.identify_arm"),
        ("lspb", "trajectories.Trapezoid"),
    ],
)
def test_public_names(name, here):
    with pytest.raises(AttributeError, match=f"'{name}'; .* {here}$"):
        getattr(aw, name)


@pytest.mark.parametrize(
    ("name", "here"), [("rnea", "inverse_dynamics"), ("crba", "mass_matrix"), ("jacob0", "jacobian")]
)
def test_kernels(name, here):
    with pytest.raises(AttributeError, match=f"'{name}'; .* {here}$"):
        getattr(aw.compile(aw.load("two-link")), name)


@pytest.mark.parametrize(
    ("name", "here"),
    [
        ("fkine", "aw.forward_kinematics(arm, …)"),
        ("fdyn", "aw.simulate(aw.Scenario(arm, …))"),
        ("dof", "n"),
        ("qlim", "aw.trajectories.MotionLimits.of(arm)"),
        ("payload", "with_payload(…)"),
    ],
)
def test_attributes_of_an_arm(name, here):
    arm = aw.load("two-link")
    with pytest.raises(AttributeError, match=f"'{name}'; here it is {re.escape(here)}$"):
        getattr(arm, name)
    assert not hasattr(arm, "xyzzy")


def test_the_tables_of_other_libraries_say_the_same():
    """Where a row of docs/coming-from.md translates one call to one call, the error about that name does, too."""
    rows = re.findall(
        r"^\| `[\w ={}]*?(?:\w+\.)?(\w+)\([^`]*` \| [^|]*?`(?:aw|dyn)\.([\w.]+)",
        page("docs/coming-from.md"),
        re.MULTILINE,
    )
    told = {name: here for name, here in rows if name.replace("_", "").lower() in HERE}
    assert len(told) > 20
    assert {name: HERE[name.replace("_", "").lower()] for name in told} == {
        name: here.rpartition(".")[2] for name, here in told.items()
    }


def test_names_that_nobody_has():
    with pytest.raises(AttributeError, match=r"'xyzzy'$"):
        _ = aw.xyzzy
    with pytest.raises(AttributeError, match="there is bias_torques, centre_of_mass"):
        _ = aw.compile(aw.load("two-link")).xyzzy


@pytest.mark.parametrize("line", ["aw.forward_kinematic", "aw.compile(aw.load('two-link')).forward_kinematic"])
def test_python_names_the_nearest(line):
    done = subprocess.run(
        [sys.executable, "-c", f"import armwright as aw\n{line}"], capture_output=True, text=True, check=False
    )
    assert "Did you mean: 'forward_kinematics'?" in done.stderr


def test_only_public_names_are_listed():
    assert dir(aw) == sorted([*aw.__all__, "__version__"])
    for module in GROUPS.values():
        assert dir(module) == module.__all__


def test_the_top_is_short_and_each_name_has_one_home():
    assert len(aw.__all__) - len(GROUPS) <= 75
    assert len({id(value) for value in PUBLIC.values()}) == len(PUBLIC)


def test_a_file_with_the_name_of_a_function_does_not_hide_it():
    from armwright.sweeps.sweep import sweep

    assert aw.sweeps.sweep is sweep

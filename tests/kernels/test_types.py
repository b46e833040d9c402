"""Types of kernels, as pyright and editors see them."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import armwright as aw
from armwright.kernels.signatures import SIGNATURES

ROOT = Path(__file__).resolve().parents[2]

SCRIPT = """\
import numpy as np

import armwright as aw

q = np.zeros(6)
dyn = aw.compile(aw.load("puma560"))
reveal_type(dyn.inverse_dynamics(q, q, q))
reveal_type(dyn.inverse_dynamics_derivatives(q, q, [0.0] * 6, wrench=q))
reveal_type(aw.compile(aw.load("puma560"), dtype="float32").mass_matrix(q))
reveal_type(dyn.forward_kinematics(q, frame="tool"))
aw.compile(aw.load("puma560"), vary=["link2.mass_kg"]).inverse_dynamics(q, q, q, [1.0], q)
dyn.inverse_dynamics(q, q, q, out=np.zeros(6))
dyn.rnea(q, q, q)
dyn.inverse_dynamics(q, q)
dyn.mass_matrix(q, frame="tool")
dyn.inverse_dynamics("q", q, qdd=dyn)
"""
# Patterns: NumPy's stubs spell shapes and float32 in a way of their own in each version.
FLOAT64, FLOAT32 = r"ndarray\[[^\]]+\]?, dtype\[float64\]\]", r"ndarray\[.+, dtype\[(float32|floating\[_32Bit\])\]\]"
REVEALED = {7: FLOAT64, 8: rf"tuple\[{FLOAT64}, {FLOAT64}, {FLOAT64}\]", 9: FLOAT32, 10: FLOAT64}
ERRORS = {13: 'Cannot access attribute "rnea"', 14: '"qdd"', 15: '"frame"', 16: "CompiledArm"}


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[int, str]]:
    """Messages of pyright about the script, by line, of each severity."""
    if importlib.util.find_spec("pyright") is None:
        pytest.skip("pyright is not installed")
    folder = tmp_path_factory.mktemp("types")
    (folder / "script.py").write_text(SCRIPT)
    (folder / "pyrightconfig.json").write_text(json.dumps({"extraPaths": [str(ROOT / "src")]}))
    command = [
        sys.executable,
        "-m",
        "pyright",
        "--outputjson",
        "--pythonpath",
        sys.executable,
        "--project",
        str(folder),
    ]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    if not run.stdout.startswith("{"):
        pytest.skip(f"pyright does not run here: {(run.stderr or run.stdout)[:200]}")
    messages: dict[str, dict[int, str]] = {}
    for each in json.loads(run.stdout)["generalDiagnostics"]:
        messages.setdefault(each["severity"], {})[each["range"]["start"]["line"] + 1] = each["message"]
    return messages


@pytest.mark.study
def test_results_have_types(found):
    revealed = {line: message.split('" is "')[1].rstrip('"') for line, message in found["information"].items()}
    assert set(revealed) == set(REVEALED)
    for line, pattern in REVEALED.items():
        assert re.fullmatch(pattern, revealed[line]), revealed[line]


@pytest.mark.study
def test_unknown_kernels_and_wrong_arguments_are_errors(found):
    assert set(found["error"]) == set(ERRORS)
    for line, part in ERRORS.items():
        assert part in found["error"][line]


def test_unknown_kernel_is_an_error_with_its_name_here():
    with pytest.raises(AttributeError, match=r"'rnea'.* inverse_dynamics"):
        aw.compile(aw.load("two-link")).rnea  # noqa: B018


def test_stub_is_current():
    place = ROOT / "tools" / "kernel_stub.py"
    spec = importlib.util.spec_from_file_location("kernel_stub", place)
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert tool.PATH.read_text(encoding="utf-8") == tool.stub(), f"python {place.relative_to(ROOT)} writes it anew"
    assert all(f"def {name}(" in tool.stub() for name in SIGNATURES)

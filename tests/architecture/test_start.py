"""A start brings no more than it needs: libraries, modules of ours, checkers of tables that nobody has. Fresh processes."""

import copy
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import armwright as aw

LIBRARIES = ("numpy", "casadi", "llvmlite", "pydantic")
NEVER = (  # in a script that loads an arm and calls a kernel
    *(
        "scipy",
        "xarray",
        "trimesh",
        "matplotlib",
        "tomlkit",
        "rich",
        "typer",
        "logging",
        "difflib",
        "concurrent.futures",
    ),
    *(f"armwright.description.{name}" for name in ("urdf", "mjcf", "modules", "parts", "solids")),
    *(f"armwright.description.{name}" for name in ("drive_effects", "springs")),  # that puma560 has not
    *("armwright.lint.hulls", "armwright.model.vary", "armwright.model.variants", "armwright.simulation"),
)
EMITTER = ("llvm", "llvm_machine", "tiles", "lowering", "polynomials")  # of kernels: what prints code

SCRIPT = """
import json, sys
import armwright as aw
first = sorted(sys.modules)
from armwright import lazy_schema
built, original = [], lazy_schema.TypeAdapter
lazy_schema.TypeAdapter = lambda kind: built.append(kind.__name__) or original(kind)
arm = aw.load("puma560")
plain = list(built)
dyn = aw.compile(arm)
tau = dyn.inverse_dynamics([0.1] * 6, [0.2] * 6, [0.3] * 6)
read = "instructions" in vars(dyn.kernel("inverse_dynamics").program)
modules = sorted(sys.modules)
aw.load("cmu-dd")
print(json.dumps([first, modules, [plain, sorted(set(built))], read, tau.tobytes().hex()]))
"""


@pytest.fixture(scope="module")
def starts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """Output of two processes, one after the other, that share an empty cache."""
    folder = tmp_path_factory.mktemp("start") / "cache"
    return {which: started(folder) for which in ("cold", "warm")}


def test_inverse_kinematics_needs_no_scipy(tmp_path):
    script = (
        "import sys, armwright as aw\n"
        "q = [0.3, 0.3, 0.3, -0.9, 0.3, 0.9, 0.3]\n"
        "found = aw.inverse_kinematics('panda', aw.forward_kinematics(aw.load('panda'), q))\n"
        "print(bool(found.success), 'scipy' in sys.modules, 'numpy.ma' in sys.modules)"
    )
    environment = os.environ | {"ARMWRIGHT_CACHE_DIR": str(tmp_path / "cache")}
    run = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert run.stdout.split() == ["True", "False", "False"], run.stderr


def started(folder: Path) -> dict[str, Any]:
    environment = os.environ | {"ARMWRIGHT_CACHE_DIR": str(folder)}
    run = subprocess.run([sys.executable, "-c", SCRIPT], env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return dict(zip(("first", "modules", "checkers", "read", "bits"), json.loads(run.stdout), strict=True))


def test_import_brings_no_library(starts):
    assert not set(LIBRARIES) & set(starts["cold"]["first"])
    assert set(LIBRARIES) <= set(starts["cold"]["modules"])


@pytest.mark.parametrize("which", ["cold", "warm"])
def test_first_kernel_brings_nothing_that_it_does_not_need(starts, which):
    assert not set(NEVER) & set(starts[which]["modules"])


def test_kernel_from_the_cache_needs_nothing_that_prints_code(starts):
    printing = {f"armwright.kernels.{name}" for name in EMITTER} | {"armwright.program.passes", "armwright.program.cut"}
    assert printing <= set(starts["cold"]["modules"])
    assert not printing & set(starts["warm"]["modules"])


def test_kernel_from_the_cache_is_not_read_instruction_by_instruction(starts):
    assert starts["cold"]["read"]
    assert not starts["warm"]["read"]


def test_kernel_from_the_cache_has_the_same_bits(starts):
    assert starts["warm"]["bits"] == starts["cold"]["bits"]


def test_tables_that_no_file_has_get_no_checker(starts):
    puma, both = starts["warm"]["checkers"]
    assert not puma
    assert both == ["BuiltFrom", "Visual"]  # of cmu-dd


@pytest.mark.parametrize("package", [aw, aw.identification], ids=["armwright", "identification"])
def test_packages_travel_to_other_processes_by_name(package):
    """Functions of a script that say `aw.simulate` are sent with the module `aw` by joblib, Dask and Ray."""
    assert pickle.loads(pickle.dumps(package)) is package
    assert copy.deepcopy(package) is package

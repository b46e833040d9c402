"""Data flows down the house: a room imports only from rooms above it, and `import armwright` is silent and cheap."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "src"
PACKAGE = "armwright"

ROUND = "entry"  # the one way round: it names types and readers of rooms below as text, imported at a call, and for checkers

# The order of design section 2, top to bottom. A room imports from those above it or on its own line.
ORDER = (
    ("printable",),
    ("terminal",),  # the one place that writes to it
    ("errors", "content"),
    (ROUND,),  # what functions take
    ("progress", "notebook"),  # a bar; HTML, made far below
    ("scalar",),
    ("program",),  # traced functions; it knows no robots
    ("interpolation",),  # tables that trace
    ("fitting",),  # measures of agreement, which every room takes from here
    ("matrix_exponential",),
    ("expressions",),
    ("output", "reading", "named_file"),
    ("examples",),  # copies of the example programs
    ("signals",),  # named layouts of vectors
    ("spatial", "joint_kinds"),  # vectors and frames; kinds of joints
    ("friction_laws",),
    ("lazy_schema",),  # tables that few files have
    ("validation",),  # pydantic's errors as ours
    ("other_names",),
    ("lazy",),  # names that are imported when they are first used
    ("toml_text",),  # and the lines that they are on
    ("quantity",),  # values with unit, source and uncertainty
    ("solids",),
    ("robots",),  # data files only; description reads them
    ("description",),
    ("lint", "parts"),  # links are checked as they are built
    ("model",),
    ("parameters",),  # values that differ by lane
    ("features",),  # of records and scenarios; consumers declare what they do not count exactly
    ("interfaces",),  # what users write themselves
    ("kinematics",),
    ("actuators",),  # above dynamics: friction and gear loss are part of the inverse dynamics
    ("dynamics",),
    ("kernels",),
    ("interop",),  # kernels in JAX and PyTorch
    ("results",),
    ("collision",),  # capsules around links
    ("ik",),
    ("simulation",),
    ("trajectory", "identification", "control"),
    ("scenarios", "motions"),  # scenario files: they name controllers and trajectories; motion files
    ("modules",),  # which arms modules make, and what they can do
    ("export",),
    ("shadow",),  # a model that runs beside its arm
    ("pictures",),  # arms drawn, in any pose and moving; plots to explore
    ("robotfiles",),  # check, compare, convert
    ("sweeps", "twin"),  # many simulations; the arm as drives on a bus
    ("tuning",),  # gains searched for over simulations
    (PACKAGE,),  # __init__.py: the public names
    ("session",),  # the report's `sim`, in the public names
    ("cli",),
    ("__main__",),
)
FLOOR = {room: depth for depth, rooms in enumerate(ORDER) for room in rooms}


def room_of(module: str) -> str:
    """`armwright.dynamics.inverse` is in room `dynamics`; `armwright` itself is the room of the public names."""
    return module.split(".")[1] if "." in module else PACKAGE


def module_of(path: Path) -> str:
    """`armwright/dynamics/inverse.py` → `armwright.dynamics.inverse`; a package's `__init__.py` → the package."""
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def imported(tree: ast.AST, path: Path) -> Iterator[tuple[int, str]]:
    """(line, room) of all of ours that a file imports, at any depth; relative imports and import_module count."""
    package = ".".join(path.parent.parts)
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            source = ".".join(above + ([node.module] if node.module else []))
            # `from armwright import scalar` names a room, `from armwright import load` a public name
            rooms = [alias.name for alias in node.names if source == PACKAGE and alias.name in FLOOR]
            names = [f"{PACKAGE}.{room}" for room in rooms] + [source] * (len(rooms) < len(node.names))
        elif isinstance(node, ast.Call) and "import_module" in ast.unparse(node.func):
            names = [arg.value for arg in node.args if isinstance(arg, ast.Constant) and isinstance(arg.value, str)]
        for name in names:
            if name.split(".")[0] == PACKAGE:
                yield node.lineno, room_of(name)


def violations(text: str, path: Path) -> list[str]:
    """Imports of one file against the order, one message each. `path` is relative to src."""
    here = room_of(module_of(path))
    if here not in FLOOR:
        return [f"src/{path}: unknown room `{here}`; give it a place in ORDER ({', '.join(FLOOR)})"]
    if here in (PACKAGE, ROUND):
        return []  # __init__.py hands out names of every room
    found = []
    for line, room in imported(ast.parse(text, str(path)), path):
        if room not in FLOOR:
            found.append(f"src/{path}:{line}: imports from unknown room `{room}`; the rooms are {', '.join(FLOOR)}")
        elif FLOOR[room] > FLOOR[here]:
            above = [name for name in FLOOR if FLOOR[name] <= FLOOR[here]]
            found.append(f"src/{path}:{line}: `{here}` imports `{room}`, below it; it may import {', '.join(above)}")
    return found


def test_rooms_import_only_from_above() -> None:
    found = []
    for file in sorted((SOURCE / PACKAGE).rglob("*.py")):
        found += violations(file.read_text(encoding="utf-8"), file.relative_to(SOURCE))
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("path", "text", "message"),
    [
        ("scalar.py", "from armwright.errors import SymbolError", None),
        ("dynamics/inverse.py", "from armwright import scalar", None),
        ("dynamics/inverse.py", "from .mass_matrix import mass_matrix", None),
        ("dynamics/inverse.py", "from ..model import Model", None),
        ("cli/main.py", "import armwright as aw", None),
        ("__init__.py", "from armwright.simulation import simulate", None),
        (
            "model/build.py",
            "def f():\n    import armwright.kernels.llvm",
            "model/build.py:2: `model` imports `kernels`, below",
        ),
        ("dynamics/inverse.py", "from ..kernels.cache import load", "`dynamics` imports `kernels`, below"),
        ("dynamics/inverse.py", "from .. import scalar, kernels", "`dynamics` imports `kernels`, below"),
        ("dynamics/inverse.py", "from armwright import load", "`dynamics` imports `armwright`, below"),
        (
            "dynamics/__init__.py",
            "from . import inverse\nfrom ..cli import main",
            "__init__.py:2: `dynamics` imports `cli`",
        ),
        ("control/pid.py", "from armwright.ik import solve", None),
        ("model/build.py", "import importlib\nimportlib.import_module('armwright.cli')", ":2: `model` imports `cli`"),
        ("utils/maths.py", "", "unknown room `utils`"),
        ("cli/main.py", "from armwright.utils import maths", "unknown room `utils`"),
    ],
)
def test_the_rule_sees(path: str, text: str, message: str | None) -> None:
    found = violations(text, Path(PACKAGE) / path)
    assert len(found) == (message is not None)
    assert message is None or message in found[0]


HEAVY = ("matplotlib", "xarray", "typer", "rich", "h5netcdf")  # imported when first needed, never before


def test_import_is_silent_and_light() -> None:
    script = f"import sys, armwright; sys.exit(', '.join(name for name in {HEAVY} if name in sys.modules) or None)"
    run = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", ""), (
        f"`import armwright` loads or says: {run.stderr}{run.stdout}"
    )

"""Physics runs on floats and on traced symbols alike: it calls `armwright.scalar`, not what fails on symbols."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "src"

# Where the equations are. A room is a folder, all of whose files count.
PHYSICS = (
    "interpolation.py",
    "spatial",
    "kinematics",
    "dynamics",
    "actuators",
    "model/build.py",
    "simulation/plant/joint_drive.py",
    "simulation/plant/plant.py",
    "simulation/plant/flow.py",
    "simulation/plant/outputs.py",
    "simulation/integration/integrators.py",
)

FILLED = "armwright.scalar.array or stack of the entries, or"
INSTEAD = {
    "numpy.where": "armwright.scalar.where",
    "numpy.clip": "armwright.scalar.clip",
    "numpy.maximum": "armwright.scalar.maximum",
    "numpy.fmax": "armwright.scalar.maximum",
    "numpy.minimum": "armwright.scalar.minimum",
    "numpy.fmin": "armwright.scalar.minimum",
    "numpy.linalg": "armwright.scalar (solve_symmetric, hypot, sqrt), or the sum or product itself",
    "numpy.zeros": f"{FILLED} armwright.scalar.zeros",
    "numpy.zeros_like": f"{FILLED} armwright.scalar.zeros",
    "numpy.ones": f"{FILLED} armwright.scalar.zeros",
    "numpy.ones_like": f"{FILLED} armwright.scalar.zeros",
    "numpy.full": f"{FILLED} armwright.scalar.zeros",
    "numpy.full_like": f"{FILLED} armwright.scalar.zeros",
    "numpy.empty": f"{FILLED} armwright.scalar.zeros",
    "numpy.empty_like": f"{FILLED} armwright.scalar.zeros",
    "math": "the function of the same name in armwright.scalar; constants from numpy (pi, inf)",
}


def aliases(tree: ast.AST) -> dict[str, str]:
    """Full name of each imported name: `np` → `numpy`, `norm` → `numpy.linalg.norm`."""
    names = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                names[alias.asname or alias.name.split(".")[0]] = (
                    alias.name if alias.asname else alias.name.split(".")[0]
                )
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
    return names


def uses(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """(line, full dotted name) of every use of an imported name: `np.linalg.norm(r)` → `numpy.linalg.norm`."""
    names = aliases(tree)
    inner = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute | ast.Name) and id(node) not in inner:
            first, *rest = ast.unparse(node).split(".")
            if first in names:
                yield node.lineno, ".".join([names[first], *rest])


def violations(text: str, path: Path) -> list[str]:
    """Every use in one file that a symbol would not survive, with what to write instead. `path` is relative to src."""
    found = []
    for line, name in sorted(set(uses(ast.parse(text, str(path))))):
        for banned, instead in INSTEAD.items():
            if name == banned or name.startswith(banned + "."):
                found.append(f"src/{path}:{line}: {name} is for floats only; use {instead}")
    return found


def test_physics_is_scalar_generic() -> None:
    found = []
    for place in PHYSICS:
        root = SOURCE / "armwright" / place
        for file in [root] if root.is_file() else sorted(root.rglob("*.py")):
            found += violations(file.read_text(encoding="utf-8"), file.relative_to(SOURCE))
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("text", "instead"),
    [
        ("import numpy as np\nx = np.pi * np.array([1.0]) @ np.cross(a, b)", None),
        ("from armwright import scalar\nx = scalar.where(a, b, c) + scalar.zeros(3)", None),
        ("x = model.math.sin(q) + where(q)", None),
        ("import numpy as np\ny = np.where(q > 0, 1, 2)", "armwright.scalar.where"),
        ("import numpy\ny = numpy.clip(q, -1, 1)", "armwright.scalar.clip"),
        ("from numpy import maximum as larger\ny = larger(a, b)", "armwright.scalar.maximum"),
        ("import numpy as np\ny = np.linalg.solve(M, b)", "solve_symmetric"),
        ("import numpy.linalg as la\ny = la.norm(r)", "armwright.scalar"),
        ("from numpy.linalg import norm\ny = norm(r)", "armwright.scalar"),
        ("import numpy as np\nJ = np.zeros((6, n))", "armwright.scalar.zeros"),
        ("import math\ny = math.sin(q)", "armwright.scalar"),
        ("from math import cos\ny = cos(q)", "armwright.scalar"),
    ],
)
def test_the_rule_sees(text: str, instead: str | None) -> None:
    found = violations(text, Path("armwright/dynamics/example.py"))
    assert len(found) == (instead is not None)
    assert instead is None or ("example.py:2: " in found[0] and instead in found[0])

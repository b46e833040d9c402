"""The table of float32 errors: its tool finds maxima and is repeatable, and the committed table and its pages agree with it."""

from __future__ import annotations

import csv
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import armwright as aw
from docs.pages import page
from kernels.test_float32 import SPRINGS
from kernels.test_kernels import FULL

ROOT = Path(__file__).parents[2]


def loaded() -> ModuleType:
    """The tool, which is no part of the package."""
    spec = importlib.util.spec_from_file_location("float32_errors", ROOT / "tools" / "float32_errors.py")
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


tool = loaded()
TABLE = list(csv.DictReader((ROOT / "docs" / "data" / "float32-errors.csv").read_text(encoding="utf-8").splitlines()))
COLUMNS = tool.HEAD[2:]


def number(text: str) -> float:
    """An error of the table."""
    return np.inf if text == "no digit" else float(text)


def row(kernel: str, arm: str) -> list[float]:
    """The errors of one function and arm."""
    (found,) = (each for each in TABLE if (each["function"], each["arm"]) == (kernel, arm))
    return [number(found[column]) for column in COLUMNS]


def test_the_search_climbs_to_a_maximum():
    """A needle in eight dimensions that no sample meets."""
    top = np.linspace(-3.0, 3.0, 8)

    def errors(rows: np.ndarray) -> np.ndarray:
        return 1.0 / (1e-6 + ((rows - top) ** 2).sum(axis=1))

    random = np.random.default_rng(0)
    starts = tool.drawn(random, 16, 8)
    assert errors(starts).max() < 1.0
    found, state = tool.searched(errors, starts, 200, 32, random)
    assert found > 1e4
    np.testing.assert_allclose(state, top, atol=1e-2)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("name", "kernel"), [("puma560", "inverse_dynamics"), ("cmu-dd", "energy"), ("panda", "mass_matrix")]
)
def test_a_small_sample_agrees_with_the_table(name, kernel):
    """Quantiles within sampling noise; the search beats its sample; the same seed gives the same numbers."""
    errors = tool.KernelErrors(aw.load(name), kernel)
    sample = tool.sampled(errors, sum(errors.sizes), states=50_000, rounds=4)
    half, most, *_, largest, found = row(kernel, name)
    assert sample.quantiles[0] == pytest.approx(half, rel=0.1)
    assert sample.quantiles[1] == pytest.approx(most, rel=0.15)
    assert sample.quantiles[2] <= sample.largest <= 1.3 * largest
    assert sample.largest <= sample.found <= 1.3 * found
    assert errors(sample.state[None])[0] == sample.found
    errors = tool.KernelErrors(aw.load(name), kernel)
    again = tool.sampled(errors, sum(errors.sizes), states=50_000, rounds=4)
    assert (again.quantiles, again.found) == (sample.quantiles, sample.found)


def test_an_error_is_that_of_the_plain_function():
    """At the worst state of a search, against the float reference."""
    arm = aw.load("puma560")
    errors = tool.KernelErrors(arm, "inverse_dynamics")
    sample = tool.sampled(errors, 18, states=20_000, rounds=4)
    q, qd, qdd = sample.state.reshape(3, 6)
    exact = aw.inverse_dynamics(arm, *(array.astype(float) for array in (q, qd, qdd)))
    single = aw.compile(arm, dtype="float32").inverse_dynamics(q, qd, qdd)
    expected = np.abs(single - exact).max() / (2.0**-24 * max(np.abs(exact).max(), 1.0))
    assert sample.found == pytest.approx(expected, rel=1e-4)


def test_the_table_is_whole():
    """Every function of every built-in arm, errors that grow from column to column."""
    expected = {(name, kernel) for name, kernel in FULL if kernel != SPRINGS}
    assert {(each["arm"], each["function"]) for each in TABLE} == expected
    for each in TABLE:
        errors = [number(each[column]) for column in COLUMNS]
        assert errors == sorted(errors), each


def test_the_pages_quote_the_table():
    half, _, most, _, found = row("inverse_dynamics", "puma560")
    batches, microcontroller = page("docs/how-to/batches.md"), page("docs/how-to/microcontroller.md")
    assert f"within {half:g} in half of them and within {most:g} in 99.99 %" in batches
    assert f"finds {found:g}, where torques cancel" in batches
    assert (
        f"{most:g} × 6·10⁻⁸ of the largest torque in 99.99 % of states, and within {found:g} × 6·10⁻⁸"
        in microcontroller
    )
    others = [each for each in TABLE if each["function"] != "operational_inertia"]
    largest = max(number(each["largest found"]) for each in others)
    half = max(number(each["half below"]) for each in others)
    said = aw.compile.__doc__ or ""
    assert f"within 1 to {half:.0f} roundings" in said
    assert f"{largest:g}. The documentation" in said

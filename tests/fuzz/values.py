"""Values for arguments, as JSON recipes: arrays of odd shapes, types, layouts and contents, and things that are no arrays."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from random import Random
from typing import Any

import numpy as np

DTYPES = ("float64", "float64", "float64", "float32", "float16", "longdouble", "int64", "int8", "uint64", "bool", "complex128",
          "object", "<U3", "S3", "datetime64[s]", "timedelta64[s]", ">f8", "V8")  # fmt: skip
FILLS = ("normal", "normal", "zero", "nan", "inf", "mixed", "1e300", "-1e200", "1e160", "5e-324", "1e9", "negative")
LAYOUTS = ("plain", "plain", "plain", "fortran", "reversed", "stepped", "broadcast", "read-only", "masked", "masked-some",
           "matrix", "unaligned", "list", "tuple", "xarray", "memoryview")  # fmt: skip
ODD: dict[str, Callable[[], Any]] = {
    "object": object,
    "set": lambda: {1.0, 2.0},
    "dict": lambda: {"a": 1},
    "bytes": lambda: b"12",
    "bytearray": lambda: bytearray(b"12"),
    "generator": lambda: (float(k) for k in range(2)),
    "range": lambda: range(2),
    "complex": lambda: 1 + 2j,
    "fraction": lambda: Fraction(1, 3),
    "decimal": lambda: Decimal("0.1"),
    "ellipsis": lambda: ...,
    "type": lambda: float,
    "function": lambda: math.sin,
    "float32": lambda: np.float32(0.5),
    "int0d": lambda: np.array(3),
    "str0d": lambda: np.array("a"),
    "nat": lambda: np.datetime64("NaT"),
    "ragged": lambda: [[1.0], [1.0, 2.0]],
    "recursive": lambda: (lambda a: (a.append(a), a)[1])([]),
    "huge-int": lambda: 10**400,
    "huge": lambda: np.broadcast_to(0.5, (10**13, 2)),
    "deep": lambda: _nested(200),
}
PLAIN = (
    *(
        None,
        True,
        False,
        0,
        1,
        -1,
        2,
        0.5,
        -0.5,
        1e-300,
        1e300,
        -1e300,
        1e9,
        math.nan,
        math.inf,
        -math.inf,
        2**63,
        10**30,
    ),
    *("", "a", "1", "nan", "elbow", "hand", "x" * 300, "\n", "\x1b[31m"),
    *([], [[]], [0.1, 0.2], [1, 2, 3], ["a", "b"], [None, None], [[0.1, 0.2]] * 3),
    *([math.nan, 0], [1e300, 1e300], [1e-320, 0], [True, False], {"elbow": 1.0}, {"a": None}, [10**400, 0]),
)


def _nested(depth: int) -> list[Any]:
    inner: list[Any] = []
    for _ in range(depth):
        inner = [inner]
    return inner


def odd_value(rng: Random, n: int = 2) -> Any:
    """A recipe of a value that may be anything.

    Args:
        rng: decides.   n: length that a good array would have.
    """
    draw = rng.random()
    if draw < 0.2:
        return rng.choice(PLAIN)
    if draw < 0.3:
        return {"odd": rng.choice([*ODD])}
    shapes = (
        [n],
        [n],
        [n],
        [3, n],
        [1, n],
        [0, n],
        [n, n],
        [n, 1],
        [n + 1],
        [1],
        [],
        [0],
        [2, 3, n],
        [100, n],
        [6],
        [3, 3],
    )
    return {
        "shape": rng.choice(shapes),
        "dtype": rng.choice(DTYPES),
        "fill": rng.choice(FILLS),
        "layout": rng.choice(LAYOUTS),
        "seed": rng.randrange(1000),
    }


def built(recipe: Any) -> Any:
    """The value of a recipe; lists are built item by item."""
    if isinstance(recipe, list):
        return [built(item) for item in recipe]
    if isinstance(recipe, dict) and set(recipe) == {"odd"}:
        return ODD[recipe["odd"]]()
    if isinstance(recipe, dict) and "layout" in recipe:
        return _laid_out(_filled(recipe), recipe["layout"])
    return recipe


def _filled(recipe: dict[str, Any]) -> np.ndarray:
    rng = np.random.default_rng(recipe["seed"])
    values = np.asarray(rng.normal(size=recipe["shape"]))
    fill = recipe["fill"]
    if fill == "mixed":
        values[rng.random(values.shape) < 0.3] = rng.choice([np.nan, np.inf, -np.inf, 1e300, 0.0])
    elif fill == "negative":
        values = -np.abs(values)
    elif fill != "normal":
        values = np.full(values.shape, 0.0 if fill == "zero" else float(fill))
    with np.errstate(all="ignore"):
        dtype = recipe["dtype"]
        if dtype.startswith(("datetime", "timedelta", "V")):
            return np.zeros(values.shape, dtype)
        if dtype == "object":
            return np.array([Fraction(1, 3) if k % 3 else "a" for k in range(values.size)], object).reshape(
                values.shape
            )
        if np.dtype(dtype).kind in "iu":
            values = np.nan_to_num(values, posinf=100, neginf=-100).clip(-100, 100)
        return np.asarray(values.astype(dtype))


def _laid_out(array: np.ndarray, layout: str) -> Any:
    if layout == "fortran":
        return np.asfortranarray(array)
    if layout == "reversed":
        return array[::-1] if array.ndim else array
    if layout == "stepped":
        return np.repeat(array, 2, axis=-1)[..., ::2] if array.ndim else array
    if layout == "broadcast":
        return np.broadcast_to(array.reshape(-1)[:1] if array.size else array, array.shape) if array.ndim else array
    if layout == "read-only":
        array = array.view()
        array.flags.writeable = False
        return array
    if layout.startswith("masked"):
        mask = np.zeros(array.shape, bool)
        mask.flat[: 1 if layout == "masked-some" else None] = True
        return np.ma.masked_array(array, mask)
    if layout == "matrix":
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return np.asmatrix(array) if array.ndim <= 2 else array
    if layout == "unaligned":
        raw = np.zeros(array.nbytes + 1, np.uint8)
        moved = raw[1:].view(array.dtype).reshape(array.shape) if array.dtype.kind != "O" else array
        moved[...] = array
        return moved
    if layout in ("list", "tuple"):
        values = array.tolist()
        return tuple(values) if layout == "tuple" and isinstance(values, list) else values
    if layout == "xarray":
        import xarray as xr

        return xr.DataArray(array)
    return (
        memoryview(array) if layout == "memoryview" and array.dtype.kind == "f" and array.dtype.itemsize == 8 else array
    )

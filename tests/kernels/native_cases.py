"""Calls of every kind, right and wrong, for native functions: the general path says what each of them gives."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import armwright as aw
from armwright.errors import ArmwrightError
from armwright.kernels.signatures import SIGNATURES


class Named(np.ndarray):
    """A subclass that NumPy's own functions keep."""


class Foreign:
    """Something that gives an array when it is asked for one."""

    def __init__(self, array: np.ndarray):
        self.array = array

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return self.array if dtype is None else self.array.astype(dtype)


class Failing:
    """Something that fails when it is asked for an array."""

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        raise RuntimeError("no array")


def read_only(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array


def unaligned(array: np.ndarray) -> np.ndarray:
    room = np.zeros(array.nbytes + 1, np.uint8)[1:]
    whole = room.view(array.dtype).reshape(array.shape)
    whole[...] = array
    return whole


def from_buffer(array: np.ndarray) -> np.ndarray:
    """A view of memory that only the view holds."""
    return np.frombuffer(bytearray(array.tobytes()), array.dtype).reshape(array.shape)


def masked(array: np.ndarray) -> np.ndarray:
    return np.ma.masked_array(array, mask=np.arange(array.size).reshape(array.shape) % 3 == 1)


def data_array(array: np.ndarray) -> Any:
    import xarray as xr

    return xr.DataArray(array)


#: What a caller may give in the place of a float64 array.
FORMS: dict[str, Callable[[np.ndarray], Any]] = {
    "array": lambda a: a,
    "copy": np.copy,
    "list": np.ndarray.tolist,
    "tuple": lambda a: tuple(a.tolist()),
    "read only": read_only,
    "unaligned": unaligned,
    "from a buffer": from_buffer,
    "foreign": Foreign,
    "failing": lambda a: Failing(),
    "xarray": data_array,
    "matrix": np.asmatrix,
    "subclass": lambda a: a.view(Named),
    "masked": masked,
    "unmasked": np.ma.masked_array,
    "record": lambda a: a.view(np.recarray),
    "float32": lambda a: a.astype(np.float32),
    "float16": lambda a: a.astype(np.float16),
    "longdouble": lambda a: a.astype(np.longdouble),
    "integers": lambda a: np.round(a).astype(int),
    "booleans": lambda a: a > 0,
    "complex": lambda a: a.astype(complex),
    "texts": lambda a: a.astype(str),
    "objects": lambda a: a.astype(object),
    "swapped": lambda a: a.astype(a.dtype.newbyteorder()),
    "annotated": lambda a: a.astype(np.dtype(float, metadata={"of": "a joint"})),
    "dates": lambda a: a.astype("m8[s]"),
    "backwards": lambda a: a[..., ::-1],
    "every other": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "fortran": np.asfortranarray,
    "zero strides": lambda a: np.broadcast_to(a[..., :1], a.shape),
    "one more axis": lambda a: a[None],
    "one axis less": lambda a: a[0],
    "one number more": lambda a: np.concatenate([a, a[..., :1]], axis=-1),
    "one number less": lambda a: a[..., :-1],
    "empty": lambda a: a[..., :0],
    "no states": lambda a: np.zeros((0, *a.shape)),
    "no states, huge": lambda a: np.zeros((1 << 40, 0, *a.shape)),
    "many axes": lambda a: a.reshape((1,) * 20 + a.shape),
    "huge, of one number": lambda a: np.broadcast_to(a, (3000, *a.shape)),
    "a number": lambda a: 1.0,
    "none": lambda a: None,
    "text": lambda a: "q",
    "not a number": lambda a: np.full(a.shape, np.nan),
    "infinite": lambda a: np.full(a.shape, np.inf),
    "subnormal": lambda a: np.full(a.shape, 5e-324),
    "large": lambda a: 1e6 * a,
}
LEADS = (), (1,), (2,), (8,), (64,), (3, 5), (2, 1, 2), (1, 1, 1, 2), (1, 1, 1, 1, 2), (700,), (0,), (4, 0)


def states(dyn: aw.CompiledArm, name: str, lead: tuple[int, ...], rng: np.random.Generator) -> list[np.ndarray]:
    """Random arrays for a kernel, of `dyn`'s dtype."""
    return [
        rng.uniform(-2.0, 2.0, (*lead, *argument.sized(dyn.arm))).astype(dyn.dtype)
        for argument in SIGNATURES[name].inputs
    ]


def general(dyn: aw.CompiledArm, name: str) -> Callable[..., Any]:
    """The method itself, which never is a native function."""
    return getattr(type(dyn), name).__get__(dyn)


def outcome(call: Callable[..., Any], *arrays: Any, **named: Any) -> tuple[Any, ...]:
    """All that a call shows: types, dtypes, shapes, layouts and bits of its results, or its error."""
    try:
        result = call(*arrays, **named)
    except (ArmwrightError, RuntimeError, TypeError, ValueError) as error:
        return type(error), str(error)
    parts = result if isinstance(result, tuple) else (result,)
    return type(result), *(
        (type(a), a.dtype.str, a.shape, a.flags.c_contiguous, a.flags.writeable, a.tobytes()) for a in parts
    )


def odd_calls(
    dyn: aw.CompiledArm, name: str, rng: np.random.Generator
) -> Iterator[tuple[str, tuple[Any, ...], dict[str, Any]]]:
    """Names, positional and keyword arguments of calls with one array in another form, too many, too few, by keyword."""
    for lead in ((), (3,)):
        arrays = states(dyn, name, lead, rng)
        names = [argument.name for argument in SIGNATURES[name].inputs]
        for form, make in FORMS.items():
            for place in range(len(arrays)):
                changed = [make(array) if k == place else array for k, array in enumerate(arrays)]
                yield f"{form} for {names[place]}, lead {lead}", tuple(changed), {}
            yield f"{form}, lead {lead}", tuple(make(array) for array in arrays), {}
        yield f"by keyword, lead {lead}", (), dict(zip(names, arrays, strict=True))
        yield f"by both, lead {lead}", tuple(arrays[:-1]), {names[-1]: arrays[-1]}
        yield f"given twice, lead {lead}", tuple(arrays), {names[0]: arrays[0]}
        yield f"unknown keyword, lead {lead}", tuple(arrays), {"nonsense": 1}
        yield f"too few, lead {lead}", tuple(arrays[:-1]), {}
        yield f"too many, lead {lead}", (*arrays, arrays[0], arrays[0]), {}
        yield f"one array everywhere, lead {lead}", (arrays[0],) * len(arrays), {}
        yield f"a wrong out, lead {lead}", tuple(arrays), {"out": np.empty(1)}
    yield "nothing", (), {}
    yield "unlike axes", tuple(states(dyn, name, (k + 2,), rng)[k] for k in range(len(arrays))), {}

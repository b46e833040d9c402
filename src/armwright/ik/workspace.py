"""Workspace of an arm: positions of its tip and manipulability, at random joint positions within the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armwright.entry import AnyArm, as_arm
from armwright.errors import ModelError
from armwright.ik.measures import checked_task, limit_margin, measures
from armwright.ik.starts import sampled_ranges

if TYPE_CHECKING:
    import xarray as xr

PERCENTILES = (0.0, 1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 99.0, 100.0)
SAMPLES, MOST = 1_000_000, 50_000_000

UNITS = {
    "position": "m", "reach": "m", "manipulability": "(m/rad)^m", "smallest_singular_value": "m/rad",
    "condition": "1", "limit_margin": "1",
}  # fmt: skip


def workspace(
    arm: AnyArm,
    samples: int = SAMPLES,
    *,
    frame: str | None = None,
    aim: str = "pose",
    length: float = 1.0,
    seed: int = 0,
    threads: int = 1,
) -> xr.Dataset:
    """Positions of the tip at random joint positions, evenly within the limits, with the measures of `manipulability` there.

    Joints without limits are drawn from a whole turn, sliding ones from half a metre to either side. Even in joint positions
    is not even in space: dense places are those that many joint positions reach.

    Args:
        arm: whose joints move.   samples: joint positions, 1 to 50 million.
        frame: name of a frame of the arm; by default its tip.
        aim: rows that count, and length: [m] that a turn by 1 rad counts as, both as in `manipulability`.
        seed: of the samples.   threads: that share the work.
    Returns:
        dataset: over `sample`: `q`, `position` [m], `reach` [m] (distance from the base's origin), `manipulability`,
            `smallest_singular_value`, `condition`, `limit_margin`; over `percentile`: `<name>_percentiles` of the last five.
    Raises:
        ModelError: no such frame or aim, samples, length or threads that are none, or an arm that branches and names no tip.
    Example:
        >>> reach = aw.kinematics.workspace("two-link", samples=10_000)
        >>> round(float(reach.reach.max()), 2)  # the farthest that the tip comes
        1.8
    """
    arm = as_arm(arm)
    import xarray as xr

    checked_task(arm, aim, length)
    for place, value, most in (("samples", samples, MOST), ("threads", threads, None)):
        if isinstance(value, bool) or not isinstance(value, int) or value < 1 or (most is not None and value > most):
            expected = "a whole number, 1 or more" if most is None else f"a whole number from 1 to {most}"
            raise ModelError(place=place, value=value, expected=expected)
    kernel = measures(arm, frame, aim, float(length))
    low, high = sampled_ranges(arm)
    q = np.random.default_rng(seed).uniform(low, high, (samples, arm.n))
    position, sigma = kernel(q, threads=threads)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = {
            "reach": np.linalg.norm(position, axis=1),
            "manipulability": sigma.prod(axis=1),
            "smallest_singular_value": sigma[:, -1],
            "condition": sigma[:, 0] / sigma[:, -1],
            "limit_margin": limit_margin(arm, q),
        }
    dataset = xr.Dataset(
        {"q": (("sample", "joint"), q), "position": (("sample", "axis"), position)}
        | {name: ("sample", each) for name, each in values.items()}
        | {f"{name}_percentiles": ("percentile", _percentiles(each)) for name, each in values.items()},
        coords={"joint": list(arm.names), "axis": ["x", "y", "z"], "percentile": list(PERCENTILES)},
        attrs={
            "arm": arm.name, "frame": "tip" if frame is None else frame, "aim": aim, "length": float(length),
            "seed": seed, "samples": samples,
        },
    )  # fmt: skip
    for name, unit in UNITS.items():
        dataset[name].attrs["units"] = unit.replace("^m", f"^{sigma.shape[1]}")
    return dataset


def _percentiles(values: np.ndarray) -> np.ndarray:
    """(9,) values at `PERCENTILES`, each that of a sample: none is made up between a number and infinity."""
    return np.percentile(values, PERCENTILES, method="nearest")

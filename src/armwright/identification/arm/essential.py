"""Essential parameters: those of a fit with small relative errors; the others are set to 0. [PhamGautier1991]

The parameter with the largest relative deviation 100 σ_i / |β_i| is taken out, the rest is fitted again, and so on until the
residual has grown by more than a stated share. A parameter that is taken out is not known to be 0: the log does not tell it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from armwright.errors import IdentificationError


@dataclass(frozen=True, eq=False)
class EssentialParameters:
    """Essential parameters of a least-squares problem.

    Attributes:
        kept: (e,) their numbers, in order.   values: (b,) with 0 for all others.   covariance: (e, e) of those kept.
        dropped: numbers of the others, the worst first.   relative: (b,) largest 100 σ/|β| of each: when it was taken out, or in
            the end.   growth: of the residual's norm, as a share.
    """

    kept: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    dropped: tuple[int, ...]
    relative: np.ndarray
    growth: float


def essential_parameters(
    R: np.ndarray,
    z: np.ndarray,
    residual: float,
    rows: int,
    *,
    growth: float = 0.01,
    well_told: float = 10.0,
    inflation: np.ndarray | None = None,
) -> EssentialParameters:
    """Essential parameters of  min |R β − z|² + residual²,  R the triangle of all weighted rows.

    Args:
        R: (b, b).   z: (b,).   residual: norm of what no β explains.   rows: number of rows behind R.
        growth: share by which the residual's norm may grow.   well_told: relative deviation in %; a parameter with this
            or less is never taken out.
        inflation: (b,) factors from white standard deviations to robust ones; None: 1.
    Raises:
        IdentificationError: parameters that the rows cannot distinguish, or no freedom left.
    """
    R, z = np.asarray(R, dtype=float), np.asarray(z, dtype=float)
    b = R.shape[1]
    if rows <= b or R.shape != (b, b) or z.shape != (b,):
        what = f"{rows} rows, shapes {R.shape} and {z.shape}"
        raise IdentificationError(what, place="R and z", expected="(b, b) and (b,), and more than b rows")
    if not growth >= 0:
        raise IdentificationError(place="growth", value=growth, expected="a share, 0 or more")
    inflation = np.ones(b) if inflation is None else np.asarray(inflation, dtype=float)
    kept, dropped, relative = list(range(b)), [], np.zeros(b)
    first = total = max(residual, np.finfo(float).tiny)
    values, covariance, _ = _solved(R, z, kept)
    covariance = total**2 / (rows - b) * covariance
    while kept:
        with np.errstate(divide="ignore"):
            relative[kept] = 100 * inflation[kept] * np.sqrt(np.diag(covariance)) / np.abs(values)
        worst = int(np.argmax(relative[kept]))
        if relative[kept[worst]] <= well_told:
            break
        fewer = kept[:worst] + kept[worst + 1 :]
        fewer_values, spread, rest = _solved(R, z, fewer)
        new = float(np.hypot(residual, rest))
        if new > (1 + growth) * first:
            break
        dropped.append(kept[worst])
        kept, total, values, covariance = fewer, new, fewer_values, new**2 / (rows - len(fewer)) * spread
    full = np.zeros(b)
    full[kept] = values
    return EssentialParameters(np.array(kept, dtype=int), full, covariance, tuple(dropped), relative, total / first - 1)


def _solved(R: np.ndarray, z: np.ndarray, kept: list[int]) -> tuple[np.ndarray, np.ndarray, float]:
    """Values of some parameters, all others 0, their covariance for a variance of 1, and the norm of what is left of z."""
    size = np.linalg.norm(R[:, kept], axis=0)
    expected = "base parameters, which the rows distinguish"
    if not (size > 0).all():
        raise IdentificationError("a column of zeros", place="R", expected=expected)
    Q, T = np.linalg.qr(R[:, kept] / size)
    if (np.abs(np.diag(T)) < 1e-13).any():
        raise IdentificationError("dependent columns", place="R", expected=expected)
    inverse = scipy.linalg.solve_triangular(T, np.eye(len(kept))) / size[:, None]
    rest = float(np.linalg.norm(z - Q @ (Q.T @ z)))
    return scipy.linalg.solve_triangular(T, Q.T @ z) / size, inverse @ inverse.T, rest

"""Triangular factors of matrices with any number of rows, block by block (TSQR). [DemmelEtAl2012]"""

from __future__ import annotations

import numpy as np
from scipy.linalg import get_lapack_funcs

ROWS = 256  # of a block: it stays in the processor's cache
# At once: with more, LAPACK's products are large enough for threads, which cost more here than they bring.
REFLECTIONS = 8

(_tpqrt,) = get_lapack_funcs(("tpqrt",), dtype=np.float64)


def triangle(rows: np.ndarray, above: np.ndarray | None = None) -> np.ndarray:
    """R (k, k) of the QR decomposition of [above; rows]:  RᵀR = aboveᵀ above + rowsᵀ rows.

    Args:
        rows: (m, k).   above: (k, k), a triangle from before; None: zeros.
    """
    k = rows.shape[1]
    result = np.zeros((k, k), order="F") if above is None else np.array(above, order="F")
    for begin in range(0, len(rows) if k else 0, ROWS):
        block = np.array(rows[begin : begin + ROWS], dtype=float, order="F")
        result, _, _, info = _tpqrt(0, min(REFLECTIONS, k), result, block, overwrite_a=True, overwrite_b=True)
        assert info == 0
    return np.triu(result)

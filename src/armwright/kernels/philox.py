"""Random numbers by counting: Philox 4×32, ten rounds. [SalmonEtAl2011]

A number depends on the key and on its place in the sequence, and on nothing that was drawn before: lanes, ticks and channels
can be drawn in any order, on any number of threads.
"""

from __future__ import annotations

import numpy as np

M0, M1 = 0xD2511F53, 0xCD9E8D57
W0, W1 = 0x9E3779B9, 0xBB67AE85  # golden ratio and √3 - 1
ROUNDS = 10
LOW = 0xFFFFFFFF


def philox(counter: np.ndarray, key: np.ndarray) -> np.ndarray:
    """Four 32-bit numbers (…, 4) from counters (…, 4) and keys (…, 2), all of uint64 below 2³²."""
    c0, c1, c2, c3 = (np.asarray(c, dtype=np.uint64) for c in np.moveaxis(np.asarray(counter), -1, 0))
    k0, k1 = (np.asarray(k, dtype=np.uint64) for k in np.moveaxis(np.asarray(key), -1, 0))
    low, shift = np.uint64(LOW), np.uint64(32)
    for _ in range(ROUNDS):
        a, b = np.uint64(M0) * c0, np.uint64(M1) * c2
        c0, c1, c2, c3 = (b >> shift) ^ c1 ^ k0, b & low, (a >> shift) ^ c3 ^ k1, a & low
        k0, k1 = (k0 + np.uint64(W0)) & low, (k1 + np.uint64(W1)) & low
    return np.stack(np.broadcast_arrays(c0, c1, c2, c3), axis=-1)


def uniform(seed: int, lane: np.ndarray, tick: int, channel: int, entries: int) -> np.ndarray:
    """Numbers in (0, 1), (…, entries), of lanes (…) in a tick: each of 52 random bits and a half.

    Two of a Philox call's numbers make one:  u = (c_high 2²⁰ + c_low 2⁻¹² + ½) 2⁻⁵².
    """
    lane = np.asarray(lane, dtype=np.uint64)
    key = np.array([seed & LOW, seed >> 32 & LOW], dtype=np.uint64)
    columns = []
    for call in range(-(-entries // 2)):
        fixed = [np.full(lane.shape, v, dtype=np.uint64) for v in (tick & LOW, tick >> 32 << 16 | channel, call)]
        c = philox(np.stack([lane & np.uint64(LOW), *fixed], axis=-1), key)
        for high, low in ((c[..., 0], c[..., 1]), (c[..., 2], c[..., 3])):
            bits = high << np.uint64(20) | low >> np.uint64(12)
            columns.append((bits.astype(float) + 0.5) * 2.0**-52)
    return np.stack(columns[:entries], axis=-1)

"""Hundred thousand states in one call: batches, broadcasting, out= and threads.

Run it:  python examples/03_batches.py
"""

import time

import numpy as np

import armwright as aw

arm = aw.load("puma560")
dyn = aw.compile(arm)
random = np.random.default_rng(0)
q, qd, qdd = random.uniform(-1, 1, (3, 100_000, arm.n))

out = np.empty_like(q)
for threads in (1, dyn.threads):
    dyn.threads = threads
    dyn.inverse_dynamics(q, qd, qdd, out=out)  # compiled when first used
    times = []
    for _ in range(10):
        start = time.perf_counter()
        dyn.inverse_dynamics(q, qd, qdd, out=out)
        times.append(time.perf_counter() - start)
    print(f"inverse dynamics, 100,000 states, {threads} thread(s): {min(times) / len(q) * 1e9:.1f} ns a state")

# The same bits alone as in the batch, and the same numbers as the float reference.
one = dyn.inverse_dynamics(q[77], qd[77], qdd[77])
reference = aw.inverse_dynamics(arm, q[77], qd[77], qdd[77])
print(f"alone = in the batch, bit for bit: {np.array_equal(one, out[77])}")
print(f"against the float reference:       {np.abs(one - reference).max():.1e} N m")

# Leading axes broadcast as in NumPy: a grid of shoulder and elbow angles, one wrench for all of it.
grid = np.zeros((61, 41, arm.n))
grid[..., 1], grid[..., 2] = np.linspace(-1.5, 1.5, 61)[:, None], np.linspace(-2, 2, 41)
torques = dyn.bias_torques(grid, np.zeros(arm.n), wrench=[0, 0, -20.0, 0, 0, 0])
print(
    f"largest shoulder torque with 20 N pulling down: {np.abs(torques[..., 1]).max():.1f} N m, of {torques.shape} values"
)

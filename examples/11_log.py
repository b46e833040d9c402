"""A log of measurements: encoder counts, a speed in the wrong unit, and what the checks say about it."""

import tempfile
from pathlib import Path

import numpy as np

import armwright as aw

arm = aw.load("two-link")
run = aw.simulate(aw.Scenario(arm, 4.0, command=[4.0, 1.5]))
folder = Path(tempfile.mkdtemp())
counts = 20000  # of an encoder in a turn of the joint
t, q, qd, tau = (run[name].values for name in ("time", "q", "qd", "tau"))
table = np.column_stack([t, np.round(q * counts / (2 * np.pi)), qd * 180 / np.pi, tau])
np.savetxt(folder / "bench.csv", table, delimiter=",", header="t,c1,c2,v1,v2,m1,m2", comments="")

description = """
robot = "two-link"
files.bench.path = "bench.csv"
time = { column = "t", unit = "s" }
signals = [
    { quantity = "position", columns = ["c1", "c2"], unit = "counts", counts_per_turn = 20000, side = "joint" },
    { quantity = "speed", columns = ["v1", "v2"], unit = "rad/s", side = "joint" },
    { quantity = "torque", columns = ["m1", "m2"], unit = "N m", side = "joint" },
]
"""
file = folder / "bench.log.toml"
file.write_text(description, encoding="utf-8")
for finding in aw.identification.read_log(file, on_error="keep").errors:
    print(finding)

file.write_text(description.replace("rad/s", "deg/s"), encoding="utf-8")
log = aw.identification.read_log(file)  # raises if it finds an error
data = aw.identification.prepare_log(log)
print("\n".join(aw.identification.choose_preparation(log).reasons))
speeds = np.stack([np.interp(data["time"], t, column) for column in qd.T], axis=1)
print(f"speeds from counts, filtered: off by {np.abs(data['qd'].values - speeds).max():.1e} rad/s at most")

"""A motor from a log of volts, amperes and encoder counts: its constants with error bars, and the delay of the loop."""

import tempfile
from pathlib import Path

import numpy as np

import armwright as aw

folder, rng, period, rows = Path(tempfile.mkdtemp()), np.random.default_rng(0), 0.005, 1200
volts = np.repeat(rng.uniform(-10, 10, rows // 30), 30)  # a level of 0.15 s behind the other
times = (np.arange(rows) + 2.3) * period  # every command acts 2.3 samples late
run = aw.simulate(
    aw.Scenario(
        aw.load(Path(__file__).with_name("motor.toml")),
        period * (rows - 1),
        command=aw.Schedule(np.concatenate([[0.0], times]), np.concatenate([volts[:1], volts])[:, None], ("motor",)),
        recording=aw.Recording(period=period),
        solver=aw.Solver(step=period / 50, integrator="rk4"),
    )
)
counts = np.round(run.q.values[:, 0] * 4096 / (2 * np.pi))
amperes = np.round((run.current.values[:, 0] + 0.05 * rng.standard_normal(rows)) / 0.005) * 0.005
table = np.column_stack([np.arange(rows) * period, volts, amperes, counts])
np.savetxt(folder / "bench.csv", table, delimiter=",", header="t,u,i,c", comments="")
description = """
joints = ["motor"]
files.bench.path = "bench.csv"
time = { column = "t", unit = "s" }
signals = [
    { quantity = "voltage", columns = "u", unit = "V" },
    { quantity = "current", columns = "i", unit = "A" },
    { quantity = "position", columns = "c", unit = "counts", counts_per_turn = 4096, side = "joint" },
]
"""
(folder / "bench.log.toml").write_text(description, encoding="utf-8")
fit = aw.identification.identify_motor(folder / "bench.log.toml", search=aw.identification.MotorSearch(starts=4))
print(fit.estimate.tables()[0])
low, high = fit.estimate.interval("motor.motor.resistance_ohm")
print(f"R between {low:.4f} and {high:.4f} Ω (true: 1.3), delay {fit.estimate['delay_s'] / period:.3f} samples")

"""A log as it comes: rows repeated, lost, frozen, stamps that jitter, counts, glitches; and what preparation makes of each."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)
arm = aw.load("two-link")
run = aw.simulate(aw.Scenario(arm, 8.0, command=[3.0, 1.0], start=[-1.0, 0.5]))  # it swings
k, rng, T = np.arange(run.sizes["time"]), np.random.default_rng(1), 1e-3
run = run.assign({n: run[n] + size * rng.normal(size=run[n].shape) for n, size in (("q", 1e-5), ("tau", 0.1))})
again, kept = np.where(rng.random(len(k)) < 0.2, 0, k), k[rng.random(len(k)) > 0.2]
defects = {  # rows of the run, their stamps, counts [rad], share of glitches
    "rows repeated: left out": (np.maximum.accumulate(again), k * T, 1e-9, 0),
    "rows lost: bridged": (kept, kept * T, 1e-9, 0),
    "rows frozen: left out": (np.where(k // 100 % 13 == 5, k // 100 * 100, k), k * T, 1e-9, 0),
    "stamps jitter: rows are even": (k, np.sort(k + 0.15 * rng.normal(size=len(k))) * T, 1e-9, 0),
    "counts of 10 mrad: smoothed": (k, k * T, 0.01, 0),
    "glitches: replaced": (k, k * T, 1e-9, 0.02),
}
figure, axes = plt.subplots(2, 3, figsize=(11, 5.6), layout="constrained")
for axis, (title, (rows, stamps, count, glitches)) in zip(axes.flat, defects.items(), strict=True):
    worn = run.isel(time=rows).assign_coords(time=stamps)
    worn["q"] = np.round((worn.q + 0.1 * (rng.random(worn.q.shape) < glitches)) / count) * count
    aw.save(worn, folder / "worn.csv")
    log = aw.identification.write_log(worn, folder / "worn.csv", folder / "worn.log.toml", arm)
    even = aw.identification.prepare_log(log, None, aw.identification.choose_preparation(log, cutoff=12.0, decimate=1))
    even["time"] = even.time + stamps[0]  # a log begins at its first row
    off = [1e3 * (each.q[:, 1] - np.interp(each.time, run.time, run.q[:, 1])) for each in (worn, even)]
    for each, style in zip((off[0], off[1].where(even.stretch.diff("time") == 0)), ".-", strict=True):
        axis.plot(each.time, each, style, markersize=4)
    xlim = (1, 2.8) if "frozen" in title or glitches else (1.9, 1.95)
    axis.set(title=title, xlabel="time [s]", ylabel="error [mrad]", xlim=xlim)
    print(f"{title:29} off by {np.abs(off[0]).mean():.3f} mrad as logged, {np.abs(off[1]).mean():.3f} mrad prepared")
figure.savefig(folder / "worn_log.png", dpi=110)

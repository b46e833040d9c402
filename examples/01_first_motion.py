"""Voltages in, motion out: six motor voltages move the direct-drive arm for a second and a half.

Run it:  python examples/01_first_motion.py [FOLDER]
"""

import sys
from pathlib import Path

import armwright as aw

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples")
folder.mkdir(parents=True, exist_ok=True)

arm = aw.load("cmu-dd")
# three rows of volts, each held
schedule = aw.simulation.read_schedule(Path(__file__).with_name("cmu-dd-steps.csv"), arm.names)
run = aw.simulate(aw.Scenario(arm, command=schedule, duration=1.5))

end = run.isel(time=-1)
print(f"{arm.name} at t = {float(end.time):g} s")
for joint in arm.names:
    q, qd = float(end.q.sel(joint=joint)), float(end.qd.sel(joint=joint))
    print(f"  {joint}  q = {q:7.4f} rad   qd = {qd:7.4f} rad/s")

aw.save(run, folder / "first_motion.nc")  # or .csv, .parquet
aw.plot(run, folder / "first_motion.png")  # or .svg, .pdf, .html

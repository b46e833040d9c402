"""Logs of two runs of an arm, one to fit and one held out, from its own inverse dynamics with noise."""

from __future__ import annotations

from pathlib import Path

import armwright as aw
from identification.arm.simulated_log import write_log

RUN = '[[runs]]\nname = "{name}"\nfiles.log = "{name}/log.csv"\nuse = "{use}"\n'


def two_runs(
    folder: Path,
    arm: aw.Model,
    *,
    seconds: float = 20.0,
    noise: float = 0.1,
    seed: int = 0,
    fresh: aw.Model | None = None,
) -> Path:
    """Path of a log whose second run, perhaps of another arm, is held out; its motion is another one."""
    for name, number, moved in (("fitted", seed, arm), ("fresh", seed + 1000, fresh or arm)):
        (folder / name).mkdir(parents=True)
        write_log(folder / name, moved, seconds=seconds, noise=noise, seed=number)
    runs = RUN.format(name="fitted", use="fit") + RUN.format(name="fresh", use="hold-out")
    text = (folder / "fitted" / "arm.log.toml").read_text().replace('path = "log.csv"\n', "")
    path = folder / "arm.log.toml"
    path.write_text(text.replace("[time]", f"{runs}[time]"))
    return path

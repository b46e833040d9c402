"""`armwright sweep`: millions of lanes, on one machine or many; a stopped sweep can be continued."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import typer

import armwright as aw
from armwright.cli.arguments import SCENARIO, Allow, argument, as_options, flag, option, output_option
from armwright.cli.outcome import exit_unless, say_each
from armwright.errors import ArmwrightError, ScenarioError
from armwright.progress import progress, rate
from armwright.terminal import console, note, result, say

if TYPE_CHECKING:
    from armwright.sweeps.sweep import Sweep


def sweep(
    scenario: Path = argument("SCENARIO", "A .scenario.toml, whose lanes are drawn."),
    lanes: float = option("N", "How many lanes, such as 1e7.", ...),
    output: Path = output_option("STORE", "Where results go: a folder that ends in .zarr.", ...),
    scheduler: str | None = option("ADDRESS", "A Dask scheduler, tcp://host:8786; default: this machine alone."),
    chunk: int | None = option("K", "Lanes in a task; by default a task takes some seconds."),
    retries: int = option("K", "How often a chunk is tried again after an error.", 2),
    rows: bool = flag("--rows", "Store recorded rows too, not only the reducers' values."),
    verify: bool = flag("--verify", "Simulate nothing: read the whole store, and compare it with its checksums."),
    allow: Allow = None,
) -> None:
    """Simulate millions of lanes of a scenario in chunks, and store a few results of each.

    If the store exists, only missing and damaged chunks are simulated: after Ctrl-C, or any kill, the same command
    continues. The bits of the results do not depend on chunks, workers and their order. `aw.sweeps.load_sweep` reads them.

    Exit code: 0 all lanes are done, 1 chunks failed, 2 bad input, or the store cannot be written.

    \b
    Examples:
      armwright sweep robust.scenario.toml --lanes 1e6 -o runs.zarr
      armwright sweep robust.scenario.toml --lanes 1e7 -o runs.zarr --scheduler tcp://node1:8786
    """
    from armwright.scenarios.mistakes import key_in_file, keys_in_text

    if not scenario.name.endswith(SCENARIO):
        raise ScenarioError(place="SCENARIO", value=str(scenario), expected=f"a file that ends in {SCENARIO}")
    if verify:
        stored = aw.sweeps.load_sweep(output, verify=True).attrs
        finished, every = stored["lanes_finished"], stored["lanes"]
        console(soft_wrap=True).print(f"{output}: {finished:,} of {every:,} lanes are as written")
        say_each("armwright: chunk ", stored.get("failed_chunks", "").splitlines()[:3], err=True)
        return exit_unless(finished == every)
    made = aw.read_scenario(scenario, allow=allow or ())
    as_typed = as_options("lanes", "chunk", "retries", "scheduler")
    try:
        with as_typed, progress(f"sweeping {made.arm.name}", "lanes") as tell:
            done = aw.sweeps.sweep(
                made, output, lanes=lanes, client=scheduler, chunk=chunk, rows=rows, retries=retries, progress=tell
            )
    except ScenarioError as error:  # of the run, which does not know the file
        if all(str(each.place).startswith("--") for each in error.problems):
            raise
        raise error.renamed(key_in_file, keys_in_text).within(file=scenario) from None
    except KeyboardInterrupt:
        kept = 0
        with suppress(ArmwrightError):  # no chunk is finished, or not even the store is begun
            kept = aw.sweeps.load_sweep(output).attrs["lanes_finished"]
        note(
            f"stopped by Ctrl-C; {kept:,} finished lanes are kept in {output}: the same command continues with the others"
        )
        raise typer.Exit(130) from None
    _show(done)
    exit_unless(not done.failed)


def _show(done: Sweep) -> None:
    kept = f", {done.kept:,} were there" if done.kept else ""
    speed = rate(done.done / max(done.seconds, 1e-9), "lanes") if done.done else "nothing to do"
    lanes = f"{done.done:,} of {done.lanes:,} lanes{kept}"
    console(soft_wrap=True).print(f"{done.path}: {lanes}; {done.seconds:.1f} s, {speed}")
    result(done)
    failed = (f"{which} failed: {reason}" for which, reason in list(done.failed.items())[:3])
    say_each("armwright: chunk ", failed, err=True)
    if len(done.failed) > 3:
        say(f"armwright: and {len(done.failed) - 3} chunks more, see attribute failed_chunks", err=True)

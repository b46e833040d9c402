"""Names of the command line that were replaced: data of `spelling.Spelled`, which reads old names for one minor version.

    OLD[command][old] = new                      an option
    OLD[command][old] = "ROBOT"                  an option whose value is now the first argument
    OLD[command]["OUT"] = new                    a last argument that is now an option
    OLD[command][old] = (new, "1/x")             an option whose value changes too: a rate in Hz, now a period in s
    OLD[command][name] = (name, "deg")           a number in degrees, which is now written with its unit

A new name is never an old one of the same command.
"""

from __future__ import annotations

from collections.abc import Mapping

UNTIL = "0.3"  # the version that refuses the names of version 0.1

MARGIN = {"--phase-margin": ("--phase-margin", "deg")}
ROBOT = {"--robot": "ROBOT"}
START = {"--q0": "--start", "--qd0": "--start-velocity"}

Names = Mapping[str, str | tuple[str, str]]
OLD: Mapping[str, Names] = {
    "animate": ROBOT,
    "assemble": {"--limit": "--max-assemblies"},
    "calibrate": ROBOT,
    "capture": {
        "--motion": "--reference",
        "--rate": ("--period", "1/x"),
        "--step": "--goal-distance",
        "--torque": "--torque-fraction",
    },
    "compare-controllers": {"--motion": "--reference", "--runs": "--lanes"},
    "convert": {"OUT": "--output", "--motion": "--reference"},
    "design": MARGIN,
    "excite arm": {
        "--acceleration": "--max-acceleration",
        "--period": "--cycle",
        "--rate": ("--record-period", "1/x"),
        "--torque": "--max-torque",
        "--velocity": "--max-velocity",
    },
    "excite motor": {
        **ROBOT,
        "--gain": "--motor-gain",
        "--most": "--max-command",
        "--sample": "--period",
        "--speed": "--max-speed",
    },
    "excite poses": {"--count": "--poses"},
    "export controller": {"--counts": "--encoder-counts"},
    "export ros2": {"--command": "--command-interface", "--rate": "--update-rate"},
    "identify arm": ROBOT,
    "identify friction": ROBOT,
    "identify gains": {**ROBOT, "--mass": "--payload-mass", "--mass-std": "--payload-mass-std"},
    "identify linear": {"--input": "--input-signal", "--output": "--output-signal"},
    "identify motor": ROBOT,
    "identify payload": ROBOT,
    "identify servo": {"--gain": "--duty-gain", "--limit": "--max-duty", "--order": "--friction-models"},
    "loops": MARGIN,
    "measure bifilar": {**ROBOT, "--length": "--wire-length", "--period": "--swing-period"},
    "measure centre": ROBOT,
    "measure mass": ROBOT,
    "measure pendulum": {**ROBOT, "--period": "--swing-period"},
    "new robot": {"--command": "--drive-command", "--joints": "--joint-count"},
    "plan": {"--rate": ("--record-period", "1/x")},
    "run-controller": {"--arm": "--serial-number", "--step": "--goal-distance", "--torque": "--torque-fraction"},
    "shadow": {**ROBOT, "--counts": "--counts-per-turn"},
    "simulate": START,
    "step-study": {**START, "--accuracy": "--accuracies", "--steps": "--step-count"},
    "tune": {**MARGIN, "--start": "--start-gains"},
    "twin": {"--eds": "--write-eds", "--q0": "--start", "--schedule": "--write-schedule"},
}

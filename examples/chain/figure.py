"""The chain in one picture: the arm, torques that it was not fitted to, errors on the bench, commands of the C code."""

import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import armwright as aw

POSE = [-0.5, 0.5, 1.1, -0.3, 0.6, 0.0]
BLUE, ORANGE, GREEN, GREY, INK = "#0072B2", "#D55E00", "#009E73", "#999999", "#222222"
STAGES = "modules", "arm", "experiment", "identify", "validate", "plan", "tune", "C", "same bits", "twin"
JOINT = 1  # the second one carries most


def draw(path, arm, judged, runs, made):
    """Writes the picture.

    Args:
        path: of it.   arm: to be shown.   judged: verdicts on the identified record and on the modules' data.
        runs: on the bench, by controller, the last one that of the C code.   made: the exported controller.
    """
    with mpl.rc_context({"font.size": 9, "axes.titlesize": 9.5, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(11.4, 4.1), dpi=100, layout="constrained", facecolor="white")
        picture, torque, error, command = figure.subplots(1, 4, width_ratios=[0.74, 1, 1, 1])
        show_arm(picture, arm)
        show_torques(torque, *judged)
        show_errors(error, runs)
        show_commands(command, list(runs.values())[-1], made.comparison)
        figure.suptitle("  →  ".join(STAGES), color=INK)
        figure.savefig(path)


def show_arm(axes, arm):
    """The assembled arm."""
    with tempfile.TemporaryDirectory() as place:
        aw.show(arm, Path(place) / "arm.png", POSE, size=480)
        axes.imshow(mpl.image.imread(Path(place) / "arm.png"))
    axes.set_axis_off()
    axes.set_title(f"{arm.n} joints of modules")


def show_torques(axes, found, before):
    """Measured and predicted torques of the motion that was held out."""
    kept, first = (next(p for p in each.predictions if p.quantity == "torque") for each in (found, before))
    axes.plot(kept.t, kept.measured[:, JOINT], color=GREY, linewidth=4, label="measured")
    axes.plot(first.t, first.predicted[:, JOINT], color=ORANGE, linewidth=1, label="modules' data")
    axes.plot(kept.t, kept.predicted[:, JOINT], color=BLUE, linewidth=1, label="as identified")
    rms = [each.of("torque", each.arm.names[JOINT]).overall.rms for each in (found, before)]
    axes.set_title(f"Identified: off by {rms[0]:.2f} N m, before {rms[1]:.1f}")
    axes.set_ylabel("torque of joint 2 [N m]")
    axes.set_xlabel("time [s]")
    axes.legend(loc="upper left", fontsize=8, frameon=False)


def show_errors(axes, runs):
    """The largest error of any joint, for each controller."""
    for (name, run), colour in zip(runs.items(), (GREY, GREEN, ORANGE, BLUE), strict=True):
        errors = 1e3 * np.abs(run.q - run.q_reference).max("joint").values
        smooth = np.convolve(errors, np.full(25, 1 / 25), "same")  # over 0.1 s
        axes.semilogy(run.time[12:-12], smooth[12:-12], color=colour, linewidth=1.3, label=name)
    axes.set_title("Tuned: error of the worst joint [mrad]")
    axes.set_xlabel("time [s]")
    axes.set_ylim(bottom=0.02, top=900)
    axes.legend(loc="upper left", fontsize=8, frameon=False)


def show_commands(axes, run, comparison):
    """Commands of the simulation and, where there is a compiler, of the C code."""
    axes.plot(run.time, run.u_issued[:, JOINT], color=GREY, linewidth=4, label="simulation")
    title = "Exported: commands of the C code"
    if comparison is not None:
        times = run.time[: comparison.ticks]
        axes.plot(times, comparison.commands[:, JOINT], color=BLUE, linewidth=1, label="compiled C")
        title = f"C code: {comparison.ticks - comparison.others} of {comparison.ticks} bit-equal"
    axes.set_title(title)
    axes.set_ylabel("current of joint 2 [A]")
    axes.set_xlabel("time [s]")
    axes.legend(loc="lower left", fontsize=8, frameon=False)

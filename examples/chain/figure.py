"""The chain in one picture: the arm, torques that it was not fitted to, errors on the bench, commands of the C code."""

import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import armwright as aw

POSE = [-0.5, 0.5, 1.1, -0.3, 0.6, 0.0]
BLUE, ORANGE, GREEN, GREY, INK = "#0072B2", "#D55E00", "#009E73", "#999999", "#777777"  # seen on white and on black
STAGES = "modules", "identify", "plan", "tune", "C", "twin"
JOINT = 1  # the second one carries most
STYLE = {
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK),
    **dict.fromkeys(("axes.facecolor", "savefig.facecolor"), "none"),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.frameon"), False),
    **dict.fromkeys(("font.size", "axes.titlesize"), 15),  # read at half its size, too
}


def draw(path, arm, judged, runs, made):
    """Writes the picture, on a transparent ground.

    Args:
        path: of it.   arm: to be shown.   judged: verdicts on the identified record and on the modules' data.
        runs: on the bench, by controller, the last one that of the C code.   made: the exported controller.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.4, 7.2), dpi=100, layout="constrained", facecolor="none")
        (picture, torque), (error, command) = figure.subplots(2, 2, width_ratios=[1, 1.08])
        show_arm(picture, arm)
        show_torques(torque, *judged)
        show_errors(error, runs)
        show_commands(command, list(runs.values())[-1], made.comparison)
        figure.suptitle("  →  ".join(STAGES))
        figure.savefig(path)


def show_arm(axes, arm):
    """The assembled arm."""
    with tempfile.TemporaryDirectory() as place:
        aw.show(arm, Path(place) / "arm.png", POSE, size=700)
        axes.imshow(mpl.image.imread(Path(place) / "arm.png")[:-82])  # without base axes and scale
    axes.set_axis_off()
    axes.set_title(f"{arm.n} joints, from modules")


def show_torques(axes, found, before):
    """Measured and predicted torques of the motion that was held out."""
    kept, first = (next(p for p in each.predictions if p.quantity == "torque") for each in (found, before))
    axes.plot(kept.t, kept.measured[:, JOINT], color=GREY, linewidth=6, label="measured")
    axes.plot(first.t, first.predicted[:, JOINT], color=ORANGE, linewidth=1.8, label="modules' data")
    axes.plot(kept.t, kept.predicted[:, JOINT], color=BLUE, linewidth=1.8, label="as identified")
    rms = [each.of("torque", each.arm.names[JOINT]).overall.rms for each in (found, before)]
    axes.set_title(f"off by {rms[0]:.2f} N m, before {rms[1]:.1f}")
    axes.set_ylabel("torque, joint 2 [N m]")
    axes.set_ylim(top=120)
    axes.set_xlabel("time [s]")
    axes.legend(loc="upper left", fontsize=13)


def show_errors(axes, runs):
    """The largest error of any joint, for each controller: its gains, and feed-forward with either model."""
    names = "first gains", "tuned", "+ modules' model", "+ identified model"
    for name, run, colour in zip(names, runs.values(), (GREY, GREEN, ORANGE, BLUE), strict=True):
        errors = 1e3 * np.abs(run.q - run.q_reference).max("joint").values
        smooth = np.convolve(errors, np.full(25, 1 / 25), "same")  # over 0.1 s
        axes.semilogy(run.time[12:-12], smooth[12:-12], color=colour, linewidth=1.8, label=name)
    axes.set_title("error of the worst joint")
    axes.set_ylabel("[mrad]")
    axes.set_xlabel("time [s]")
    axes.set_ylim(bottom=0.02, top=1e5)
    axes.legend(loc="upper left", fontsize=13)


def show_commands(axes, run, comparison):
    """Commands of the simulation and, where there is a compiler, of the C code."""
    axes.plot(run.time, run.u_issued[:, JOINT], color=GREY, linewidth=6, label="simulation")
    title = "current, joint 2 [A]"
    if comparison is not None:
        times = run.time[: comparison.ticks]
        axes.plot(times, comparison.commands[:, JOINT], color=BLUE, linewidth=1.8, label="compiled C")
        title = f"C: {comparison.ticks - comparison.others} of {comparison.ticks} bit-equal"
    axes.set_title(title)
    axes.set_ylabel("current, joint 2 [A]")
    axes.set_xlabel("time [s]")
    axes.set_ylim(top=6)
    axes.legend(loc="upper left", fontsize=13)

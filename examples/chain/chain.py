"""From modules to C: assemble an arm, measure it, identify, validate, plan, tune, export its controller, and run that.

Run it:  python examples/chain/chain.py [FOLDER]
"""

import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from figure import draw

import armwright as aw

HERE = Path(__file__).parent
COUNTS, AMPERES = 360000, 1e-3  # of the log: counts in an encoder's turn, and the step of a current [A]


def say(stage, text):
    """One line of a stage, with the number that matters."""
    print(f"{stage:<9} {text}", flush=True)


def assemble(folder):
    """The arm that the modules make, by the data of the modules."""
    robot = aw.modules.assemble(folder / "arm.assembly.toml")
    aw.robotfiles.write_toml(robot, folder / "arm.toml")
    arm = aw.load(folder / "arm.toml")
    say("modules", f"base PB21 L1 PB22 L2 PB23 L3: {arm.n} joints, {robot.total_mass:.4g} kg")
    return arm


def measure(folder, arm):
    """The scenario of the bench, and logs of two motions: a designed one to fit, and another one to judge."""
    bench = aw.read_scenario(folder / "bench.scenario.toml")  # its [values] are the arm's secret
    limits = aw.trajectories.MotionLimits.of(arm, velocity=0.8, torque=np.inf)
    designed = aw.identification.design_excitation(arm, limits=limits, cycle=12.0, harmonics=3, starts=1)
    centre, sine, cosine = (np.round(getattr(designed.trajectory, name), 4) for name in ("centre", "sine", "cosine"))
    excited = aw.trajectories.Fourier.at_rest(centre, sine, cosine, cycle=12.0, cycles=1)
    other = aw.trajectories.Fourier.at_rest(centre, -0.7 * sine, 0.7 * cosine, cycle=10.0, cycles=1)
    for name, motion in (("excited", excited), ("other", other)):
        loop = replace(bench.loop, reference=motion)
        run = aw.simulate(replace(bench, loop=loop, start=motion(0.0)[0], duration=motion.cycle))
        counts = np.rint(run.q_measured.values * COUNTS / (2 * np.pi))
        amperes = np.rint(run.current_measured.values / AMPERES) * AMPERES
        header = ",".join(["t", *(f"{column}{k + 1}" for column in "ci" for k in range(arm.n))])
        formats = ["%.6f"] + ["%d"] * arm.n + ["%.3f"] * arm.n
        rows = np.column_stack([run.time, counts, amperes])
        np.savetxt(folder / f"{name}.csv", rows, formats, ",", header=header, comments="")
    kind = "counts of 0.001°, 20 mA of noise, commands a tick late, 1 % of samples lost"
    say("measure", f"condition number {designed.condition:.1f}, 22 s at 250 Hz: {kind}")
    return bench


def identify(folder, arm):
    """The arm's own numbers, from counts and amperes."""
    found = aw.identification.identify_arm(aw.identification.read_log(folder / "bench.log.toml"), arm)
    found.write(folder / "identified.toml")
    told = f"{len(found.formulas)} of {found.structural} base parameters"
    drive = f"viscous friction of joint 1 {found.estimate['fv1']:.2f} N m s/rad (modules 15.68, the arm's own 19.00)"
    say("identify", f"{told}; {drive}")
    return aw.load(folder / "identified.toml")


def validate(folder):
    """Verdicts of the motion that was held out: on the identified record, and on the modules' data."""
    found, before = (
        aw.identification.validate(folder / name, folder / "bench.log.toml") for name in ("identified.toml", "arm.toml")
    )
    aw.identification.write_verdict(found)
    rms = [np.mean([each.of("torque", joint).overall.rms for joint in found.arm.names]) for each in (found, before)]
    verdict = "passes" if found.passed else "FAILS"
    say("validate", f"{verdict}: torques of another motion within {rms[0]:.2f} N m rms (modules {rms[1]:.2f})")
    return found, before


def plan(folder):
    """The motion that the arm is for, within the limits of the identified record."""
    planned = aw.trajectories.plan(folder / "round.motion.toml")
    kept = "every limit is kept" if planned.limits_report.kept else "A LIMIT IS EXCEEDED"
    say("plan", f"{planned.motion.duration:.3f} s in {len(planned.kinds)} segments, {kept}")
    return planned.motion


def tune(bench, arm, motion):
    """The cascade with gains that hold for all that the identification leaves open."""
    duration = bench.loop.period * np.ceil(motion.duration / bench.loop.period)
    loop = replace(bench.loop, reference=motion)
    nominal = replace(bench, arm=arm, vary={}, loop=loop, start=motion(0.0)[0], duration=duration)
    gains, search = {"position_kp": 5, "speed_kp": 4}, aw.tuning.Search(generations=5)
    result = aw.tuning.tune(nominal, gains, draws={"record": True}, lanes=16, search=search)
    begun, tuned = result.objectives["rms_error"]
    share = f"rms error {tuned / begun:.0%} of the first gains' on arms not tuned on"
    say("tune", f"{share}, {result.simulations} runs, margins of 2 and 30° kept")
    return result.scenario


def drive(bench, tuned, arm, modules):
    """Runs on the bench: first gains, tuned gains, and feed-forward by either record; and the scenario of the last."""
    laws = {"first gains": bench.controller, "tuned gains": tuned.controller}
    for name, model in (("+ feed-forward of the modules", modules), ("+ feed-forward as identified", arm)):
        laws[name] = aw.FeedForward(tuned.controller, inertia="full", friction=True, model=model)
    moving = replace(tuned, arm=bench.arm, vary=bench.vary)
    ways = {name: replace(moving, loop=replace(moving.loop, controller=law)) for name, law in laws.items()}
    runs = {name: aw.simulate(way) for name, way in ways.items()}
    worst = (1e3 * float(np.abs(run.q - run.q_reference).max()) for run in runs.values())
    say("drive", ", ".join(f"{name} {error:.3g}" for name, error in zip(runs, worst, strict=True)) + " mrad at most")
    return runs, ways["+ feed-forward as identified"]


def export(folder, scenario):
    """The controller as C99, and its commands beside those of the simulation."""
    made = aw.export.export_controller(scenario, folder / "c", name="six_joints")
    lines = len(made.paths[1].read_text(encoding="utf-8").splitlines())
    say("C", f"{made.paths[1].name}: {lines} lines of C99, no allocation, {len(made.paths)} files")
    same = made.comparison
    bits = made.notes[0] if same is None else f"{same.ticks - same.others} of {same.ticks} commands have the same bits"
    say("SIL", bits)
    return made


def twin(scenario):
    """The same controller over a CAN bus, with the simulated arm as six CiA 402 drives, in lock-step."""
    sensors = replace(scenario.loop.sensors, current_noise=0.0)  # no measured current is in the frames
    # frames carry thousandths of the rated torque
    command_filter = replace(scenario.loop.command_filter, resolution=None)
    scenario = replace(scenario, loop=replace(scenario.loop, sensors=sensors, command_filter=command_filter))
    try:
        with aw.bus.Twin(scenario, "virtual"):
            run = aw.bus.run_controller(scenario, "virtual")
    except aw.ArmwrightError as error:  # the extra is not installed
        say("twin", str(error))
        return
    bits = "equal to the simulation to the bit" if run.equal else f"NOT AS SIMULATED from tick {run.first_difference}"
    error = f"error {1e3 * np.abs(run.errors).max():.3g} mrad at most"
    say("twin", f"{len(run.q)} cycles of {run.q.shape[1]} drives on a virtual CAN bus, {bits}, {error}")


def main(folder):
    """All stages, each with what the ones before it left in the folder or returned."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in HERE.glob("*.toml"):
        shutil.copy(path, folder)
    modules = assemble(folder)
    bench = measure(folder, modules)
    arm = identify(folder, modules)
    judged = validate(folder)
    motion = plan(folder)
    tuned = tune(bench, arm, motion)
    runs, deployed = drive(bench, tuned, arm, modules)
    made = export(folder, deployed)
    twin(deployed)
    draw(folder / "chain.png", modules, judged, runs, made)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "build/examples/chain"))

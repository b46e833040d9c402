"""Motors and servos by output error: numbers of benches with known truth, and what logs cannot tell."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import armwright as aw
from armwright.identification import MotorReading, MotorSearch, ServoSearch
from armwright.identification.servo.orders import ORDERS, Scales, order_of
from armwright.identification.servo.output_error import BenchProblem
from frozen.answers import all_refused, record, shared_folder
from frozen.numbers import Case
from identification.motor.test_motors_by_themselves import LOAD, arm_of, log_of, logged
from identification.motor.test_priors import with_prior
from identification.motor_simulator import Bench, Motor, write_log as simulated_log
from identification.motor_truth import DELAY, PERIOD, TRUE, true_record, write_log
from identification.servo.test_identify_servo import LOOP, TRUE as TRUE_SERVO, as_json, bench_log

ident = aw.identification
IGNORED = ("sha", "version", "sources", "fits")
FEW = ["R", "Kt", "J", "coulomb"]  # other laws are not tried then
CLOSE = 1e-3  # of searches that end at a tolerance
ONE = MotorSearch(starts=1)
FIELDS = ("names", "values", "covariance", "fit", "remarks", "at_bound", "identifiable", "units")


def of(fit, folder, exact=True):
    """The numbers of a fit, its predictions, and the record."""
    estimate = fit.estimate
    chosen = FIELDS if exact else ("names", "values", "verdict", "identifiable")
    path = fit.write(folder / "identified.toml", key="own")
    found = {"result": fit} if exact else {}
    return found | {
        "estimate": {name: getattr(estimate, name) for name in chosen}, "predictions": dict(fit.predictions),
        "hold_out": fit.hold_out, "record": record(path).get("joints"), "good": fit.good,
    }  # fmt: skip


def bench(folder, signals=("current", "q", "qd"), rows=300, search=ONE, change=None, arm=None, **options):
    """A fit of the log of a bench."""
    log = write_log(folder, 0, signals, rows=rows)
    if change is not None:
        log.write_text(change(log.read_text()))
    return of(ident.identify_motor(log, None if arm is None else arm(folder), search=search, **options), folder)


def without_voltage(text):
    begin = text.index("[[signals]]")
    return text[:begin] + text[text.index("[[signals]]", begin + 1) :]


def two_runs(folder, use="fit", **options):
    """Two runs of different friction, one of them perhaps held out."""
    for k, coulomb in enumerate((0.012, 0.015)):
        write_log(folder, k, rows=300, name=f"run{k}", coulomb=coulomb)
    uses = ("fit", use)
    runs = "".join(f'[[runs]]\nname = "r{k}"\nfiles.log = "run{k}.csv"\nuse = "{uses[k]}"\n' for k in range(2))
    text = (folder / "run0.log.toml").read_text()
    path = folder / "both.log.toml"
    path.write_text(text.replace('path = "run0.csv"', "").replace("[time]", f"{runs}[time]"))
    return of(ident.identify_motor(path, **options), folder)


def of_an_arm(folder, **options):
    """Motors of an arm that were logged by themselves, with a load."""
    log = log_of(folder, {"elbow": logged(1, rows=300, J=TRUE["J"] + LOAD / 400)})
    return of(ident.identify_motor(log, arm_of(folder), joint="elbow", load=LOAD, search=ONE, **options), folder)


def simulated(folder, motor, experiment, **options):
    return of(ident.identify_motor(simulated_log(folder, motor, experiment, 3), search=ONE, **options), folder)


@cache
def servo_logs():
    """Logs of a servo as the simulator has them, in counts."""
    blank = [bench_log(k % 3, p, mass, k) for k, (p, mass) in enumerate([(8, 1.0), (32, 0.5)])]
    blank = [
        replace(each, **{name: getattr(each, name)[:200] for name in ("t", "position", "goal", "on", "supply")})
        for each in blank
    ]
    order = order_of("M1", LOOP, Scales.of(blank), ("offset",))
    bench_problem = BenchProblem(tuple(blank), LOOP, order)
    values = order.matrix @ np.array([TRUE_SERVO[name] for name in order.names]) + order.fixed
    q, count = bench_problem.predictions(values[None])[0], 2 * np.pi / 4096
    counted = np.floor(q / count + 0.5) * count
    return [replace(log, position=counted[part]) for log, part in zip(blank, bench_problem.parts, strict=True)]


def servo(folder, orders=("M1",), free=("offset",), loop=LOOP, change=lambda log: log, **options):
    logs = [change(each) for each in servo_logs()]
    search = ServoSearch(orders=orders, free=free)
    fit = ident.identify_servo(logs, loop, search=search, progress=False, **options)
    path = fit.write(folder / "servo.toml")
    return {
        "order": fit.order, "names": list(fit.estimate.names), "values": fit.estimate.values, "std": fit.estimate.std,
        "error": fit.error, "orders": fit.orders, "remarks": [len(each) for each in fit.estimate.remarks],
        "good": fit.good,
        "simulated": list(fit.simulated), "record": record(path)["joints"],
    }  # fmt: skip


def orders():
    """Unknowns of every friction model, and motions of the bench with typical numbers."""
    found = {}
    for name in ORDERS:
        for word, free, loop in (
            ("usual", ("offset",), LOOP),
            ("all", ("offset", "delay", "gain", "goal_speed"), replace(LOOP, goal_speed_rad_per_s=5.0)),
            ("current", (), replace(LOOP, output="current", output_limit=0.5)),
        ):
            order = order_of(name, loop, Scales.of(servo_logs()), free)
            bench_problem = BenchProblem(tuple(servo_logs()), loop, order)
            middle = order.matrix @ np.full(len(order.names), 0.3) + order.fixed
            found[f"{name} {word}"] = {
                "names": list(order.names), "matrix": order.matrix, "fixed": order.fixed,
                "predicted": bench_problem.predictions(middle[None])[0],
            }  # fmt: skip
    return found


def read_back(folder):
    """Logs as BAM writes them."""
    log = servo_logs()[0]
    again = ident.read_bench_log(as_json(log, folder))
    bare = ident.read_bench_log(as_json(replace(log, name="bare"), folder, motor="mine", dt=0.01))
    return {"again": replace(again, sha256=""), "bare": replace(bare, sha256="")}


def refusals(folder):
    log = write_log(folder, 0, rows=200)
    robot = true_record(folder)
    arm, motors = arm_of(folder), log_of(shared_folder("motors"), {"elbow": logged(1, rows=200)})
    servo_log = servo_logs()[0]

    def fit(of=log, robot=None, **options):
        return lambda: ident.identify_motor(of, robot, **options)

    def changed(**columns):
        return lambda: replace(servo_log, **columns)

    few, late = servo_log.t[:10], servo_log.t.copy()
    late[5] = late[4]
    return all_refused({
        "starts": lambda: MotorSearch(starts=0), "delay": lambda: MotorSearch(most_delay=-1),
        "per run": lambda: MotorSearch(per_run="J"),
        "seed": lambda: MotorSearch(seed=-1), "pwm": lambda: MotorSearch(pwm="x"),
        "runs": lambda: MotorReading(runs="a"),
        "speed": lambda: MotorReading(speed="x"), "free": fit(free="R"), "nothing": fit(free=[]),
        "unknown": fit(free=["Q"]),
        "fixed": fit(fixed={"R": -1.0}), "late": fit(fixed={"delay": -1.0}), "both": fit(free=["R"], fixed={"R": 1.0}),
        "priors": fit(search=MotorSearch(priors=True)), "no priors": fit(robot=robot, search=MotorSearch(priors=True)),
        "signals": fit(reading=MotorReading(signals=["x"])), "load": fit(load=0), "joint": fit(joint="elbow"),
        "as one": fit(motors, arm, joint="elbow"), "no joint": fit(motors, arm, joint="wrist", load=0),
        "negative": fit(motors, arm, joint="elbow", load=-1),
        "locked": fit(motors, arm, joint="elbow", load=0, locked=True),
        "loads": fit(motors, arm, joint="elbow", load={"shoulder": 0}), "run": fit(reading=MotorReading(runs=["b"])),
        "rows": changed(t=few), "times": changed(t=late), "supply": changed(supply=servo_log.supply * 0.0),
        "on": changed(on=servo_log.on + 0.5), "mass": changed(mass=0.0), "rod": changed(arm_mass=-1.0),
        "length": changed(length=0.0),
        "p": changed(p=0.0), "goal": changed(goal=servo_log.goal * np.nan),
        "orders": lambda: ServoSearch(orders=("M7",)),
        "no orders": lambda: ServoSearch(orders=()), "extra": lambda: ServoSearch(free=("R",)),
        "goal speed": lambda: servo(folder, free=("goal_speed",)),
        "servo": lambda: servo(folder, loop=None, change=_of_mine),
    }, folder)  # fmt: skip


def _of_mine(log):
    return replace(log, servo="mine")


def case(call, close=CLOSE, ignored=(), study=False):
    return Case(call, close, (*IGNORED, *ignored), study)


CASES = {
    "bench": case(bench),
    "bench without current": case(lambda folder: bench(folder, ("qd",), fixed={"viscous": TRUE["viscous"]}), 1e-2),
    "bench of positions": case(
        lambda folder: bench(folder, ("q",), fixed={"R": TRUE["R"], "delay": DELAY * PERIOD}), 1e-2
    ),
    "bench by current": case(
        lambda folder: bench(folder, ("current", "qd"), change=without_voltage, fixed={"Kt": TRUE["Kt"], "delay": 0.0})
    ),
    "bench with a record": case(
        lambda folder: bench(folder, arm=true_record, free=["R", "Kt", "J", "coulomb", "delay", "offset"])
    ),
    "bench by instants": case(
        lambda folder: bench(folder, free=FEW, reading=MotorReading(signals=["qd", "current"], speed="instant"))
    ),
    "friction by direction": case(
        lambda folder: bench(
            folder, free=["R", "Kt", "J", "viscous", "coulomb_positive", "coulomb_negative"], fixed={"delay": 0.01}
        )
    ),
    "all that is asked for": case(
        lambda folder: bench(folder, ("qd",), free=["R", "Kt", "J", "coulomb"], fixed={"delay": 0.0115}), 1e-2
    ),
    "prior": case(
        lambda folder: bench(
            folder,
            ("qd",),
            arm=lambda folder: with_prior(folder, 1.25, 0.05),
            free=["R", "Kt", "J", "coulomb", "delay"],
            fixed={"viscous": TRUE["viscous"]},
            search=MotorSearch(priors=True, starts=1),
        ),
        1e-2,
    ),
    "two runs": case(lambda folder: two_runs(folder, search=MotorSearch(per_run=["coulomb"], starts=1), free=FEW)),
    "held out": case(lambda folder: two_runs(folder, "hold-out", search=ONE, free=FEW[:3])),
    "of an arm": case(of_an_arm),
    "locked": case(
        lambda folder: simulated(folder, Motor(C=1.0, L=2e-3), Bench(rows=400, signals=("i",)), locked=True)
    ),
    "geared": case(
        lambda folder: simulated(
            folder,
            Motor(R=8.0, L=1e-5, K=0.02, J=2e-6, B=1e-6, C=1e-3, gear=-50.0),
            Bench(period=2e-3, rows=400, counts=1024),
        ),
        ignored=("resistance_ohm.std",),
    ),
    "closed loop": case(lambda folder: simulated(folder, Motor(L=1e-5), Bench(rows=300, loop=True), free=FEW), 1e-2),
    "friction models": case(lambda _: orders(), 1e-6),
    "files of servos": read_back,
    "refusals": refusals,
}

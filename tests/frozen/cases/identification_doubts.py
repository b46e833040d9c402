"""Logs that hardly tell what they are asked for, coupled and lossy arms, springs, files of other formats, and refused columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armwright as aw
from armwright.identification import ArmTerms, FitRows, LogSignals, MotorReading, MotorSearch
from armwright.identification.arm.payload import with_identified_payload
from armwright.identification.linear.choice import MODELS, fit_linear
from armwright.identification.logs.log_file import FileTable
from armwright.identification.logs.tables import open_table
from frozen.answers import all_refused, record, shared_folder
from frozen.cases.identification_arm import CLOSE, IGNORED, all_of, arm_with, fitted
from frozen.cases.identification_linear import log_of as linear_log
from frozen.cases.identification_logs import all_of as all_of_log
from frozen.cases.identification_terms import lossy, of, sprung, with_loss
from frozen.numbers import Case
from identification.arm import test_gear_loss
from identification.arm.moved_arm import moved, multisine, written_log
from identification.arm.weighed_arm import four_joints, weighed
from identification.logs.example_logs import motion, write_joint_states, written
from identification.logs.test_tables import DIALECTS, MISTAKES
from identification.motor_truth import write_log

ident = aw.identification
ONE = MotorSearch(starts=1)


# --- arms -------------------------------------------------------------------------------------------------------------


def hardly_moved(folder, arm=None, size=0.05, harmonics=1, seconds=12.0, **options):
    """A fit of small slow motions: directions that it hardly tells, and what would tell them."""
    arm = arm_with() if arm is None else arm
    t, q, qd, qdd = multisine(arm.n, seconds, 100.0, 2, size, harmonics)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    tau += 0.02 * np.random.default_rng(1).normal(size=tau.shape)
    log = written_log(folder, "small", arm.names, t, q, tau)
    return fitted(log, arm, **({"rows": FitRows(cutoff=5.0)} | options))


def springs_stay(folder):
    """Springs that stay, and the record with them."""
    arm = arm_with()
    log = moved(folder, "sprung", sprung(arm), seconds=12.0, rate=200.0, torque_noise=0.1)
    found = ident.identify_arm(
        log, arm, terms=ArmTerms(springs=("elbow",)), rows=FitRows(cutoff=20.0, decimate=2), checks=()
    )
    return all_of(found) | {"written": record(found.write(folder / "sprung.toml"))["joints"]}


def sprung_loop():
    """Instruments for an arm whose record has a spring, by a loop that follows the log."""
    log = moved(
        shared_folder("sprung loop"), "sprung", sprung(aw.load("two-link")), seconds=3.0, rate=100.0, torque_noise=0.1
    )
    gains = np.array([900.0, 300.0]), np.array([120.0, 40.0]), 0.01
    options = {"friction": (), "terms": ArmTerms(lacks=("rotors",)), "feedback": gains, "rows": FitRows(cutoff=20.0)}
    return fitted(log, sprung(aw.load("two-link")), method="iv", **options)


def lossy_record(variant, folder, **options):
    """A fit of a lossy or coupled arm and its record."""
    arm = test_gear_loss.VARIANTS[variant](lossy())
    log = moved(folder, "moved", arm, seconds=6.0, rate=100.0, harmonics=10, size=0.7, torque_noise=0.2)
    found = ident.identify_arm(log, test_gear_loss.record_of(arm), rows=FitRows(cutoff=10.0), checks=(), **options)
    q = np.random.default_rng(9).uniform(-1, 1, (3, 6, 4))
    path = found.write(folder / "found.toml")
    return {
        "estimate": found.estimate.values, "std": found.estimate.std, "remarks": list(found.estimate.remarks),
        "record": found.record.values, "kept": found.record.kept, "r2": found.record.r2,
        "torque": aw.compile(path).inverse_dynamics(*q), "written": record(path)["joints"],
    }  # fmt: skip


def lossy_friction(folder, variant="motor side"):
    arm = test_gear_loss.VARIANTS[variant](lossy())
    log = moved(folder, "moved", arm, seconds=6.0, rate=100.0, harmonics=10, size=0.7, torque_noise=0.2)
    return of(ident.identify_friction(log, arm, candidates=()))


def lossy_payload(folder, two):
    """A payload of an arm whose gears lose power."""
    arm = lossy()
    given = {"seconds": 6.0, "rate": 100.0, "harmonics": 8, "size": 0.6, "torque_noise": 0.1}
    loaded = moved(folder, "loaded", arm.with_payload(4.0, (0.05, 0.02, 0.1), 0.03 * np.eye(3)), seed=3, **given)
    log, more = (moved(folder, "empty", arm, **given), {"loaded_log": loaded}) if two else (loaded, {})
    found = ident.identify_payload(log, arm, **more)
    q = np.random.default_rng(9).uniform(-1, 1, (3, 4, 4))
    return of(found, torque=aw.compile(with_identified_payload(arm, found)).inverse_dynamics(*q))


def doubtful_constants(folder, factors=None, mass=5.0, noise=0.01, moving=None, exchanged=False, com=None):
    """Torque constants that a payload hardly tells."""
    true, plain = four_joints(folder, constants=True), four_joints(folder, constants=False)
    factors = None if factors is None else np.array(factors)
    moving = None if moving is None else np.array(moving)
    logs = [
        weighed(folder, "empty", true, 0, noise=noise, moving=moving),
        weighed(
            folder,
            "loaded",
            true.with_payload(mass, (0.05, -0.04, 0.08), 0.006 * mass * np.eye(3)),
            1,
            noise=noise,
            factors=factors,
        ),
    ]
    try:
        return of(ident.identify_drive_gains(*(logs[::-1] if exchanged else logs), plain, mass, com))
    except aw.ArmwrightError as error:
        return {"place": error.place, "text": str(error).replace(str(folder), "FOLDER")}


# --- files ------------------------------------------------------------------------------------------------------------


def formats(folder):
    """Logs as NetCDF, Parquet and MCAP."""
    import pandas
    import xarray

    t = np.arange(300) / 100.0
    q, qd, _, tau = motion(t)
    table = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "m1": tau[:, 0], "m2": tau[:, 1]}
    xarray.Dataset({name: ("row", values) for name, values in table.items()}).to_netcdf(
        folder / "log.nc", engine="h5netcdf"
    )
    pandas.DataFrame(table).to_parquet(folder / "log.parquet")
    write_joint_states(folder / "log.mcap", ["shoulder", "elbow"], t, q, qd, tau)
    found = {}
    for ending in ("nc", "parquet", "mcap"):
        names = ('"position/shoulder", "position/elbow"', '"effort/shoulder", "effort/elbow"')
        names = names if ending == "mcap" else ('"q1", "q2"', '"m1", "m2"')
        clock = 'time.column = "stamp"' if ending == "mcap" else 'time = { column = "t", unit = "s" }'
        text = f"""
            joints = ["shoulder", "elbow"]
            files.log.path = "log.{ending}"
            {clock}
            signals = [
                {{ quantity = "position", columns = [{names[0]}], unit = "rad", side = "joint" }},
                {{ quantity = "torque", columns = [{names[1]}], unit = "N m", side = "joint" }},
            ]
        """
        log = ident.read_log(written(folder, text, {"unused.csv": {"t": np.zeros(1)}}), on_error="keep")
        found[ending] = all_of_log(log, folder)
    run = aw.simulate(aw.Scenario("two-link", 0.1, command=[3.0, 1.0], lanes=range(2)))
    aw.save(run, folder / "run.nc")
    found["run"] = read(folder / "run.nc", ["t", "q_shoulder", "tau_elbow"], lane=1)
    return found


def read(path: Path, wanted, **about):
    """Columns of a file in blocks of two rows."""
    return np.concatenate(
        [np.stack(block, axis=1) for block in open_table(path, FileTable(path=path.name, **about)).blocks(wanted, 2)]
    )


def dialects(folder):
    found = {}
    for name, (text, about) in DIALECTS.items():
        (folder / "x.csv").write_bytes(text.encode())
        found[name] = read(folder / "x.csv", [1, 2, 3], **about)
    return found


def mistakes(folder):
    """Files of text that are damaged, by their words."""

    def of_text(name):
        text, about, _ = MISTAKES[name]
        path = folder / "x.csv"

        def call():
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
            return read(path, [1, 2] if about else ["t", "a"], **about)

        return call

    return all_refused({name: of_text(name) for name in MISTAKES}, folder)


# --- motors and models ------------------------------------------------------------------------------------------------


def columns_of_motors(folder):
    """Logs of a motor with a wrong sign, exchanged columns, and signals that are missing."""
    calls = {}
    for name, (old, new) in {
        "voltage": ('unit = "V"', 'unit = "V"\nsigns = -1'), "current": ('unit = "A"', 'unit = "A"\nsigns = -1'),
        "speed": ('unit = "rad/s"', 'unit = "rad/s"\nsigns = -1'), "position": ('unit = "counts"', 'unit = "counts"\nsigns = -1'),
        "u and i": ("", ""),
    }.items():  # fmt: skip
        signals = ("current", "q") if name == "position" else ("current", "qd")
        path = write_log(folder, 0, signals, rows=300, name=name.replace(" ", ""))
        text = path.read_text().replace(old, new) if old else path.read_text()
        if name.startswith("u and"):
            other = name[-1]
            text = text.replace('"u"', '"?"').replace(f'"{other}"', '"u"').replace('"?"', f'"{other}"')
        own = path.with_name(f"{path.name.split('.')[0]}{len(calls)}.log.toml")
        own.write_text(text)
        calls[name] = lambda own=own: ident.identify_motor(
            own, search=ONE, free=["R", "Kt", "J"], fixed={"delay": 0.0115}
        )
    calls["signals"] = lambda: ident.identify_motor(own, search=ONE, reading=MotorReading(signals=["q"]))
    return all_refused(calls, folder)


def by_name(folder):
    """Models of a log by the names of their kinds, as the command takes them."""
    log = linear_log(folder, {"a": "fit", "b": "hold-out"})
    options = {"frequency": {}, "n4sid": {"order": "1"}}
    found = {
        name: fit_linear(log, name, LogSignals(), **options.get(name, {"order": "1", "delay": 1, "select": "bic"}))
        for name in MODELS
    }
    return found | all_refused({
        "model": lambda: fit_linear(log, "lsq", LogSignals()), "order": lambda: fit_linear(log, "oe", LogSignals(), order="one"),
    }, folder)  # fmt: skip


ROUNDING = ("parameter", "formulas")  # factors that are rounding


def case(call, close=CLOSE, ignored=(), study=False):
    return Case(call, close, (*IGNORED, *ignored), study)


CASES = {
    "small motions": case(hardly_moved, ignored=ROUNDING),
    "small motions of six joints": case(
        lambda folder: hardly_moved(folder, aw.load("lwa4p"), 0.1, 2, checks=("cutoff",)), 1e-3
    ),
    "small motions, freely chosen": case(
        lambda folder: hardly_moved(folder, size=0.2, rows=FitRows(), checks=("cutoff",)), 1e-3, ROUNDING
    ),
    "springs that stay": case(springs_stay, 1e-3),
    "loop of an arm with a spring": case(lambda _: sprung_loop(), 1e-3),
    "record of a coupled arm": case(lambda folder: lossy_record("coupled", folder), 1e-3),
    "record with friction of motors": case(lambda folder: lossy_record("motor side", folder), 1e-3),
    "record with an efficiency": case(
        lambda folder: lossy_record("efficiency", folder, terms=ArmTerms(fit_efficiency=("elbow",))), 1e-2
    ),
    "friction behind gears": case(lossy_friction, 1e-3),
    "payload behind gears": case(lambda folder: lossy_payload(folder, False), 1e-3),
    "payload behind gears, two logs": case(lambda folder: lossy_payload(folder, True), 1e-3),
    "constants of a light payload": case(lambda folder: doubtful_constants(folder, mass=0.2, noise=0.05), 1e-3),
    "constants of no payload": case(lambda folder: doubtful_constants(folder, mass=0.01, noise=0.05), 1e-3),
    "constants of a joint at rest": case(lambda folder: doubtful_constants(folder, moving=[1, 1, 0, 1]), 1e-3),
    "constants of other currents": case(lambda folder: doubtful_constants(folder, factors=[1.0, 1.3, 1.0, -1.0]), 1e-3),
    "constants of exchanged logs": case(lambda folder: doubtful_constants(folder, exchanged=True), 1e-3),
    "constants of another centre": case(lambda folder: doubtful_constants(folder, com=(0.4, 0.3, -0.2)), 1e-3),
    "fit of one efficiency": case(lambda _: with_loss("one motor", record=False), 1e-3),
    "formats": case(formats, study=True),
    "dialects": dialects,
    "mistakes": mistakes,
    "columns of motors": columns_of_motors,
    "models by name": case(by_name),
}

"""Verdicts on records by logs that their fit did not use, friction that residuals show, and estimates by themselves."""

from __future__ import annotations

from functools import cache

import numpy as np

import armwright as aw
from armwright.identification.validation.friction_signature import friction_signature
from frozen.answers import all_refused, beside, record, refused, shared_folder, words_of
from frozen.numbers import Case
from identification.validation.made_logs import driven, motor_file, random_steps, written_log
from identification.validation.test_friction_signature import ACCELERATION, MISSING, NOISE, SPEED
from identification.validation.test_report import ESTIMATE

ident = aw.identification
PERIOD = 2e-3
CLOSE = 1e-4
IGNORED = ("sha", "version", "date")
STEPS = "voltage", ("speed", "voltage")
MEASURES = (
    "joint", "quantity", "unit", "how", "overall", "runs", "at_rest", "autocorrelation", "whiteness", "cross",
    "input_name",
    "delay", "period", "spectrum", "friction", "diverged", "remarks", "spread", "worst",
)  # fmt: skip


def motion(arm, seed, rows=1200, noise=1e-3):
    """A sum of sines and the torques that it takes."""
    t, rng = PERIOD * np.arange(rows), np.random.default_rng(seed)
    q, qd, qdd = (np.zeros((rows, arm.n)) for _ in range(3))
    for k in range(1, 5):
        a, phase = rng.uniform(-0.4, 0.4, arm.n) / k, rng.uniform(0, 6, arm.n)
        w = 2 * np.pi * 0.6 * k
        x = w * t[:, None] + phase
        q, qd, qdd = q + a * np.sin(x), qd + a * w * np.cos(x), qdd - a * w**2 * np.sin(x)
    tau = aw.compile(arm).inverse_dynamics(q, qd, qdd)
    return {"t": t, "position": q, "speed": qd, "torque": tau + noise * tau.std(axis=0) * rng.normal(size=tau.shape)}


def of(found):
    """Everything that a validation says."""
    parts = {"checks": found.checks, "unjudged": found.unjudged, "runs": found.runs, "held_out": found.held_out}
    parts |= {
        f"{each.quantity} of {each.joint}": {name: getattr(each, name) for name in MEASURES} for each in found.measures
    }
    return {"result": found, "limits": found.limits.model_dump(exclude_none=True)} | parts


def links(folder, change=lambda tables: tables, arm=None, use="hold-out", text=("", ""), **options):
    """A validation of two links on a log that may be changed."""
    model = aw.load("two-link")
    tables = {name: motion(model, k) for k, name in enumerate(("fit", "held"))}
    log = written_log(folder, list(model.names), change(tables) or tables, use=use)
    log.write_text(log.read_text().replace(*text))
    found = ident.validate(model if arm is None else arm(model), ident.read_log(log, on_error="keep"), **options)
    return of(found)


def held(change):
    """A change of the run that is judged."""

    def changed(tables):
        change(tables["held"])

    return changed


def resting(table):
    table["position"][600:], table["speed"][600:] = table["position"][600], 0.0
    table["torque"][600:] = 3.0


def still(table):
    table["position"][:, 1], table["speed"][:, 1] = 0.4, 0.0


def holes(table):
    table["torque"][[300, 301, 700], [0, 1, 1]] = np.nan


def late(table):
    table["torque"] = np.stack([np.interp(table["t"] - 0.008, table["t"], each) for each in table["torque"].T], axis=1)


def without(*names):
    def change(tables):
        return {run: {key: each for key, each in table.items() if key not in names} for run, table in tables.items()}

    return change


@cache
def motor_log(command, kept):
    """Path of the record of a geared motor, and of its log under steps."""
    folder = shared_folder(f"motor {command} {' '.join(kept)}")
    path = motor_file(folder)
    path.write_text(path.read_text().replace('command = "voltage"', f'command = "{command}"'))
    size = {"voltage": 6.0, "torque": 0.8}[command]
    tables = {
        name: driven(aw.load(path), random_steps(600, 60, [size], k), PERIOD, kept, 0.005)
        for k, name in enumerate(("fit", "held"))
    }
    return path, written_log(folder, ["motor"], tables)


def motor(command="voltage", kept=("speed", "voltage"), coulomb=None, text=("", ""), **options):
    path, log = motor_log(command, kept)
    if coulomb is not None:
        path = motor_file(path.parent, coulomb=coulomb, name="other.toml")
    other = log.with_name("other.log.toml")
    other.write_text(log.read_text().replace(*text))
    return of(ident.validate(path, other, **options))


def currents(folder):
    """Torques by currents of a motor whose record has no Coulomb friction."""
    arm = aw.load(motor_file(folder))
    t = PERIOD * np.arange(1500)
    q, qd, qdd = np.sin(3.0 * t)[:, None], 3 * np.cos(3.0 * t)[:, None], -9 * np.sin(3.0 * t)[:, None]
    table = {"t": t, "position": q, "current": aw.compile(arm).inverse_dynamics(q, qd, qdd) / 0.4}
    log = written_log(folder, ["motor"], {"fit": table, "held": table})
    return of(ident.validate(motor_file(folder, coulomb="", name="smooth.toml"), log, simulation=False))


def scenario(folder):
    arm = aw.load("two-link")
    loop = aw.Loop(
        aw.ComputedTorque(kp=100.0, kd=20.0), reference=aw.trajectories.Sine([0.0, 0.0], [0.4, 0.3], 0.5), period=0.004
    )
    run = aw.simulate(aw.Scenario(arm, 1.0, loop=loop))
    table = {
        "t": run["time"].values,
        "position": run["q"].values + 1e-3 * np.cos(9 * run["q"].values),
        "speed": run["qd"].values,
    }
    log = written_log(folder, list(arm.names), {"fit": table, "held": table})
    return of(ident.validate(aw.Scenario(arm, 1.0, loop=loop), ident.read_log(log, on_error="keep")))


def verdicts(folder):
    """Verdicts that are stored, found again, and no longer belong."""
    path, log = motor_log(*STEPS)
    copy = folder / "motor.toml"
    copy.write_text(path.read_text())
    found = {"none": ident.stored_verdict(copy)}
    for name, limits in (("passes", None), ("fails", {"speed": {"rms_at_most_rad_per_s": 1e-9}})):
        file = ident.write_verdict(ident.validate(copy, log, limits=limits))
        stored = ident.stored_verdict(copy)
        found[name] = {
            "file": file.name,
            "table": stored.table.model_dump(),
            "belongs": stored.belongs,
            "passed": stored.passed,
        }
        found[f"{name} asked"] = refused(lambda: ident.passing_verdict(copy), folder)
    copy.write_text(copy.read_text().replace("gear_ratio = 10", "gear_ratio = 11"))
    changed = ident.stored_verdict(copy)
    return found | {
        "changed": [changed.belongs, changed.passed],
        "asked": refused(lambda: ident.passing_verdict(copy), folder),
    }


def signatures():
    """Terms of friction that residuals show."""
    slow = np.abs(SPEED) < 0.3
    calls = {name: (torque + NOISE, {}) for name, (_, torque) in MISSING.items()}
    calls |= {
        "less": (-MISSING["Coulomb"][1] + NOISE, {}), "nothing": (NOISE, {}),
        "small": (0.02 * MISSING["viscous"][1] + NOISE, {"size": 9.0}),
        "stribeck": (MISSING["Coulomb"][1] + 2.0 * np.sign(SPEED) * np.exp(-((SPEED / 0.1) ** 2)) + 0.2 * NOISE, {}),
        "sliding": (MISSING["inertia"][1] + MISSING["offset"][1] + NOISE, {"unit": "N", "length": "m"}),
        "direction": (np.where(slow, 0.0, np.sign(SPEED)) + NOISE, {"direction": np.where(slow, 0.0, np.sign(SPEED))}),
    }  # fmt: skip
    names = ("unit", "length", "direction", "size")
    found = {}
    for name, (torque, more) in calls.items():
        given = [more.get(key, default) for key, default in zip(names, ("N m", "rad", None, 0.0), strict=True)]
        found[name] = friction_signature(torque, SPEED, ACCELERATION, *given)
    found["few rows"] = friction_signature(NOISE[:20], SPEED[:20], ACCELERATION[:20])
    found["one way"] = friction_signature(NOISE, np.abs(SPEED) + 0.1, ACCELERATION)
    return found


def estimates(folder):
    """Estimates by themselves: intervals, selections, and records that they are written into."""
    chosen = ESTIMATE.select(["delay_s", "motor.motor.torque_constant_n_m_per_a"])
    plain = ident.Estimate(
        ("a", "b"), [1.0, 2.0], np.diag([0.01, np.nan]), 64 * "0", "by hand", ("m", ""), condition=2000.0
    )
    arm = motor_file(folder)
    path = ident.write_into(arm, ESTIMATE.select(ESTIMATE.names[:2]), folder / "written.toml", key="bench")
    again = ident.write_into(path, ESTIMATE.select(ESTIMATE.names[:1]), folder / "again.toml", key="later")
    two = ident.Estimate(
        ("forearm.mass_kg", "forearm.com_m[0]", "shoulder.friction.viscous_n_m_s_per_rad"), [3.5, 0.2, 0.1],
        np.diag([0.01, 1e-4, 1e-4]),
        64 * "0", "by hand", identifiable=[True, True, False],
    )  # fmt: skip
    links = refused(lambda: ident.write_into("two-link", two, folder / "links.toml"), folder)
    names = ("values", "std", "correlation", "units", "at_bound", "identifiable")
    return {
        "whole": beside(ESTIMATE, *names, interval=ESTIMATE.interval("delay_s"), first=ESTIMATE.interval(ESTIMATE.names[0])),
        "chosen": beside(chosen, *names),
        "plain": beside(plain, *names, of_a=plain.interval("a"), number=plain.number("b")),
        "written": record(path), "again": record(again), "links": links, "as links": _of(folder / "links.toml"),
    }  # fmt: skip


def _of(path):
    return record(path) if path.exists() else None


def pages(folder):
    """Words of the pages of a validation and of an estimate."""
    arm = aw.load("two-link")
    tables = {name: motion(arm, k, 1000) for k, name in enumerate(("fit", "held"))}
    resting(tables["held"])
    log = written_log(folder, list(arm.names), tables)
    found = ident.validate(arm, ident.read_log(log, on_error="keep"), simulation=False)
    reports = found.report(folder / "links.html"), ESTIMATE.report(folder / "estimate.html", "A motor")
    words = {page.stem: words_of(page) for page in reports}
    return {f"{name} {k}": " ".join(each[k : k + 10]) for name, each in words.items() for k in range(0, len(each), 10)}


def refusals(folder):
    arm = aw.load("two-link")
    tables = {name: motion(arm, k, 400) for k, name in enumerate(("fit", "held"))}
    log = ident.read_log(written_log(folder, list(arm.names), tables), on_error="keep")
    (folder / "alone").mkdir()
    alone = ident.read_log(written_log(folder / "alone", list(arm.names), without("torque")(tables)), on_error="keep")
    path, _ = motor_log(*STEPS)

    def judge(of=arm, by=log, **options):
        return lambda: ident.validate(of, by, **({"simulation": False} | options))

    def estimate(*given, **more):
        return lambda: ident.Estimate(*given, **more)

    return all_refused({
        "joint": judge(limits={"joints": {"wrist": {}}}), "key": judge(limits={"torque": {"r2_at_last": 0.9}}),
        "share": judge(limits={"torque": {"r2_at_least": 1.5}}),
        "unit": judge(limits={"joints": {"elbow": {"torque": {"rms_at_most_n": 1.0}}}}),
        "speed": judge(limits={"speed": {"fit_at_least": 50}}), "number": judge(limits=5),
        "file": judge(limits="no-such.toml"),
        "arm": judge(path), "run": judge(runs=["third"]), "motion": judge(by=alone),
        "window": judge(window=-1.0, simulation=True),
        "long window": judge(window=100.0, simulation=True), "cutoff": judge(cutoff=9e3),
        "of": lambda: ident.validate(arm, log, simulation=False).of("speed", "elbow"),
        "no file": lambda: ident.write_verdict(ident.validate(arm, log, simulation=False)),
        "record": lambda: ident.stored_verdict(folder / "x.toml"),
        "names": estimate("ab", [1.0], [[1.0]], "", ""), "values": estimate(("a",), [1.0, 2.0], np.eye(2), "", ""),
        "covariance": estimate(("a",), [1.0], np.eye(2), "", ""), "name": lambda: ESTIMATE["nothing"],
        "interval": lambda: ESTIMATE.interval("motor.motor.resistance"),
    }, folder)  # fmt: skip


def case(call, close=CLOSE, ignored=(), study=False):
    return Case(call, close, (*IGNORED, *ignored), study)


CHANGES = {
    "wrong sign": {"text": ('unit = "N m"', 'unit = "N m"\nsigns = [1, -1]')},
    "lacks gravity": {"text": ('unit = "N m"', 'unit = "N m"\nlacks = ["gravity"]')},
    "held torques": {"text": ('unit = "N m"', 'unit = "N m"\nheld = true')},
    "another mass": {"arm": lambda arm: arm.with_values({"forearm.mass_kg": 9.0})},
    "resting": {"change": held(resting)},
    "still": {"change": held(still)}, "holes": {"change": held(holes)}, "late": {"change": held(late)},
    "no speeds": {"change": without("speed")}, "all runs": {"use": "fit"}, "cut-off": {"cutoff": 9.0},
    "first run": {"runs": ["fit"]},
    "limits": {
        "limits": {
            "torque": {"r2_at_least": 0.5, "nrmse_at_most": 0.2, "vaf_at_least": 99.0},
            "joints": {"elbow": {"torque": {"rms_at_most_n_m": 1e-9, "fit_at_least": 20.0}}},
        }
    },
}  # fmt: skip
CASES = {
    "two links": case(lambda folder: links(folder, simulation=False)),
    "windows": case(lambda folder: links(folder, window=0.2), 1e-3),
    "chosen windows": case(lambda folder: links(folder, held(holes)), 1e-3),
    **{
        name: case(lambda folder, more=more: links(folder, **({"simulation": False} | more)))
        for name, more in CHANGES.items()
    },
    "motor": case(lambda _: motor(), 1e-3),
    "motor without friction": case(lambda _: motor(coulomb=""), 1e-3),
    "motor of positions": case(lambda _: motor(kept=("position", "voltage")), 1e-3),
    "motor by torque": case(lambda _: motor("torque", ("position", "torque"), simulation=False), 1e-3),
    "motor by held torque": case(
        lambda _: motor(
            "torque", ("position", "torque"), simulation=False, text=('unit = "N m"', 'unit = "N m"\nheld = true')
        ),
        1e-3,
    ),
    "currents": case(currents),
    "scenario": case(scenario, 1e-3),
    "verdicts": case(verdicts, 1e-3),
    "signatures": lambda _: signatures(),
    "estimates": case(estimates),
    "pages": case(pages),
    "refusals": refusals,
}

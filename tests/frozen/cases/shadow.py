"""A model beside its arm: residuals, alarms, events, verdicts, and friction at rest."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

import armwright as aw
from armwright.actuators.coupling import motor_shares
from armwright.model import build_model
from armwright.shadow.alarms import AlarmWatch, ShadowAlarm
from armwright.shadow.filter import SignalFilter, critically_damped
from armwright.shadow.observer import MomentumObserver, with_kilogram
from armwright.shadow.rest import RestingFriction, _elements, widened
from armwright.shadow.rows import RowCheck, ShadowEvent, event_lines
from armwright.shadow.uncertainty import torque_deviations
from armwright.shadow.verdict import Judged, verdict
from frozen.cases.control_design import LIMITED_ARM
from frozen.numbers import Case
from identification.arm.simulated_log import motion
from physics.arms import arm
from shadow.test_rest import ARMS, two_link
from shadow.test_shadow import EMPTY, log_file, point_to_point
from simulation.plants import chain

LOG = Path(__file__).parents[3] / "examples" / "logs" / "lwa4p" / "lwa4p.log.toml"
RATE = 500.0
Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


def rows_of(name: str = "two-link", seconds: float = 2.0, seed: int = 2, loaded: float = 0.0) -> Rows:
    """t, q and tau of a built-in arm that moves, with a payload from the middle on."""
    model = aw.load(name)
    t, q, qd, qdd = motion(model.n, seconds, RATE, seed=seed)
    tau = aw.compile(model).inverse_dynamics(q, qd, qdd)
    if loaded:
        late = t > 0.5 * seconds
        heavier = aw.compile(model.with_payload(loaded, *EMPTY))
        tau[late] = heavier.inverse_dynamics(q, qd, qdd)[late]
    return t, q, tau


def shadowed(rows: Rows, name: str = "two-link", qd: Any = None, **options: Any) -> dict[str, Any]:
    """Residuals, alarms, events and verdict of rows."""
    shadow = aw.shadow.ArmShadow(name, **({"deviation": 0.2} | options))
    raised = shadow.update(*rows, qd)
    judged = shadow.judged
    return {
        "residuals": shadow.last, "raised": raised, "alarms": list(shadow.alarms), "said": [str(each) for each in shadow.alarms],
        "events": [[vars(each), str(each)] for each in shadow.events], "judged": [judged, judged.unjudged],
        "verdict": shadow.verdict, "active": shadow.active, "limits": shadow.limits,
    }  # fmt: skip


def pushed(joint: int, force: float, begin: float = 1.2, end: float = 1.6) -> dict[str, Any]:
    """What is noticed of a push at a joint."""
    t, q, tau = rows_of()
    tau[(t > begin) & (t < end), joint] -= force
    return shadowed((t, q, tau))


def disturbed(change: Any, **options: Any) -> dict[str, Any]:
    """What is noticed of rows that something happened to."""
    t, q, tau = (each.copy() for each in rows_of())
    changed = change(t, q, tau)
    return shadowed((t, q, tau) if changed is None else changed, **options)


def junk(t: np.ndarray, q: np.ndarray, tau: np.ndarray) -> None:
    """Positions and torques that cannot be: single ones, of two joints, several in a row."""
    q[300, 1], q[420, 0], q[421] = np.nan, 4e6, np.inf
    tau[500:503, 0], tau[620] = 1e7, -np.inf
    q[700, 0] += 30.0  # too far from the row before


def clock(t: np.ndarray, q: np.ndarray, tau: np.ndarray) -> None:
    """Time stamps that stand still, go back, jump, are none, and a clock that is set."""
    t[200], t[260], t[330], t[331] = t[199], t[200], np.nan, np.inf
    t[400] += 1e3
    t[600:] += 200.0


def gaps(t: np.ndarray, q: np.ndarray, tau: np.ndarray) -> Rows:
    """Rows that are missing: few, and so many that the observer starts again."""
    kept = np.r_[0:300, 304:600, 640:800, 805:1000]
    return t[kept], q[kept], tau[kept]


def speeds(_: Path) -> dict[str, Any]:
    """Rows with measured speeds, of which some cannot be, and with torques that are held."""
    t, q, tau = rows_of()
    qd = np.gradient(q, t, axis=0)
    qd[333, 1], qd[444, 0] = 2e3, np.nan
    given = {"qd": qd, "held": True, "bandwidths": aw.shadow.ShadowBandwidths(30.0, 8.0, 2.0, 0.05)}
    return shadowed((t, q, tau), **given)


def in_blocks(_: Path) -> dict[str, Any]:
    """Blocks of all lengths, a restart, and time without rows."""
    t, q, tau = rows_of(loaded=2.0)
    shadow = aw.shadow.ArmShadow("two-link", deviation=0.2, held=True)
    found: dict[str, Any] = {"before": shadow.verdict}
    for ends in ((0, 1), (1, 250), (250, 251), (251, 1000)):
        part = slice(*ends)
        shadow.update(t[part], q[part], tau[part])
        found[str(ends)] = [shadow.last, shadow.judged, list(shadow.alarms)]
    shadow.without_rows(0.7)
    found["without rows"] = [shadow.judged, shadow.verdict]
    shadow.restart()
    shadow.update(t[:300], q[:300], tau[:300])
    return found | {"restarted": [shadow.last, shadow.judged, len(shadow.alarms)]}


def filtered(_: Path) -> dict[str, Any]:
    """Filtered signals: derived and measured speeds, held torques, uneven rows, beginnings."""
    t = np.cumsum(np.array([0.0, *([2e-3] * 30), 5e-3, *([2e-3] * 30), 1e-3, *([3e-3] * 20)]))
    q, tau = np.stack([np.sin(5.0 * t), np.cos(3.0 * t)], 1), np.stack([t**2, np.sign(np.sin(40.0 * t))], 1)
    begins = np.zeros(len(t), dtype=bool)
    begins[[0, 50]] = True
    found: dict[str, Any] = {"matrix": critically_damped(60.0, 4e-3)}
    for held in (False, True):
        for qd in (None, 5.0 * q):
            one = SignalFilter(100.0, held)
            parts = [
                one.rows(t[k], q[k], tau[k], None if qd is None else qd[k], begins[k])
                for k in (slice(0, 33), slice(33, None))
            ]
            found[f"{held} {qd is None}"] = [*parts, one.delay, one.settling]
    return found


def checked(name: str, change: Any = junk) -> dict[str, Any]:
    """Rows of an arm that are taken, and what is said of the others."""
    model = LIMITED_ARM if name == "limited drives" else arm(name)
    t, q, _, _ = motion(model.n, 2.0, RATE, seed=1)
    tau = np.stack([np.sin(t * (k + 1.0)) for k in range(model.n)], axis=1)
    change(t, q, tau)
    check = RowCheck(model)
    found = [check.check(t[:450], q[:450], tau[:450], None), check.check(t[450:], q[450:], tau[450:], q[450:])]
    return {
        "rows": found,
        "events": [vars(each) for each in check.events],
        "middle": check._middle,
        "most": check._most,
    }


def lines(_: Path) -> list[Any]:
    """Events in words, few and many; alarms in words."""
    events = [
        ShadowEvent(1.0, 1.0, "q", "elbow", 7.0, 1, (-1.0, 2.0)), ShadowEvent(1.0, 2.5, "tau", "elbow", np.nan, 3, (-1.0, 2.0)),
        ShadowEvent(0.5, 0.5, "t", None, 4.25, 2), ShadowEvent(1.0, 1.5, "residual", "elbow", np.inf, 2),
        ShadowEvent(1.0, 1.0, "qd", "elbow", 5.0),
    ]  # fmt: skip
    runs = [(f"run{k}", each) for k, each in enumerate(events * 3)]
    alarms = [ShadowAlarm(1.0, end, "elbow", -3.0, 2.0, "shoulder", mass, share)
              for end, mass, share in ((None, 1.5, 0.95), (2.0, -0.4, 0.9), (2.0, 1.0, 0.89))]  # fmt: skip
    return [
        event_lines(runs),
        event_lines(runs[:12]),
        event_lines(runs[:13]),
        *([each.kind, each.cause, str(each)] for each in alarms),
    ]


def watched(_: Path) -> dict[str, Any]:
    """Alarms of a stream of residuals: short peaks, one that comes and goes, rows without one, friction that hides, no limit."""
    rows = len(T_WATCHED)
    torque = np.zeros((rows, 3))
    torque[100:105, 0] = 5.0  # too short
    torque[150:400, 1] = np.where(np.arange(250) % 50 < 45, 4.0, 0.8)
    torque[170:300, 2] = 3.0
    torque[450:520], torque[480:490] = [2.5, 0.0, 0.5], np.nan
    torque[500:504, 1] = np.nan
    torque[700:760] = [1.0, 2.2, 3.3]
    torque[765:, 2] = -6.0
    kilogram = np.tile([1.0, 2.2, 3.2], (rows, 1))
    resting = np.zeros((rows, 3))
    resting[150:260, 2] = 1.0
    found = []
    for limits in (np.array([1.0, 1.5, 2.0]), np.array([1.0, np.nan, 2.0])):
        watch = AlarmWatch(("a", "b", "c"), limits)
        for part in (slice(0, 470), slice(470, None)):
            block = aw.shadow.Residuals(
                T_WATCHED[part], torque[part], 0.1 * torque[part], 0.0 * torque[part], kilogram[part],
                np.abs(np.sin(T_WATCHED[part]))[:, None] * [4.0, 5.0, 6.0], resting[part], np.full(len(T_WATCHED[part]), 4e-3),
            )  # fmt: skip
            found.append([watch.update(block), watch.active, watch.judged])
        found.append(list(watch.alarms))
    return {"found": found}


T_WATCHED = 4e-3 * np.arange(900)


def verdicts(_: Path) -> dict[str, Any]:
    """Verdicts of everything that may be judged, not judged, far away or raised."""
    slide, n = arm("workshop"), 5
    cases = {
        "clean": (Judged(10.0, np.zeros(n), np.full(n, 0.05)), 0),
        "hardly lost": (Judged(10.0, np.array([0.0, 0.05, 0.0, 0.1, 0.0]), np.zeros(n)), 0),
        "one lost": (Judged(10.0, np.array([0.0, 0.2, 0.0, 0.0, 0.0]), np.zeros(n)), 0),
        "two lost": (Judged(10.0, np.array([0.0, 0.2, 0.0, 10.0, 0.3]), np.full(n, 0.2)), 0),
        "all lost": (Judged(10.0, np.full(n, 5.0), np.zeros(n)), 0),
        "nothing judged": (Judged(10.0, np.full(n, 10.0), np.zeros(n)), 0),
        "no time": (Judged.of(n), 0),
        "far": (Judged(10.0, np.zeros(n), np.array([0.4, 0.2, 0.6, 0.1, 0.0])), 0),
        "an alarm": (Judged(10.0, np.zeros(n), np.zeros(n)), 1),
        "alarms": (Judged(10.0, np.array([1.0, 0.0, 0.0, 0.0, 0.0]), np.full(n, 0.7)), 2),
    }
    added = Judged(1.0, np.arange(3.0), np.array([1.0, 5.0, 2.0])) + Judged(2.0, np.ones(3), np.array([3.0, 4.0, 2.5]))
    return {name: verdict(slide, *each) for name, each in cases.items()} | {"sum": [added, added.unjudged]}


def deviations(folder: Path) -> dict[str, Any]:
    """Deviations that are given, of a fit, of a record's numbers and their correlation, and not known."""
    one = aw.load("two-link")
    record = one.record
    links = [each.replace(mass_kg=each.mass_kg.replace(std=0.05 * (k + 1.0))) for k, each in enumerate(record.links)]
    numbers = record.replace(links=tuple(links))
    fit = {
        "source": "bench", "method": "weighted least squares", "log_sha256": 64 * "0", "verdict": "identified",
        "measures": {"shoulder": {"rms": 0.2}, "elbow": {"rms": 0.7}},
    }  # fmt: skip
    sources = {"bench": {"kind": "fit", "text": "a bench"}}
    fitted = build_model(record.replace(sources=sources, fits={"bench": fit}))
    some = {name: each for name, each in fit.items() if name != "measures"}
    some |= {"names": [f"{each.name}.mass_kg" for each in record.links], "correlation": [[], [-0.8]]}
    correlated = build_model(numbers.replace(sources=sources, fits={"bench": some}))
    models = {"none": one, "fit": fitted, "numbers": build_model(numbers), "correlated": correlated}
    return {name: torque_deviations(each) for name, each in models.items()} | {
        "given": [torque_deviations(one, given=each) for each in (2.0, [1.0, 3.0])],
        "changed": torque_deviations(build_model(numbers).replace(gravity=[0.0, 0.0, 0.0])),
    }


# --- friction at rest -------------------------------------------------------------------------------------------------


def resting(model: Any, lacking: Any = None) -> dict[str, Any]:
    """Centre and width of friction along a motion that turns and rests, and the elements that make it."""
    t = np.arange(60) * 0.02
    q = 4.0 * np.sin(2.0 * t)[:, None] * np.linspace(1.0, -0.7, model.n)
    qd = np.where((t < 0.4)[:, None], 0.8 * np.cos(2.0 * t)[:, None], 0.01) * np.linspace(1.0, -0.7, model.n)
    qdd = np.where((t < 0.8)[:, None], -1.6 * np.sin(2.0 * t)[:, None], 0.02) * np.linspace(1.0, -0.7, model.n)
    seen = model if lacking is None else lacking
    motors = aw.compile(seen).inverse_dynamics(q, qd, qdd)
    found = RestingFriction(seen, model, 0.02, 0.05).of(q, qd, qdd, motors)
    whole = widened(model)
    elements = [
        [each.row, each.on_motor, each.at_own_speed, each.gear is None]
        for each in _elements(seen, whole, motor_shares(seen))
    ]
    return {"resting": found, "elements": elements}


def lacking_friction(folder: Path) -> dict[str, Any]:
    """Of an arm beside torques that lack its friction."""
    whole = two_link(folder, *ARMS["stiction"])
    return resting(whole, whole.replace(friction=None))


def wide(folder: Path) -> dict[str, Any]:
    """Numbers of friction and gears three deviations away, to the side that hides more."""
    text = "gear_ratio = 50.0\nrotor_inertia_kg_m2 = 1e-5\ngear_efficiency = {{ value = 0.7, std = STD }}\n"
    dry = (
        "coulomb_positive_n_m = { value = 4.0, std = 0.1 }\ncoulomb_negative_n_m = { value = 3.0, std = 0.2 }\n"
        "viscous_n_m_s_per_rad = { value = 2.0, std = 0.3 }\nstribeck_torque_n_m = { value = 6.0, std = 0.4 }\n"
        "stribeck_speed_rad_per_s = { value = 0.05, std = 0.01 }\noffset_n_m = { value = 0.4, std = 0.1 }\n"
    )
    found: dict[str, Any] = {}
    for std in (0.05, 0.2):
        place = folder / str(std)
        place.mkdir()
        model = widened(two_link(place, text.replace("STD", str(std)), dry))
        known = torque_deviations(aw.load(place / "arm.toml"))
        rows = [[vars(body.friction), body.drive.efficiency] for body in model.coordinates]
        found[str(std)] = [known, *rows]
    return found


# --- logs -------------------------------------------------------------------------------------------------------------


def logged(folder: Path, name: str = "two-link", changes: Any = None, **options: Any) -> dict[str, Any]:
    """The shadow of a log of an arm, in numbers and words."""
    model = aw.load(name)
    path = log_file(folder, model, motion(model.n, 1.5, RATE, seed=4), 0.05)
    if changes is not None:
        path.write_text(changes(path.read_text()))
    given, seen = model if options.pop("as_model", False) else name, []
    found = aw.shadow.shadow_log(path, given, progress=lambda done, total: seen.append([done, total]), **options)
    return told(found) | {"progress": seen}


def told(found: Any) -> dict[str, Any]:
    """A result in numbers and words."""
    return {
        "runs": found.runs, "limits": found.limits, "deviations": found.deviations, "words": found.sentences(),
        "rows": found.tables()[0].rows(), "good": found.good, "rms": [found.rms(), found.rms("position")],
        "largest": [found.largest(), found.largest("position")], "alarms": len(found.alarms), "events": len(found.events),
    }  # fmt: skip


def lacking(*terms: str) -> Any:
    """Changes a log: its torques lack some terms."""
    return lambda text: text.replace('quantity = "torque"', f'quantity = "torque"\nlacks = {list(terms)}')


def measured_arm(_: Path) -> dict[str, Any]:
    """The example's log of a measured arm, whole and of one run."""
    log = aw.identification.read_log(LOG)
    return told(aw.shadow.shadow_log(log, "lwa4p", deviation=5.0, runs=[log.runs[0].name], progress=False))


def moves(_: Path) -> dict[str, Any]:
    """An arm with friction of motors that moves from rest to rest, with a payload of its own later."""
    model = aw.load("puma560")
    rows = point_to_point(6, 3)
    t, q, qd, qdd = (each[:1200] for each in rows)
    tau = aw.compile(model).inverse_dynamics(q, qd, qdd)
    late = t > 1.6
    tau[late] = aw.compile(model.with_payload(2.0, *EMPTY)).inverse_dynamics(q, qd, qdd)[late]
    return shadowed((t, q, tau), "puma560", deviation=[1.0, 2.0, 1.0, 0.2, 0.2, 0.1])


def kilograms(_: Path) -> list[Any]:
    """Torques of a kilogram more at the tip; none of an arm without one."""
    heavier = with_kilogram(aw.load("two-link"))
    tipless = chain([{"command": "torque"}])
    assert heavier is not None
    return [heavier.bodies[-1].mass, aw.gravity_torques(heavier, [0.2, 0.3]), with_kilogram(tipless) is None]


def bare_observer(folder: Path) -> list[Any]:
    """The observer without the heavier arm, of an arm whose gears lose power, and of residuals that are not finite."""
    record = aw.load("puma560").description
    text = re.sub(r"(gear_ratio = .*\n)", r"\1gear_efficiency = 0.7\n", aw.robotfiles.to_toml(record))
    path = folder / "lossy.toml"
    path.write_text(text)
    t, q, tau = rows_of("puma560", 1.0)
    lossy = MomentumObserver(aw.load(path)).update(t, q, tau)
    t, q, tau = rows_of(seconds=1.0)
    tau[300] = 9e4
    observer = MomentumObserver(aw.load("two-link"))
    return [lossy, observer.update(t, q, tau), [vars(each) for each in observer.events]]


CASES = {
    "right arm": lambda _: shadowed(rows_of()),
    "payload": lambda _: shadowed(rows_of(loaded=1.5)),
    "push at the shoulder": lambda _: pushed(0, 12.0),
    "push at the elbow": lambda _: pushed(1, -9.0),
    "push that is short": lambda _: pushed(1, 30.0, 1.2, 1.22),
    "push that lasts": lambda _: pushed(1, 6.0, 1.2, 3.0),
    "values that cannot be": lambda _: disturbed(junk),
    "clock": lambda _: disturbed(clock),
    "gaps": lambda _: disturbed(gaps),
    "small factor": lambda _: disturbed(junk, factor=0.5, deviation=[0.1, 0.3]),
    "measured speeds": speeds,
    "blocks": in_blocks,
    "moves from rest to rest": Case(moves, close=1e-5),
    "filter": filtered,
    **{
        f"checked rows of {name}": lambda _, name=name: checked(name)
        for name in ("two-link", "puma560", "workshop", "lwa4p", "limited drives")
    },
    "checked clock": lambda _: checked("two-link", clock),
    "in words": lines,
    "alarms": watched,
    "verdicts": verdicts,
    "deviations": deviations,
    **{f"at rest, {name}": lambda folder, each=each: resting(two_link(folder, *each)) for name, each in ARMS.items()},
    "at rest, friction that torques lack": lacking_friction,
    "at rest, workshop": lambda _: resting(arm("workshop")),
    "at rest, mimics": lambda _: resting(arm("gripper")),
    "widened": wide,
    "log": logged,
    "log of a model, no limits": lambda folder: logged(folder, as_model=True),
    "log with limits": lambda folder: logged(folder, deviation=0.1, factor=3.0),
    "log without gravity": lambda folder: logged(folder, changes=lacking("gravity", "coulomb"), deviation=0.3),
    "measured arm": Case(measured_arm, close=1e-5),
    "a kilogram more": kilograms,
    "observers": bare_observer,
}

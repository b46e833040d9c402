"""Friction of joints against speed, load and temperature, from a log of an arm with otherwise known dynamics.

The torque that the arm without friction leaves unexplained, row by row, is fitted by the terms of `friction_law`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.actuators.gear import loses_power
from armwright.description.friction import BY_TEMPERATURE
from armwright.description.paths import path_name, unit_at
from armwright.dynamics.gears import joint_torques
from armwright.entry import AnyArm, AnyLog, as_arm, as_log
from armwright.errors import DescriptionError, IdentificationError, Interrupted, check_known
from armwright.fitting.covariance import covariance_of
from armwright.fitting.measures import agreement
from armwright.friction_laws import law_of_keys
from armwright.identification.arm.equations import Samples
from armwright.identification.arm.friction_law import (
    CANDIDATES,
    WORTH,
    Choice,
    FittedFriction,
    FrictionRows,
    FrictionTerm,
    choose_terms,
    fitted_law,
    level_of,
    terms_of,
)
from armwright.identification.arm.samples import checked, stream_of
from armwright.identification.arm.spring_record import spring_keys
from armwright.identification.arm.torque_model import SUPPORT as LINEAR, torque_model
from armwright.identification.estimate import Estimate
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation, choose_preparation
from armwright.identification.validation.comparison import NO_HOLD_OUT, NO_VERDICT, judged_on_torques
from armwright.model import Body, Model
from armwright.progress import Progress, Shown, automatic

SUPPORT = LINEAR.named("identify friction")

SLOWEST = 0.02  # of a joint's largest speed: slower rows are left out, the direction of dry friction is not known there
WIDER, HIGHEST = 4.0, 0.2  # cut-off by the one that suits the positions, and its largest share of the rate
FEWEST = 50  # rows of a joint
STRETCH_GAP = 100  # row numbers between stretches: their residuals are independent
BINS = 12  # of a table over speed, either way
LEAST_EXPLAINED, MOST_LEFT = 0.5, 0.1  # shares of power: of the friction's torque, and of the measured torque
BOUND = 1e-9  # of a parameter's scale


def friction_rows(
    log: Log, arm: Model, preparation: Preparation | None = None, warming: Mapping[str, float] | None = None
) -> list[FrictionRows]:
    """Rows of every joint of a known arm in motion, for `choose_terms` and `fitted_law`.

    Rows near a turn are left out: there the low-pass has rounded off the change of sign.

    Args:
        log: with torques, currents or voltages.   arm: the arm; its own friction is not used.
        preparation: None: chosen.
        warming: [K] of each run, by its name; None: the log's temperatures above the record's `motor.thermal.reference_c`.
    Raises:
        IdentificationError: an arm without masses, or a log that does not fit.
    """
    if not np.any(np.asarray(arm.inertial_parameters, dtype=float)):
        what = "an arm without masses: its gravity cannot be taken off"
        raise IdentificationError(what, place=arm.name, expected="identify it first: armwright identify arm")
    from armwright.kernels.compiled import compile_arm

    plain = compile_arm(arm.replace(friction=None))
    links = compile_arm(arm.replace(friction=None, rotors=None, efficiency=None))
    choice, shares = preparation or _wider(log), motor_shares(arm)
    frictionless = arm.replace(friction=None)
    lossy, to_motors = any(map(loses_power, frictionless.coordinates)), np.linalg.inv(shares)
    model, parts, stretch, end = torque_model(arm), [[] for _ in range(arm.n)], None, 0
    for block in stream_of(log, arm, None, choice).samples(model):
        begin = end if (block.run, block.stretch) == stretch else end + STRETCH_GAP
        stretch, end = (block.run, block.stretch), begin + len(block.t)
        load = links.inverse_dynamics(block.q, block.qd, block.qdd) @ shares
        if lossy:  # what leaves the gears, without what the links take
            own = (block.tau @ to_motors).T
            rest = np.asarray(joint_torques(frictionless, block.qd.T, block.qdd.T, own), dtype=float).T - load
        else:
            rest = block.tau - plain.inverse_dynamics(block.q, block.qd, block.qdd) @ shares
        near = max(round(1.0 / (choice.cutoff * max(np.median(np.diff(block.t)), 1e-9))), 1) if len(block.t) > 1 else 1
        warm = _warming(block, arm, warming)
        for j in range(arm.n):
            speed = block.qd[:, j]
            turns = np.flatnonzero(np.diff(np.sign(speed)) != 0)
            away = np.ones(len(speed), dtype=bool)
            for turn in turns:
                away[max(turn + 1 - near, 0) : turn + 1 + near] = False
            kept = away & np.isfinite(rest[:, j]) & (True if block.fitted is None else block.fitted[:, j])
            columns = (each[kept, j] for each in (block.q, block.qd, rest, load, warm))
            parts[j].append(FrictionRows(*columns, number=begin + np.flatnonzero(kept)))
    joined = []
    for each in parts:
        rows = FrictionRows(*(np.concatenate([getattr(part, name) for part in each]) for name in vars(each[0])))
        largest = np.abs(rows.speed).max(initial=0.0)
        joined.append(rows.part(np.abs(rows.speed) > SLOWEST * largest))
    return joined


def _behind_gears(arm: Model) -> list[str]:
    """A sentence about joints whose friction the record has on the motor's side of a lossy gear, and a fit has at the joint."""
    lossy = [body for body in arm.replace(friction=None).coordinates if loses_power(body)]
    own = {body.joint for body in arm.coordinates if body.friction is not None and body.friction.on_motor}
    joints = [body.joint for body in lossy if body.joint in own]
    if not joints:
        return []
    return [
        f"{', '.join(joints)}: the record has friction at the motor; here it is that of the joint, behind the lossy gear, "
        "which is not the same by the gear's loss of it: `identify arm` keeps the side"
    ]


def _warming(block: Samples, arm: Model, warming: Mapping[str, float] | None) -> np.ndarray:
    """(rows, n) [K] of the motors above their reference temperatures; NaN where it is not known."""
    if warming is not None:
        return np.full(block.q.shape, warming.get(block.run, np.nan))
    thermal = [body.drive.thermal for body in arm.coordinates]
    reference = np.array([np.nan if each is None else float(each.reference) for each in thermal])
    return np.full(block.q.shape, np.nan) if block.temperature is None else block.temperature - reference


def _wider(log: Log) -> Preparation:
    """A low-pass wider than the positions need: the wider, the fewer rows near a turn are left out."""
    chosen = choose_preparation(log).cutoff
    return choose_preparation(log, cutoff=max(chosen, min(WIDER * chosen, HIGHEST / log.run().period)))


def friction_over_speed(rows: FrictionRows, bins: int = BINS) -> np.ndarray:
    """A table of friction: (≤ 2 bins, 4) mean speed, mean friction, its standard deviation, and number of rows."""
    edges = np.linspace(0.0, np.abs(rows.speed).max(initial=1e-9), bins + 1)
    table = []
    for sign in (-1, 1):
        for low, high in pairwise(edges):
            chosen = (sign * rows.speed > low) & (sign * rows.speed <= high)
            if chosen.sum() >= 2:
                values = rows.torque[chosen]
                table.append([rows.speed[chosen].mean(), values.mean(), values.std(ddof=1), chosen.sum()])
    return np.array(sorted(table)) if table else np.zeros((0, 4))


def identify_friction(
    log: AnyLog,
    arm: AnyArm,
    *,
    preparation: Preparation | None = None,
    warming: Mapping[str, float] | None = None,
    candidates: Sequence[str] = CANDIDATES,
    worth: float = WORTH,
    progress: Shown = None,
) -> Estimate:
    """Friction of every joint against its speed, load and temperature, from a log of an arm with otherwise known dynamics.

    Args:
        log: with positions, and torques, currents or voltages.   arm: the arm; its masses count, its friction does not.
        preparation: None: chosen.   warming: [K] above the reference temperature, of each run by its name; None: by the
            log's temperatures, for joints whose record has a reference temperature.
        candidates: of "stribeck", "load", "coulomb by temperature", "viscous by temperature", "sigmoid", "spring" and
            "counterbalance", which stay only if they lower the held-out error by `worth`, a share.   worth: 0.01.
        progress: True or None: a bar where it is seen; False: none; a function is called with joints done and of all.
    Returns:
        estimate: numbers under the record's own keys, such as `joint1.friction.viscous_n_m_s_per_rad`; those of springs, of which
            the record may make a table, under names of their own. Remarks say what each candidate brought. "not identified" where
            friction explains less than half of what the arm leaves unexplained and a tenth of the torque's power is left, or
            where the record predicts the runs that the log holds out worse than the one that came in, or with R² below 0.5,
            or where no record can have the numbers, as friction that takes more than the load that it grows with.
    Raises:
        IdentificationError: an arm without masses, an unknown candidate, a log that does not fit.
        Interrupted: Ctrl-C; `found` holds the friction of the joints until then, "not identified".
    Example:
        >>> log = "examples/logs/lwa4p/lwa4p.log.toml"
        >>> fit = aw.identification.identify_friction(log, "lwa4p", candidates=())
        >>> fit["joint1.friction.viscous_n_m_s_per_rad"] > 0
        True
    """
    log = as_log(log)
    arm = as_arm(arm)
    for each in candidates:
        check_known(IdentificationError, each, CANDIDATES, "unknown", place="candidates")
    log = checked(log, arm)
    names: list[str] = []
    values, bounds, blocks, measures = [], [], [], {}
    remarks, doubtful = [*map(str, log.warnings), *SUPPORT.notes(arm), *_behind_gears(arm)], False
    measured = log.layout["temperature"].joints or () if "temperature" in log.layout and warming is None else ()
    with automatic(progress, "fitting friction") as tell:
        every = friction_rows(log, arm, preparation, warming)
        fits = _fits(every, candidates, worth, tell)
    for body, rows, fit in zip(arm.coordinates, every, fits, strict=False):
        if body.drive.thermal is None and log.joints.index(body.joint) in measured:
            what = "the log has its temperature, the record no motor.thermal.reference_c to count it from"
            remarks.append(f"{body.joint}: {what}: slopes of friction over temperature are not tried")
        if fit is None:
            remarks.append(
                f"{body.joint}: does not move both ways for long enough; its friction stays as the record has it"
            )
            continue
        choice, law, covariance = fit
        remarks += (doubt := _unexplained_torque(body.joint, rows, choice.error))
        doubtful = doubtful or bool(doubt)
        for term, value, at_bound in _recorded(rows, law):
            names.append(_name(body, term))
            values.append(value)
            bounds.append(at_bound)
        blocks.append(_spread(law, covariance))
        found = agreement(rows.torque, law(rows))
        measures[body.joint] = {"r2": found.r2, "rms": found.rms, "held_out_rms": choice.error}
        remarks += _said(body.joint, law, choice, worth)
    if not names:
        raise IdentificationError(
            "no joint moves both ways", place="log", expected="motion of the joints, forward and back"
        )
    from scipy.linalg import block_diag

    at_bound = np.array(bounds)
    remarks += [f"{name} is at its bound" for name, at in zip(names, bounds, strict=True) if at]
    missing = ", ".join(arm.names[len(fits) :])
    if missing:
        remarks.append(f"not fitted, as Ctrl-C stopped the identification: {missing}")
    result = Estimate(
        tuple(names), np.array(values), np.asarray(block_diag(*blocks)), log.sha256,
        "friction: least squares of the torque that the arm without friction leaves unexplained, candidates by held-out error",
        units=tuple(_unit(name) for name in names), at_bound=at_bound, remarks=tuple(remarks),
        fit=measures, verdict="not identified" if doubtful or missing else "identified", log=log.path.name,
    )  # fmt: skip
    if missing:
        raise Interrupted(f"before {missing} could be fitted", found=result)
    return _judged(result, log, arm, [joint for joint in arm.names if joint in measures])


def _judged(estimate: Estimate, log: Log, arm: Model, joints: Sequence[str]) -> Estimate:
    """The estimate with measures of its record on the runs held out, as `validate` has them, beside the record that came in.

    The few numbers of a joint's friction add nothing to its error there that counts beside the spread of the residuals.

    Args:
        estimate: of the friction.   log: of the runs.   arm: that came in.   joints: names of those that were fitted.
    """
    try:
        with_identified_friction(arm, estimate)
    except DescriptionError as error:
        remarks = (*estimate.remarks, f"no record can have these numbers, so this is no friction alone: {error}")
        return replace(estimate, remarks=remarks, verdict="not identified")
    if not log.hold_out:
        return replace(estimate, remarks=(*estimate.remarks, NO_HOLD_OUT))
    if any(name.endswith(BY_TEMPERATURE) for name in estimate.names):
        what = f"{NO_VERDICT}: validate predicts torques at the reference temperature, and this friction depends on temperature"
        return replace(estimate, remarks=(*estimate.remarks, what))
    return judged_on_torques(estimate, lambda: with_identified_friction(arm, estimate), arm, log, joints)


def _fits(
    joints: Sequence[FrictionRows], candidates: Sequence[str], worth: float, progress: Progress
) -> list[tuple[Choice, FittedFriction, np.ndarray] | None]:
    """Choice of terms, law and covariance by joint, None of those that do not move both ways; fewer joints after Ctrl-C.

    Raises:
        KeyboardInterrupt: before the first joint was fitted.
    """
    found: list[tuple[Choice, FittedFriction, np.ndarray] | None] = []
    for rows in joints:
        try:
            progress(len(found), len(joints))
            if len(rows.speed) < FEWEST or not (rows.speed > 0).any() or not (rows.speed < 0).any():
                found.append(None)
                continue
            choice = choose_terms(rows, candidates, worth)
            law = fitted_law(rows, choice.terms)
            found.append((choice, law, _covariance(rows, law)))
        except KeyboardInterrupt:
            if not any(found):
                raise
            break
    return found


def _unexplained_torque(joint: str, rows: FrictionRows, error: float) -> list[str]:
    """A sentence where the friction does not explain what the arm leaves unexplained, and that is not small.

    Args:
        joint: name.   rows: of it.   error: on held-out parts [N m | N].
    """
    left, measured = error**2 / max(float(rows.torque.var()), 1e-300), float((rows.torque + rows.load).var())
    if left <= 1 - LEAST_EXPLAINED or error**2 <= MOST_LEFT * measured:
        return []
    what = f"on held-out parts friction explains {max(1 - left, 0.0):.0%} of what the arm leaves unexplained"
    return [
        f"{joint}: {what}, and {error**2 / max(measured, 1e-300):.0%} of the torque's power is left: is it this arm?"
    ]


OFFSET = FrictionTerm("offset", "torque", level_of, -np.inf)


def _is_shifted(law: FittedFriction) -> bool:
    """True if a Coulomb level is below 0, which no record allows: then one level with an offset is used."""
    return min(law.values.get("coulomb_positive", 0.0), law.values.get("coulomb_negative", 0.0)) < 0


def _recorded(rows: FrictionRows, law: FittedFriction) -> list[tuple[FrictionTerm, float, bool]]:
    """Every number of a law as a record has it, and whether it is at its bound."""
    values = dict(law.values)
    terms = list(terms_of(law.terms))
    if _is_shifted(law):
        plus, minus = values["coulomb_positive"], values["coulomb_negative"]
        values |= dict.fromkeys(("coulomb_positive", "coulomb_negative"), 0.5 * (plus + minus))
        values["offset"] = 0.5 * (plus - minus)
        terms.append(OFFSET)
    result = []
    for term in terms:
        low = 0.0 if term.stem.startswith("coulomb_") and term.dimension else term.low
        value = max(values[term.stem], low)
        result.append((term, value, value - low < BOUND * max(abs(term.start(rows)), 1e-3)))
    return result


def _spread(law: FittedFriction, covariance: np.ndarray) -> np.ndarray:
    """Covariance of `_recorded`."""
    if not _is_shifted(law):
        return covariance
    stems = [term.stem for term in terms_of(law.terms)]
    plus, minus = stems.index("coulomb_positive"), stems.index("coulomb_negative")
    change = np.eye(len(stems) + 1, len(stems))
    change[np.ix_([plus, minus], [plus, minus])] = 0.5
    change[-1, [plus, minus]] = 0.5, -0.5
    return change @ covariance @ change.T


SPRING = " of a spring or counterbalance"
# stem → value of `spring_keys`
OF_SPRING = {"stiffness": "spring", "rest": "constant", "sine": "sine", "cosine": "cosine"}


def _name(body: Body, term: FrictionTerm) -> str:
    if term.dimension == "spring":
        return f"{body.joint}: {term.stem}{SPRING}"
    key = term.stem if term.dimension is None else body.kind.units.key(term.stem, term.dimension)
    return f"{path_name(body.joint)}.friction.{key}"


def _unit(name: str) -> str:
    return unit_at(name) if ".friction." in name else "N m/rad" if "stiffness" in name else "N m"


def _said(joint: str, law: FittedFriction, choice: Choice, worth: float) -> list[str]:
    """Held-out errors of all candidates, in words."""
    said = []
    for name, share in choice.tried.items():
        if name in choice.terms:
            said.append(f"{joint}: {name} lowers the held-out error by {share:.1%}: kept")
        elif share > 0.1 * worth:
            said.append(f"{joint}: {name} lowers the held-out error by {share:.1%}, less than {worth:.0%}: left out")
    below = [side for side in ("coulomb_positive", "coulomb_negative") if law.values.get(side, 0.0) < 0]
    return said + [
        f"{joint}: {side} is below 0: an offset of the torque is larger than the dry friction" for side in below
    ]


def _covariance(rows: FrictionRows, law: FittedFriction) -> np.ndarray:
    """Covariance of a law's numbers, for residuals that are correlated in time; NaN of numbers without effect."""
    stems = [term.stem for term in terms_of(law.terms)]
    x = np.array([law.values[stem] for stem in stems])
    J = np.zeros((len(rows.speed), len(x)))
    for k in range(len(x)):
        h = 1e-6 * max(abs(x[k]), 1e-3)
        ends = [FittedFriction(law.terms, {**law.values, stems[k]: x[k] + sign * h})(rows) for sign in (1, -1)]
        J[:, k] = (ends[0] - ends[1]) / (2 * h)
    at = rows.number - rows.number[0]
    X, rest = np.zeros((at[-1] + 1, 1, len(x))), np.full((at[-1] + 1, 1), np.nan)  # rows that are left out are missing
    X[at, 0], rest[at, 0] = J, rows.torque - law(rows)
    lost = np.linalg.norm(J, axis=0) == 0
    return np.where(lost | lost[:, None], np.nan, covariance_of([(X, rest)]))


def with_identified_friction(arm: Model, estimate: Estimate) -> Model:
    """The arm with the estimated friction in place of its own, and with the estimated springs added to its own.

    Raises:
        DescriptionError: the record cannot have these numbers.
    """
    from armwright.description.drive import LinearFriction, RotaryFriction
    from armwright.description.robot import MovingJoint
    from armwright.model.variants.edits import checked, replaced

    numbers: dict[str, dict[str, Any]] = {}
    springs: dict[str, dict[str, float]] = {}
    for name, value, std in zip(estimate.names, estimate.values, estimate.std, strict=True):
        joint, _, key = name.partition(".friction.")
        if name.endswith(SPRING):
            joint, _, stem = name.removesuffix(SPRING).rpartition(": ")
            springs.setdefault(joint, {})[OF_SPRING[stem]] = float(value)
        if key:
            spread = {"std": float(std)} if np.isfinite(std) else {}
            numbers.setdefault(joint, {})[key] = {"value": float(value), "source": "fit", **spread}
    joints, bodies = [], {body.joint: body for body in arm.coordinates}
    for joint in arm.record.joints:
        keys = numbers.get(joint.name)
        if keys is not None and isinstance(joint, MovingJoint):
            units = joint.kind.units
            kind = LinearFriction if units.linear else RotaryFriction
            law = law_of_keys(keys, units)
            smoothing = units.key("smoothing", "speed")
            old = getattr(joint.friction, smoothing, None)
            kept = {smoothing: old} if old is not None and law == "coulomb" else {}
            friction = checked(kind, f"{path_name(joint.name)}.friction", law=law, **kept, **keys)
            joint = joint.replace(friction=friction)
        if joint.name in springs:
            joint = joint.replace(**spring_keys(bodies[joint.name], springs[joint.name], "fit")[0])
        joints.append(joint)
    prefixes = tuple(f"{path_name(joint)}.friction." for joint in numbers)
    fits = {key: fit.without(prefixes) for key, fit in arm.record.fits.items()}
    record = replaced(arm.record, "with_identified_friction", joints=tuple(joints), fits=fits)
    from armwright.model import build_model

    return replace(build_model(record, on_impossible="warn"), changes={})

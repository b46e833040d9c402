"""Torque prediction: inverse dynamics of a record along the motion of a log, compared with measured torques."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from armwright.actuators.coupling import motor_shares
from armwright.errors import LogError
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import (
    LITTLE,
    beyond_limits,
    measured_limits,
    resting_speeds,
    without_rest,
)
from armwright.identification.logs.prepared import LoggedMotion, zero_phase
from armwright.identification.logs.torques import torques_on_joints
from armwright.identification.validation.match import Match, check_pose_free, match
from armwright.identification.validation.prediction import Prediction
from armwright.kernels.compiled import CompiledArm, compile_arm
from armwright.model import Model

FRICTION: dict[str, dict[str, float | None]] = {  # fields of a term that torques may lack
    "viscous": {"viscous": 0.0},
    "coulomb": {"coulomb_positive": 0.0, "coulomb_negative": 0.0, "stribeck": None},
    "offset": {"offset": 0.0},
}
NEEDED = {"current": ("torque_constant",), "voltage": ("torque_constant", "resistance")}  # constants of drives


def predict_torque(
    arm: Model, log: Log, motion: LoggedMotion, dyn: CompiledArm | None = None, matched: Match | None = None
) -> Prediction:
    """Torques of a run by inverse dynamics,  τ̂ = M(q) q̈ + C q̇ + g + f(q̇),  along its prepared motion. [LuhWalkerPaul1980]

    The motion passes a wider low-pass than the preparation's, then τ̂ and the measured torques pass that of the preparation, as
    in `arm.samples`: a low-pass of the motion alone would leave a part of τ̂ out. A torque that is held from row to row (`held` in
    the log's file) acts half a period later than its row says.

    Where motors are coupled, τ̂ are torques on the joints, as logs have them: Bᵀ times those of the motors.

    Measured torques are those of the log, or of its currents, Nᵀ Kt i, or of its voltages by eq. (12) of the CMU report; NaN
    where a full converter cuts them off.

    Args:
        arm: a full record.   log: what `read_log` returned.   motion: of one of its runs.
        dyn: kernels of `as_logged`; None: they are compiled.   matched: what the log has of the arm; None: looked up.
    Returns:
        prediction: of the torque, a row for each row that the motion keeps.
    Raises:
        LogError: an arm that does not match, no torque, no motor constants for a current or voltage.
    """
    matched = matched or match(arm, log)
    source, order, run, data = matched.source, matched.columns, motion.run, motion.data
    if source is None:
        raise LogError("neither torque nor current logged", place="signals", expected="one of them", file=log.path)
    check_constants(arm, source, log)
    arm = as_logged(arm, matched.lacks)
    dyn = dyn or compile_arm(arm)
    if "q" not in matched.logged:
        check_pose_free(arm, dyn, log)
    qd, qdd = (data[name].values[:, order] for name in ("qd", "qdd"))
    q = data["q"].values[:, order] if "q" in matched.logged else np.zeros_like(qd)
    resting, efforts = resting_speeds(log, run.name)[order], data[source].values[:, order]
    limits = measured_limits(log, run.name, source)[:, order]
    cut_off = beyond_limits(efforts, limits) & (np.abs(qd) > resting)
    qd = without_rest(qd, resting, motion.preparation.rate)
    measured = _filtered(motion, torques_on_joints(arm, source, efforts, qd))
    if cut_off.any():
        measured[np.abs(_filtered(motion, cut_off.astype(float))) > LITTLE] = np.nan
    predicted = _filtered(motion, dyn.inverse_dynamics(q, qd, qdd)) @ motor_shares(arm)
    if source == "tau_link":
        predicted = predicted + sensor_zeros(arm)
    direction, qd, qdd = (_filtered(motion, each) for each in (np.sign(qd), qd, qdd))
    how = {"tau": "", "tau_link": " behind the gears", "current": " from currents", "voltage": " from voltages"}[source]
    how = f"inverse dynamics along the log, torques measured{how}{', held from row to row' * (source in log.held)}"
    t, part = (data[name].values[motion.kept] for name in ("time", "stretch"))
    every = motion.preparation.decimate
    return Prediction.of(
        arm, run, "torque", how, t, part, measured, predicted, rate=motion.preparation.rate / every, every=every, speed=qd,
        acceleration=qdd, inputs=qdd, input_name="acceleration", direction=direction,
    )  # fmt: skip


def sensor_zeros(arm: Model) -> np.ndarray:
    """(n,) [N m | N] zeros of the torque sensors behind the gears, as the last fit of the record that found them; else 0."""
    zeros = np.zeros(arm.n)
    for fit in () if arm.description is None else arm.description.fits.values():
        for k in range(arm.n):
            zeros[k] = fit.others[f"zero{k + 1}"].number if f"zero{k + 1}" in fit.others else zeros[k]
    return zeros


def _filtered(motion: LoggedMotion, values: np.ndarray) -> np.ndarray:
    """Values (rows, n) of all rows behind the filter that measured torques have passed, stretch by stretch, at the kept rows."""
    return np.concatenate([zero_phase(motion.preparation, values[part]) for part in motion.parts])[motion.kept]


def check_constants(arm: Model, source: str, log: Log) -> None:
    """Refuses currents or voltages of motors without the necessary constants in the record.

    Raises:
        LogError: names joint and key.
    """
    keys = {"torque_constant": "torque_constant_n_m_per_a", "resistance": "resistance_ohm"}
    for body in arm.coordinates:
        for name in NEEDED.get(source, ()):
            if getattr(body.drive, name) is None:
                what = f"the log has {source}s, and the record of {arm.name} states no {keys[name]}"
                place, expected = f"joint {body.joint!r} motor", "a record with motor constants, or logged torques"
                raise LogError(what, place=place, expected=expected, file=log.path)


def as_logged(arm: Model, lacks: Collection[str]) -> Model:
    """The arm without the terms that were subtracted from its torques before logging: the key `lacks` of the log's file.

    Args:
        arm: the whole arm.   lacks: `Log.lacks`, where torques are what is used of the log.
    """
    whole = {"springs": None, "rotors": None, "gravity": np.zeros(3)}
    arm = arm.replace(**{term: value for term, value in whole.items() if term in lacks})
    taken = {key: value for term in lacks for key, value in FRICTION.get(term, {}).items()}
    if not taken:
        return arm
    bodies = (
        body if body.friction is None else replace(body, friction=replace(body.friction, **taken))
        for body in arm.bodies
    )
    return replace(arm, bodies=tuple(bodies))

"""Torque prediction: inverse dynamics of a record along the motion of a log, compared with measured torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from armwright.actuators import drive_torque
from armwright.actuators.coupling import motor_shares
from armwright.description.drive import Command
from armwright.errors import LogError
from armwright.fitting.residuals import parts_of
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import Preparation
from armwright.identification.logs.prepared import prepare_log, resting_speeds, zero_phase
from armwright.identification.validation.prediction import (
    Prediction,
    check_match,
    columns_of,
    is_logged,
    positions_of,
    preparation_for,
    units_of,
)
from armwright.kernels.compiled import CompiledArm, compile_arm
from armwright.model import Model

Source = Literal["tau", "current", "voltage"]  # signals of a log from which torques are known

FRICTION: dict[str, dict[str, float | None]] = {  # fields of a term that torques may lack
    "viscous": {"viscous": 0.0},
    "coulomb": {"coulomb_positive": 0.0, "coulomb_negative": 0.0, "stribeck": None},
    "offset": {"offset": 0.0},
}


def torque_source(log: Log) -> Source | None:
    """The signal used for measured torques: "tau", else "current", else "voltage" with positions; None if none is logged."""
    sources: tuple[Source, ...] = ("tau", "current", "voltage")
    for signal in sources:
        if signal in log.layout and (signal != "voltage" or is_logged(log, "q")):
            return signal
    return None


def predict_torque(
    arm: Model, log: Log, run: str | None = None, preparation: Preparation | None = None, dyn: CompiledArm | None = None
) -> Prediction:
    """Torques of a run by inverse dynamics,  τ̂ = M(q) q̈ + C q̇ + g + f(q̇),  along its prepared motion. [LuhWalkerPaul1980]

    The motion passes a wider low-pass than the preparation's, then τ̂ and the measured torques pass that of the preparation, as
    in `arm.samples`: a low-pass of the motion alone would leave a part of τ̂ out. A torque that is held from row to row (`held` in
    the log's file) acts half a period later than its row says.

    Where motors are coupled, τ̂ are torques on the joints, as logs have them: Bᵀ times those of the motors.

    Measured torques are those of the log, or of its currents, Nᵀ Kt i, or of its voltages by eq. (12) of the CMU report.

    Args:
        arm: a full record.   log: what `read_log` returned.   run: its name; None: the first.
        preparation: None: what `preparation_for` says.   dyn: kernels of `as_logged`; None: they are compiled.
    Returns:
        prediction: of the torque, a row for each prepared row.
    Raises:
        LogError: an arm that does not match, no torque, no motion.   ModelError: no motor constants for a current or voltage.
    """
    check_match(arm, log)
    source = torque_source(log)
    if source is None:
        raise LogError("neither torque nor current logged", place="signals", expected="one of them", file=log.path)
    check_constants(arm, source, log)
    chosen = log.run(run)
    preparation = preparation or preparation_for(log, chosen.name)
    first = preparation.of_motion
    data = prepare_log(log, chosen.name, replace(first, decimate=1))
    if "qdd" not in data:
        raise LogError("neither position nor speed logged", place="signals", expected="one of them", file=log.path)
    arm = as_logged(arm, log, source)
    dyn = dyn or compile_arm(arm)
    order, parts = columns_of(arm, log), parts_of(data["stretch"].values)
    q, qd, qdd = positions_of(arm, dyn, log, data), data["qd"].values[:, order], data["qdd"].values[:, order]
    values = data[source].values[:, order]
    spoilt = preparation.edge - first.edge
    kept = [np.arange(part.start + spoilt, part.stop - spoilt, preparation.decimate) for part in parts]
    rows = np.concatenate(kept)
    if not len(rows):
        expected = f"more than {2 * preparation.edge} rows without a gap; or a higher cut-off"
        raise LogError("no stretch is long enough", place=f"run {chosen.name!r}", expected=expected, file=log.path)

    def prepared(values: np.ndarray) -> np.ndarray:
        return _filtered(values, parts, preparation)[rows]

    qd = np.where(np.abs(qd) < resting_speeds(log, chosen.name)[order], 0.0, qd)
    measured, predicted = (
        prepared(measured_torques(arm, source, values, qd)),
        prepared(dyn.inverse_dynamics(q, qd, qdd)),
    )
    direction, qd, qdd = (prepared(each) for each in (np.sign(qd), qd, qdd))
    how = {"tau": "", "current": " from currents", "voltage": " from voltages"}[source]
    return Prediction(
        "torque",
        f"inverse dynamics along the log, torques measured{how}{', held from row to row' * (source in log.held)}",
        chosen.name,
        chosen.use,
        tuple(arm.names),
        units_of(arm, "torque"),
        preparation.rate / preparation.decimate,
        preparation.decimate,
        data["time"].values[rows],
        data["stretch"].values[rows],
        measured,
        predicted @ motor_shares(arm),
        qd,
        qdd,
        qdd,
        "acceleration",
        direction=direction,
    )


def _filtered(values: np.ndarray, parts: Sequence[slice], preparation: Preparation) -> np.ndarray:
    """Values (rows, n) through the filter that measured torques have passed, stretch by stretch."""
    found = values.copy()
    for part in parts:
        found[part] = zero_phase(preparation, values[part])
    return found


def check_constants(arm: Model, source: str, log: Log) -> None:
    """Refuses currents or voltages of motors without the necessary constants in the record.

    Raises:
        LogError: names joint and key.
    """
    needed = {"tau": (), "current": ("torque_constant",), "voltage": ("torque_constant", "resistance")}[source]
    keys = {"torque_constant": "torque_constant_n_m_per_a", "resistance": "resistance_ohm"}
    for body in arm.coordinates:
        for name in needed:
            if getattr(body.drive, name) is None:
                what = f"the log has {source}s, and the record of {arm.name} states no {keys[name]}"
                place = f"joint {body.joint!r} motor"
                raise LogError(
                    what, place=place, expected="a record with motor constants, or logged torques", file=log.path
                )


def measured_torques(arm: Model, source: Source, values: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Torques on the joints (rows, n), Bᵀ times those of the motors, from torques, currents or voltages.

    Args:
        arm: the model.   source: the signal.   values: (rows, n) of it.   qd: (rows, n) [rad/s | m/s], needed of voltages.
    """
    if source == "tau":
        return values
    return drive_torque(with_command(arm, source), qd.T, values.T).T @ motor_shares(arm)


def as_logged(arm: Model, log: Log, source: str) -> Model:
    """The arm without the terms that were subtracted from its torques before logging: the key `lacks` of the log's file.

    Args:
        arm: the whole arm.   log: whose torques these are.   source: the signal that is used; only of "tau" terms are taken away.
    """
    lacks = {term for signal in log.table.signals for term in signal.lacks} if source == "tau" else set()
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


def with_command(arm: Model, command: Command) -> Model:
    """The arm with drives that take another kind of command."""
    bodies = (replace(body, drive=replace(body.drive, command=command)) for body in arm.bodies)
    return replace(arm, bodies=tuple(bodies))

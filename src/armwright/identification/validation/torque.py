"""Torque prediction: inverse dynamics of a record along the motion of a log, beside the torques that were measured."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.signal import sosfiltfilt

from armwright.actuators import drive_torque
from armwright.actuators.coupling import shares_of, to_motors
from armwright.description.drive import Command
from armwright.errors import LogError
from armwright.identification.logs.log import Log
from armwright.identification.logs.preparation import EDGE, Preparation, prepare_log, settling
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
    """The signal from which torques are known: "tau", else "current", else "voltage" with positions; None: there is none."""
    sources: tuple[Source, ...] = ("tau", "current", "voltage")
    for signal in sources:
        if signal in log.layout and (signal != "voltage" or is_logged(log, "q")):
            return signal
    return None


def predict_torque(
    arm: Model, log: Log, run: str | None = None, preparation: Preparation | None = None, dyn: CompiledArm | None = None
) -> Prediction:
    """Torques of a run by inverse dynamics,  τ̂ = M(q) q̈ + C q̇ + g + f(q̇),  along its prepared motion. [LuhWalkerPaul1980]

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
    data = prepare_log(log, chosen.name, preparation)
    if "qdd" not in data:
        raise LogError("neither position nor speed logged", place="signals", expected="one of them", file=log.path)
    arm = as_logged(arm, log, source)
    dyn = dyn or compile_arm(arm)
    order = columns_of(arm, log)
    q, qd, qdd = positions_of(arm, dyn, log, data), data["qd"].values[:, order], data["qdd"].values[:, order]
    predicted = dyn.inverse_dynamics(q, qd, qdd) + _rounding(arm, dyn, log, chosen.name, preparation)
    measured = _measured(arm, source, data[source].values[:, order], qd)
    how = {"tau": "", "current": " from currents", "voltage": " from voltages"}[source]
    return Prediction(
        "torque",
        f"inverse dynamics along the log, torques measured{how}",
        chosen.name,
        chosen.use,
        tuple(arm.names),
        units_of(arm, "torque"),
        preparation.rate / preparation.decimate,
        preparation.decimate,
        data["time"].values,
        data["stretch"].values,
        measured,
        predicted @ motor_shares(arm),
        qd,
        qdd,
        qdd,
        "acceleration",
    )


def _rounding(arm: Model, dyn: CompiledArm, log: Log, run: str, preparation: Preparation) -> np.ndarray:
    """Loss of dry friction in the low-pass, (rows, n) or 0 [N m | N]: measured torques went through it, signs of speeds did not.

    Dry friction jumps where a joint turns back, and leaves the filter as a smooth step.
    """
    if not any(body.friction is not None and body.friction.is_dry for body in arm.coordinates):
        return np.zeros(arm.n)
    smooth = compile_arm(_without_friction(arm, ("coulomb",)))
    data, order = prepare_log(log, run, replace(preparation, decimate=1)), columns_of(arm, log)
    q, qd, qdd = positions_of(arm, dyn, log, data), data["qd"].values[:, order], data["qdd"].values[:, order]
    sharp = dyn.inverse_dynamics(q, qd, qdd) - smooth.inverse_dynamics(q, qd, qdd)
    parts = []
    for stretch in np.unique(data["stretch"].values):
        dry = sharp[data["stretch"].values == stretch]
        pad = min(3 * settling(preparation.sections, EDGE), len(dry) - 1)
        rounded = np.asarray(sosfiltfilt(preparation.sections, dry, axis=0, padlen=pad))
        parts.append((rounded - dry)[:: preparation.decimate])
    return np.concatenate(parts)


def check_constants(arm: Model, source: str, log: Log) -> None:
    """Refuses currents or voltages of motors whose constants the record does not state.

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


def _measured(arm: Model, source: Source, values: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Torques on the joints (rows, n), Bᵀ times those of the motors, from torques, currents or voltages."""
    if source == "tau":
        return values
    return drive_torque(with_command(arm, source), qd.T, values.T).T @ motor_shares(arm)


def motor_shares(arm: Model) -> np.ndarray:
    """B (n, n) of coupled motors, 1 where there are none: tau_joints = Bᵀ tau_motors, as rows  tau_joints = tau_motors B."""
    return np.array(to_motors(shares_of(arm), np.eye(arm.n)), dtype=float)


def as_logged(arm: Model, log: Log, source: str) -> Model:
    """The arm without the terms that were taken off its torques before they were logged: what the log's tables call `lacks`.

    Args:
        arm: the whole arm.   log: whose torques these are.   source: the signal that is used; only of "tau" terms are taken away.
    """
    lacks = {term for signal in log.table.signals for term in signal.lacks} if source == "tau" else set()
    whole = {"springs": None, "rotors": None, "gravity": np.zeros(3)}
    arm = arm.replace(**{term: value for term, value in whole.items() if term in lacks})
    return _without_friction(arm, lacks)


def _without_friction(arm: Model, terms: Collection[str]) -> Model:
    """The arm without some terms of its friction, keys of `FRICTION`; it knows no others."""
    taken = {key: value for term in terms for key, value in FRICTION.get(term, {}).items()}
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

"""Linear model of an arm's motor torques: the parameters identifiable from torques, and the column of each.

With B the motors' speeds by the joints' (w = B q̇, `actuators.coupling`) and π the inertial parameters of all links,

    tau = Y(q, q̇, q̈) π + Σ Bᵢᵀ Iᵢ (B q̈)ᵢ + Σ Bᵢᵀ fᵢ((B q̇)ᵢ) + springs.

A motor that several joints turn gives its torque to all of them: its rotor, viscous and Coulomb columns have more than one row.
[GautierKhalil1990], [AtkesonAnHollerbach1986]
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from armwright.actuators.coupling import shares_of
from armwright.actuators.friction import by_loads
from armwright.description.paths import path_name
from armwright.entry import as_arm
from armwright.errors import IdentificationError, check_known
from armwright.features import Support
from armwright.friction_laws import LAWS
from armwright.friction_laws.levels import smooth_sign
from armwright.identification.arm.spring_record import SPRINGS
from armwright.kernels.compiled import KERNELS
from armwright.model import Model

if TYPE_CHECKING:
    from armwright.kernels.compiled import CompiledArm

ELECTRICAL = ("servo", "servo counts", "inductance", "current loop", "coasting", "dead zone", "supply")
MEASURED = Support(  # what takes measured torques and an arm's own
    "measured torques",
    approximated={name: how for name, how in KERNELS.approximated.items() if name not in ELECTRICAL},
    without_effect={
        "brakes": "they are released",
        **dict.fromkeys(ELECTRICAL, "motor torques are measured, as torques or as currents"),
    },
)
FITTED, IN_FRICTION = "fitted as a constant of the whole log", "viscous and Coulomb friction stand for it"
SUPPORT = replace(
    MEASURED,
    consumer="identify arm",
    approximated={
        **MEASURED.approximated,
        **dict.fromkeys(("heat", "friction by temperature"), FITTED),
        **dict.fromkeys(("Stribeck friction", "sigmoid friction", "LuGre friction"), IN_FRICTION),
        "load-dependent friction": "what loads add is the record's, with its masses",
    },
)
INERTIAL = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
INERTIAL_UNITS = ("kg", "kg m", "kg m", "kg m", *["kg m²"] * 6)
FRICTION = ("viscous", "coulomb", "offset", "asymmetric", "stribeck", "zero")
USUAL_FRICTION = ("viscous", "coulomb", "offset")
LACKS = ("gravity", "springs", "rotors", "viscous", "coulomb", "offset")  # terms that a measured torque may be without
ZERO = 1e-10  # of the largest column: smaller ones are rounding
PROBES = 50  # random states that show which joint's torque a column is part of


@dataclass(frozen=True)
class ColumnKind:
    """A kind of drive or spring column: torque `law(x)` for a parameter of 1, x the joint's or motor's `state`.

    Attributes:
        stem: of names.   about: in words.   state: "q", "qd" or "qdd".   unit, sliding_unit: of the parameter.
        lack: the term of `LACKS` that it belongs to.
    """

    stem: str
    about: str
    state: str
    law: Callable[[np.ndarray, float], np.ndarray]
    unit: str
    sliding_unit: str
    lack: str = ""


def _sign(speed: np.ndarray, smoothing: float) -> np.ndarray:
    return smooth_sign(speed, smoothing or None)


def _fall(speed: np.ndarray, over: float) -> np.ndarray:
    return np.sign(speed) * np.exp(-((speed / over) ** 2))


KINDS = {
    "rotor": ColumnKind("Ia", "rotor inertia", "qdd", lambda x, _: x, "kg m²", "kg", "rotors"),
    "viscous": ColumnKind("fv", "viscous friction", "qd", lambda x, _: x, "N m s/rad", "N s/m", "viscous"),
    "coulomb": ColumnKind("fc", "Coulomb friction", "qd", _sign, "N m", "N", "coulomb"),
    "coulomb+": ColumnKind(
        "fc+", "Coulomb friction forward", "qd", lambda x, s: np.maximum(_sign(x, s), 0), "N m", "N", "coulomb"
    ),
    "coulomb-": ColumnKind(
        "fc-", "Coulomb friction backward", "qd", lambda x, s: np.minimum(_sign(x, s), 0), "N m", "N", "coulomb"
    ),
    "stribeck": ColumnKind("fs", "friction at standstill above Coulomb's", "qd", _fall, "N m", "N", "coulomb"),
    "offset": ColumnKind("off", "constant torque", "qd", lambda x, _: np.ones_like(x), "N m", "N", "offset"),
    "zero": ColumnKind("zero", "zero of the torque sensor", "qd", lambda x, _: np.ones_like(x), "N m", "N"),
    "spring": ColumnKind("k", "spring stiffness", "q", lambda x, _: x, "N m/rad", "N/m", "springs"),
    "sine": ColumnKind("ks", "counterbalance by sin q", "q", lambda x, _: np.sin(x), "N m", "N", "springs"),
    "cosine": ColumnKind("kc", "counterbalance by cos q", "q", lambda x, _: np.cos(x), "N m", "N", "springs"),
}


@dataclass(frozen=True)
class TorqueColumn:
    """One parameter of the model.

    Attributes:
        name: short, such as "mcx3" or "fv2"; numbers count joints from 1.   unit: of the parameter.
        joint: name of the joint that its link or motor belongs to.   kind: "inertial", or a key of `KINDS`.
        about: in words, such as "mass of link3".   path: of the number in the robot's record; None where it has no such number.
        turned: joints that turn it with their shares, (row, share): one for a joint, more for a coupled motor.
        speed: smoothing or Stribeck speed of its law [rad/s | m/s]; 0: none.
    """

    name: str
    unit: str
    joint: str
    kind: str
    about: str
    path: str | None
    turned: tuple[tuple[int, float], ...] = ()
    speed: float = 0.0


@dataclass(frozen=True, eq=False)
class TorqueModel:
    """The linear model of an arm: its columns, and their values at measured states.

    Attributes:
        arm: without the terms that the torque lacks.   columns: inertial ones first, 10 a link in the order of `arm.bodies`.
        prior: (p,) the record's values of the parameters, joint side; NaN where it says nothing.
        of_joint: (n, p) bool: the column is part of that joint's torque.   dyn: the compiled arm.
    """

    arm: Model
    columns: tuple[TorqueColumn, ...]
    prior: np.ndarray
    of_joint: np.ndarray
    dyn: CompiledArm
    sprung: bool
    # without friction, where loads add to the record's
    unrubbed: CompiledArm | None = field(default=None, kw_only=True)

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [column.name for column in self.columns]

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def sprung_joints(self) -> list[str]:
        """Names of the joints that have a spring and a counterbalance among the columns."""
        return list(dict.fromkeys(column.joint for column in self.columns if column.kind in SPRINGS))

    def index(self, name: str) -> int:
        """Number of a column.

        Raises:
            IdentificationError: no column has that name.
        """
        check_known(IdentificationError, name, self.names, "no such column", place="column")
        return self.names.index(name)

    def rows(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Values of all columns:  tau = rows @ parameters (+ `known_torques`).

        Args:
            q: (rows, n) [rad | m].   qd: (rows, n) [rad/s | m/s].   qdd: (rows, n) [rad/s² | m/s²].
        Returns:
            Y: (rows, n, p) [N m | N] per the columns' units.
        """
        return rows_of(self.dyn, self.columns, q, qd, qdd)

    def known_torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Torques (rows, n) [N m | N] that are not fitted, at states q, q̇, q̈: those of the record's springs."""
        return self.dyn.spring_torques(q) if self.sprung else np.zeros_like(q)

    def loaded_friction(self, q: np.ndarray, qd: np.ndarray, tau: np.ndarray, speeds: np.ndarray) -> np.ndarray | None:
        """Dry friction that loads add (rows, n) [N m | N] by the record and its masses; None where nothing is.

        Args:
            q, qd: (rows, n) states, speeds 0 where a joint rests.   tau: (rows, n) motor torques on the joints [N m | N].
            speeds: (k, rows, n) around each row, over whose directions the mean is taken, as friction jumps between rows.
        """
        if self.unrubbed is None:
            return None
        external, added = -self.unrubbed.bias_torques(q, qd), np.zeros_like(q)
        for j, body in enumerate(self.arm.coordinates):
            friction = body.friction
            if friction is not None and by_loads(body):
                level = LAWS[friction.law].level(friction, qd[:, j], (tau[:, j], external[:, j]))
                coulomb = np.where(qd[:, j] < 0.0, friction.coulomb_negative, friction.coulomb_positive)
                added[:, j] = smooth_sign(speeds[..., j], friction.smoothing).mean(axis=0) * (level - coulomb)
        return added

    def terms(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`rows` and `known_torques` together."""
        return self.rows(q, qd, qdd), self.known_torques(q, qd, qdd)

    def directed(self, rows: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """Columns (rows, n, p) with dry friction as its mean over speeds (k, rows, n) around each row: it jumps between rows."""
        for k, column in enumerate(self.columns):
            if column.kind != "inertial" and KINDS[column.kind].lack == "coulomb":
                torque = _law(column, {"qd": speeds}).mean(axis=0)
                for j, share in column.turned:
                    rows[:, j, k] = share * torque
        return rows

    def known_rows(self, qd: np.ndarray, smoother: np.ndarray) -> np.ndarray | None:
        """(rows, n) False where the measured torque is none of this model's, by two estimates of the speed; None: nowhere."""
        return None


def rows_of(
    dyn: CompiledArm, columns: Sequence[TorqueColumn], q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> np.ndarray:
    """Values (rows, n, p) of columns, as `TorqueModel.rows`."""
    arm = dyn.arm
    inertial = 10 * len(arm.bodies)
    values = np.zeros((len(q), arm.n, len(columns)))
    values[:, :, :inertial] = dyn.regressor(q, qd, qdd)
    states = {"q": q, "qd": qd, "qdd": qdd}
    for k, column in enumerate(columns[inertial:], start=inertial):
        torque = _law(column, states)
        for j, share in column.turned:
            values[:, j, k] = share * torque
    return values


def _law(column: TorqueColumn, states: Mapping[str, np.ndarray]) -> np.ndarray:
    """A column's law (…, rows) at states (…, rows, n) of the joint or motor that it belongs to."""
    kind = KINDS[column.kind]
    x = sum(share * states[kind.state][..., j] for j, share in column.turned)
    return kind.law(np.asarray(x), column.speed)


def torque_model(
    arm: Model,
    *,
    friction: Collection[str] = USUAL_FRICTION,
    springs: Collection[str] = (),
    lacks: Collection[str] = (),
    stribeck_speed: float | None = None,
    gears: np.ndarray | None = None,
    loads: bool = False,
) -> TorqueModel:
    """The linear model of an arm's torques.

    Args:
        arm: a full record, or kinematics alone.
        friction: of "viscous", "coulomb", "offset", "asymmetric" (Coulomb's level by direction, instead of "coulomb" and
            "offset"), "stribeck" and "zero", a torque sensor's, which no record has.
        springs: names of joints that get a spring and a counterbalance as candidates.
        lacks: terms that the measured torque is without: "gravity", "springs", "rotors", "viscous", "coulomb", "offset".
        stribeck_speed: of the Stribeck column [rad/s | m/s], at the joint.
        gears: (n, n) θ_motor = gears q, where the record has no motors.
        loads: whether what loads add to the record's friction is known torque, and not the fit's.
    Returns:
        model: its columns are structural; which of them a log can tell is another question (`base_parameters`).
    Raises:
        IdentificationError: an unknown term or joint, or gears that do not fit the arm.
    """
    from armwright.kernels.compiled import compile_arm

    arm = as_arm(arm)
    _check(arm, friction, springs, lacks, stribeck_speed)
    if "gravity" in lacks:
        arm = arm.replace(gravity=(0.0, 0.0, 0.0))
    columns = [*_inertial(arm), *_drives(arm, _shares(arm, gears), friction, stribeck_speed), *_springs(arm, springs)]
    columns = [each for each in columns if each.kind == "inertial" or KINDS[each.kind].lack not in lacks]
    dyn = compile_arm(arm)
    sprung = arm.is_sprung and "springs" not in lacks
    loads = loads and "coulomb" not in lacks and any(map(by_loads, arm.coordinates))
    unrubbed = None
    if loads:
        bodies = tuple(replace(body, friction=None) for body in arm.bodies)
        unrubbed = compile_arm(replace(arm, bodies=bodies))
    return TorqueModel(
        arm, tuple(columns), _prior(arm, columns), _of_joint(dyn, columns), dyn, sprung, unrubbed=unrubbed
    )


def _check(
    arm: Model, friction: Collection[str], springs: Collection[str], lacks: Collection[str], speed: float | None
):
    terms = (("friction", friction, FRICTION), ("lacks", lacks, LACKS), ("springs", springs, arm.names))
    for place, given, known in terms:
        for each in given:
            check_known(IdentificationError, each, known, "unknown", place=place)
    if "asymmetric" in friction and {"coulomb", "offset"} & set(friction):
        raise IdentificationError(
            "stands for coulomb and offset together", place="friction", value="asymmetric", expected="one or the other"
        )
    if ("stribeck" in friction) != (speed is not None):
        expected = 'a speed in rad/s or m/s, with friction "stribeck"'
        raise IdentificationError(place="stribeck_speed", value=speed, expected=expected)
    if speed is not None and not speed > 0:
        raise IdentificationError(place="stribeck_speed", value=speed, expected="a speed above 0 [rad/s | m/s]")


def _inertial(arm: Model) -> list[TorqueColumn]:
    words = ["mass", *[f"first moment along {axis}" for axis in "xyz"], *[f"inertia {e[1:]}" for e in INERTIAL[4:]]]
    columns = []
    for i, body in enumerate(arm.bodies, start=1):
        for name, unit, word in zip(INERTIAL, INERTIAL_UNITS, words, strict=True):
            path = f"{path_name(body.link)}.mass_kg" if name == "m" else None
            columns.append(TorqueColumn(f"{name}{i}", unit, body.joint, "inertial", f"{word} of {body.link}", path))
    return columns


def _shares(arm: Model, gears: np.ndarray | None) -> list[list[tuple[int, float]]]:
    """For every motor, the other joints that it turns and their shares: rows of B - 1."""
    if gears is None or any(body.drive.coupling for body in arm.coordinates):
        return [[(j, float(share)) for j, share in row] for row in shares_of(arm)]
    gears = np.asarray(gears, dtype=float)
    expected = f"({arm.n}, {arm.n}), numbers other than 0 on the diagonal"
    if gears.shape != (arm.n, arm.n):
        raise IdentificationError(f"shape {gears.shape}", place="gears", expected=expected)
    if (np.diag(gears) == 0).any():
        raise IdentificationError(f"the diagonal is {np.diag(gears).tolist()}", place="gears", expected=expected)
    shares = gears / np.diag(gears)[:, None]
    return [[(int(j), float(row[j])) for j in np.flatnonzero(row) if j != i] for i, row in enumerate(shares)]


def _drives(
    arm: Model, shares: list[list[tuple[int, float]]], friction: Collection[str], stribeck_speed: float | None
) -> list[TorqueColumn]:
    """Rotor and friction of every joint; a motor that several joints turn has columns of its own beside its joint's."""
    wanted = ["rotor"]
    for each in friction:
        wanted += ["coulomb+", "coulomb-"] if each == "asymmetric" else [each]
    columns = []
    for kind in sorted(wanted, key=list(KINDS).index):
        own = [((i, 1.0),) for i in range(arm.n)]
        columns += [_drive(arm, kind, i, own[i], stribeck_speed, bool(shares[i])) for i in range(arm.n)]
        several = [i for i in range(arm.n) if shares[i] and kind != "offset"]
        columns += [_drive(arm, kind, i, (*own[i], *shares[i]), stribeck_speed, False) for i in several]
    return columns


def _drive(
    arm: Model, kind: str, i: int, turned: tuple[tuple[int, float], ...], stribeck_speed: float | None, coupled: bool
) -> TorqueColumn:
    """A column of joint i, or of its motor where several joints turn it; `coupled`: its motor has one of its own."""
    body, law = arm.coordinates[i], KINDS[kind]
    unit = law.sliding_unit if body.kind.units.linear else law.unit
    stem, sign = law.stem.rstrip("+-"), law.stem[len(law.stem.rstrip("+-")) :]
    own = len(turned) == 1
    name = f"{stem}{'' if own else 'm'}{i + 1}{sign}"
    about = (
        f"{law.about} of {body.joint}" if own else f"{law.about} of the motor of {body.joint}, which turns with others"
    )
    if coupled and kind == "rotor":
        about = f"inertia behind the gear of {body.joint}"
    smoothing = 0.0 if body.friction is None or body.friction.smoothing is None else float(body.friction.smoothing)
    speed = {"stribeck": stribeck_speed or 0.0, "coulomb": smoothing, "coulomb+": smoothing, "coulomb-": smoothing}
    path = f"{path_name(body.joint)}.motor.rotor_inertia_kg_m2" if kind == "rotor" and not coupled else None
    return TorqueColumn(name, unit, body.joint, kind, about, path, turned, speed.get(kind, 0.0))


def _springs(arm: Model, springs: Collection[str]) -> list[TorqueColumn]:
    columns = []
    for kind in ("spring", "sine", "cosine"):
        for i, body in enumerate(arm.coordinates):
            if body.joint in springs and (kind == "spring" or body.kind.turns):
                columns.append(_drive(arm, kind, i, ((i, 1.0),), None, coupled=False))
    return columns


def _prior(arm: Model, columns: Sequence[TorqueColumn]) -> np.ndarray:
    """The record's values: inertial ones, rotors and friction; NaN where it has none."""
    prior = np.full(len(columns), np.nan)
    values = np.asarray(arm.inertial_parameters, dtype=float)
    for i in range(len(arm.bodies)):
        part = slice(10 * i, 10 * i + 10)
        prior[part] = values[part] if values[part].any() else np.nan
    index = {body.joint: body for body in arm.coordinates}
    coupled = {body.joint for body in arm.coordinates if body.drive.coupling}
    for k, column in enumerate(columns):
        if column.kind == "inertial":
            continue
        body = index[column.joint]
        of_motor = column.joint in coupled
        if column.kind == "rotor":
            known = body.drive.torque_constant is not None or body.drive.gear_ratio != 1.0
            if known and of_motor == (len(column.turned) > 1):
                prior[k] = float(body.drive.reflected)
        elif body.friction is not None and (body.friction.on_motor and of_motor) == (len(column.turned) > 1):
            f = body.friction
            of_kind = {
                "viscous": f.viscous, "offset": f.offset, "coulomb+": f.coulomb_positive, "coulomb-": f.coulomb_negative,
                "coulomb": 0.5 * (f.coulomb_positive + f.coulomb_negative),
            }  # fmt: skip
            prior[k] = float(of_kind.get(column.kind, np.nan))
    return prior


def _of_joint(dyn: CompiledArm, columns: Sequence[TorqueColumn]) -> np.ndarray:
    """(n, p) bool: columns that are not zero in a joint's torque, from random states."""
    q, qd, qdd = random_states(dyn.arm, PROBES)
    size = np.abs(rows_of(dyn, columns, q, qd, qdd)).max(axis=0)
    return size > ZERO * np.maximum(size.max(), np.finfo(float).tiny)


def random_states(arm: Model, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random q, q̇, q̈, each (count, n), of a few units, which excite all identifiable parameters.

    Args:
        arm: its number of joints counts.   count: how many.   seed: of the generator.
    """
    generator = np.random.default_rng(seed)
    q = generator.uniform(-np.pi, np.pi, (count, arm.n))
    return q, generator.normal(size=(count, arm.n)) * 3.0, generator.normal(size=(count, arm.n)) * 10.0

"""Safety conditions before a controller may drive a real arm over a bus.

a twin, bus not virtual    --serial-number N, as object 1018 of every node says
a real arm                 that, a passing verdict of `validate` on this scenario, drives whose rated torque and counts are
                           the record's, real time with a heartbeat, a dead-man key, and reduced speed and torque until a
                           reduced run has come to its end
"""

from __future__ import annotations

import datetime
import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tomlkit

from armwright.description.toml_file import toml_tables
from armwright.dynamics.inverse import gravity_torques
from armwright.errors import BusError
from armwright.identification.validation.validate import record_sha256
from armwright.identification.validation.verdict import StoredVerdict, stored_verdict
from armwright.interfaces import JointReference
from armwright.model import Model
from armwright.model.payload import Payload
from armwright.output import write_whole
from armwright.parameters import Batch
from armwright.program import interpret, trace
from armwright.scalar import Array, Scalar, real_number
from armwright.simulation.inputs.schedule import Schedule
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Inputs
from armwright.twin import objects as od
from armwright.twin.bus import is_virtual
from armwright.twin.units import BusUnits

if TYPE_CHECKING:
    from armwright.twin.master import Identity, Master

REDUCED_SPEED, REDUCED_TORQUE = 0.25, 0.5  # of the scenario's, in the first runs of a real arm
ENDING = ".bus.toml"
RATED = 0.01  # parts by which the rated torque of a drive may differ from the record's
POSES, LOADED = 200, 1e-6  # at which gravity is looked at; of a joint's largest torque, below which it is rounding


@dataclass(frozen=True, eq=False)
class Permission:
    """Confirmations and tests that a user has provided before an arm may move.

    Attributes:
        serial: of the arm, as object 1018 has it; None: not said.   path: of the scenario's file.
        sha256: checksum of all that decides the run but for its speed and torque.
        verdict: of `validate` on it; None: there is none.   speed, torque: of the run, in parts of the scenario's.
        may_move: the dead-man key; None: there is none.
    """

    serial: int | None = None
    path: Path | None = None
    sha256: str = ""
    verdict: StoredVerdict | None = None
    speed: float = 1.0
    torque: float = 1.0
    may_move: Callable[[], bool] | None = None

    @classmethod
    def of(cls, path: str | os.PathLike[str], scenario: Scenario, motion: bytes = b"", **said: Any) -> Permission:
        """The permission for a scenario that was read from a file, with its verdict.

        Args:
            path: of the file.   scenario: as it was read.   motion: what it follows in place of its own reference.
            said: the other attributes.
        Raises:
            LogError: a verdict that cannot be read.
        """
        sha256 = record_sha256(Path(path), scenario)
        of_run = hashlib.sha256(sha256.encode() + motion).hexdigest()
        return cls(path=Path(path), sha256=of_run, verdict=stored_verdict(path, sha256), **said)

    @property
    def reduced(self) -> bool:
        """True for a run at reduced speed and torque, which a real arm requires first."""
        return self.speed <= REDUCED_SPEED and self.torque <= REDUCED_TORQUE

    def has_run_reduced(self, bound: Mapping[str, Any]) -> bool:
        """True if a reduced run that counts was made with all that is bound.

        Args:
            bound: as of the function `bound`.
        Raises:
            BusError: a file that is none.
        """
        if self.path is None or not self.path.with_suffix(ENDING).exists():
            return False
        with toml_tables(self.path.with_suffix(ENDING), BusError) as tables:
            same = all(tables.get(name) == value for name, value in self._bound(bound).items())
            return same and _share(tables.get("speed"), REDUCED_SPEED) and _share(tables.get("torque"), REDUCED_TORQUE)

    def write_reduced(self, bound: Mapping[str, Any]) -> Path | None:
        """Stores beside the scenario that a reduced run was completed; None of a scenario that has no file.

        Args:
            bound: as of the function `bound`.
        Raises:
            OutputError: the file cannot be written.
        """
        if self.path is None:
            return None
        path, document = self.path.with_suffix(ENDING), tomlkit.document()
        document.add(
            tomlkit.comment("Written by `armwright run-controller` after a run with reduced speed and torque.")
        )
        values = {**self._bound(bound), "speed": self.speed, "torque": self.torque}
        for name, value in {**values, "date": datetime.date.today().isoformat()}.items():
            document[name] = value
        write_whole(path, tomlkit.dumps(document))
        return path

    def _bound(self, bound: Mapping[str, Any]) -> dict[str, Any]:
        return {"serial": self.serial, "run_sha256": self.sha256, **bound}


def _share(value: Any, most: float) -> bool:
    return isinstance(value, float) and 0.0 < value <= most


def bound(master: Master, identities: Sequence[Identity]) -> dict[str, Any]:
    """Properties of a bus and its nodes that a full run must share with the reduced one.

    Args:
        master: on the bus.   identities: of its nodes.
    """
    return {
        "bus": master.bus,
        "bitrate": master.rehearsal.load.bitrate,
        "nodes": list(master.numbers),
        "vendors": [each.vendor for each in identities],
        "products": [each.product for each in identities],
        "serials": [each.serial for each in identities],
        "reference_sha256": master.rehearsal.reference_sha256,
    }


def check_serial(master: Master, identities: Sequence[Identity], permission: Permission) -> None:
    """Refuses the nodes of another arm, on a bus that is not virtual.

    Raises:
        BusError: no serial number was said, or a node has another one.
    """
    if is_virtual(master.bus):
        return
    if permission.serial is None:
        what = "the drives on this bus may be those of a real arm"
        expected = "its serial number, as object 1018 says it (--serial-number N)"
        raise BusError(what, place="arm", value=None, expected=expected)
    for number, name, identity in zip(master.numbers, master.names, identities, strict=True):
        if identity.serial != permission.serial:
            what = f"node {number} of {name} has serial number {identity.serial}"
            raise BusError(what, place="arm", value=permission.serial, expected="the number of every node")


def check_permission(
    master: Master, identities: Sequence[Identity], permission: Permission, *, real_time: bool
) -> bool:
    """True for a real arm that may move; False for a twin.

    Args:
        master: on the bus, before anything was enabled.   identities: of its nodes.   permission: what the user has said.
        real_time: as the run is to be.
    Raises:
        BusError: says what is missing, the first of it.
    """
    check_serial(master, identities, permission)
    if is_virtual(master.bus) or all(identity.is_twin for identity in identities):
        return False
    _check_verdict(permission)
    _check_drives(master)
    rehearsed, said = (master.rehearsal.speed, master.rehearsal.torque), (permission.speed, permission.torque)
    for name, ours, theirs in zip(("speed", "torque"), rehearsed, said, strict=True):
        if ours != theirs:
            what = f"the run was rehearsed at {ours:g} of the {name}"
            raise BusError(
                what, place=name, value=theirs, expected=f"a permission for {ours:g}, or `rehearse` at {theirs:g}"
            )
    if not real_time:
        raise BusError("a real arm runs in real time", place="real_time", value=False, expected="True (--real-time)")
    if permission.may_move is None:
        raise BusError(
            "no dead-man key", place="may_move", value=None, expected="a key that is held while the arm moves"
        )
    if not permission.reduced and not permission.has_run_reduced(bound(master, identities)):
        what = f"speed {permission.speed:g} and torque {permission.torque:g} before a reduced run that counts"
        expected = f"at most {REDUCED_SPEED:g} and {REDUCED_TORQUE:g} (--speed, --torque-fraction) in the first run"
        raise BusError(what, place="speed", value=permission.speed, expected=expected)
    return True


def _check_verdict(permission: Permission) -> None:
    verdict = permission.verdict
    if verdict is None or not verdict.passed:
        what = "no verdict on this scenario" if verdict is None else str(verdict)
        expected = "a passing one of `armwright validate SCENARIO FILE.log.toml`, stored beside the scenario"
        raise BusError(what, place="verdict", expected=expected, file=permission.path or "")


def _check_drives(master: Master) -> None:
    """Refuses drives whose units are not those that the record gives them."""
    units = master.units
    for k, (node, name) in enumerate(zip(master.nodes, master.names, strict=True)):
        rated, ours = master.get(node, od.RATED_TORQUE), 1e3 * float(units.limit[k] * units.torque[k])
        if abs(rated - ours) > RATED * ours:
            what = f"node {node.id} of {name} has a rated torque of {rated / 1e3:g} N m"
            raise BusError(what, place="object 6076", expected=f"{ours / 1e3:g} N m, the largest torque of the record")
        turn = master.rehearsal.scenario.arm.coordinates[k].kind.units.whole
        counts = master.get(node, (0x608F, 1)) / master.get(node, (0x608F, 2))
        if abs(counts * float(units.count[k]) - turn) > 1e-6 * turn:
            what = f"node {node.id} of {name} has {counts:g} counts"
            raise BusError(what, place="object 608F", expected=f"{turn / float(units.count[k]):g}, loop.sensors.counts")


@dataclass(frozen=True, eq=False)
class Slowed:
    """A reference in slow motion: r(v t), with matching speeds and accelerations.

    Attributes:
        reference: a function of time.   speed: v, above 0 and at most 1.
    """

    reference: Any
    speed: float

    def __call__(self, t: Scalar) -> JointReference | Array:
        """The reference at a time t [s]."""
        at, v = self.reference(self.speed * t), self.speed
        if isinstance(at, tuple):
            at = JointReference(*at)
        if isinstance(at, JointReference):
            return JointReference(at.q, v * at.qd, v * v * at.qdd)
        return at


def reduced(scenario: Scenario, speed: float = 1.0, torque: float = 1.0) -> Scenario:
    """The scenario with a slower reference and smaller commands.

    Args:
        scenario: with a controller.   speed: of the reference, in parts of it.
        torque: largest command, in parts of the rated one.
    Raises:
        BusError: a number that is not above 0 and at most 1; a reference that cannot be slowed.
    """
    for name, value in (("speed", speed), ("torque", torque)):
        number = real_number(value)
        if number is None or not 0.0 < number <= 1.0:
            raise BusError(place=name, value=value, expected="a number above 0 and at most 1")
    loop = scenario.loop
    if loop is None or (speed == torque == 1.0):
        return scenario
    if torque < 1.0:
        most = torque * BusUnits.of(scenario).limit
        limit = most if loop.command_filter.limit is None else np.minimum(loop.command_filter.limit, most)
        loop = replace(loop, command_filter=replace(loop.command_filter, limit=limit))
    if speed < 1.0 and loop.reference is not None and not _is_pose(loop.reference, scenario.arm.n):
        if not callable(loop.reference):
            expected = "1, or a reference that is a function of time, such as a motion"
            raise BusError("its reference is a table", place="speed", value=speed, expected=expected)
        loop = replace(loop, reference=Slowed(loop.reference, speed))
    duration = scenario.duration
    if duration is not None and speed < 1.0:
        duration = float(np.ceil(duration / speed / scenario.tick - 1e-9) * scenario.tick)
    # Inputs come where the full run has them, as the slower motion gets there later; bodies of a motion become the
    # scenario's own, since another reference may take its place.
    acting = replace(scenario.inputs, payload=scenario.carried)
    inputs = Inputs(**{each.name: _later(getattr(acting, each.name), speed) for each in fields(Inputs)})
    return replace(scenario, loop=loop, inputs=inputs, duration=duration)


def _later(value: Any, speed: float) -> Any:
    """An input of a scenario with its times stretched; one that does not change as it is."""
    if isinstance(value, Schedule):
        return replace(value, times=value.times / speed)
    if isinstance(value, Payload):
        time = value.time
        return replace(value, time=Batch(time.values / speed) if isinstance(time, Batch) else time / speed)
    if isinstance(value, Batch) and value.shape is None:
        return Batch([_later(each, speed) for each in value.values])
    if isinstance(value, (list, tuple)):
        return [_later(each, speed) for each in value]
    return value


def _is_pose(reference: Any, joints: int) -> bool:
    return isinstance(reference, (list, tuple, np.ndarray)) and np.shape(reference) == (joints,)


def joints_without_brake(arm: Model) -> tuple[str, ...]:
    """Names of the joints that gravity moves and that have no brake in the record, or one that is too weak.

    Args:
        arm: the model, whose positions are looked at within the limits of its joints.
    """
    low, high = np.array([body.limits.position for body in arm.coordinates], dtype=float).T
    poses = low + (high - low) * np.random.default_rng(0).random((POSES, arm.n))
    load = trace("gravity_torques", lambda q: gravity_torques(arm, q), {"q": (arm.n,)}, ("g",))
    most = np.abs(interpret(load, poses)).reshape(POSES, arm.n).max(axis=0)
    limits = np.array([body.limits.torque for body in arm.coordinates])
    lifts = most > LOADED * np.where(np.isfinite(limits), limits, 1.0)
    holds = np.array([0.0 if body.brake is None else body.brake.holding for body in arm.coordinates], dtype=float)
    return tuple(body.joint for body, falls in zip(arm.coordinates, lifts & (holds < most), strict=True) if falls)

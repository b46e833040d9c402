"""An arm beside a log: that the two belong together, and what of the log can be compared with the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright.errors import LogError
from armwright.identification.logs.columns import check_gears
from armwright.identification.logs.log import Log
from armwright.identification.logs.torques import Source, missing_terms, torque_source
from armwright.kernels.compiled import CompiledArm
from armwright.model import Model

POSES = 8  # in which an arm's torques are compared


@dataclass(frozen=True)
class Match:
    """Signals of an arm in a log.

    Attributes:
        columns: (n,) column of the log for every joint of the arm.   logged: signals that the log has of all of its joints.
        source: signal that measured torques are known from; None if none is logged, or voltages without all positions.
        signals: that the log has, of all joints or of some.   lacks: terms that the torques of `source` are without.
    """

    columns: list[int]
    logged: frozenset[str]
    source: Source | None
    signals: frozenset[str]
    lacks: tuple[str, ...]

    def without_torques(self, arm: Model) -> str:
        """The reason why no torques can be predicted, in words; "" where they can."""
        if self.source is None:
            return "neither torque nor current is logged"
        if self.source == "voltage" and any(body.drive.resistance is None for body in arm.coordinates):
            return "voltages alone are logged, and the record states no resistances"
        return "" if {"q", "qd"} & self.signals else "neither position nor speed is logged"


def match(arm: Model, log: Log) -> Match:
    """Signals in a log of the arm that it belongs to.

    Raises:
        LogError: other joints or gears, or an arm without masses.
    """
    if sorted(log.joints) != sorted(arm.names):
        theirs, ours = (", ".join(map(repr, names)) for names in (log.joints, arm.names))
        what = f"the log has {len(log.joints)} ({theirs}), {arm.name} has {arm.n} ({ours})"
        raise LogError(what, place="joints", expected="the same joints by name, in the log's joints", file=log.path)
    check_gears(log, arm)
    if all(float(body.mass) == 0.0 and not np.any(body.inertia) for body in arm.bodies) and not any(
        float(body.drive.rotor_inertia) for body in arm.coordinates
    ):
        what = f"{arm.name} states no masses: of kinematics alone nothing can be predicted"
        expected = "a record with masses, as `armwright identify` writes"
        raise LogError(what, place="arm", expected=expected, file=log.path)
    logged = frozenset(each.name for each in log.layout if len(each.joints or ()) == len(log.joints))
    source = torque_source(log.layout)
    source = None if source == "voltage" and "q" not in logged else source
    columns = [log.joints.index(name) for name in arm.names]
    lacks = missing_terms(log.lacks, source)
    return Match(columns, logged, source, frozenset(log.layout.names), lacks)


def check_pose_free(arm: Model, dyn: CompiledArm, log: Log) -> None:
    """Refuses a log without positions of an arm whose torques depend on them.

    Raises:
        LogError: names what is missing.
    """
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (POSES, arm.n))
    ones = np.ones_like(q)
    torques = dyn.inverse_dynamics(q, ones, ones)
    if np.abs(torques - torques[0]).max() > 1e-9 * max(np.abs(torques).max(), 1.0):
        what = f"not logged, and torques of {arm.name} depend on them"
        raise LogError(what, place="position", expected='[[signals]] with quantity = "position"', file=log.path)

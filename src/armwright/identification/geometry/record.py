"""Record of a robot with a calibrated geometry: its joints, its tool, and named frames of what was measured with and where."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armwright.description.paths import path_name, quantities
from armwright.description.robot import NamedFrame, RobotDescription, Source
from armwright.errors import IdentificationError
from armwright.identification.estimate import Estimate, write_into
from armwright.identification.geometry.arm_chain import OF_TERM, STORED
from armwright.identification.geometry.chain import Constant, Correction, matrix_of, moved
from armwright.identification.geometry.fitting import GeometryFit
from armwright.identification.geometry.problem import Target
from armwright.model.build import joint_placement
from armwright.spatial import Placement, roll_pitch_yaw, rotation_rpy

STEP = 1e-6  # [m | rad] for derivatives of a frame's numbers
FRAME = (*(f"xyz_m[{k}]" for k in range(3)), *(f"rpy_rad[{k}]" for k in range(3)))
ROUNDING = 1e-8  # of such a derivative
UPRIGHT = 1e-3  # cosine of the pitch, below which roll and yaw turn about one axis and have no deviations of their own
KINDS = (*(kind for term in STORED for kind in OF_TERM[term]), "frame", "point")


@dataclass(frozen=True, eq=False)
class GeometryRecord:
    """Numbers of a record that a calibration changes.

    Attributes:
        fit: the calibration.   key: of the source.
    """

    fit: GeometryFit
    key: str

    def write(self, estimate: Estimate, output: str | os.PathLike[str]) -> Path:
        """Writes the record; see `Calibration.write`.

        Raises:
            IdentificationError: corrections that a record has no number for.   OutputError, DescriptionError: as `write_into`.
        """
        lost = sorted({column.kind for column in self.fit.setting.kept if column.kind not in KINDS})
        if lost:
            what = f"{', '.join(lost)} cannot be written: no room reads such a number of a record"
            raise IdentificationError(what, place="terms", expected="a calibration of zeros and frames alone")
        text = f"{estimate.method}; {estimate.log}, sha256 {estimate.sha256}"
        record = self.described(Source(kind="fit", text=text))
        return write_into(record, self.estimate(estimate), output, self.key)

    def described(self, source: Source) -> RobotDescription:
        """The record with the frames that are new, whose numbers are then written."""
        record, setting = self.fit.setting.arm.record, self.fit.setting
        known = {each.name for each in record.frames}
        new, tip = [], record.tip
        for name, (link, matrix) in self.frames(self.fit.values).items():
            if name not in known:
                *xyz, roll, pitch, yaw = _of_frame(name, matrix).values()
                numbers = {"xyz_m": xyz, "rpy_rad": [roll, pitch, yaw]}
                fields = {key: {"value": value, "source": self.key} for key, value in numbers.items()}
                new.append(NamedFrame(name=name, link=link, **fields))  # type: ignore[arg-type]
        for target in setting.targets:
            if target.measured.kind == "pose" and target.measured.frame is None:
                tip = self._tool_name(target)
        sources = {**record.sources, self.key: source}
        return record.replace(frames=(*record.frames, *new), tip=tip, sources=sources)

    def estimate(self, estimate: Estimate) -> Estimate:
        """Numbers of the record, then the corrections, with the covariance of all."""
        values = self.fit.values
        numbers = self.numbers(values)
        steps = STEP * np.eye(len(values))
        either = [[np.array([*self.numbers(values + sign * step).values()]) for sign in (1.0, -1.0)] for step in steps]
        slopes = np.array([(up - down) / (2.0 * STEP) for up, down in either]).reshape(len(values), -1).T
        slopes[self._without_deviation(numbers)] = np.nan
        names = [*numbers]
        whole = [name.partition("[")[0] for name in names]  # the same rotation may have other angles: all or none
        moves = [not (np.abs(slope) < ROUNDING).all() for slope in slopes]
        moved_by = {name for name, moving in zip(whole, moves, strict=True) if moving}
        changed = [k for k, name in enumerate(whole) if name in moved_by]
        own = [k for k, column in enumerate(self.fit.setting.kept) if column.joint]
        both = np.concatenate([slopes[changed], np.eye(len(values))[own]])
        return replace(
            estimate,
            names=(*(names[k] for k in changed), *(estimate.names[k] for k in own)),
            values=np.concatenate([np.array([*numbers.values()])[changed], values[own]]),
            covariance=np.einsum("ia,ab,jb->ij", both, estimate.covariance, both),
            units=(*("rad" if "_rad" in names[k] else "m" for k in changed), *(estimate.units[k] for k in own)),
            at_bound=None,
            identifiable=None,
        )

    def numbers(self, values: np.ndarray) -> dict[str, float]:
        """Numbers of the record by path, for values (b,) of the identifiable parameters."""
        setting, found = self.fit.setting, dict[str, float]()
        known = {path: quantity for path, quantity, _ in quantities(setting.arm.record)}
        framed: set[str] = set()
        for column, value in zip(setting.kept, values, strict=True):
            if column.path:
                found[column.path] = float(known[column.path]) + float(value)
            elif column.joint:
                framed.add(column.joint)
        for joint in setting.arm.record.moving_joints:
            if joint.name in framed:
                found |= _of_frame(f"{path_name(joint.name)}.frame", self._joint_frame(joint, values))
        for name, (_, matrix) in self.frames(values).items():
            found |= _of_frame(path_name(name), matrix)
        return found

    def _joint_frame(self, joint: Any, values: np.ndarray) -> np.ndarray:
        """(4, 4) frame of a joint in its parent's, with its corrections."""
        setting = self.fit.setting
        own = next(filter(None, (self._of_joint(each, joint.name) for each in setting.targets)))
        before, after = (matrix_of(each) for each in joint_placement(joint))
        return moved(
            [Constant(before), *own, Constant(after)], np.zeros((1, 0)), setting.all_parameters(values)
        ).placement[0]

    def frames(self, values: np.ndarray) -> dict[str, tuple[str, np.ndarray]]:
        """Named frames as link and (4, 4) in it: the measuring frame, points and frames of the tool, points that do not move."""
        setting, every = self.fit.setting, self.fit.setting.all_parameters(values)
        record, none, found = setting.arm.record, np.zeros((1, 0)), {}
        if setting.base is not None and any(column.kind == "frame" for column in setting.kept):
            front = [
                Correction(k, axis % 3, axis >= 3)
                for axis, k in enumerate(k for k, c in enumerate(setting.columns) if c.kind == "frame")
            ]
            placed = moved([Constant(setting.base), *front], none, every).placement[0]
            found[setting.measurements.measuring_frame] = (record.base, np.linalg.inv(placed))
        for target in setting.targets:
            measured, frame = target.measured, target.measured.frame or setting.arm.tip
            for k, name in enumerate(self._end_names(target)):
                matrix = np.eye(4)
                matrix[:3, 3] = target.fixed[k] + every[target.ends[k]]
                found[name] = (record.base, matrix)
            if not any(isinstance(each, Correction) for each in target.tool):
                continue
            named = next((each for each in record.frames if each.name == frame), None)
            link = str(frame if named is None else named.link)
            inner = moved(target.tool, none, every).placement[0]
            if named is not None:
                inner = matrix_of(Placement(rotation_rpy(*named.rpy_rad.numbers), np.asarray(named.xyz_m))) @ inner
            name = self._tool_name(target) if measured.kind == "pose" else measured.name
            found[name] = (link, inner)
        return found

    def _tool_name(self, target: Target) -> str:
        """The named frame that a measured pose is of; of a link's own frame the measurement's name."""
        arm = self.fit.setting.arm
        frame = target.measured.frame or arm.tip
        named = any(each.name == frame for each in arm.record.frames)
        return str(frame) if named else target.measured.name

    def _end_names(self, target: Target) -> Iterator[str]:
        """Names of the points that do not move."""
        columns = self.fit.setting.columns
        for parameters in target.ends:
            yield columns[int(parameters[0])].name.removesuffix(" x")

    def _of_joint(self, target: Target, joint: str) -> list[Correction]:
        """Corrections of a joint's frame on the way to a target."""
        own = [each for each in target.factors if isinstance(each, Correction) and each.weight is None]
        return [each for each in own if self.fit.setting.columns[each.parameter].joint == joint]

    def _without_deviation(self, numbers: dict[str, float]) -> list[int]:
        """Numbers of roll and yaw of frames that stand upright on end: only their sum or difference is determined."""
        names = list(numbers)
        upright = {
            name.removesuffix("[1]")
            for name, value in numbers.items()
            if name.endswith("rpy_rad[1]") and abs(np.cos(value)) < UPRIGHT
        }
        return [k for k, name in enumerate(names) if name[:-3] in upright and name[-3:] != "[1]"]


def _of_frame(name: str, matrix: np.ndarray) -> dict[str, float]:
    """Numbers of a frame by path."""
    values = (*matrix[:3, 3].tolist(), *roll_pitch_yaw(matrix[:3, :3]))
    return {f"{name}.{key}": value for key, value in zip(FRAME, values, strict=True)}

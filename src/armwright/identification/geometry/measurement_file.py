"""File of measurements of the geometry, `*.calibration.toml`, which says what the columns of a table hold; and its reading."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from armwright.description import builtin_names
from armwright.description.toml_file import toml_tables
from armwright.errors import LogError
from armwright.identification.geometry.measurements import Measured, Measurements
from armwright.identification.logs.log_file import Above0, Column, FileTable, Seen, Text, _listed
from armwright.identification.logs.measured_table import MeasuredTable
from armwright.identification.logs.tables import open_table
from armwright.quantity import Record
from armwright.reading import opened
from armwright.spatial import rotation_quaternion, rotation_rpy
from armwright.validation import Invalid, validated

ANGLES = {"rad": 1.0, "deg": np.pi / 180.0}
LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "in": 0.0254}
Columns = Annotated[tuple[Column, ...], BeforeValidator(_listed), Field(min_length=1)]
Vector = tuple[float, float, float]
ROTATIONS = {"quaternion wxyz": 4, "quaternion xyzw": 4, "rpy": 3}
COUNTS = {"point": 3, "distance": 1}
BLOCK = 100_000  # rows


class JointTable(Record):
    """Columns of joint readings."""

    columns: Columns = Field(description="Names, or numbers from 1.")
    names: Annotated[tuple[Seen, ...], BeforeValidator(_listed)] | None = Field(
        default=None, description="Joints of the columns; absent: the columns' names."
    )
    unit: Literal["rad", "deg", "m", "mm"] = Field(default="rad", description="Of all these columns.")
    signs: tuple[float, ...] | None = Field(default=None, description="1 or -1 for each column; absent: 1.")

    @model_validator(mode="after")
    def _fitting(self) -> JointTable:
        if self.names is None and any(isinstance(each, int) for each in self.columns):
            raise Invalid("missing", place="names", expected="joints of columns that are given by number")
        for key in ("names", "signs"):
            given = getattr(self, key)
            if given is not None and len(given) != len(self.columns):
                raise Invalid(place=key, value=given, expected=f"{len(self.columns)}, one for each column")
        if self.signs is not None and any(abs(sign) != 1.0 for sign in self.signs):
            raise Invalid(place="signs", value=self.signs, expected="1 or -1")
        return self


class QuantityTable(Record):
    """Columns of one measured quantity."""

    name: Seen = Field(description="What results call it, and the frame that the record gets for it.")
    kind: Literal["point", "pose", "distance", "fixed point"] = Field(
        description="point: x, y, z of a point of the tool in the measuring frame. pose: x, y, z and rotation of a frame there. "
        "distance: from an anchor to a point of the tool. fixed point: a point of the tool touches one that does not move."
    )
    columns: Annotated[tuple[Column, ...], BeforeValidator(_listed)] = Field(
        default=(),
        description="3 of a point, 6 or 7 of a pose, 1 of a distance; of a fixed point none, or the one with its number.",
    )
    unit: Literal["m", "mm", "um", "in"] = Field(default="m", description="Of lengths.")
    rotation: Literal["quaternion wxyz", "quaternion xyzw", "rpy"] = Field(
        default="quaternion wxyz", description="Of a pose: order of its quaternion, or roll, pitch, yaw."
    )
    angle_unit: Literal["rad", "deg"] = Field(default="rad", description="Of roll, pitch and yaw.")
    frame: Seen | None = Field(default=None, description="Frame or link that carries it; absent: the tip.")
    place_m: Vector | None = Field(default=None, description="Of the point in that frame; absent: unknown.")
    anchor_m: Vector | None = Field(
        default=None, description="Of a distance: its other end in base axes; absent: unknown."
    )
    length_m: Above0 | None = Field(default=None, description="Of a distance that is always the same, as a ball bar's.")

    @model_validator(mode="after")
    def _fitting(self) -> QuantityTable:
        counts = {"pose": (3 + ROTATIONS[self.rotation],), "fixed point": (0, 1)}
        allowed = counts.get(self.kind) or ((0,) if self.length_m is not None else (COUNTS[self.kind],))
        if len(self.columns) not in allowed:
            expected = " or ".join(map(str, allowed))
            raise Invalid(f"{len(self.columns)} of a {self.kind}", place="columns", expected=expected)
        for key, kinds in (
            ("anchor_m", ("distance",)),
            ("length_m", ("distance",)),
            ("place_m", ("point", "distance", "fixed point")),
        ):
            if getattr(self, key) is not None and self.kind not in kinds:
                raise Invalid(f"goes with {' or '.join(kinds)}", place=key)
        return self


class FrameTable(Record):
    """The frame in which points and poses were measured."""

    name: Seen = Field(default="measuring", description="Of the frame that the record gets for it.")
    xyz_m: Vector | None = Field(default=None, description="Where it is in the base; absent: unknown.")
    rpy_rad: Vector | None = Field(default=None, description="Roll, pitch, yaw of it in the base.")

    @model_validator(mode="after")
    def _whole(self) -> FrameTable:
        if (self.xyz_m is None) != (self.rpy_rad is None):
            raise Invalid("one without the other", place="xyz_m, rpy_rad", expected="both, or none")
        return self


class MeasurementFile(Record):
    """A whole file of measurements."""

    title: str | None = Field(default=None, description="One line for whoever reads the file.")
    robot: Text | None = Field(default=None, description="A built-in arm, or a robot file beside this one.")
    kinematics_only: bool = Field(default=False, description="true: links of the robot file may lack mass properties.")
    file: FileTable = Field(description="The table with a pose a row: its path and its format.")
    joints: tuple[JointTable, ...] = Field(min_length=1, description="[[joints]]: one table for each unit.")
    locked: dict[str, float] = Field(
        default_factory=dict, description="Positions of joints without a column, in rad or m; absent: 0."
    )
    measured: tuple[QuantityTable, ...] = Field(min_length=1, description="[[measured]]: one table for each quantity.")
    measuring_frame: FrameTable = Field(default_factory=FrameTable, description="In which points and poses are given.")


def read_measurements(path: str | os.PathLike[str]) -> Measurements:
    """Measurements of an arm's geometry, read and checked.

    Args:
        path: of the `*.calibration.toml` that says what the columns of a table hold.
    Returns:
        measurements: frozen; `findings` has what the checks found.
    Raises:
        LogError: no such file, a key or a column that is not there, a cell that holds no number.
    Example:
        >>> from pathlib import Path
        >>> size = Path("arm.calibration.toml").write_text('''file.path = "poses.csv"
        ... joints = [{ columns = ["q1", "q2"], names = ["shoulder", "elbow"], unit = "deg" }]
        ... measured = [{ name = "tip", kind = "point", columns = ["x", "y", "z"] }]''')
        >>> np.savetxt("poses.csv", np.eye(9, 5), "%g", ",", header="q1,q2,x,y,z", comments="")
        >>> aw.identification.read_measurements("arm.calibration.toml").q.shape
        (9, 2)
    """
    if not isinstance(path, (str, os.PathLike)):
        raise LogError(value=path, expected="the path of a *.calibration.toml file")
    path = Path(path)
    with toml_tables(path, LogError) as tables:
        file = validated(MeasurementFile, tables, file=path, error=LogError)
        if file.file.path is None:
            raise LogError("missing", place="file.path", file=path, expected="the path of the table")
        if file.file.time is not None:
            raise LogError("poses have no clock", place="file.time", file=path, expected="a pose a row")
        table = open_table(path.parent / file.file.path, file.file)
        joints = [name for each in file.joints for name in map(str, each.names or each.columns)]
        q = np.concatenate([_joints(table, each) for each in file.joints], axis=1)
        measured = tuple(_measured(table, each, len(q)) for each in file.measured)
        frame = file.measuring_frame
        robot = file.robot if file.robot is None or file.robot in builtin_names() else str(path.parent / file.robot)
        try:
            return Measurements(
                tuple(joints), q, measured, frame.name, None if frame.xyz_m is None else (*frame.xyz_m, *(frame.rpy_rad or ())),
                file.locked, robot, file.kinematics_only, sha256=_sha256(path.parent / file.file.path), name=path.name,
            )  # fmt: skip
        except LogError as error:
            raise error.within(file=path) from None


def _joints(table: MeasuredTable, joints: JointTable) -> np.ndarray:
    """(poses, joints) [rad | m]."""
    factor = (ANGLES | LENGTHS)[joints.unit]
    return _columns(table, joints.columns) * factor * np.array(joints.signs or [1.0] * len(joints.columns))


def _measured(table: MeasuredTable, each: QuantityTable, poses: int) -> Measured:
    """A quantity in SI units, rotations as quaternions w, x, y, z."""
    values = _columns(table, each.columns) if each.columns else np.zeros((poses, 1))
    if each.kind != "fixed point":
        values[:, :3] *= LENGTHS[each.unit]
    if each.length_m is not None:
        values = np.full((poses, 1), float(each.length_m))
    if each.kind == "pose":
        values = np.concatenate([values[:, :3], _quaternions(values[:, 3:], each)], axis=1)
    return Measured(each.name, each.kind, values, each.frame, each.place_m, each.anchor_m)


def _quaternions(turns: np.ndarray, each: QuantityTable) -> np.ndarray:
    if each.rotation == "rpy":
        angles = turns * ANGLES[each.angle_unit]
        return np.array(
            [rotation_quaternion(rotation_rpy(*row)) if np.isfinite(row).all() else [np.nan] * 4 for row in angles]
        )
    return turns if each.rotation == "quaternion wxyz" else turns[:, [3, 0, 1, 2]]


def _columns(table: MeasuredTable, columns: tuple[int | str, ...]) -> np.ndarray:
    """(rows, columns) of the table, NaN for empty cells.

    Raises:
        LogError: no such column, no row.
    """
    blocks = [np.stack(block, axis=1) for block in table.blocks(list(columns), BLOCK)]
    if not blocks:
        raise LogError("no rows", file=table.path, expected="a pose a row")
    return np.concatenate(blocks).astype(float)


def _sha256(path: Path) -> str:
    with opened(path, "a measured file", LogError) as file:
        return hashlib.sha256(file.read()).hexdigest()

"""Task of an arm, `*.task.toml`: poses to reach with a payload, in a given time."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from armwright.description.consistency import check_sources, check_unique
from armwright.description.robot import Name
from armwright.description.toml_file import read_record
from armwright.entry import as_path
from armwright.errors import DescriptionError
from armwright.quantity import NotNegative, Positive, Record, Source, Vector3, optional
from armwright.spatial import rotation_rpy
from armwright.validation import Invalid


class Pose(Record):
    """A pose for the tip, in the base's frame."""

    source: str | None = None
    name: Name = Field(description="Name in results.")
    xyz_m: Vector3 = Field(description="Position of the tip's origin.")
    rpy_rad: Vector3 | None = optional("How the tip should be turned, about fixed x, then y, then z; absent: any way.")

    def matrix(self) -> np.ndarray:
        """(4, 4) of the tip in the base; where any turn will do, the identity's."""
        pose = np.eye(4)
        pose[:3, 3] = np.array(self.xyz_m)
        if self.rpy_rad is not None:
            pose[:3, :3] = rotation_rpy(*np.array(self.rpy_rad))
        return pose


class Task(Record):
    """Poses that the tip visits in their order and then again from the first, resting at each."""

    name: Name = Field(description="Name of the task.")
    title: str | None = optional("One line for lists.")
    source: str | None = optional("Source of every number that names none of its own.")
    sources: dict[str, Source] = Field(default_factory=dict, description="[sources.KEY]: sources of numbers.")
    payload_kg: NotNegative = Field(description="Point mass that the tip carries all the time.")
    payload_com_m: Vector3 = Field(description="Its place in the tip's frame.")
    cycle_time_s: Positive = Field(description="For one round through all poses, without the time spent at them.")
    position_tolerance_m: Positive = Field(description="How far off the tip may be.")
    angle_tolerance_rad: Positive | None = optional("How far it may be turned off; needed where a pose has rpy_rad.")
    poses: tuple[Pose, ...] = Field(min_length=1, description="One table a pose.")

    @model_validator(mode="after")
    def _consistent(self) -> Task:
        check_unique("poses", [pose.name for pose in self.poses])
        turned = [pose.name for pose in self.poses if pose.rpy_rad is not None]
        if turned and self.angle_tolerance_rad is None:
            raise Invalid(f"pose {turned[0]!r} has rpy_rad", expected="angle_tolerance_rad beside position_tolerance_m")
        check_sources(self)
        return self


def read_task(path: str | os.PathLike[str]) -> Task:
    """A task, from the path of its TOML file.

    Args:
        path: such as "pick.task.toml".
    Returns:
        task: poses, payload and time, each number with its source.
    Raises:
        DescriptionError: no such file, or one that is no task.
    Example:
        >>> task = aw.modules.read_task("examples/pick.task.toml")
        >>> task.payload_kg.value, [pose.name for pose in task.poses]
        (0.5, ['desk', 'shelf'])
    """
    return read_record(Path(as_path(path, "path", DescriptionError)), Task)

"""Contents that a run keeps: texts with their checksums, robots as TOML without their looks."""

from __future__ import annotations

import hashlib
import tomllib
from typing import Annotated, Any

from pydantic import Field

from armwright.description.built_from import Sha256
from armwright.description.database import parse
from armwright.description.robot import RobotDescription
from armwright.description.writer import to_toml
from armwright.errors import DescriptionError, RunError
from armwright.quantity import Record, optional

LARGEST = 64 * 2**20  # [bytes] of all contents that a run keeps


class Content(Record):
    """A text that a run was made from."""

    sha256: Sha256 = Field(description="Of the text in UTF-8.")
    size: Annotated[int, Field(ge=0, strict=True, description="Bytes of the text in UTF-8.")]
    text: str | None = optional("Absent: too large to be kept.")

    @classmethod
    def of(cls, text: str, room: int = LARGEST) -> Content:
        """A text with its checksum; the text itself is left out where it has more than `room` bytes."""
        data = text.encode("utf-8")
        kept = text if len(data) <= room else None
        return cls(sha256=hashlib.sha256(data).hexdigest(), size=len(data), text=kept)

    def checked(self, place: str, file: Any) -> str:
        """The text, if it is whole.

        Args:
            place: of the content in the run.   file: of the run, for errors.
        Raises:
            RunError: it was too large to be kept, or has another checksum now.
        """
        if self.text is None:
            expected = f"up to {LARGEST / 2**20:g} MiB in all; simulate the scenario's file again"
            raise RunError(
                f"was too large to be kept: {self.size / 2**20:.3g} MiB", place=place, expected=expected, file=file
            )
        if Content.of(self.text).sha256 != self.sha256:
            what = "does not have its checksum: it was damaged or changed"
            raise RunError(what, place=place, expected="the run as it was saved", file=file)
        return self.text


def robot_text(robot: RobotDescription) -> str:
    """The robot as TOML without its looks, which do not change the motion."""
    return to_toml(_without_visuals(robot))


def parse_robot(text: str, place: str) -> RobotDescription:
    """The robot in a text of `robot_text`; `place` is what errors call its file.

    Raises:
        DescriptionError: not TOML, or an invalid robot.
    """
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DescriptionError(f"not TOML: {error}", file=place) from None
    return _without_visuals(parse(document, place))


def _without_visuals(robot: RobotDescription) -> RobotDescription:
    links = tuple(link.model_copy(update={"visuals": ()}) for link in robot.links)
    return robot.model_copy(update={"links": links})

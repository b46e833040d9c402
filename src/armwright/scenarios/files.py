"""Files of a scenario: read below its folder, or the contents that a run has kept."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from armwright.description import builtin_names, read_description
from armwright.description.content import LARGEST, Content, parse_robot, robot_text
from armwright.description.database import XML_ENDINGS
from armwright.description.drive_file import drive_file_beside
from armwright.description.robot import RobotDescription
from armwright.errors import RunError, ScenarioError, check_known
from armwright.named_file import named_file
from armwright.quantity import Record
from armwright.reading import read_file
from armwright.results.csv_tables import table_text

FORM = 2  # of a document; Armwright 0.1 wrote none, and no checksums


class Document(Record):
    """Files of a run, stored in it for `reproduce`."""

    form: Literal[2] = Field(description="How the document is written.")
    scenario: Content = Field(description="The scenario file.")
    files: dict[str, Content] = Field(
        description="By their names in it: schedules, and the robot as TOML without its looks."
    )
    origins: dict[str, Content] = Field(
        default_factory=dict,
        description="Assembly, modules or parts that the robot was built from; nothing reads them.",
    )


class Files(ABC):
    """Files that a scenario names, by the names it gives them.

    Attributes:
        read: contents of those that were read.   origins: of those that the robot was built from.
    """

    def __init__(self) -> None:
        self.read: dict[str, Content] = {}
        self.origins: dict[str, Content] = {}

    def document(self, scenario: str) -> Document:
        """The scenario's text and all that was read, to be kept with a run."""
        return Document(form=FORM, scenario=self.content(scenario), files=self.read, origins=self.origins)

    def content(self, text: str) -> Content:
        """A text for storage in a run, if there is room beside the others."""
        others = (*self.read.values(), *self.origins.values())
        return Content.of(text, LARGEST - sum(each.size for each in others if each.text is not None))

    @abstractmethod
    def place(self, name: str) -> str | None:
        """The path of a robot's file, or a built-in name; None of kept contents, which are no file."""

    @abstractmethod
    def robot(self, name: str) -> RobotDescription:
        """The record of a robot.

        Raises:
            ArmwrightError: no such robot, or an invalid file.
        """

    @abstractmethod
    def table(self, place: str, name: str) -> tuple[str, str]:
        """The text of a table of numbers, and what errors call its file.

        Args:
            place: of the name in the scenario.   name: of the table.
        Raises:
            ArmwrightError: it is not there, may not be read, or is no text.
        """


class FolderFiles(Files):
    """Files below the folder of a scenario file, and below those that the user allowed."""

    def __init__(self, folder: Path, allow: Iterable[Path] = ()):
        """Args:
        folder: of the scenario file.   allow: further folders.
        """
        super().__init__()
        self.folder, self.allow = folder, tuple(allow)

    def place(self, name: str) -> str:
        """The path of a robot's file, or a built-in name."""
        return name if name in builtin_names() else os.path.abspath(self.folder / name)

    def robot(self, name: str) -> RobotDescription:
        """The record of a built-in robot, or of one in a file beside the scenario."""
        if name in builtin_names():
            record = read_description(name)
        elif not Path(name).suffix:
            expected = "a built-in arm, or the path of a TOML, URDF or MJCF file"
            raise ScenarioError(place="robot", value=name, expected=expected, choices=builtin_names())
        else:
            path = self._path("robot", name)
            drives = drive_file_beside(path)
            reading: dict[str, Any] = {}
            if drives is not None:
                self._path("robot", str(Path(name).with_name(drives.name)))
                reading = {"drive": drives} if path.suffix.lower() in XML_ENDINGS else {}
            record = read_description(path, **reading)
            self._keep_origins(record, path.parent)
        self.read[name] = self.content(robot_text(record))
        return record

    def table(self, place: str, name: str) -> tuple[str, str]:
        """The text of a table beside the scenario."""
        path = self._path(place, name)
        text = table_text(path)
        self.read[name] = self.content(text)
        return text, str(path)

    def _path(self, place: str, name: str) -> Path:
        named_file(name, self.folder, self.allow, place=place, error=ScenarioError)
        return self.folder / name  # as the user knows it, for errors

    def _keep_origins(self, robot: RobotDescription, folder: Path) -> None:
        """Keeps assembly, modules and parts, if they still are what the robot was built from."""
        if robot.built_from is None:
            return
        for name, start in robot.built_from.texts(folder).items():
            try:
                path = named_file(name, start, (self.folder, *self.allow), place=name, error=ScenarioError)
                text = read_file(path, "a text", ScenarioError).decode("utf-8")
            except (ScenarioError, UnicodeDecodeError):
                continue  # the checksum stands in the robot's record
            if robot.built_from.is_unchanged(name, text):
                self.origins[name] = self.content(text)


class KeptFiles(Files):
    """Contents that a run keeps; no file is read."""

    def __init__(self, run: Path, kept: Document):
        """Args:
        run: its file, for errors.   kept: what it keeps.
        """
        super().__init__()
        self.run, self.kept, self.origins = run, kept, kept.origins

    def place(self, name: str) -> None:
        """Kept contents are no file."""
        return None

    def robot(self, name: str) -> RobotDescription:
        """The record of a robot."""
        return parse_robot(*self.table("robot", name))

    def table(self, place: str, name: str) -> tuple[str, str]:
        """The text of a table, or of a robot."""
        check_known(RunError, name, self.kept.files, "not kept with the run", place=place, file=self.run)
        text = self.kept.files[name].checked(f"content of {name!r}", self.run)
        self.read[name] = self.kept.files[name]
        return text, f"{self.run} ({name})"

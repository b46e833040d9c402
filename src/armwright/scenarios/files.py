"""Files of a scenario: in a folder, or as texts that a run has kept."""

from __future__ import annotations

import shutil
import tempfile
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from armwright.description import read_description
from armwright.description.database import parse
from armwright.description.robot import RobotDescription
from armwright.description.writer import to_toml
from armwright.errors import ScenarioError


@dataclass
class Files:
    """Files that a scenario names, by the names it gives them.

    Attributes:
        folder: where they lie.   kept: texts by name, of a run that is done again; they come first.
        read: what was read, to be kept with a run.   written: where kept tables lie as files, until `close`.
    """

    folder: Path
    kept: dict[str, str] = field(default_factory=dict)
    read: dict[str, str] = field(default_factory=dict)
    written: Path | None = None

    def close(self) -> None:
        """Takes away what was written of kept tables."""
        if self.written is not None:
            shutil.rmtree(self.written, ignore_errors=True)
            self.written = None

    def robot(self, name: str) -> RobotDescription:
        """A robot's record: kept, beside the scenario, or built in."""
        if name in self.kept:
            self.read[name] = self.kept[name]
            return parse(tomllib.loads(self.kept[name]), name, self.folder)
        beside = self.folder / name
        record = read_description(beside if Path(name).suffix else name)
        bare = record.model_copy(
            update={"links": tuple(link.model_copy(update={"visuals": ()}) for link in record.links)}
        )
        self.read[name] = to_toml(bare)  # meshes do not change the motion
        return record

    def table(self, name: str) -> Path:
        """The path of a table of numbers.

        Raises:
            ScenarioError: it is not there, or no text.
        """
        if name in self.kept:
            self.read[name] = self.kept[name]
            self.written = self.written or Path(tempfile.mkdtemp(prefix="armwright-"))
            path = self.written / Path(name).name
            path.write_text(self.kept[name], encoding="utf-8")
            return path
        path = self.folder / name
        try:
            self.read[name] = path.read_text(encoding="utf-8")
        except OSError as error:
            raise ScenarioError(f"cannot be read: {error.strerror}", file=path) from None
        except UnicodeDecodeError as error:
            raise ScenarioError(f"byte {error.start} is not UTF-8 text", file=path) from None
        return path

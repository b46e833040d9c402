"""One reading of a URDF: what the caller wants, and the account of all that was not used."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from armwright.description.drive_file import DriveFile, JointDrive
from armwright.description.urdf.tags import HARMLESS, READ
from armwright.description.xml_tree import Element
from armwright.errors import DescriptionError, nearest


@dataclass
class UrdfReading:
    """Options of one reading, and what it left out: harmless tags are counted, what a user should know is remarked."""

    path: Path
    packages: tuple[Path, ...] = ()
    smoothing: float | None = None
    mimic: str = "coupled"
    ignore: frozenset[str] = frozenset()
    drives: DriveFile | None = None
    ignored: Counter[str] = field(default_factory=Counter)
    remarks: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    renamed: dict[str, str] = field(default_factory=dict)
    dropped: set[str] = field(default_factory=set)  # of `ignore`, what was found

    @property
    def source(self) -> str:
        """The key of [sources] that the URDF's numbers get: none of the drive file's."""
        return self._free_key("urdf_file")

    @property
    def smoothing_source(self) -> str:
        """The key of [sources] of a smoothing speed that the caller gave."""
        return self._free_key("smoothing_argument")

    def _free_key(self, key: str) -> str:
        taken = {} if self.drives is None else self.drives.sources
        return next(name for name in (key, *(f"{key}_{k}" for k in range(2, len(taken) + 3))) if name not in taken)

    def remark(self, told: str, kind: str, name: str) -> None:
        """A sentence for the user, about one more link or joint; equal sentences are told once, with all names."""
        self.remarks.setdefault((kind, told), []).append(name)

    def drive_of(self, joint: str) -> JointDrive | None:
        """What the drive file says of a joint."""
        return None if self.drives is None else self.drives.joints.get(joint)

    def check_children(self, element: Element) -> None:
        """Counts what is harmless in an element, and refuses what nobody would read.

        Raises:
            DescriptionError: a tag that is neither read nor known to be harmless.
        """
        read = READ.get(element.tag, ())
        if element.text.strip():
            told = f"text between its elements is not read: {element.text.strip()[:40]!r}"
            self.remark(told, element.tag, element.attributes.get("name", ""))
        for child in element.children:
            if child.tag in read:
                continue
            if child.tag in HARMLESS.get(element.tag, ()) or child.tag in self.ignore:
                self.leave_out(child.tag, child.tag if element.tag == "robot" else f"{element.tag}/{child.tag}")
            elif child.tag.startswith("xacro:"):
                raise child.error(
                    f"<{child.tag}>: this is a xacro file, a program that writes URDF; "
                    f"run it first: xacro {self.path.name} > robot.urdf"
                )
            else:
                known = nearest(child.tag, [*read, *HARMLESS.get(element.tag, ())])
                raise child.error(
                    f"<{child.tag}> in <{element.tag}> is unknown, and could carry physics; {known} "
                    f"(ignore = [{child.tag!r}] leaves it out)"
                )

    def leave_out(self, tag: str, place: str) -> None:
        """Counts a tag as ignored."""
        self.ignored[place] += 1
        self.dropped.add(tag)

    def check_ignore(self) -> None:
        """Refuses words of `ignore` that left nothing out.

        Raises:
            DescriptionError: names the first of them.
        """
        for tag in sorted(self.ignore - self.dropped):
            read = any(tag in tags for tags in READ.values())
            why = "it is read, and cannot be left out" if read else "there is no such tag that would be refused"
            raise DescriptionError(f"{self.path}: ignore = [{tag!r}]: {why}")

    def told(self) -> tuple[str, ...]:
        """All remarks, one sentence each."""
        plural = {kind: f"{kind}s" for kind, _ in self.remarks}
        return tuple(
            f"{plural[kind] if len(names) > 1 else kind} {', '.join(names)}: {told}"
            for (kind, told), names in self.remarks.items()
        )

    def notes(self) -> str:
        """What was ignored and renamed, in a few words."""
        parts = [f"Read from {self.path.name}, its base fixed."]
        if self.ignored:
            counted = (f"{tag} ({count})" for tag, count in sorted(self.ignored.items()))
            parts.append(f"Ignored, as harmless to the dynamics: {', '.join(counted)}.")
        if self.renamed:
            names = (f"{old} → {new}" for old, new in self.renamed.items())
            parts.append(f"Renamed, as names hold no spaces, dots and brackets: {', '.join(names)}.")
        return " ".join(parts)

"""One reading of a URDF: the options of the caller, the tags that are read or ignored, and all that was not used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from armwright.description.drive_file import DriveFile, JointDrive, free_key
from armwright.description.xml_tree import Element
from armwright.errors import MOST, DescriptionError, Findings, Problem

Result = TypeVar("Result")

READ: dict[str, tuple[str, ...]] = {
    "robot": ("link", "joint", "transmission", "material", "gazebo"),
    "link": ("inertial", "visual", "gravity", "kinematic", "origin"),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
    "visual": ("origin", "geometry", "material"),
}

HARMLESS: dict[str, tuple[str, ...]] = {
    "robot": (
        *("sensor", "ros2_control", "plugin", "controller", "rviz", "verbose"),
        *("group", "group_state", "end_effector", "virtual_joint", "passive_joint", "disable_collisions"),  # SRDF
        *("collision_filter", "self_collide", "drake:collision_filter_group"),
    ),
    "link": (
        *("collision", "collision_checking", "self_filter", "verbose", "sensor"),
        *("contact", "surface", "selfCollide", "self_collide"),  # the touch of an environment, which is not here
    ),
    "joint": ("safety_controller", "calibration", "hardwareInterface", "verbose"),  # of controllers
    "visual": ("verbose", "texture", "name"),
}

TRANSMISSION_HARMLESS = (
    *("type", "hardwareInterface", "hardware_interface", "robotNamespace", "role", "plugin", "param", "verbose"),
    *("command_interface", "state_interface", "simulated_actuated_joint", "pulsesPerRevolution", "offset"),
    "ignoreTransmissionAbsoluteEncoder",  # which encoder a controller reads
)

TRANSMISSION_PHYSICS = (  # of other programs; where it counts, the drive file says it
    *("motorInertia", "motor_inertia", "rotorInertia", "rotor_inertia", "motorScale", "motor_scale"),
    *("motorTorqueConstant", "motor_torque_constant", "torque_constant", "efficiency", "damping", "friction"),
    *("saturationLower", "saturationUpper", "deadBandLower", "deadBandUpper"),  # of PAL's virtual joints
    *("leftActuator", "rightActuator", "rollJoint", "flexJoint", "gap_joint", "passive_joint", "screw_joint"),  # PR2's
    *("compensator", "use_simulated_gripper_joint", "thread_pitch"),
)

GAZEBO_ELEMENTS = ("inertial", "joint", "link", "model")  # bodies and joints that only Gazebo has

GAZEBO_PHYSICS = {  # what would change the dynamics in Gazebo, and the values that do not
    "turnGravityOff": ("0", "false", ""),
    "gravity": ("1", "true", ""),
    "springStiffness": ("0", "0.0", ""),
    "springReference": ("0", "0.0", ""),
    "dampingFactor": ("0", "0.0", ""),
}

DYNAMICS_ELSEWHERE = ("D", "K", "mu_coulomb", "mu_viscous")  # vendors' own simulation; contradict damping and friction
LIMITS_ELSEWHERE = ("acceleration", "deceleration", "jerk", "current", "command_effort", "gear_velocity")


@dataclass
class UrdfReading:
    """Options of one reading, and what it left out: harmless tags are counted, what a user should know is remarked."""

    path: Path
    packages: tuple[Path, ...] = ()
    meshes: tuple[Path, ...] = ()
    smoothing: float | None = None
    mimic: str = "coupled"
    ignore: frozenset[str] = frozenset()
    drives: DriveFile | None = None
    ignored: Counter[str] = field(default_factory=Counter)
    remarks: Findings = field(default_factory=Findings)
    renamed: dict[str, str] = field(default_factory=dict)
    dropped: set[str] = field(default_factory=set)  # of `ignore`, what was found
    wrong: list[Problem] = field(default_factory=list)  # all that makes the file unreadable

    @property
    def source(self) -> str:
        """The key of [sources] that the URDF's numbers get: none of the drive file's."""
        return free_key("urdf_file", self.drives)

    @property
    def smoothing_source(self) -> str:
        """The key of [sources] of a smoothing speed that the caller gave."""
        return free_key("smoothing_argument", self.drives)

    def attempt(self, read: Callable[..., Result], *arguments: Any) -> Result | None:
        """The result of reading one part; None where that is wrong, which is kept with what else is."""
        try:
            return read(*arguments)
        except DescriptionError as error:
            self._keep(error)
            return None

    def _keep(self, error: DescriptionError) -> None:
        """Keeps what is wrong, as far as anybody reads it."""
        self.wrong += error.problems[: max(MOST - len(self.wrong), 0)]

    def check_wrong(self) -> None:
        """Refuses the file where parts of it were wrong.

        Raises:
            DescriptionError: with all that was found.
        """
        if self.wrong:
            raise DescriptionError.of(*(each for k, each in enumerate(self.wrong) if each not in self.wrong[:k]))

    def remark(self, kind: str, name: str, what: str) -> None:
        """A remark for the user about a link or joint."""
        self.remarks.add(kind, name, Problem(what))

    def drive_of(self, joint: str) -> JointDrive | None:
        """The drive file's fields for a joint."""
        return None if self.drives is None else self.drives.joints.get(joint)

    def check_children(self, element: Element) -> None:
        """Counts children that may be ignored, and records unknown tags as errors."""
        read = READ.get(element.tag, ())
        if element.text.strip():
            what = f"text between its elements is not read: {element.text.strip()[:40]!r}"
            self.remark(element.tag, element.attributes.get("name", ""), what)
        for child in element.children:
            if child.tag in read:
                continue
            if child.tag in HARMLESS.get(element.tag, ()) or child.tag in self.ignore:
                self.leave_out(child.tag, child.tag if element.tag == "robot" else f"{element.tag}/{child.tag}")
            elif child.tag.startswith("xacro:"):
                what = f"a tag of xacro, a program that writes URDF: run it first, xacro {self.path.name} > robot.urdf"
                self._keep(child.error(what))
            else:
                known = (*read, *HARMLESS.get(element.tag, ()))
                self._keep(unknown_tag(child, f"<{element.tag}>", known))

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
            raise DescriptionError(why, place="ignore", value=tag, file=self.path)

    def notes(self) -> str:
        """A sentence each about what was ignored and renamed."""
        parts = [f"Read from {self.path.name}, its base fixed."]
        if self.ignored:
            counted = (f"{tag} ({count})" for tag, count in sorted(self.ignored.items()))
            parts.append(f"Ignored, as harmless to the dynamics: {', '.join(counted)}.")
        if self.renamed:
            names = (f"{old} → {new}" for old, new in self.renamed.items())
            parts.append(f"Renamed, as names hold no brackets and quotation marks: {', '.join(names)}.")
        return " ".join(parts)


def unknown_tag(element: Element, parent: str, known: Sequence[str]) -> DescriptionError:
    """The error of a tag that nobody would read, for the caller to raise."""
    expected = f"a tag that is read, or ignore = [{element.tag!r}]"
    return element.error(f"unknown in {parent}, and could carry physics", expected=expected, choices=known)

"""Model: an arm as algorithms and users have it. Variants are made with `replace` and `with_…`, never by mutation."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any

from armwright.content import checksum
from armwright.description.robot import RobotDescription, Source
from armwright.errors import DescriptionError, ModelError, Problem
from armwright.lint.feasibility import check_bodies, check_drives, impossible_links
from armwright.lint.plausibility import implausible_values
from armwright.model.build import massless, places_of_joints, tree_of
from armwright.model.changes import changed
from armwright.model.cylinder_lengths import implausible_lengths, is_stretched
from armwright.model.parameter_table import Parameters, parameters_of
from armwright.model.tree import Tree
from armwright.notebook import repr_html
from armwright.other_names import advice_of_arm
from armwright.spatial import rotated


@dataclass(frozen=True, eq=False)
class Model(Tree):
    """A robot arm: its numeric tree, the description that it was built from, and what was changed since.

    Attributes:
        description: its source record, or None of a model that was built directly.   warnings: doubts about the arm.
        changes: edits to the description that `replace` made, in order.
        file: what it was loaded from, a built-in name or the path of a file; None of a variant with another description.
    """

    description: RobotDescription | None = field(default=None, repr=False)
    warnings: tuple[str, ...] = ()
    changes: Mapping[str, Any] = field(default_factory=dict, repr=False)
    file: str | None = field(default=None, repr=False)

    __repr__ = Tree.__repr__
    _repr_html_ = repr_html

    if not TYPE_CHECKING:  # with it any attribute of an arm would pass a type checker

        def __getattr__(self, name: str) -> Any:
            raise AttributeError(f"an arm has no attribute {name!r}{advice_of_arm(name)}", name=name, obj=self)

    @cached_property
    def sha256(self) -> str:
        """Checksum of all that it holds."""
        return checksum(self)

    @property
    def record(self) -> RobotDescription:
        """The description.

        Raises:
            ModelError: the model was made without one.
        """
        if self.description is None:
            raise ModelError(
                "was not made from a description, so it has no parameters, sources or variants",
                place="arm",
                value=self.name,
            )
        return self.description

    @property
    def parameters(self) -> Parameters:
        """Every number of the record as a table: name, value, unit, standard deviation, bounds, source, scale.

        Raises:
            ModelError: a model that was not made from a description.
        """
        return parameters_of(self.record)

    def provenance(self, path: str) -> Source:
        """Source of a number of the record: `arm.provenance("link3.mass_kg")`."""
        return self.record.provenance(path)

    def replace(self, **changes: Any) -> Model:
        """A variant of the arm; the original does not change.

        Args:
            friction: None takes all joint friction away.   springs: None takes joints' springs and cylinders away.
            rotors: None takes the rotors' inertia away.   efficiency: None makes the gears lossless.
            firmware: None takes servos' loops away: what is behind them takes voltages or currents.
            gravity: (3,) [m/s²].   tip: name of a frame.   name: str.
        Raises:
            ModelError: an unknown change, or a value that is none.
        """
        result = self
        for name, value in changes.items():
            result = changed(result, name, value)
        if "gravity" in changes:
            changes["gravity"] = result.gravity  # a copy of its own
        return dataclasses.replace(result, changes={**self.changes, **changes})

    def with_payload(self, mass: Any, com: Any, inertia: Any, frame: str | None = None, **names: Any) -> Model:
        """The arm with a body at its end effector: a link "payload" fixed to a frame. What `replace` changed stays changed.

        Args:
            mass: () [kg].   com: (3,) [m] centre of mass, in the frame.
            inertia: (3, 3) [kg m²] about the centre of mass, in the frame's axes, or three principal moments.
            frame: name of a frame; by default the tip.   names: `name` of the link, `source` of its numbers.
        Raises:
            DescriptionError: a body that cannot be, a name that is taken, no such frame.   ModelError: no description.
        """
        at = self.tip if frame is None else frame
        return self._rebuilt(_variants().with_payload(self.record, mass, com, inertia, at, **names), self.changes)

    def with_locked(self, positions: Mapping[str, Any]) -> Model:
        """The arm with locked joints, `{"joint3": 0.4}` [rad | m]: q has the others only, the dynamics are the same.

        Raises:
            DescriptionError: no such joint, a position that is none, or no joint left.   ModelError: no description.
        """
        return self._rebuilt(_variants().with_locked(self.record, positions), self.changes)

    def with_values(self, values: Mapping[str, Any], source: str = "definition") -> Model:
        """The arm with other numbers in its record, `{"link6.mass_kg": 2.0, "link6.com_m[2]": 0.1}`, checked like a file's.

        Raises:
            DescriptionError: no such number, or a value that cannot stand there.   ModelError: no description.
        """
        return self._rebuilt(_variants().with_values(self.record, values, source), self.changes)

    def subchain(self, base: str, tip: str) -> Model:
        """The part of the arm from one frame or link to another, its new base and tip. What is fixed to it stays, what moves
        beside it is left out, with a warning. Gravity is turned into the new base's axes, joints before the base at 0.

        Raises:
            DescriptionError: no such frame, or nothing moves between the two.   ModelError: no description.
        """
        part = _variants().subchain(self.record, base, tip)
        changes = {name: value for name, value in self.changes.items() if name != "tip"}
        if "gravity" in changes:
            changes["gravity"] = rotated(part.base.rotation.T, changes["gravity"])
        return self._rebuilt(part.robot, changes)

    def _rebuilt(self, robot: RobotDescription, changes: Mapping[str, Any]) -> Model:
        """The model of a variant's description; impossible links are accepted only where the arm itself has some."""
        accepts = any(link.accept_impossible is None for link in impossible_links(self.record))
        model = build_model(robot, on_impossible="warn" if accepts else "error")
        known = build_model(self.record, on_impossible="warn").warnings
        of_file = [warning for warning in self.warnings if warning not in known]
        return dataclasses.replace(model, warnings=(*model.warnings, *of_file)).replace(**changes)


def _variants() -> Any:
    from armwright.model import variants  # few need them, and a first kernel should not wait for them

    return variants


def assembled(robot: RobotDescription) -> Model:
    """The model of a description whose values are numbers or symbols, unchecked.

    Raises:
        DescriptionError: no joint moves.
    """
    tree = tree_of(robot)
    return Model(**{each.name: getattr(tree, each.name) for each in fields(tree)}, description=robot)


def build_model(robot: RobotDescription, *, on_impossible: str = "error") -> Model:
    """The model of a description.

    Args:
        robot: the description.
        on_impossible: what an impossible inertia does: "error" (default) or "warn".
    Returns:
        model: fixed links merged into the bodies that carry them, joints in the order of the file, those that follow others
            without an entry in q.
    Raises:
        DescriptionError: a link whose mass properties no real body can have, a cylinder that no joint stretches.
    """
    if not isinstance(on_impossible, str) or on_impossible not in ("error", "warn"):
        raise DescriptionError(place="on_impossible", value=on_impossible, expected='"error" or "warn"')
    findings = [*check_bodies(robot, on_impossible), *check_drives(robot)]
    model = assembled(robot)
    _check_stretched(model)
    findings += implausible_values(robot, places_of_joints(robot, model))
    return dataclasses.replace(
        model, warnings=(*robot.remarks, *map(str, (*findings, *massless(model), *implausible_lengths(model))))
    )


def _check_stretched(model: Model) -> None:
    """Refuses cylinders whose length no joint changes: they do nothing.

    Raises:
        DescriptionError: there are some.
    """
    problems = [
        Problem(
            "no joint changes its length", f"cylinder {cylinder.name!r}", expected="anchors that a joint moves apart"
        )
        for cylinder in model.cylinders
        if not is_stretched(model, cylinder)
    ]
    if problems:
        raise DescriptionError.of(*problems)

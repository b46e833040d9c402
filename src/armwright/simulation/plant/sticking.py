"""Parts of a plant that stick, and their directions of motion: of a state, and over a step.

One element is all that acts at one speed and jumps where it is 0: of a joint its friction and, with a rigid gear, its motor's and
the gear's loss; a motor behind an elastic gear, or turned by several joints, is an element by itself. Behind an elastic gear it
has an equation of its own,  J ẇ = t₊ where w > 0, t₋ where w < 0:  it sticks where t₊ ≤ 0 ≤ t₋. All others are solved together
(`dynamics.sticking`), by the motors' speeds z = B q̇ where several joints turn one: each of these is then one of the unknowns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import from_motors, to_joints, to_motors
from armwright.actuators.friction import joint_friction, sliding_friction
from armwright.dynamics.gears import Gear, lossy_gears
from armwright.dynamics.inverse import newton_euler
from armwright.dynamics.mass_matrix import mass_matrix
from armwright.dynamics.sticking import (
    DryElement,
    Row,
    Side,
    at_rest,
    held_accelerations,
    next_speeds,
    present_directions,
)
from armwright.errors import ScenarioError
from armwright.friction_laws import LAWS
from armwright.friction_laws.law import Loads
from armwright.model import Body, Model
from armwright.program import WhereNeeded
from armwright.scalar import Array, Scalar
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.joint_drive import DrivenJoint, sticks_on_joint, sticks_on_motor

if TYPE_CHECKING:
    from armwright.simulation.plant.flow import PlantFlow

SLACK = 1e-9  # of what friction can hold: a load that is beyond it by less does not move it
ACTING = ("command", "wrench", "brake", "contacts")  # inputs by which the set-valued laws are solved
Place = tuple[int, bool]  # of an element: its joint, and whether it is the motor by itself


def sticking_places(model: Model, brakes: bool) -> tuple[Place, ...]:
    """Places of an arm's elements, its brakes included if they take part; none of one whose friction and gears are smooth."""
    followed = {k for k, _, body in _followers(model) if body.friction is not None and body.friction.sticks}
    places = []
    for i, body in enumerate(model.coordinates):
        of_motor = sticks_on_motor(body, brakes)
        if sticks_on_joint(body, brakes) or (of_motor and not _is_separate(body)) or i in followed:
            places.append((i, False))
        if of_motor and _is_separate(body):
            places.append((i, True))
    return tuple(places)


def _is_separate(body: Body) -> bool:
    """True if a joint's motor has another speed than the joint."""
    return body.elasticity is not None or bool(body.drive.coupling)


def _followers(model: Model) -> list[tuple[int, Scalar, Body]]:
    """Joints that follow others: the coordinate that moves each, its factor, and the joint."""
    if model.mimics is None:
        return []
    rows = zip(model.mimics.coordinate, model.mimics.factor, model.tree.bodies, strict=True)
    names = set(model.names)
    return [(k, factor, body) for k, factor, body in rows if body.joint not in names]


@dataclass(frozen=True, eq=False)
class Sticking:
    """The set-valued friction and gear laws of a plant."""

    plant: PlantFlow
    places: tuple[Place, ...]

    def of_joints(self, directions: Array) -> list[tuple[Scalar, Scalar]]:
        """Directions of every joint and its motor, from those of the elements; a motor that has none moves as its joint."""
        known = dict(zip(self.places, directions, strict=True))
        joints = [known.get((i, False), 0.0) for i in range(self.plant.model.n)]
        return [(joint, known.get((i, True), joint)) for i, joint in enumerate(joints)]

    def speeds(self, x: Array) -> np.ndarray:
        """Speeds (elements,) [rad/s | m/s], of motors referred to their joints."""
        motions = self.plant.motions(x)
        return scalar.array([motions[i].motor_speed if on_motor else motions[i].qd for i, on_motor in self.places])

    def accelerations(
        self, x: Array, inputs: PlantInputs, joints: Sequence[DrivenJoint]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (n,) with directions held, and the torques (n,) [N m | N] by which what sticks holds the joints."""
        directions = inputs.directions
        assert directions is not None
        mass, bias, gears = self._equations(x, inputs, joints, self.of_joints(directions), ())
        held = [directions[k] for k, place in enumerate(self.places) if place in self._together]
        rows = [self._row(place) for place in self._together]
        qdd, torques = held_accelerations(mass, bias, gears, rows, scalar.array(held))
        total = scalar.zeros(self.plant.model.n)
        for row, torque in zip(rows, torques, strict=True):
            for j, factor in row:
                total[j] = total[j] + factor * torque
        holding = total if self._inverse is None else to_joints(self.plant.shares, total)
        return self._of_joints(qdd), scalar.array(list(holding))

    def present(self, x: Array, inputs: PlantInputs) -> np.ndarray:
        """Directions (elements,) of a state."""
        sides = self._sides(x, inputs)
        mass, bias, gears, elements = self._problem(x, inputs, sides)
        together = present_directions(mass, bias, self._unknowns(x), elements, gears) if elements else ()
        return self._merged(together, {i: move for i, (move, _) in self._elastic_motors(x, sides, None).items()})

    def step(self, x: Array, inputs: PlantInputs, h: Scalar, moved: Callable[[Array], Array]) -> np.ndarray:
        """The state (size,) after a step of h [s]: by a rule while all directions are held, where speeds keep to them.

        Where one would turn round within the step, positions and speeds are those of the set-valued laws. These are solved where
        they are needed: there, and where something is at rest, for the direction in which it begins to move.

        Args:
            x: (size,).   inputs: without directions.   h: () [s].   moved: directions (elements,) → state (size,) by the rule.
        """
        acting = {name: getattr(inputs, name) for name in ACTING if getattr(inputs, name) is not None}

        def function(x: Array, h: Scalar, *values: Array) -> np.ndarray:
            return self._set_valued(x, replace(inputs, **dict(zip(acting, values, strict=True))), h)

        shapes = {name: np.shape(value) for name, value in {"x": x, "h": h, **acting}.items()}
        set_valued, arguments = WhereNeeded("set_valued", function, shapes), (x, h, *acting.values())
        count, standing = len(self.places), self._at_rest(x)
        starts = standing[0]
        for stands in standing[1:]:
            starts = scalar.maximum(starts, stands)
        found = set_valued(starts, scalar.zeros(count + self.plant.size), *arguments)
        directions = scalar.array(
            [
                scalar.where(stands, begins, scalar.sign(speed))
                for stands, begins, speed in zip(standing, found, self.speeds(x), strict=False)
            ]
        )
        after = self._settled(moved(directions), directions)
        ways = zip(directions, self.speeds(after), self._have_dry_friction(x, self._sides(x, inputs)), strict=True)
        turned = scalar.less(0.0, sum(scalar.less(way * speed, 0.0) * jump for way, speed, jump in ways))
        found = set_valued(turned * (1.0 - starts), found, *arguments)
        turns = [scalar.where(turned, by_sets, by_rule) for by_sets, by_rule in zip(found[count:], after, strict=True)]
        of_motion = [name for name in ("q", "qd", "motor_q", "motor_qd") if name in self.plant.layout]
        places = {k for name in of_motion for k in range(*self.plant.layout.place(name).indices(self.plant.size))}
        return scalar.array([turns[k] if k in places else value for k, value in enumerate(after)])

    def _at_rest(self, x: Array) -> list[Scalar]:
        """1 for elements at rest."""
        unknowns, speeds = self._unknowns(x), self.speeds(x)
        return [
            at_rest(self._row(place), unknowns) if place in self._together else scalar.equal(speed, 0.0)
            for place, speed in zip(self.places, speeds, strict=True)
        ]

    def _set_valued(self, x: Array, inputs: PlantInputs, h: Scalar) -> np.ndarray:
        """Directions (elements,) in a step of h [s], then the state (size,) after it by the set-valued laws.

        The state is of order 1, and of positions and speeds alone: the rest of it is that before the step.
        """
        n, plant, moved = self.plant.model.n, self.plant, list(x)
        sides = self._sides(x, inputs)
        mass, bias, gears, elements = self._problem(x, inputs, sides)
        after, together = next_speeds(mass, bias, self._unknowns(x), h, elements, gears)
        for i, speed in enumerate(self._of_joints(after)):
            moved[i], moved[n + i] = x[i] + 0.5 * h * (x[n + i] + speed), speed
        elastic = self._elastic_motors(x, sides, h)
        for i, (_, speed) in elastic.items():
            k = (plant.layout["motor_q"].joints or ()).index(i)
            q, w = (plant.layout.place(name).start + k for name in ("motor_q", "motor_qd"))
            turned = plant.model.coordinates[i].drive.gear_ratio * speed
            moved[q], moved[w] = x[q] + 0.5 * h * (x[w] + turned), turned
        directions = self._merged(together, {i: move for i, (move, _) in elastic.items()})
        return scalar.array([*directions, *moved])

    def _have_dry_friction(self, x: Array, sides: Sequence[Sequence[DrivenJoint]]) -> list[Scalar]:
        """1 for elements with dry friction; 0 for those without, such as a joint whose only friction is its released brake."""
        ratios = [body.drive.gear_ratio for body in self.plant.model.coordinates]
        jumps = []
        for place in self.places:
            if place in self._together:
                forward, backward = (way.standing for way in self._ways(x, place, sides))
            else:
                forward, backward = (side[place[0]].acceleration / ratios[place[0]] for side in sides)
            jumps.append(scalar.less(forward, backward))
        return jumps

    def landed(
        self, x: Array, inputs: PlantInputs, moved: Array, error: Array, h: Scalar, others: Sequence[Array] = ()
    ) -> tuple[Array, ...]:
        """The state (size,) after a step in which directions are held, its error (size,), others, the rule's own error, and at
        which part of the step a direction changes.

        A speed that turns round counts as wrong by what it has beyond 0, and is 0 then: the next step begins there. What breaks
        loose within the step counts as wrong by the speed that it would have by then: it begins late by the rest of the step,
        with the acceleration there and all that friction loses once it slides. Both places are those of straight lines.

        Args:
            x: (size,) before the step.   inputs: with the directions.   moved, error: (size,) of the rule.   h: () [s].
            others: what the rule tells beside.
        """
        assert inputs.directions is not None
        wrong, part, still = list(error), 1.0, []
        jumps = self._have_dry_friction(x, self._sides(x, inputs))
        ends = zip(
            self.speeds(x), self.speeds(moved), self._excess(x, inputs), self._excess(moved, inputs), strict=True
        )
        for place, way, jump, (begin, end, (lacking, _, _), (breaking, lost, _)) in zip(
            self.places, inputs.directions, jumps, ends, strict=True
        ):
            sticks, turned = scalar.equal(way, 0.0), scalar.less(way * end, 0.0) * jump
            loose = sticks * scalar.less(0.0, breaking)
            of_turn = _part(scalar.abs(begin), scalar.abs(end))
            of_break = _part(-lacking, breaking)
            part = scalar.minimum(part, scalar.where(turned, of_turn, scalar.where(loose, of_break, 1.0)))
            late = scalar.where(loose, h * (1.0 - of_break) * (0.5 * breaking + lost), 0.0)
            k, ratio = self._speed_of(place)
            shifted = self._shifted(place, begin, end, lost, h)
            wrong[k] = shifted * scalar.abs(wrong[k])
            wrong[k] = wrong[k] + scalar.abs(ratio) * (scalar.where(turned, scalar.abs(end), 0.0) + late)
            still.append(scalar.maximum(turned, sticks))
        return self._with_zero_speeds(moved, still), scalar.array(wrong), *others, error, part

    def _shifted(self, place: Place, begin: Scalar, end: Scalar, lost: Scalar, h: Scalar) -> Scalar:
        """Factor by which an error of speed grows while friction falls.

        It shifts all that follows in time, by itself over the acceleration; that one then rises by what friction still loses.
        """
        friction = self.plant.model.coordinates[place[0]].friction
        if friction is None or friction.stribeck is None:
            return 1.0
        moved, speed = scalar.abs(end - begin), begin / friction.stribeck_speed
        left = h * lost * scalar.exp(-speed * speed)
        return 1.0 + scalar.where(
            scalar.equal(moved, 0.0), 0.0, left / scalar.where(scalar.equal(moved, 0.0), 1.0, moved)
        )

    def sliding(self, x: Array, inputs: PlantInputs) -> np.ndarray:
        """Speeds (elements,) of what slides in its direction, below 0 where it has turned round; 1 of what sticks."""
        assert inputs.directions is not None
        jumps = self._have_dry_friction(x, self._sides(x, inputs))
        return scalar.array(
            [
                scalar.where(scalar.equal(way, 0.0), 1.0, scalar.where(scalar.less(0.0, jump), way * speed, 1.0))
                for way, speed, jump in zip(inputs.directions, self.speeds(x), jumps, strict=True)
            ]
        )

    def keeping(self, x: Array, inputs: PlantInputs) -> np.ndarray:
        """`sliding`, and of what sticks the acceleration (elements,) [rad/s² | m/s²] that its load lacks to set it in motion.

        It counts as loose where the load is beyond by more than rounding, `SLACK` of what friction can hold: it then moves.
        """
        assert inputs.directions is not None
        rows = zip(inputs.directions, self.sliding(x, inputs), self._excess(x, inputs), strict=True)
        return scalar.array(
            [scalar.where(scalar.equal(way, 0.0), SLACK * room - excess, s) for way, s, (excess, _, room) in rows]
        )

    def settled(self, x: Array, inputs: PlantInputs) -> np.ndarray:
        """The state (size,) with speeds of 0 for what sticks and for what has passed 0 against its direction."""
        assert inputs.directions is not None
        slides = self.sliding(x, inputs)
        still = [
            scalar.maximum(scalar.equal(way, 0.0), scalar.less(s, 0.0))
            for way, s in zip(inputs.directions, slides, strict=True)
        ]
        return self._with_zero_speeds(x, still)

    def at_rest(self, x: Array, directions: Array) -> np.ndarray:
        """The state (size,) with speeds of 0 for elements whose direction is 0."""
        return self._with_zero_speeds(x, [scalar.equal(way, 0.0) for way in directions])

    def _excess(self, x: Array, inputs: PlantInputs) -> list[tuple[Scalar, Scalar, Scalar]]:
        """Breakaway margins [rad/s² | m/s²]: acceleration by the loads if the joint slipped; negative while it holds.

        Beside each the one that falling friction adds once it slides, and the one by which friction can hold in all. Of motors
        that turn several joints -1, 0 and 1: what holds them is no single torque.
        """
        directions, model = inputs.directions, self.plant.model
        assert directions is not None
        sides = self._sides(x, inputs)
        found: dict[Place, tuple[Scalar, Scalar, Scalar]] = {}
        for i, on_motor in self.places:
            if (i, on_motor) not in self._together:
                forth, back = (side[i].acceleration / model.coordinates[i].drive.gear_ratio for side in sides)
                lost = (
                    _falling(model.coordinates[i], on_motor, sides[0][i].known) / model.coordinates[i].drive.reflected
                )
                found[i, True] = scalar.maximum(forth, -back), lost, back - forth
        if self._inverse is not None or not self._together:
            return [found.get(place, (-1.0, 0.0, 1.0)) for place in self.places]
        joints = self.plant.driven(x, inputs, self.of_joints(directions))
        mass, bias, gears = self._equations(x, inputs, joints, self.of_joints(directions), ())
        held = scalar.array([directions[k] for k, place in enumerate(self.places) if place in self._together])
        _, holding = held_accelerations(mass, bias, gears, [self._row(place) for place in self._together], held)
        for place, torque in zip(self._together, holding, strict=True):
            i = place[0]
            there = torque + self._side(place, joints[i], self._resisting(x, i, joints[i], 0.0)).standing
            low, high = (way.standing for way in self._ways(x, place, sides))
            excess = scalar.maximum(low - there, there - high) / mass[i, i]
            found[place] = (
                excess,
                _falling(model.coordinates[i], place[1], joints[i].known) / mass[i, i],
                (high - low) / mass[i, i],
            )
        return [found[place] for place in self.places]

    def _speed_of(self, place: Place) -> tuple[int, Scalar]:
        """Place of an element's speed in the state, and its unit there by that of the element; a coupled motor's joint's."""
        i, _ = place
        if place in self._together:
            return self.plant.model.n + i, 1.0
        k = (self.plant.layout["motor_qd"].joints or ()).index(i)
        return self.plant.layout.place("motor_qd").start + k, self.plant.model.coordinates[i].drive.gear_ratio

    def _settled(self, x: Array, directions: Array) -> Array:
        """The state with speeds of 0 for what sticks, where sums of speeds have rounding left."""
        return x if self._inverse is None else self.at_rest(x, directions)

    def _with_zero_speeds(self, x: Array, still: Sequence[Scalar]) -> np.ndarray:
        """The state with speeds of 0 for elements that stand still."""
        n, after = self.plant.model.n, list(x)
        for place, stands in zip(self.places, still, strict=True):
            if place not in self._together or not place[1]:
                k, _ = self._speed_of(place)
                after[k] = scalar.where(stands, 0.0, after[k])
        if self._inverse is not None:
            z = list(self._unknowns(after))
            for (i, on_motor), stands in zip(self.places, still, strict=True):
                if on_motor and (i, on_motor) in self._together:
                    z[i] = scalar.where(stands, 0.0, z[i])
            after[n : 2 * n] = self._of_joints(scalar.array(z))
        return scalar.array(after)

    def stuck(self, inputs: PlantInputs) -> list[tuple[int, Scalar]]:
        """Places in the state of the speeds of elements, and 1 for those that stick.

        Raises:
            ScenarioError: where several joints turn a motor that sticks, whose speed is none of the state's.
        """
        if self._inverse is not None:
            raise ScenarioError(
                "takes no motors that several joints turn and that stick",
                place="solver.integrator",
                value="rodas3",
                expected="'auto', 'rk45' or a fixed step; or a record with a smoothing speed in `friction`",
            )
        assert inputs.directions is not None
        return [
            (self._speed_of(place)[0], scalar.equal(direction, 0.0))
            for place, direction in zip(self.places, inputs.directions, strict=True)
        ]

    @property
    def by_joints(self) -> bool:
        """True if the speeds of all elements are entries of the state."""
        return self._inverse is None

    @cached_property
    def _together(self) -> tuple[Place, ...]:
        """Places of all elements but motors behind elastic gears."""
        coordinates = self.plant.model.coordinates
        return tuple((i, on) for i, on in self.places if not on or coordinates[i].elasticity is None)

    def _merged(self, together: Array, elastic: dict[int, Scalar]) -> np.ndarray:
        """Values of all elements (elements,), from those solved together and those of motors behind elastic gears."""
        values = iter(together)
        return scalar.array([next(values) if place in self._together else elastic[place[0]] for place in self.places])

    @cached_property
    def _inverse(self) -> np.ndarray | None:
        """B⁻¹ (n, n) where the unknowns are the motors' speeds; None where they are the joints'."""
        if not any(on_motor for _, on_motor in self._together):
            return None
        return scalar.array(from_motors(self.plant.shares, scalar.eye(self.plant.model.n)))

    def _row(self, place: Place) -> Row:
        """An element's speed by the unknowns."""
        joint, on_motor = place
        if self._inverse is None or on_motor:
            return [(joint, 1.0)]
        return [(j, f) for j, f in enumerate(self._inverse[joint]) if scalar.is_symbolic(f) or f != 0.0]

    def _unknowns(self, x: Array) -> Array:
        """Speeds (n,) of the motors, or of the joints."""
        qd = x[self.plant.model.n : 2 * self.plant.model.n]
        return qd if self._inverse is None else to_motors(self.plant.shares, qd)

    def _of_joints(self, unknowns: Array) -> Array:
        """Speeds or accelerations (n,) of the joints."""
        return unknowns if self._inverse is None else from_motors(self.plant.shares, unknowns)

    def _sides(self, x: Array, inputs: PlantInputs) -> list[list[DrivenJoint]]:
        """Every joint's drive moving forward, and moving backward."""
        return [self.plant.driven(x, inputs, [(way, way)] * self.plant.model.n) for way in (1.0, -1.0)]

    def _elastic_motors(
        self, x: Array, sides: Sequence[Sequence[DrivenJoint]], h: Scalar | None
    ) -> dict[int, tuple[Scalar, Scalar]]:
        """Directions of motors behind elastic gears, and their speeds after a step of h; None: as they are now."""
        motions, found = self.plant.motions(x), {}
        for i, on_motor in self.places:
            if (i, on_motor) in self._together:
                continue
            speed, ratio = motions[i].motor_speed, self.plant.model.coordinates[i].drive.gear_ratio
            begin, length = (0.0, 1.0) if h is None else (speed, h)
            forth, back = (begin + length * (side[i].acceleration / ratio) for side in sides)
            moves = scalar.less(0.0, forth) - scalar.less(back, 0.0)
            after = scalar.where(scalar.less(0.0, forth), forth, scalar.where(scalar.less(back, 0.0), back, 0.0))
            found[i] = scalar.where(scalar.equal(speed, 0.0), moves, scalar.sign(speed)), after
        return found

    def _problem(
        self, x: Array, inputs: PlantInputs, sides: Sequence[Sequence[DrivenJoint]]
    ) -> tuple[Array, Array, list[Gear], list[DryElement]]:
        """M, b, lossy gears and elements by the unknowns; the first three without what is part of an element."""
        coordinates, n = self.plant.model.coordinates, self.plant.model.n
        mass, bias, gears = self._equations(x, inputs, sides[0], [(1.0, 1.0)] * n, self._together)
        elements = []
        for i, on_motor in self._together:
            lossy = sides[0][i].gear_loss is not None and (on_motor or not _is_separate(coordinates[i]))
            inertia = coordinates[i].drive.reflected if lossy else 0.0
            elements.append(DryElement(self._row((i, on_motor)), inertia, *self._ways(x, (i, on_motor), sides)))
        return mass, bias, gears, elements

    def _ways(self, x: Array, place: Place, sides: Sequence[Sequence[DrivenJoint]]) -> list[Side]:
        """An element that moves forward, and one that moves backward."""
        i, ways = place[0], zip(sides, (1.0, -1.0), strict=True)
        return [self._side(place, side[i], self._resisting(x, i, side[i], way)) for side, way in ways]

    def _side(self, place: Place, joint: DrivenJoint, resisting: Scalar) -> Side:
        i, on_motor = place
        if on_motor:
            return Side(joint.gear, 0.0, joint.gear_loss)
        if _is_separate(self.plant.model.coordinates[i]):
            return Side(0.0, resisting, None)
        return Side(joint.gear, resisting, joint.gear_loss)

    def _equations(
        self, x: Array, inputs: PlantInputs, joints: Sequence[DrivenJoint], directions: Sequence[tuple[Scalar, Scalar]],
        without: Sequence[Place],
    ) -> tuple[Array, Array, list[Gear]]:  # fmt: skip
        """M, b and lossy gears by the unknowns, without the torques of some elements."""
        model, n = self.plant.model, self.plant.model.n
        q, qd = x[:n], x[n : 2 * n]
        motors = {i for i, on in without if on or not _is_separate(model.coordinates[i])}
        gear = [0.0 if i in motors else joint.gear for i, joint in enumerate(joints)]
        resisting = [
            0.0 if (i, False) in without else self._resisting(x, i, joint, directions[i][0])
            for i, joint in enumerate(joints)
        ]
        links, driven, gears = lossy_gears(self.plant.rigid, scalar.array(gear), [joint.gear_loss for joint in joints])
        gears = [each for each in gears if each.row[0][0] not in motors]
        bias = newton_euler(links, q, qd, scalar.zeros(n), inputs.wrench) + scalar.array(resisting) - driven
        mass = mass_matrix(links, q)
        if self._inverse is None:
            return mass, bias, gears
        turned = self._inverse
        gears = [replace(each, row=[(each.row[0][0], 1.0)]) for each in gears]
        return turned.T @ mass @ turned, turned.T @ bias, gears

    def _resisting(self, x: Array, joint: int, driven: DrivenJoint, direction: Scalar) -> Scalar:
        """Friction torque against motion in `direction`, with that of the joints that follow [N m | N]."""
        total = driven.resisting
        for k, factor, body in _followers(self.plant.model):
            if k != joint or body.friction is None:
                continue
            speed = factor * x[self.plant.model.n + k]
            if body.friction.sticks:
                total = total + factor * sliding_friction(body.friction, speed, direction * scalar.sign(factor))
            else:
                total = total + factor * joint_friction(body.friction, speed)
        return total


def _falling(body: Body, on_motor: bool, loads: Loads | Scalar | None) -> Scalar:
    """Torque [N m | N] by which a joint's or its motor's friction at rest is above that of sliding."""
    friction = body.friction
    if friction is None or (_is_separate(body) and friction.on_motor != on_motor):
        return 0.0
    return LAWS[friction.law].falling(friction, loads)


def _part(before: Scalar, beyond: Scalar) -> Scalar:
    """Part of a step at which a line from `before` on one side of 0 to `beyond` on the other is 0; half where it begins there."""
    whole = before + beyond
    return scalar.where(scalar.less(0.0, before), before / scalar.where(scalar.less(0.0, whole), whole, 1.0), 0.5)

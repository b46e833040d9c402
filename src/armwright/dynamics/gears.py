"""Torques between motors and links: rotors, motor-side friction, lossy gears, motors that several joints turn.

With B the motors' speeds by the joints', w = B q̇ (B = 1 but for coupled wrists), D = n² J_m the rotors' inertia and f_m the
motor-side friction, a gear is entered by  t = tau - D ẇ - f_m(w),  and the joints receive Bᵀ G(t)  (`actuators.gear`):

    M_links q̈ + C q̇ + g + f_links(q̇) - Jᵀ wrench  =  Bᵀ G(tau - D B q̈ - f_m(B q̇))

Given q̈ this is explicit. Given tau, the difference of both sides is the gradient of a strictly convex function of q̈, whose
second derivative is M_links + Bᵀ diag(G') D B: Newton's method on it ends at the one solution.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import from_joints, shares_of, to_joints, to_motors
from armwright.actuators.friction import by_loads, driving_torque, motor_friction
from armwright.actuators.gear import GearLoss, gear_loss
from armwright.model import Model
from armwright.program import WhereNeeded, repeated
from armwright.scalar import Array, Factored, Scalar

MOST = 12  # solves: a million states of random and adversarial arms take up to seven
# Of them the first go all the way, which ends sooner; the others only as far as a convex function falls, which always ends.
BOLD, BOLD_OF_TABLES = 5, 1
SEARCHED = 6  # parts of the way at which the slope is looked at where gears have tables
SETTLED = 1e-4  # of a gear's torque: an iteration that goes on leaves more of it, one that has ended only rounding


def gear_losses(arm: Model, qd: Array) -> list[GearLoss | None]:
    """G of every motor at the joints' speeds, load-proportional friction included; None for gears without loss."""
    w = to_motors(shares_of(arm), qd)
    return [gear_loss(body.drive, w[i], body.friction) for i, body in enumerate(arm.coordinates)]


def motor_torques(arm: Model, qd: Array, qdd: Array, joint_torques: Array, external: Array | None = None) -> np.ndarray:
    """Torques of the motors that give the joints these:  tau = G⁻¹(B⁻ᵀ r) + D B q̈ + f_m(B q̇)  (n,) [N m | N].

    Friction by loads depends on tau itself, and on `external` (n,), τ_e of `inverse.external_torques`: None, no joint has such.
    """
    shares = shares_of(arm)
    w, wd, leaving = to_motors(shares, qd), to_motors(shares, qdd), from_joints(shares, joint_torques)
    tau = []
    for i, (body, loss) in enumerate(zip(arm.coordinates, gear_losses(arm, qd), strict=True)):
        entering = leaving[i] if loss is None else loss.input(leaving[i])
        if external is not None and by_loads(body):
            tau.append(driving_torque(body, w[i], entering + body.drive.reflected * wd[i], external[i]))
            continue
        tau.append(entering + motor_friction(body, w[i]) + body.drive.reflected * wd[i])
    return scalar.array(tau)


def joint_torques(arm: Model, qd: Array, qdd: Array, tau: Array, external: Array | None = None) -> np.ndarray:
    """Torques that the motors give the joints:  Bᵀ G(tau - D B q̈ - f_m(B q̇))  (n,) [N m | N]; external as `motor_torques`."""
    shares = shares_of(arm)
    w, wd = to_motors(shares, qd), to_motors(shares, qdd)
    leaving = []
    for i, (body, loss) in enumerate(zip(arm.coordinates, gear_losses(arm, qd), strict=True)):
        loads = None if external is None else (tau[i], external[i])
        entering = tau[i] - motor_friction(body, w[i], loads) - body.drive.reflected * wd[i]
        leaving.append(entering if loss is None else loss.output(entering))
    return to_joints(shares, leaving)


@dataclass(frozen=True, eq=False)
class Gear:
    """A lossy gear behind a rotor, in the form used by Newton's method."""

    row: list[tuple[int, Scalar]]  # of B: which joints turn the motor, and by how much
    inertia: Scalar  # D [kg m² | kg]
    torque: Scalar  # tau - f_m(w) [N m | N]
    loss: GearLoss

    def entering(self, qdd: Array) -> Scalar:
        """t at those accelerations."""
        return self.torque - self.inertia * self.turned(qdd)

    def turned(self, qdd: Array) -> Scalar:
        """The motor's acceleration at those of the joints."""
        return sum(share * qdd[j] for j, share in self.row)

    def packed(self) -> np.ndarray:
        """Its numbers, for `unpacked`."""
        shares = [share for _, share in self.row]
        return scalar.array([*shares, self.inertia, self.torque, *self.loss.packed()])

    def unpacked(self, values: Array) -> Gear:
        """The gear with other numbers."""
        k = len(self.row)
        row = [(j, value) for (j, _), value in zip(self.row, values, strict=False)]
        return Gear(row, values[k], values[k + 1], self.loss.unpacked(values[k + 2 :]))


def lossy_gears(arm: Model, torques: Array, losses: Sequence[GearLoss | None]) -> tuple[Model, np.ndarray, list[Gear]]:
    """Torques of an arm's motors, divided into those that its rotors' accelerations change in the gear and the others.

    Args:
        arm: the model.   torques: (n,) tau - f_m(w) of the motors [N m | N].   losses: of their gears.
    Returns:
        arm: without the rotors of the gears below.   driven: (n,) what reaches the joints from all others [N m | N].
        gears: with loss, behind rotors.
    """
    shares, gears, driven, rotors = shares_of(arm), [], [], set()
    for i, (body, torque, loss) in enumerate(zip(arm.coordinates, torques, losses, strict=True)):
        inertia = body.drive.reflected
        if loss is not None and (scalar.is_symbolic(inertia) or inertia > 0.0):
            gears.append(Gear([(i, 1.0), *shares[i]], inertia, torque, loss))
            rotors.add(body.joint)
            torque, loss = 0.0, None
        driven.append(torque if loss is None else loss.output(torque))
    return without_rotors(arm, rotors) if rotors else arm, to_joints(shares, driven), gears


def motors(arm: Model, qd: Array, tau: Array, external: Array | None = None) -> tuple[Model, np.ndarray, list[Gear]]:
    """`lossy_gears` of an arm whose motors give torques tau (n,) [N m | N], by speed; external as `motor_torques`."""
    w = to_motors(shares_of(arm), qd)
    loads = [None] * arm.n if external is None else zip(tau, external, strict=True)
    torques = [
        tau[i] - motor_friction(body, w[i], each)
        for (i, body), each in zip(enumerate(arm.coordinates), loads, strict=True)
    ]
    return lossy_gears(arm, scalar.array(torques), gear_losses(arm, qd))


def without_rotors(arm: Model, joints: Collection[str]) -> Model:
    """The arm without the rotors of those joints' motors."""
    bodies = (
        replace(body, drive=replace(body.drive, rotor_inertia=0.0)) if body.joint in joints else body
        for body in arm.bodies
    )
    return replace(arm, bodies=tuple(bodies))


def through_gears(mass: Array, bias: Array, gears: Sequence[Gear]) -> tuple[np.ndarray, Factored]:
    """Accelerations q̈ (n,) that solve  M q̈ + b = Σ Bᵢᵀ Gᵢ(torque - D Bᵢ q̈),  and the factors of  M + Σ Bᵢᵀ G' D Bᵢ.

    By Newton's method with a line search, in at most `MOST` solves; q̈ is NaN where those do not end it.
    """
    qdd, factors, ended = solved(mass, bias, gears)
    return scalar.array(scalar.where(ended, qdd, np.nan)), factors


def solved(
    mass: Array, bias: Array, gears: Sequence[Gear], start: Array | None = None, most: int = MOST
) -> tuple[np.ndarray, Factored, Scalar]:
    """Newton from `start` with at most `most` solves: q̈, its factors, and 1 if it converged, else 0 (q̈ then means nothing)."""
    near = newton_steps(mass, bias, gears, start, most)[: len(bias)]
    matrix, right = linearised(mass, bias, gears, near)
    factors = scalar.factor_symmetric(matrix)
    qdd, ended = scalar.solve_factored(factors, right), 1.0
    for gear in gears:
        slope, offset = gear.loss.line(gear.entering(near))
        t = gear.entering(qdd)
        torque = gear.loss.output(t)
        left = scalar.abs(torque - (slope * t + offset))
        size = scalar.abs(torque) + scalar.abs(gear.torque)
        ended = ended * scalar.less_equal(left, SETTLED * size)
    return qdd, factors, ended


def newton_steps(
    mass: Array, bias: Array, gears: Sequence[Gear], start: Array | None = None, most: int = MOST
) -> np.ndarray:
    """Accelerations at which every gear has the line that it has at the solution, and how many steps led there (n + 1,).

    The steps begin at accelerations `start` (n,), by default 0; the solution is the same from any.
    """
    n = len(bias)
    first = scalar.zeros(n) if start is None else start
    lower = [(i, j) for i in range(n) for j in range(i + 1)]

    def step(state: Array, packed: Array, bias: Array, *numbers: Array) -> np.ndarray:
        matrix = scalar.zeros(n, n)
        for (i, j), entry in zip(lower, packed, strict=True):
            matrix[i, j] = matrix[j, i] = entry
        unpacked = [gear.unpacked(values) for gear, values in zip(gears, numbers, strict=True)]
        return _newton_step(state[:n], state[n], scalar.array(matrix), bias, unpacked)

    packed = scalar.array([mass[i, j] for i, j in lower])
    arguments = (packed, scalar.array(bias), *(gear.packed() for gear in gears))
    return repeated("gears", step, scalar.array([*first, 0.0]), arguments, most - 1)


def linearised(mass: Array, bias: Array, gears: Sequence[Gear], qdd: Array) -> tuple[Array, Array]:
    """A and right side of the linear system that holds where every gear keeps the line that it has at q̈."""
    matrix, right = np.array(mass, dtype=object), -np.array(bias, dtype=object)
    for gear in gears:
        slope, offset = gear.loss.line(gear.entering(qdd))
        torque = slope * gear.torque + offset
        for i, a in gear.row:
            right[i] = right[i] + a * torque
            for j, b in gear.row:
                matrix[i, j] = matrix[i, j] + a * b * (slope * gear.inertia)
    return scalar.array(matrix), scalar.array(right)


def _newton_step(qdd: Array, steps: Scalar, mass: Array, bias: Array, gears: Sequence[Gear]) -> np.ndarray:
    """Accelerations after one more of Newton's steps from q̈, and the number of steps then (n + 1,).

    Both stay where every gear keeps its line on the way: `linearised` at q̈ then has the solution.
    """
    full = scalar.solve_symmetric(*linearised(mass, bias, gears, qdd))
    move, kept, pieces = full - qdd, 1.0, []
    for gear in gears:
        t, there = gear.entering(qdd), gear.entering(full)
        # by the side of each knot, not by slopes, which are equal at rest: derivatives need the right side there too
        for knot in gear.loss.knots:
            kept = kept * scalar.equal(scalar.less(t, knot), scalar.less(there, knot))
        pieces.append((gear.loss, gear.turned(move), t, there - t))
    if not any(loss.jumps for loss, *_ in pieces):
        part = _lowest_part(qdd, move, steps, mass, bias, pieces)
    else:  # a step that keeps all lines, as the last one does, needs no search, which is most of the work

        def search(qdd: Array, move: Array, ways: Array) -> np.ndarray:
            losses = (gear.loss for gear in gears)
            found = [(loss, *way) for loss, way in zip(losses, np.asarray(ways).reshape(-1, 3), strict=True)]
            return scalar.array([_lowest_part(qdd, move, steps, mass, bias, found)])

        ways = scalar.array([value for _, *way in pieces for value in way])
        shapes = {name: np.shape(value) for name, value in (("qdd", qdd), ("move", move), ("ways", ways))}
        (part,) = WhereNeeded("search", search, shapes)(1.0 - kept, scalar.zeros(1), qdd, move, ways)
    new = qdd + part * move
    return scalar.array([*scalar.where(kept, qdd, new), scalar.where(kept, steps, steps + 1.0)])


def _lowest_part(
    qdd: Array, move: Array, steps: Scalar, mass: Array, bias: Array, pieces: Sequence[tuple[Any, ...]]
) -> Scalar:
    """Part of the way along `move` (n,) that one of Newton's steps goes, 1 where the function falls all the way.

    Args:
        qdd: (n,) where it begins.   steps: done before.   mass, bias: without gears.
        pieces: of every gear its loss, by how much it turns on the way, its torque, and by how much that changes.
    """
    curvature, start = move @ (mass @ move), move @ (mass @ qdd + bias)

    def slope(part: Scalar) -> Scalar:
        """Of the convex function on the way; it rises, along lines between the bends."""
        return start + part * curvature - sum(turn * loss.output(t + part * change) for loss, turn, t, change in pieces)

    at_start, at_end = slope(0.0), slope(1.0)
    falling = scalar.less_equal(at_end, 0.0)
    bracket, bold = (0.0, 1.0, at_start, at_end), BOLD
    jumps = any(loss.jumps for loss, *_ in pieces)
    if jumps or all(len(loss.knots) == 1 for loss, *_ in pieces):
        for loss, _, t, change in pieces:  # the two bends that the lowest point lies between
            for knot in loss.knots:
                bend = (knot - t) / scalar.where(scalar.equal(change, 0.0), 1.0, change)
                bracket = _narrowed(bracket, bend, slope(bend))
        bold = 0 if jumps else BOLD  # a bold step would go from one side of a jump to the other, and back
    else:  # among many bends halving goes on where the secant creeps, and the secant is exact within a line
        bold = BOLD_OF_TABLES
        for k in range(SEARCHED):
            low, high, _, _ = bracket
            part = 0.5 * (low + high) if k % 2 else _secant(bracket, falling)
            bracket = _narrowed(bracket, part, slope(part))
    lowest = _secant(bracket, falling)
    all_the_way = scalar.minimum(1.0, falling + scalar.less(steps, float(bold)))
    return scalar.where(all_the_way, 1.0, lowest)


def _narrowed(bracket: tuple[Scalar, ...], part: Scalar, value: Scalar) -> tuple[Scalar, ...]:
    """The ends of a bracket and the slopes there, one of them moved to a part of the way between them with that slope."""
    low, high, at_low, at_high = bracket
    inside = scalar.less(0.0, part) * scalar.less(part, 1.0)
    before, behind = inside * scalar.less(value, 0.0), inside * scalar.less_equal(0.0, value)
    return (
        scalar.where(before, scalar.maximum(low, part), low),
        scalar.where(behind, scalar.minimum(high, part), high),
        scalar.where(before, scalar.maximum(at_low, value), at_low),
        scalar.where(behind, scalar.minimum(at_high, value), at_high),
    )


def _secant(bracket: tuple[Scalar, ...], falling: Scalar) -> Scalar:
    """Part of the way at which the line between a bracket's ends is 0; of no meaning where the function falls all the way."""
    low, high, at_low, at_high = bracket
    return (low * at_high - high * at_low) / scalar.where(falling, 1.0, at_high - at_low)

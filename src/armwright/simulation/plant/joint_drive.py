"""One joint of the plant: from its command and its states to what reaches the links, what changes and where power goes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from armwright import scalar
from armwright.actuators.backlash import flank_depths
from armwright.actuators.brake import holding
from armwright.actuators.cogging import cogging_torque
from armwright.actuators.dead_zone import command_for
from armwright.actuators.elasticity import bent, transmitted
from armwright.actuators.firmware import FirmwareState, bridged, within_drive
from armwright.actuators.friction import has_corner, joint_friction, sliding_friction
from armwright.actuators.gear import GearLoss, gear_loss, holds_by_loss
from armwright.actuators.lugre import bristle_friction, sliding
from armwright.actuators.motor import check_command, joint_constant
from armwright.actuators.stops import stop_depths, stopped
from armwright.actuators.thermal import warmed, warming_rates
from armwright.actuators.winding import Winding, driven_winding, is_limit, switched
from armwright.description.firmware import MOST_LATENCY
from armwright.friction_laws import LAWS
from armwright.friction_laws.law import Loads
from armwright.model import Body, Brake, Model
from armwright.scalar import Array, Scalar
from armwright.simulation.plant.state import OUTPUTS, WAITING

STANDING = 1e-9  # of the speed that friction is smoothed over, or [rad/s | m/s]: a joint that is slower stands


@dataclass(frozen=True, eq=False)
class JointStates:
    """State of a joint's drive; None for parts that it lacks."""

    current: Scalar | None = None  # [A]
    bristle: Scalar | None = None  # [rad | m]
    brake: Scalar | None = None  # [rad | m]
    winding_temperature: Scalar | None = None  # [°C]
    housing_temperature: Scalar | None = None  # [°C]
    servo: FirmwareState | None = None


@dataclass(frozen=True, eq=False)
class DriveMotion:
    """Positions and speeds of one joint and its motor; of the motor as θ_motor / n, on the joint side."""

    q: Scalar  # of the joint [rad | m]
    qd: Scalar  # [rad/s | m/s]
    motor: Scalar
    motor_speed: Scalar
    link: Scalar  # where the motor would be behind a rigid gear: q, but for coupled motors
    link_speed: Scalar


@dataclass(frozen=True, eq=False)
class DrivenJoint:
    """Torques, derivatives and electrical values of a joint's drive."""

    tau: Scalar  # n Kt i [N m | N]
    voltage: Scalar  # [V]
    current: Scalar  # [A]
    power: Scalar  # into the drive [W]
    heat: Scalar | None  # in the winding [W]; None where its resistance is not known
    gear: Scalar  # into a rigid gear, less what the rotor takes, or out of an elastic one [N m | N]
    gear_loss: GearLoss | None  # of a rigid gear
    resisting: Scalar  # on the joint itself, against positive motion: its friction, brake and stops [N m | N]
    friction: Scalar  # of the joint itself [N m | N]
    loss: Scalar  # in gear, friction, dampers, brake [W]
    acceleration: Scalar | None  # of the motor behind an elastic gear [rad/s²]
    change: dict[str, Scalar]  # d/dt of `JointStates`
    rates: dict[str, Scalar]  # [1/s] their parts that are linear in themselves
    switching: list[SwitchingFunction]  # where all this bends
    known: Loads | Scalar | None  # load of its friction, where that is known [N m | N]


@dataclass(frozen=True, eq=False)
class SwitchingFunction:
    """A value that changes its sign where the derivative bends."""

    value: Scalar  # the push of a contact [N m | N], or a speed at which friction turns round [rad/s | m/s]
    least: Scalar = 0.0  # from a to b it changes where a b < -least²: what hovers about 0 does not


def sticks_on_motor(body: Body, brakes: bool) -> bool:
    """True if something of a joint holds its motor at rest: dry friction on its side, a lossy gear, a rigid brake if it acts."""
    return holds_by_loss(body) or _sticks(body, brakes, on_motor=True)


def sticks_on_joint(body: Body, brakes: bool) -> bool:
    """True if something of a joint holds the joint itself at rest."""
    return _sticks(body, brakes, on_motor=False)


def _sticks(body: Body, brakes: bool, *, on_motor: bool) -> bool:
    """True if friction on that side sticks, or a rigid brake there."""
    friction, brake = body.friction, body.brake if brakes else None
    return (friction is not None and friction.on_motor == on_motor and friction.sticks) or (
        brake is not None and brake.is_rigid and brake.on_motor == on_motor
    )


def contact_depths(body: Body, at: DriveMotion) -> list[Scalar]:
    """Depths [rad | m] in the joint's stops, upper and lower, and of its gear's flanks, forward and back."""
    depths: list[Scalar] = []
    if body.stops is not None:
        depths += stop_depths(*body.limits.position, at.q)
    if body.elasticity is not None and body.elasticity.backlash is not None:
        deflection, _ = bent(body.elasticity, body.drive.gear_ratio, at.motor, at.link)
        depths += flank_depths(deflection, body.elasticity.backlash)
    return depths


def contact_names(body: Body) -> list[str]:
    """Names of the contacts of `contact_depths`, in its order."""
    names = [] if body.stops is None else ["its upper stop", "its lower stop"]
    play = body.elasticity is not None and body.elasticity.backlash is not None
    return names + ["the flanks of its gear that push forward", "the flanks of its gear that push back"] * play


def driven_joint(
    body: Body,
    states: JointStates,
    at: DriveMotion,
    u: Scalar,
    volts: Scalar | None,
    applied: Scalar | None,
    touching: Sequence[Scalar] | None = None,
    directions: tuple[Scalar, Scalar] | None = None,
    external: Scalar = 0.0,
    enabled: Scalar | None = None,
) -> DrivenJoint:
    """All that one joint's drive does in a state.

    Args:
        body: the joint.   states: of its drive.   at: where it is.   u: its command.
        volts: of the bus [V]; None: the supply never sags.   applied: 1 where its brake is applied; None: it has none.
        touching: 1 for each of `contact_depths` that counts as a contact; None: where it is not below 0.
        directions: in which joint and motor move where these stick, 1, -1 or 0; None: nothing sticks.
        enabled: 1 where its servo is on; None: it is.
        external: torque on the joint of all but its drive that depends on the state alone [N m | N], for friction `by_loads`.
    """
    if touching is None:
        touching = [scalar.less_equal(0.0, depth) for depth in contact_depths(body, at)]
    of_stops = 0 if body.stops is None else 2
    switching: list[SwitchingFunction] = []
    change: dict[str, Scalar] = {}
    rates: dict[str, Scalar] = {}
    winding = _winding(body, states, at.motor_speed, u, volts, enabled)
    if winding.change is not None:
        change["current"], rates["current"] = winding.change, winding.rate
    torque, ratio = winding.torque, body.drive.gear_ratio
    if body.drive.cogging is not None:
        torque = torque + ratio * cogging_torque(body.drive.cogging, ratio * at.motor)
    loss, spring = 0.0, None
    warming = _warming(body, states, winding.heat, change)
    if body.elasticity is not None:
        flanks = (touching[-2], touching[-1]) if len(touching) > of_stops else None
        spring = transmitted(body.elasticity, ratio, at.motor, at.motor_speed, at.link, at.link_speed, flanks)
        loss, switching = loss + spring.loss, [*switching, *_contact_forces(spring.pushes, touching[of_stops:])]
    turning = None if directions is None else directions[1]
    of_gear = gear_loss(body.drive, at.motor_speed, None if _load_is_known(body) else body.friction, turning)
    load = leaving = entering = torque
    if spring is not None:
        leaving = spring.slope * spring.torque
        entering = leaving if of_gear is None else of_gear.input(leaving)
        load = entering if body.friction is not None and body.friction.on_motor else spring.torque
    stop = None
    if body.stops is not None:
        stop = stopped(body.stops, *body.limits.position, at.q, at.qd, (touching[0], touching[1]))
        external = external + stop.torque
    known: Loads | Scalar | None = load if _load_is_known(body) else None
    if body.friction is not None and LAWS[body.friction.law].by_loads:
        on_motor = spring is not None and body.friction.on_motor
        known = (torque, -entering) if on_motor else (torque if spring is None else spring.torque, external)
    before, behind, rubbed = _friction(body, states, at, known, warming, change, rates, directions)
    link_friction, loss = behind, loss + rubbed
    if body.friction is not None and has_corner(body.friction):
        switching.append(_turning(body, at.motor_speed if body.friction.on_motor else at.qd))
    if applied is not None:
        assert body.brake is not None
        speed = at.motor_speed if body.brake.on_motor else at.qd
        braking = _braking(body.brake, states, speed, applied, change, rates, directions)
        if not body.brake.is_rigid:
            switching.append(_turning(body, speed))
        loss = loss + braking * speed
        if body.brake.on_motor:
            before = before + braking
        else:
            behind = behind + braking
    if stop is not None:
        behind, loss = behind - stop.torque, loss + stop.loss
        switching += _contact_forces(stop.pushes, touching)
    acceleration, gear = None, torque - before
    if spring is not None:
        acceleration = ratio * (gear - entering) / body.drive.reflected
        if directions is not None and sticks_on_motor(body, applied is not None):
            acceleration = scalar.where(scalar.equal(directions[1], 0.0), 0.0, acceleration)
        if of_gear is not None:
            loss = loss + (entering - leaving) * at.motor_speed
        gear, of_gear = spring.torque, None
    return DrivenJoint(
        winding.torque, winding.voltage, winding.current, winding.power, winding.heat, gear, of_gear, behind, link_friction,
        loss, acceleration, change, rates, switching, known,
    )  # fmt: skip


def _contact_forces(pushes: Sequence[Scalar], touching: Sequence[Scalar]) -> list[SwitchingFunction]:
    """Pushes of the contacts there are; those of the others are 0 and stay so."""
    return [SwitchingFunction(touch * push) for push, touch in zip(pushes, touching, strict=False)]


def _turning(body: Body, speed: Scalar) -> SwitchingFunction:
    """A speed, and below which the joint stands."""
    return SwitchingFunction(speed, standing(None if body.friction is None else body.friction.smoothing))


def standing(smoothing: Scalar | None) -> Scalar:
    """Speed [rad/s | m/s] below which a joint stands, by the speed that its friction or gear loss is smoothed over."""
    return STANDING * (1.0 if smoothing is None else smoothing)


def _winding(
    body: Body, states: JointStates, speed: Scalar, u: Scalar, volts: Scalar | None, enabled: Scalar | None
) -> Winding:
    """Motor values for the command at the present temperature and supply."""
    check_command(body)
    supply, firmware = body.limits.voltage, body.drive.firmware
    if volts is not None:
        supply = scalar.minimum(supply, volts) if is_limit(supply) and firmware is None else volts
    if firmware is not None and states.servo is not None:
        u = within_drive(firmware, states.servo.output, supply)
        body = bridged(body)
    drive = body.drive
    if states.winding_temperature is not None:
        drive = warmed(drive, states.winding_temperature, states.housing_temperature)
    winding = driven_winding(body, drive, speed, u, supply, states.current, volts)
    return winding if enabled is None else switched(drive, winding, enabled, speed)


def followed_command(body: Body, states: JointStates, speed: Scalar, u: Scalar, volts: Scalar | None) -> Scalar:
    """Command that a drive follows at this speed, as a drive would report it whose current were there at once.

    Args:
        body: the joint, no servo.   states: of its drive.   speed: of the motor, referred to the joint [rad/s | m/s].
        u: [V | A | N m | N].   volts: of the bus [V]; None: the supply never sags.
    Returns:
        followed: u within limits and supply, in its unit; a torque by the constant of the record, as the drive takes it.
    """
    winding = _winding(body, replace(states, current=None), speed, u, volts, None)
    if body.drive.command == "voltage":
        return command_for(winding.voltage, body.drive.dead_zone)
    return winding.current if body.drive.command == "current" else joint_constant(body.drive) * winding.current


def _warming(body: Body, states: JointStates, heat: Scalar | None, change: dict[str, Scalar]) -> Scalar | None:
    """Puts down how the motor's temperatures change; by how much it is warmer than its reference [K]."""
    thermal, winding, housing = body.drive.thermal, states.winding_temperature, states.housing_temperature
    if thermal is None:
        return None
    assert winding is not None
    change["winding_temperature"], rate = warming_rates(thermal, heat, winding, housing)
    if housing is not None:
        change["housing_temperature"] = rate
    return (winding if housing is None else housing) - thermal.reference


def _load_is_known(body: Body) -> bool:
    """True if the torque through a gear is known before accelerations are: of springs, and for bristles that of the motor."""
    return body.elasticity is not None or (body.friction is not None and body.friction.has_bristles)


def _friction(
    body: Body, states: JointStates, at: DriveMotion, load: Loads | Scalar | None, warming: Scalar | None,
    change: dict[str, Scalar], rates: dict[str, Scalar], directions: tuple[Scalar, Scalar] | None,
) -> tuple[Scalar, Scalar, Scalar]:  # fmt: skip
    """Friction torque before the gear's spring and behind it [N m | N], and its power [W]."""
    friction = body.friction
    if friction is None:
        return 0.0, 0.0, 0.0
    speed = at.motor_speed if friction.on_motor else at.qd
    if friction.sticks and directions is not None:
        torque = sliding_friction(friction, speed, directions[friction.on_motor], load, warming)
    elif not friction.has_bristles:
        torque = joint_friction(friction, speed, load, warming)
    else:
        bent = bristle_friction(friction, speed, states.bristle, load, warming)
        torque, change["bristle"], rates["bristle"] = bent.torque, bent.speed, bent.rate
    return (torque, 0.0, torque * speed) if friction.on_motor else (0.0, torque, torque * speed)


def _braking(
    brake: Brake, states: JointStates, speed: Scalar, applied: Scalar, change: dict[str, Scalar], rates: dict[str, Scalar],
    directions: tuple[Scalar, Scalar] | None,
) -> Scalar:  # fmt: skip
    """Torque of a brake [N m | N] at the speed of its side."""
    if brake.is_rigid:
        return applied * brake.holding * (scalar.sign(speed) if directions is None else directions[brake.on_motor])
    held = holding(brake, speed, states.brake, applied)
    change["brake"], rates["brake"] = held.speed, held.rate
    return held.torque


def at_rest(model: Model, q: Array, qd: Array, motor: Array, motor_speed: Array) -> dict[str, Any]:
    """For every part of a plant's state the values to begin with, one per joint; all arguments (n,), `motor` as θ_motor / n."""
    ratios = [body.drive.gear_ratio for body in model.coordinates]

    def bent(i: int, body: Body) -> Array:
        if body.friction is None or not body.friction.has_bristles:
            return 0.0
        return sliding(body.friction, motor_speed[i] if body.friction.on_motor else qd[i])

    ambient = [0.0 if body.drive.thermal is None else body.drive.thermal.ambient for body in model.coordinates]
    nothing = [0.0] * model.n
    return {
        "q": q,
        "qd": qd,
        "motor_q": [n * value for n, value in zip(ratios, motor, strict=True)],
        "motor_qd": [n * value for n, value in zip(ratios, motor_speed, strict=True)],
        "current": nothing,
        "bristle": [bent(i, body) for i, body in enumerate(model.coordinates)],
        "brake": nothing,
        "winding_temperature": ambient,
        "housing_temperature": ambient,
        "goal": q,
        **dict.fromkeys(("goal_speed", "goal_error", "goal_integral", *OUTPUTS), nothing),
        **{f"{WAITING}{k}": nothing for k in range(1, MOST_LATENCY + 1)},
        "bus_voltage": [0.0 if model.supply is None else model.supply.voltage],
    }

"""Plants with the energies that go each way as four more states, moved by the same stages in the compiled loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.actuators.cogging import cogging_energy
from armwright.actuators.elasticity import transmitted
from armwright.actuators.stops import stopped
from armwright.dynamics import energy
from armwright.dynamics.gears import without_rotors
from armwright.kernels.loop import NativeLoop
from armwright.kernels.stages import Integrate
from armwright.kernels.target import select_target
from armwright.kinematics import jacobian
from armwright.model import Body, Model
from armwright.program import trace
from armwright.signals import Layout
from armwright.simulation.integrate.exponential import Split
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.integrate.step_control import Allowed
from armwright.simulation.integrate.stepping import Adaptivity, adaptive_stage, dormand_prince_trial, speed_pairs
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.joint_drive import DriveMotion, JointStates
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.switching import Watched, switching_programs

WAYS = ("electrical", "heat", "friction", "mechanical")


def energy_rates(plant: Plant, x: Any, inputs: Any) -> dict[str, Any]:
    """Powers [W]; what comes in is  electrical = heat + friction + mechanical + d/dt `stored_energy`.

    Electrical comes out of the supply's source, or goes into the drives where it is not told; heat is that of windings, source
    and braking resistor; friction all that rubs, dampens or slips, bent bristles included; mechanical goes into the environment.
    """
    inputs = PlantInputs.of(inputs)
    flow, wrench, n = plant._flow(x, inputs), inputs.wrench, plant.model.n
    heat = sum(joint.heat for joint in flow.joints if joint.heat is not None)
    power = sum(joint.power for joint in flow.joints)
    mechanical: Any = 0.0
    if wrench is not None:
        mechanical = -(wrench @ (jacobian(plant.model, x[:n]) @ x[n : 2 * n]))
    if flow.fed is not None:
        power, heat = flow.fed.source, heat + flow.fed.loss
    friction = sum(joint.loss for joint in flow.joints) + sum(plant._followers_loss(x))
    return dict(zip(WAYS, (power, heat, friction, mechanical), strict=True))


def stored_energy(plant: Plant, x: Any) -> Any:
    """Energy [J] that the plant can give back: motion, height, springs, magnets, windings' fields, the bus capacitor."""
    n, model = plant.model.n, plant.model
    total = sum(energy(without_rotors(model, model.names), x[:n], x[n : 2 * n]))
    motions = plant.motions(x)
    for i, body in enumerate(model.coordinates):
        total = total + _of_drive(body, plant._states(x, i), motions[i])
    if model.supply is not None:
        volts = plant.part(x, "bus_voltage")[0]
        total = total + 0.5 * model.supply.capacitance * volts * volts
    return total


def _of_drive(body: Body, states: JointStates, at: DriveMotion) -> Any:
    """Energy [J] in a joint's drive: the rotor's motion, field, springs of gear and stops, magnets."""
    drive = body.drive
    total = 0.5 * drive.reflected * at.motor_speed * at.motor_speed
    if states.current is not None:
        assert drive.inductance is not None
        total = total + 0.5 * drive.inductance * states.current * states.current
    if drive.cogging is not None:
        total = total + cogging_energy(drive.cogging, drive.gear_ratio * at.motor)
    if body.elasticity is not None:
        spring = transmitted(body.elasticity, drive.gear_ratio, at.motor, at.motor_speed, at.link, at.link_speed)
        total = total + spring.energy
    if body.stops is not None:
        total = total + stopped(body.stops, *body.limits.position, at.q, at.qd).energy
    return total


class Balance:
    """The power balance of an arm under constant commands.

    Args:
        arm: the model.   rule: a name of `INTEGRATORS`, or rk45 with that `tolerance`.
        landing: whether steps end where contacts switch; False to see that it matters.
    """

    def __init__(self, arm: Model, rule: str = "rk3", *, tolerance: float | None = None, landing: bool = True):
        self.plant = plant = Plant.of(arm)
        size, n = plant.size, arm.n
        shapes = {"x": (size + len(WAYS),), "u": (n,)}

        def slopes(y: Any, u: Any, touching: Any = None) -> tuple[Any, Any]:
            inputs = PlantInputs(u, contacts=touching)
            rates = energy_rates(plant, y[:size], inputs)
            xd, fast = plant.split(y[:size], inputs)
            return scalar.array([*xd, *(rates[way] for way in WAYS)]), fast

        contacts = sum(plant.contacts)
        watched = Watched(
            lambda y, u: plant.contact_depths(y[:size]),
            lambda y, u, touching: plant.switching_functions(y[:size], PlantInputs(u, contacts=touching)),
            contacts,
        )
        held = watched.block if contacts else {}

        def step(y: Any, u: Any, *rest: Any) -> Any:
            *touching, h = rest
            chosen = INTEGRATORS[rule].paired(speed_pairs(plant.layout))
            if not plant.stiff:
                return chosen.step(lambda y, u: slopes(y, u, *touching)[0], y, u, h)
            touched = touching[0] if touching else None
            fast = lambda y, u: plant.fast(y[:size], PlantInputs(u, contacts=touched))  # noqa: E731
            moved = chosen.exponential(Split(lambda y, u: slopes(y, u, *touching), fast, plant.stiff), y, u, h)
            return scalar.array([*plant.settled(moved[:size]), *moved[size:]])

        if tolerance is not None:
            adaptivity, switching = (
                Adaptivity(Allowed(tolerance, 0.1 * tolerance), 10**5),
                watched if contacts else None,
            )
            derivative = lambda *given: slopes(*given)[0]  # noqa: E731
            trial = dormand_prince_trial(derivative, {**shapes, **held})
            stage = adaptive_stage(trial, shapes, adaptivity, Layout(), watched=switching)
        elif landing:
            landing_programs = switching_programs(watched if contacts else None, shapes)
            stage = Integrate(trace("step", step, {**shapes, **held, "h": ()}, ("x_next",)), **landing_programs)
        else:
            stage = Integrate(trace("step", lambda y, u, h: step(y, u, h), {**shapes, "h": ()}, ("x_next",)))
        self.loop = NativeLoop((stage,), select_target())

    def moved(self, begun: np.ndarray, u: np.ndarray, h: float, ticks: int = 1) -> tuple[np.ndarray, dict[str, float]]:
        """The last state, and the energies [J] that went each way, from a state under commands (rows, n), each so many ticks."""
        lanes, size = self.loop.lanes(1), self.plant.size
        lanes.set("x", np.concatenate([begun, np.zeros(len(WAYS))]))
        for row in u:
            lanes.set("u", row)
            self.loop.run(lanes, h, (0, ticks))
        assert lanes.get("frozen")[0, 0] < 0.0
        y = lanes.get("x")[0]
        return y[:size], dict(zip(WAYS, y[size:], strict=True))

    def lack(self, q: Any, qd: Any, u: Any, h: float, duration: float) -> float:
        """The energy that the balance lacks, as a share of the largest that went any way."""
        begun = self.plant.initial(q, qd)
        return self.lacking(begun, *self.moved(begun, np.array([u], dtype=float), h, round(duration / h)))

    def lacking(self, begun: np.ndarray, last: np.ndarray, went: dict[str, float]) -> float:
        """The same, from the states at both ends and what went each way."""
        stored = float(stored_energy(self.plant, last)) - float(stored_energy(self.plant, begun))
        lack = went["electrical"] - went["heat"] - went["friction"] - went["mechanical"] - stored
        return abs(lack) / max(abs(value) for value in went.values())

"""Outputs of a plant in a state: signals, values of exact sensors, motor quantities, powers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armwright import scalar
from armwright.actuators import friction_torques
from armwright.actuators.coupling import to_joints, to_motors
from armwright.scalar import Array, Scalar
from armwright.simulation.plant.flow import Flow, PlantFlow
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.state import SHOWN, has_effect


@dataclass(frozen=True, eq=False)
class PlantOutputs(PlantFlow):
    """A plant's outputs in a state."""

    @cached_property
    def is_plain(self) -> bool:
        """True if the drives have neither states nor effects: then q, q̇, torque, voltage and current say all."""
        return len(self.layout.signals) == 2 and not any(has_effect(body) for body in self.model.coordinates)

    def outputs(self, x: Array, inputs: PlantInputs | Array) -> dict[str, np.ndarray]:
        """Signals beside the state, each (n,) except the bus; NaN for joints whose record lacks the numbers for one.

        Args:
            x: (size,).   inputs: as `derivative`.
        Returns:
            qdd [rad/s² | m/s²], tau: n Kt i of each motor, referred to its joint [N m | N], voltage [V] averaged over the PWM,
            current [A].
            tau_link [N m | N]: what leaves the gear, as a torque sensor reads it; friction of rigid gears before it,
            behind an elastic one the joint's own friction, brake and stops behind it.
            heat [W] of the windings, friction_loss [W] of all that rubs or dampens, electrical_power [W] into the drives.
            motor_q [rad], motor_qd [rad/s], bristle, brake [rad | m], winding_temperature, housing_temperature [°C],
            goal [rad], duty, goal_current [A] of servos, bus_voltage [V]: where they are states.
        """
        model = self.model
        flow = self._flow(x, PlantInputs.of(inputs))
        joints, gear = flow.joints, self._link_torques(flow)
        rows = {
            "qdd": flow.qdd,
            "tau": [joint.tau for joint in joints],
            "voltage": [joint.voltage for joint in joints],
            "current": [joint.current for joint in joints],
            "tau_link": gear,
            "heat": [np.nan if joint.heat is None else joint.heat for joint in joints],
            "friction_loss": [joint.loss + loss for joint, loss in zip(joints, self._followers_loss(x), strict=True)],
            "electrical_power": [joint.power for joint in joints],
        }
        for name in SHOWN:
            if name in self.layout:
                values = dict(zip(self.layout[name].joints or (), self.part(x, name), strict=True))
                rows[name] = [values.get(i, np.nan) for i in range(model.n)]
        if "bus_voltage" in self.layout:
            rows["bus_voltage"] = self.part(self.settled(x), "bus_voltage")
        return {name: scalar.array(list(values)) for name, values in rows.items()}

    def _link_torques(self, flow: Flow) -> Array:
        """Torques (n,) that leave the gears, on the joint side."""
        wd, leaves, friction = to_motors(self.shares, flow.qdd), [], []
        for i, (joint, body) in enumerate(zip(flow.joints, self.model.coordinates, strict=True)):
            if body.elasticity is not None:
                leaves, friction = [*leaves, joint.gear], [*friction, 0.0]
                continue
            entering = joint.gear - body.drive.reflected * wd[i]
            leaves.append(entering if joint.gear_loss is None else joint.gear_loss.output(entering))
            friction.append(joint.friction)
        torques = to_joints(self.shares, leaves) - scalar.array(friction)
        if flow.holding is None:
            return torques
        bodies = self.model.coordinates  # what holds a joint behind an elastic gear acts after the gear
        held = [hold if body.elasticity is None else 0.0 for body, hold in zip(bodies, flow.holding, strict=True)]
        return torques + scalar.array(held)

    def _followers_loss(self, x: Array) -> list[Scalar]:
        """Power [W] that rubs in the joints that follow each coordinate."""
        n = self.model.n
        if self.model.mimics is None:
            return [0.0] * n
        qd = x[n : 2 * n]
        return list(friction_torques(self._followers, qd) * qd)

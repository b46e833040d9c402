"""View of the plant at one instant: all quantities that a sensor may measure, computed on access."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from armwright.actuators.coupling import from_motors
from armwright.kinematics import forward_kinematics, jacobian
from armwright.model import Model
from armwright.scalar import Array
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant


class PlantView:
    """The plant at the instant of a measurement, without any sensor's faults; numbers, or symbols in a trace.

    Attributes:
        arm: the model, with the lane's own parameters.   period: [s] between measurements.
        outputs: qdd, tau, tau_link, voltage, heat, temperatures … by name, as `Plant.outputs` gives them.
    """

    def __init__(self, plant: Plant, x: Array, inputs: PlantInputs, period: float):
        self._plant, self._x, self._inputs, self.period = plant, x, inputs, period

    @property
    def arm(self) -> Model:
        """The model, with the lane's own parameters."""
        return self._plant.model

    @cached_property
    def q(self) -> Array:
        """(n,) joint positions [rad | m]."""
        return self._plant.part(self._x, "q")

    @cached_property
    def qd(self) -> Array:
        """(n,) joint velocities [rad/s | m/s]."""
        return self._plant.part(self._x, "qd")

    @cached_property
    def motor_q(self) -> Array:
        """(n,) positions of the motors, referred to their joints: θ_motor / n [rad | m]."""
        return self._motors[0]

    @cached_property
    def motor_qd(self) -> Array:
        """(n,) velocities of the motors, referred to their joints [rad/s | m/s]."""
        return self._motors[1]

    @cached_property
    def current(self) -> Array:
        """(n,) [A], NaN where the record cannot say it."""
        return self._plant.measured(self._x, self._inputs, "link")[2]

    @cached_property
    def wrench(self) -> Array:
        """(6,) [N, N m] of the environment on the tip, in base axes; zeros without one."""
        return np.zeros(6) if self._inputs.wrench is None else self._inputs.wrench

    @cached_property
    def outputs(self) -> dict[str, np.ndarray]:
        """Outputs of the plant's drives and joints, by name: qdd, tau, tau_link, voltage, heat, …"""
        return self._plant.outputs(self._x, self._inputs)

    def pose(self, frame: str | None = None) -> np.ndarray:
        """(4, 4) pose of a frame in the base; default: the tip."""
        return forward_kinematics(self.arm, self.q, frame)

    def jacobian(self, frame: str | None = None) -> np.ndarray:
        """(6, n) Jacobian of a frame, linear rows first, in base axes; default: the tip."""
        return jacobian(self.arm, self.q, frame)

    def joints_of_motors(self, motors: Array) -> Array:
        """(n,) positions or velocities of the joints from those of the motors, which coupled joints share."""
        return from_motors(self._plant.shares, motors)

    @cached_property
    def _motors(self) -> tuple[Array, Array]:
        return self._plant.measured(self._x, self._inputs, "motor")[:2]

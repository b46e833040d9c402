"""Slopes of a plant by its state, for linearly implicit rules, from the torques that its joints lack at given accelerations."""

from __future__ import annotations

import numpy as np

from armwright import scalar
from armwright.dynamics import mass_matrix
from armwright.dynamics.gears import linearised
from armwright.dynamics.inverse import newton_euler
from armwright.scalar import Array
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant


def plant_slopes(plant: Plant, x: Array, inputs: PlantInputs) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """dx/dt, and A, E with  ∂(dx/dt)/∂x = E⁻¹ A:  exact, and without the inverse of the mass matrix.  [GriewankWalther2008]

    With b(x, q̈) the torques on the joints less those that the links need, 0 at the plant's own q̈, E holds the mass matrix
    -∂b/∂q̈ = M + Σ Bᵢᵀ Gᵢ' D Bᵢ in the rows of q̇, and A holds ∂b/∂x there, at that q̈. All other rows of E are those of the
    unit matrix. Newton and Euler's recursion is differentiated by a nudge of each joint (`dynamics.derivatives`).

    Args:
        plant: an arm with its drives.   x: (size,).   inputs: as `Plant.derivative`; of an arm that sticks with its directions.
    Returns:
        xd: (size,).   slope: A (size, size).   mass: E (size, size).
    Raises:
        ScenarioError: motors that several joints turn stick by themselves.
    """
    n, size = plant.model.n, plant.size
    xd = plant.derivative(x, inputs)
    q, qdd = x[:n], xd[n : 2 * n]

    def rates(moved: np.ndarray) -> np.ndarray:
        """q̇, lacking torques and the other rates, for nudges (n,) of the links and a state (size,) of the drives."""
        nudge, at = moved[:n], moved[n:]
        loads, qd = plant.loads(at, inputs), at[n : 2 * n]
        torque = loads.driven - loads.resisting - newton_euler(loads.links, q, qd, qdd, inputs.wrench, nudge)
        for gear in loads.gears:
            leaving = gear.loss.output(gear.entering(qdd))
            for j, share in gear.row:
                torque[j] = torque[j] + share * leaving
        return np.concatenate([qd, torque, plant.drive_rates(at, inputs)])

    slope = scalar.jacobian(rates, np.concatenate([scalar.zeros(n), x]))
    by_state = np.array(slope[:, n:], dtype=object)
    by_state[:, :n] = by_state[:, :n] + slope[:, :n]
    loads, mass = plant.loads(x, inputs), scalar.eye(size)
    mass[n : 2 * n, n : 2 * n] = linearised(mass_matrix(loads.links, q), scalar.zeros(n), loads.gears, qdd)[0]
    if plant.sticking is not None:
        for k, stuck in plant.sticking.stuck(inputs):  # K = 0 in its row, whatever the others do
            by_state[k] = scalar.where(stuck, 0.0, by_state[k])
            row = scalar.where(stuck, 0.0, mass[k])
            row[k] = scalar.where(stuck, 1.0, mass[k, k])
            mass[k], mass[:, k] = row, row
    return xd, scalar.array(by_state), scalar.array(mass)

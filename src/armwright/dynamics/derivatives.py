"""Derivatives of inverse and forward dynamics by the state, exact to rounding. [GriewankWalther2008] [CarpentierMansard2018]

Of short arms, Newton and Euler's recursion is differentiated as it stands. A joint is moved by a first-order turn behind its own
(`JointMotion`), so that derivatives by q need no derivatives of sine and cosine. Of long arms, from a chain of 10 joints on
(`one_frame.slopes_pay`), the links' part comes from `one_frame.link_slopes`, which takes fewer operations a pair of joints; the
rest (motors, gears, friction, springs, the wrench) is differentiated automatically still. Arms whose friction depends on loads
need the slopes of other torques as well, and keep the automatic ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from armwright import scalar
from armwright.actuators.friction import by_loads, link_friction
from armwright.actuators.gear import loses_power
from armwright.dynamics.gears import joint_torques, motor_torques, motors, through_gears
from armwright.dynamics.inverse import external_torques, inverse_torques, newton_euler, torques_of_links
from armwright.dynamics.mass_matrix import mass_matrix
from armwright.dynamics.one_frame import link_slopes, slopes_pay
from armwright.model import Model, one_state_with_masses
from armwright.scalar import Array, Factored


@one_state_with_masses
def inverse_dynamics_derivatives(
    arm: Model, q: Array, qd: Array, qdd: Array, wrench: Array | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of `inverse_dynamics`:  ∂tau/∂q, ∂tau/∂q̇ and ∂tau/∂q̈.  [GriewankWalther2008]

    ∂tau/∂q̈ is M without gear loss and friction by loads.

    Friction and gear loss are in them. Where a slope jumps as a joint turns back (lossy gears, unequal Coulomb friction), at
    rest it is that for motion in the positive direction. Without a smoothing speed they jump themselves: at rest they count 0,
    and the slopes are those beside the jump.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].   qdd: (n,) [rad/s² | m/s²].
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes; it is held.
    Returns:
        dtau_dq: (n, n) row torque, column q; [N m/rad | N m/m, N/rad | N/m].
        dtau_dqd: (n, n) [N m s/rad | N m s/m, N s/rad | N s/m].
        dtau_dqdd: (n, n) [kg m² | kg m | kg]; `mass_matrix` without gear loss, coupled motors and friction by loads.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> q, qd, qdd = [0.3, 0.5], [1.0, -0.5], [0.0, 2.0]
        >>> by_q, by_qd = aw.inverse_dynamics_derivatives(arm, q, qd, qdd)[:2]
        >>> by_q.round(3)
        array([[-31.553, -11.741],
               [-11.26 ,  -9.855]])
    """
    n = arm.n

    def torques(x: np.ndarray) -> np.ndarray:
        return inverse_torques(arm, q, x[n : 2 * n], x[2 * n :], wrench, nudge=x[:n])

    def motors_torques(x: np.ndarray) -> np.ndarray:
        needed = x[3 * n :] + torques_of_links(weightless(arm), q, x[n : 2 * n], x[2 * n : 3 * n], wrench, nudge=x[:n])
        return motor_torques(arm, x[n : 2 * n], x[2 * n : 3 * n], needed)

    state = np.concatenate([scalar.zeros(n), qd, qdd])
    if is_analytic(arm):
        of_links, *slopes = slopes_of_links(arm, q, qd, qdd)
        slope = scalar.jacobian(motors_torques, np.concatenate([state, of_links]))
        slope = slope[:, : 3 * n] + _chained(slope[:, 3 * n :], np.concatenate(slopes, axis=1))
    else:
        slope = scalar.jacobian(torques, state)
    by_qdd = slope[:, 2 * n :]
    if not any(loses_power(body) or body.drive.coupling or by_loads(body) for body in arm.coordinates):
        by_qdd = scalar.array([[by_qdd[min(i, j), max(i, j)] for j in range(n)] for i in range(n)])
    return slope[:, :n], slope[:, n : 2 * n], by_qdd


@one_state_with_masses
def forward_dynamics_derivatives(
    arm: Model, q: Array, qd: Array, tau: Array, wrench: Array | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of `forward_dynamics`:  ∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂tau.  [CarpentierMansard2018]

    ∂q̈/∂tau is M⁻¹ without gear loss and friction by loads.

    Of the equation that `forward_dynamics` solves, at its solution: one factorisation serves all. Friction and gear loss are in
    them. Where a slope jumps as a joint turns back, at rest it is that for motion in the positive direction; without a
    smoothing speed dry friction and gear loss count 0 at rest, and the slopes are those beside their jump.

    Args:
        arm: the model.   q: (n,) [rad | m].   qd: (n,) [rad/s | m/s].
        tau: (n,) [N m | N] motor torque referred to the joints, before rotor, gear loss and friction.
        wrench: (6,) [N, N m] force and moment of the environment on the arm at the tip, in base axes; it is held.
    Returns:
        dqdd_dq: (n, n) row acceleration, column q; [1/s² | rad/(m s²), m/(rad s²) | 1/s²].
        dqdd_dqd: (n, n) [1/s | rad/(m s), m/(rad s) | 1/s].
        dqdd_dtau: (n, n) [1/(kg m²) | 1/(kg m) | 1/kg]. None is finite where M is singular.
    Raises:
        ModelError: a wrench on an arm that branches and names no tip.
    Example:
        >>> arm = aw.load("two-link")
        >>> q, qd, tau = [0.3, 0.5], [1.0, -0.5], [20.0, 5.0]
        >>> by_q, by_qd, by_tau = aw.forward_dynamics_derivatives(arm, q, qd, tau)
        >>> by_tau.round(4)  # the inverse of the mass matrix
        array([[ 0.271 , -0.7171],
               [-0.7171,  3.0689]])
    """
    return driven_derivatives(arm, q, qd, tau, lambda qd, tau: tau, wrench)


def driven_derivatives(
    arm: Model, q: Array, qd: Array, u: Array, torque: Callable[[Array, Array], Array], wrench: Array | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂u (n, n) for commands u (n,) of which motors make  torque(q̇, u)."""
    n = arm.n
    qdd, factors = _solved(arm, q, qd, torque(qd, u), wrench)

    def missing(x: np.ndarray) -> np.ndarray:
        """Torques that the joints get beyond those that they need at that q̈."""
        speeds, commands = x[n : 2 * n], x[2 * n :]
        external = external_torques(arm, q, speeds, wrench, nudge=x[:n])
        driven = joint_torques(arm, speeds, qdd, torque(speeds, commands), external)
        return driven - torques_of_links(massive, q, speeds, qdd, wrench, nudge=x[:n])

    massive = weightless(arm) if is_analytic(arm) else arm
    slope = scalar.jacobian(missing, np.concatenate([scalar.zeros(n), qd, u]))
    if is_analytic(arm):
        _, *slopes, _ = slopes_of_links(arm, q, qd, qdd)
        slope = np.concatenate([slope[:, : 2 * n] - np.concatenate(slopes, axis=1), slope[:, 2 * n :]], axis=1)
    by_state = scalar.solve_factored(factors, slope[:, : 2 * n])
    by_u = scalar.inverse_factored(factors) @ slope[:, 2 * n :]
    return by_state[:, :n], by_state[:, n:], scalar.array(by_u)


def _solved(arm: Model, q: Array, qd: Array, tau: Array, wrench: Array | None) -> tuple[np.ndarray, Factored]:
    """The accelerations, and the factors of M_links + Bᵀ diag(G') D B."""
    arm, driven, gears = motors(arm, qd, tau, external_torques(arm, q, qd, wrench))
    bias = newton_euler(arm, q, qd, scalar.zeros(arm.n), wrench) + link_friction(arm, qd)
    if gears:
        return through_gears(mass_matrix(arm, q), bias - driven, gears)
    factors = scalar.factor_symmetric(mass_matrix(arm, q))
    return scalar.solve_factored(factors, driven - bias), factors


def is_analytic(arm: Model) -> bool:
    """True if the links' part of the derivatives comes from `one_frame.link_slopes`."""
    return slopes_pay(arm) and not any(map(by_loads, arm.coordinates))


def slopes_of_links(arm: Model, q: Array, qd: Array, qdd: Array) -> list[np.ndarray]:
    """`one_frame.link_slopes` of an arm, by its coordinates:  tau (n,), and Gᵀ (∂tau_all/∂x_all) G  for x = q, q̇, q̈."""
    mimics = arm.mimics
    if mimics is None:
        return list(link_slopes(arm, q, qd, qdd))
    tau, *slopes = link_slopes(arm.tree, mimics.positions(q), mimics.rates(qd), mimics.rates(qdd))
    return [mimics.torques(tau), *(mimics.columns(mimics.torques(slope)) for slope in slopes)]


def weightless(arm: Model) -> Model:
    """The arm with links without mass: its joints then need torques for springs, friction, rotors of followers and the wrench."""
    still = {"mass": 0.0, "first_moment": scalar.zeros(3), "inertia": scalar.zeros(3, 3)}
    return replace(arm, gravity=scalar.zeros(3), bodies=tuple(replace(body, **still) for body in arm.bodies))


def _chained(outer: Array, inner: Array) -> Array:
    """outer (n, n) @ inner (n, m), the few entries of outer that are not 0 one by one."""
    rows = []
    for row in outer:
        terms = [entry * inner[k] for k, entry in enumerate(row) if scalar.is_symbolic(entry) or entry != 0.0]
        rows.append(sum(terms[1:], terms[0]))
    return scalar.array(rows)

# Made by tools/kernel_stub.py from the table in signatures.py; do not edit.
"""KernelMethods: a method for every kernel of the table, with signature and docstring."""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armwright.kernels.signatures import Signature

Real = TypeVar("Real", bound=np.floating)
OPTIONS: dict[str, str]

class KernelMethod:
    """A method that an arm may have as a native function, from its first use on."""

    function: Callable[..., Any]
    form: str
    def __init__(self, function: Callable[..., Any], form: str) -> None: ...
    def __get__(self, arm: Any, kind: Any = None) -> Callable[..., Any]: ...

def kernel_method(signature: Signature) -> KernelMethod:
    """The method of a row of the table."""

class KernelMethods(Generic[Real]):
    """Methods of `CompiledArm`, one for each kernel."""

    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        wrench: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
        *,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Motor torques that give acceleration `qdd` in state (q, qd).  [LuhWalkerPaul1980]

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            qdd: (…, n) [rad/s² | m/s²]
            wrench: (…, 6) [N, N m], optional
            out: where to write the result, of `dyn.dtype`.
        Returns:
            tau: (…, n) [N m | N]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> q, qd, qdd = [0.3, 0.5], [1.0, -0.5], [0.0, 2.0]
            >>> dyn.inverse_dynamics(q, qd, qdd).round(3)
            array([81.629, 13.409])
        """

    def forward_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        tau: ArrayLike,
        wrench: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
        *,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Accelerations that motor torques give, the exact inverse of `inverse_dynamics`.  [WalkerOrin1982] [Featherstone2008]

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            tau: (…, n) [N m | N]
            wrench: (…, 6) [N, N m], optional
            out: where to write the result, of `dyn.dtype`.
        Returns:
            qdd: (…, n) [rad/s² | m/s²]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> dyn.forward_dynamics([0.3, 0.5], [1.0, -0.5], [20.0, 5.0]).round(3)
            array([-10.674,  20.384])
        """

    def mass_matrix(
        self, q: ArrayLike, parameters: ArrayLike | None = None, *, out: NDArray[Real] | None = None
    ) -> NDArray[Real]:
        """M(q), rotors' inertia Nᵀ J_m N included, of coupled motors too:  kinetic energy = ½ q̇ᵀ M q̇.  [WalkerOrin1982]

        Args:
            q: (…, n) [rad | m]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            M: (…, n, n) [kg m² | kg m | kg]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> dyn.mass_matrix([0.3, 0.5]).round(3)
            array([[9.662, 2.257],
                   [2.257, 0.853]])
        """

    def bias_torques(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        wrench: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
        *,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Torques that no acceleration asks for, the report's bias vector, eq. (14):  h = C q̇ + g(q) + s(q) + f(q̇) - Jᵀ wrench.

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            wrench: (…, 6) [N, N m], optional
            out: where to write the result, of `dyn.dtype`.
        Returns:
            h: (…, n) [N m | N]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> dyn.bias_torques([0.3, 0.5], [1.0, -0.5]).round(3)
            array([77.114, 11.703])
        """

    def gravity_torques(
        self, q: ArrayLike, parameters: ArrayLike | None = None, *, out: NDArray[Real] | None = None
    ) -> NDArray[Real]:
        """Torques that hold the arm against gravity:  g(q) = ∂U/∂q, inverse dynamics at rest without friction and springs.

        Args:
            q: (…, n) [rad | m]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            g: (…, n) [N m | N]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> dyn.gravity_torques([0.0, 0.0]).round(3)  # stretched out level
            array([84.366, 15.696])
        """

    def spring_torques(
        self, q: ArrayLike, parameters: ArrayLike | None = None, *, out: NDArray[Real] | None = None
    ) -> NDArray[Real]:
        """Torques that hold the arm against its springs:  s(q) = ∂U/∂q,  U their energy; what the joints need beside g(q).

        Args:
            q: (…, n) [rad | m]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            s: (…, n) [N m | N]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> dyn.spring_torques([0.3, 0.5])  # this arm has no springs
            array([0., 0.])
        """

    def forward_kinematics(
        self,
        q: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        frame: str | None = None,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Pose of the tip or of another frame:  T = A_0^1 A_1^2 … A_{N-1}^N.  [DenavitHartenberg1955]

        Args:
            q: (…, n) [rad | m]
            frame: name of a frame of the arm; by default its tip.
            out: where to write the result, of `dyn.dtype`.
        Returns:
            T: (…, 4, 4) [- | m]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> dyn.forward_kinematics([0.3, 0.5])[:3, 3].round(3)  # where the tip is
            array([1.513, 0.869, 0.   ])
        """

    def jacobian(
        self,
        q: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        frame: str | None = None,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Geometric Jacobian of the tip or of another frame:  [v; ω] = J(q) q̇.  [Whitney1972]

        Args:
            q: (…, n) [rad | m]
            frame: name of a frame of the arm; by default its tip.
            out: where to write the result, of `dyn.dtype`.
        Returns:
            J: (…, 6, n) [m/rad | -, - | 1/m]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> (dyn.jacobian([0.3, 0.5])[:3] @ [1.0, -0.5]).round(3)  # speed of the tip
            array([-0.582,  1.234,  0.   ])
        """

    def motor_voltage(
        self, qd: ArrayLike, tau: ArrayLike, parameters: ArrayLike | None = None, *, out: NDArray[Real] | None = None
    ) -> NDArray[Real]:
        """Motor voltages for joint torques, eq. (11):  V = R tau / (n Kt) + n Ke q̇.

        Args:
            qd: (…, n) [rad/s | m/s]
            tau: (…, n) [N m | N]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            voltage: (…, n) [V]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("cmu-dd")
            >>> tau = dyn.gravity_torques([0.0, 0.35, 0.0, 0.6, 0.0, 0.4])
            >>> dyn.motor_voltage(np.zeros(6), tau).round(2)  # what holds the arm still
            array([ 0.  , 22.52, -2.31, 11.91, -1.92,  0.93])
        """

    def motor_torque(
        self,
        qd: ArrayLike,
        voltage: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Motor torques for voltages, eq. (12):  tau = n Kt (V - n Ke q̇) / R.

        Args:
            qd: (…, n) [rad/s | m/s]
            voltage: (…, n) [V]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            tau: (…, n) [N m | N]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("cmu-dd")
            >>> dyn.motor_torque(np.zeros(6), [8, 12, 8, 4, 2, 1]).round(2)
            array([15.27, 52.5 ,  7.27,  9.85,  0.81,  0.33])
        """

    def forward_arm(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        u: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """The report's Forward Arm: drive commands in, accelerations out.  tau by eq. (12), then `forward_dynamics`.

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            u: (…, n) [V | A | N m | N]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            qdd: (…, n) [rad/s² | m/s²]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("cmu-dd")
            >>> dyn.forward_arm(np.zeros(6), np.zeros(6), [8, 12, 8, 4, 2, 1]).round(2)
            array([ 10.01,   5.43,  29.46,  -5.61,  -1.26, -59.94])
        """

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        wrench: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
        *,
        out: tuple[NDArray[Real], NDArray[Real], NDArray[Real]] | None = None,
    ) -> tuple[NDArray[Real], NDArray[Real], NDArray[Real]]:
        """Derivatives of `inverse_dynamics`:  ∂tau/∂q, ∂tau/∂q̇ and ∂tau/∂q̈.  [GriewankWalther2008]

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            qdd: (…, n) [rad/s² | m/s²]
            wrench: (…, 6) [N, N m], optional
            out: tuple of arrays to write the results into, of `dyn.dtype`.
        Returns:
            dtau_dq: (…, n, n) [N m/rad | N m/m, N/rad | N/m]
            dtau_dqd: (…, n, n) [N m s/rad | N m s/m, N s/rad | N s/m]
            dtau_dqdd: (…, n, n) [kg m² | kg m | kg]
        Raises:
            ModelError: an arm of more than 30 joints, for which this is not offered.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> q, qd, qdd = [0.3, 0.5], [1.0, -0.5], [0.0, 2.0]
            >>> by_q, by_qd = dyn.inverse_dynamics_derivatives(q, qd, qdd)[:2]
            >>> by_q.round(3)
            array([[-31.553, -11.741],
                   [-11.26 ,  -9.855]])
        """

    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        tau: ArrayLike,
        wrench: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
        *,
        out: tuple[NDArray[Real], NDArray[Real], NDArray[Real]] | None = None,
    ) -> tuple[NDArray[Real], NDArray[Real], NDArray[Real]]:
        """Derivatives of `forward_dynamics`:  ∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂tau.  [CarpentierMansard2018]

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            tau: (…, n) [N m | N]
            wrench: (…, 6) [N, N m], optional
            out: tuple of arrays to write the results into, of `dyn.dtype`.
        Returns:
            dqdd_dq: (…, n, n) [1/s² | rad/(m s²), m/(rad s²)]
            dqdd_dqd: (…, n, n) [1/s | rad/(m s), m/(rad s)]
            dqdd_dtau: (…, n, n) [1/(kg m²) | 1/(kg m) | 1/kg]
        Raises:
            ModelError: an arm of more than 30 joints, for which this is not offered.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> q, qd, tau = [0.3, 0.5], [1.0, -0.5], [20.0, 5.0]
            >>> by_q, by_qd, by_tau = dyn.forward_dynamics_derivatives(q, qd, tau)
            >>> by_tau.round(4)  # the inverse of the mass matrix
            array([[ 0.271 , -0.7171],
                   [-0.7171,  3.0689]])
        """

    def forward_arm_linearised(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        u: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        out: tuple[NDArray[Real], NDArray[Real]] | None = None,
    ) -> tuple[NDArray[Real], NDArray[Real]]:
        """A and B of  δẋ = A δx + B δu,  x = (q, q̇), about a state and its drive commands: the slopes of `forward_arm`.

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            u: (…, n) [V | A | N m | N]
            out: tuple of arrays to write the results into, of `dyn.dtype`.
        Returns:
            A: (…, 2n, 2n) [1 | 1/s | 1/s²]
            B: (…, 2n, n) [rad/s² | m/s², per unit of u]
        Raises:
            ModelError: an arm of more than 30 joints, for which this is not offered.
        Example:
            >>> dyn = aw.compile("cmu-dd")
            >>> q, qd, volts = np.zeros(6), np.zeros(6), [8, 12, 8, 4, 2, 1]
            >>> [each.shape for each in dyn.forward_arm_linearised(q, qd, volts)]
            [(12, 12), (12, 6)]
        """

    def regressor(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Y of  M_links q̈ + C q̇ + g = Y(q, q̇, q̈) π,  π = `arm.inertial_parameters`.  [AtkesonAnHollerbach1986]

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            qdd: (…, n) [rad/s² | m/s²]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            Y: (…, n, 10N) [N m | N, per kg, kg m, kg m²]
        Raises:
            ModelError: an arm of more than 30 joints, for which this is not offered.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> q, qd, qdd = [0.3, 0.5], [1.0, -0.5], [0.0, 2.0]
            >>> (dyn.regressor(q, qd, qdd) @ dyn.arm.inertial_parameters).round(3)
            array([81.629, 13.409])
        """

    def regressor_drive(
        self, qd: ArrayLike, qdd: ArrayLike, parameters: ArrayLike | None = None, *, out: NDArray[Real] | None = None
    ) -> NDArray[Real]:
        """Y_d of  Nᵀ J_m N q̈ + f(q̇) = Y_d(q̇, q̈) π_d,  π_d = `arm.drive_parameters`.  [OlssonEtAl1998]

        Args:
            qd: (…, n) [rad/s | m/s]
            qdd: (…, n) [rad/s² | m/s²]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            Y_drive: (…, n, 7N) [N m | N, per unit of arm.drive_parameters]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("cmu-dd")
            >>> dyn.regressor_drive(np.ones(6), np.ones(6)).shape
            (6, 42)
        """

    def coriolis_matrix(
        self, q: ArrayLike, qd: ArrayLike, parameters: ArrayLike | None = None, *, out: NDArray[Real] | None = None
    ) -> NDArray[Real]:
        """C(q, q̇) of Christoffel symbols:  C_ij = ½ Σ_k (∂M_ij/∂q_k + ∂M_ik/∂q_j - ∂M_jk/∂q_i) q̇_k.  [SicilianoEtAl2009]

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            C: (…, n, n) [N m s/rad | N m s/m, N s/rad | N s/m]
        Raises:
            ModelError: an arm of more than 30 joints, for which this is not offered.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> qd = np.array([1.0, -0.5])
            >>> (dyn.coriolis_matrix([0.3, 0.5], qd) @ qd).round(3)
            array([0.575, 0.767])
        """

    def energy(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        out: tuple[NDArray[Real], NDArray[Real]] | None = None,
    ) -> tuple[NDArray[Real], NDArray[Real]]:
        """Kinetic and potential energy, T and U: without friction, gear loss and drives their sum stays what it is.

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            out: tuple of arrays to write the results into, of `dyn.dtype`.
        Returns:
            kinetic: (…) [J]
            potential: (…) [J]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> np.round(dyn.energy([0.3, 0.5], [1.0, -0.5]), 3)
            array([ 3.809, 31.553])
        """

    def centre_of_mass(
        self, q: ArrayLike, parameters: ArrayLike | None = None, *, out: NDArray[Real] | None = None
    ) -> NDArray[Real]:
        """Centre of mass of all moving links:  p = Σ m p_c / Σ m.  [Featherstone2008]

        Args:
            q: (…, n) [rad | m]
            out: where to write the result, of `dyn.dtype`.
        Returns:
            p: (…, 3) [m]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> dyn.centre_of_mass([0.3, 0.5]).round(3)
            array([0.78 , 0.322, 0.   ])
        """

    def operational_inertia(
        self,
        q: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        frame: str | None = None,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Inertia of the tip or of another frame, the operational space's:  Λ = (J M⁻¹ Jᵀ)⁻¹, rotors included.  [Khatib1987]

        Args:
            q: (…, n) [rad | m]
            frame: name of a frame of the arm; by default its tip.
            out: where to write the result, of `dyn.dtype`.
        Returns:
            Lambda: (…, 6, 6) [kg | kg m | kg m²]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("ur5e")
            >>> dyn.operational_inertia([0.0, -1.0, 1.2, -0.5, 0.8, 0.0]).shape
            (6, 6)
        """

    def jacobian_dot_qd(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        parameters: ArrayLike | None = None,
        *,
        frame: str | None = None,
        out: NDArray[Real] | None = None,
    ) -> NDArray[Real]:
        """Acceleration of the tip or of another frame at q̈ = 0:  [v̇; ω̇] = J q̈ + J̇ q̇.  [LuhWalkerPaul1980]

        Args:
            q: (…, n) [rad | m]
            qd: (…, n) [rad/s | m/s]
            frame: name of a frame of the arm; by default its tip.
            out: where to write the result, of `dyn.dtype`.
        Returns:
            a: (…, 6) [m/s², rad/s²]
        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
        Example:
            >>> dyn = aw.compile("two-link")
            >>> dyn.jacobian_dot_qd([0.3, 0.5], [1.0, -0.5])[:3].round(3)
            array([-1.095, -0.439,  0.   ])
        """

"""Whether a description's numbers can be those of a real arm. [Wensing2018]"""

from __future__ import annotations

import numpy as np

from armwright.description.brushless import DC_EQUIVALENT
from armwright.description.robot import FixedJoint, Link, RobotDescription
from armwright.errors import DescriptionError
from armwright.spatial import pseudo_inertia

IMPOSSIBLE = 1e-9  # an eigenvalue of the pseudo-inertia below minus this share of the largest is no rounding
SELF_LOCKING = 0.5  # a gear below this efficiency cannot be driven back


def check_bodies(robot: RobotDescription, on_impossible: str) -> list[str]:
    """Refuses links that no real body can be; what was accepted comes back as warnings.

    Raises:
        DescriptionError: names the link and by how much its pseudo-inertia fails to be positive semidefinite.
    """
    warnings = []
    for link in impossible_links(robot):
        eigenvalues = np.linalg.eigvalsh(_body(link))
        fault = (
            f"link {link.name!r} has an impossible inertia: its pseudo-inertia has the eigenvalue {eigenvalues[0]:.4g}, "
            f"{-eigenvalues[0] / max(abs(eigenvalues[-1]), 1e-300):.2g} of the largest below 0"
        )
        if link.accept_impossible is not None:
            warnings.append(f"{fault}; accepted: {link.accept_impossible}")
        elif on_impossible == "warn":
            warnings.append(fault)
        else:
            raise DescriptionError(
                f"{robot.name}: {fault}; expected a real body, "
                'or accept_impossible = "reason" in the link, or on_impossible="warn"'
            )
    return warnings


def impossible_links(robot: RobotDescription) -> list[Link]:
    """The links that no real body can be, accepted or not."""
    return [link for link in robot.links if not is_possible(_body(link))]


def _body(link: Link) -> np.ndarray:
    """(4, 4) pseudo-inertia."""
    return pseudo_inertia(float(link.mass_kg), np.array(link.com_m), link.inertia_kg_m2.matrix())


def is_possible(body: np.ndarray) -> np.ndarray:
    """(…) whether pseudo-inertias (…, 4, 4) are positive semidefinite, but for rounding."""
    eigenvalues = np.linalg.eigvalsh(body)
    least, most = eigenvalues[..., 0], eigenvalues[..., -1]
    return (least >= -IMPOSSIBLE * np.maximum(most, 0.0)) & (most >= 0)


def check_drives(robot: RobotDescription) -> list[str]:
    """Warnings about gears that lock themselves and motor constants that contradict each other."""
    warnings = []
    for joint in robot.joints:
        if isinstance(joint, FixedJoint) or joint.motor is None:
            continue
        motor = joint.motor
        if motor.gear_efficiency is not None and float(motor.gear_efficiency) < SELF_LOCKING:
            warnings.append(
                f"joint {joint.name!r}: gear efficiency {float(motor.gear_efficiency):g} is below {SELF_LOCKING}, self-locking"
            )
        factor = DC_EQUIVALENT[motor.basis]
        if motor.torque_constant_n_m_per_a is None or motor.back_emf_constant_v_s_per_rad is None:
            continue
        kt = factor.torque_constant * float(motor.torque_constant_n_m_per_a)
        ke = factor.back_emf_constant * float(motor.back_emf_constant_v_s_per_rad)
        if not 0.9 < kt / ke < 1.1:
            warnings.append(
                f"joint {joint.name!r}: torque constant {kt:.4g} N m/A and back-EMF constant {ke:.4g} V s/rad differ as "
                f"DC-equivalents, where they should be equal; check basis = {motor.basis!r}"
            )
    return warnings

"""Derivative of a plant's state: every joint's drive by itself (`drives`), then the arm that they move."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armwright import scalar
from armwright.actuators.coupling import to_motors
from armwright.actuators.friction import friction_torques
from armwright.actuators.supply import Bus
from armwright.dynamics import mass_matrix
from armwright.dynamics.forward import accelerations
from armwright.dynamics.gears import Gear, lossy_gears, without_rotors
from armwright.model import Model
from armwright.scalar import Array, Scalar
from armwright.simulation.plant.drives import PlantDrives
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.joint_drive import DrivenJoint, SwitchingFunction, standing
from armwright.simulation.plant.sticking import Sticking, sticking_places


@dataclass(frozen=True, eq=False)
class Flow:
    """All that happens in one state."""

    qdd: Array  # (n,) [rad/s² | m/s²]
    holding: Array | None  # (n,) [N m | N] by which what sticks holds the joints; None of an arm that never sticks
    joints: list[DrivenJoint]
    change: dict[str, list[Scalar]]  # d/dt of each signal of the state
    rates: list[Scalar]  # [1/s] of the stiff entries, in the order of x
    fed: Bus | None  # what happens on the bus, where the arm has one


@dataclass(frozen=True, eq=False)
class Loads:
    """Torques of the drives on the links, as `forward.accelerations` takes them."""

    joints: list[DrivenJoint]
    links: Model  # without the rotors of `gears`
    driven: Array  # (n,) [N m | N]
    resisting: Array  # (n,) [N m | N]
    gears: list[Gear]  # with loss, behind rotors


@dataclass(frozen=True, eq=False)
class PlantFlow(PlantDrives):
    """The equations of an arm with its drives."""

    def _flow(self, x: Array, inputs: PlantInputs) -> Flow:
        """Every joint's drive, then the arm they move, then what all that makes of the state."""
        n, holding = self.model.n, None
        q, qd = x[:n], x[n : 2 * n]
        if self.sticking is not None and inputs.directions is None:
            inputs = replace(inputs, directions=self.sticking.present(x, inputs))
        loads = self.loads(x, inputs)
        if self.sticking is None:
            qdd = accelerations(loads.links, q, qd, loads.driven, loads.resisting, inputs.wrench, loads.gears)
        else:
            qdd, holding = self.sticking.accelerations(x, inputs, loads.joints)
        joints = self._with_gear_loss(loads.joints, to_motors(self.shares, qd), to_motors(self.shares, qdd))
        change, rates, fed = self._of_drives(x, joints)
        return Flow(qdd, holding, joints, {"q": list(qd), "qd": list(qdd), **change}, rates, fed)

    def loads(self, x: Array, inputs: PlantInputs) -> Loads:
        """Torques of the drives on the links in a state."""
        directions = None
        if self.sticking is not None and inputs.directions is not None:
            directions = self.sticking.of_joints(inputs.directions)
        joints = self.driven(x, inputs, directions)
        losses = [joint.gear_loss for joint in joints]
        links, driven, gears = lossy_gears(self.rigid, scalar.array([joint.gear for joint in joints]), losses)
        resisting = scalar.array([joint.resisting for joint in joints])
        if self.model.mimics is not None:
            resisting = resisting + friction_torques(self._followers, x[self.model.n : 2 * self.model.n])
        return Loads(joints, links, driven, resisting, gears)

    def drive_rates(self, x: Array, inputs: PlantInputs) -> np.ndarray:
        """Derivatives of the state's entries behind q and q̇, without the arm's dynamics."""
        change, _, _ = self._of_drives(x, self.loads(x, inputs).joints)
        return scalar.array([value for name in self.layout.names[2:] for value in change[name]])

    def _with_gear_loss(self, joints: list[DrivenJoint], w: Array, wd: Array) -> list[DrivenJoint]:
        """The joints with the loss (t - G(t)) w of rigid gears and where they bend; w, ẇ of the motors (n,)."""
        done = []
        for i, (body, joint) in enumerate(zip(self.model.coordinates, joints, strict=True)):
            if joint.gear_loss is not None:
                t = joint.gear - body.drive.reflected * wd[i]
                bends = [SwitchingFunction(w[i], standing(body.drive.smoothing))]
                bends += [SwitchingFunction(t - knot) for knot in joint.gear_loss.knots]
                loss = joint.loss + (t - joint.gear_loss.output(t)) * w[i]
                joint = replace(joint, loss=loss, switching=[*joint.switching, *bends])
            done.append(joint)
        return done

    @cached_property
    def sticking(self) -> Sticking | None:
        """The arm's set-valued laws; None where all are smooth."""
        places = sticking_places(self.model, self.brakes)
        return Sticking(self, places) if places else None

    def inertia(self, q: Array) -> np.ndarray:
        """The mass matrix of links and of the rotors of rigid gears.

        Args:
            q: (n,) [rad | m].
        Returns:
            M: (n, n) [kg m² | kg m | kg].
        """
        return mass_matrix(self.rigid, q)

    @cached_property
    def rigid(self) -> Model:
        """The arm without the rotors of motors behind elastic gears, which move by themselves."""
        elastic = {body.joint for body in self.model.coordinates if body.elasticity is not None}
        return without_rotors(self.model, elastic) if elastic else self.model

    @cached_property
    def _followers(self) -> Model:
        """The arm with friction in those joints only that follow others."""
        names = set(self.model.names)
        bodies = (replace(body, friction=None) if body.joint in names else body for body in self.model.bodies)
        return replace(self.model, bodies=tuple(bodies))

"""The table of kernels: name, function, inputs and outputs with shape and unit. The compiled API, its docstrings, the C
header and the tests over all kernels are made from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from armwright import actuators, dynamics, kinematics
from armwright.errors import ModelError
from armwright.model import Model
from armwright.model.simplify import STEPS, aligned_frames

if TYPE_CHECKING:
    from armwright.model.vary import Varied

Step = Callable[[Model], Model]
Size = int | str  # "n", "2n", …: number of coordinates, or a multiple of it; "10N": of all joints that move


@dataclass(frozen=True)
class Operand:
    """An input or output: its name, shape and unit."""

    name: str
    shape: tuple[Size, ...]
    unit: str

    def sized(self, model: Model) -> tuple[int, ...]:
        """The shape for one arm."""
        return tuple(_sized(size, model) for size in self.shape)


def _sized(size: Size, model: Model) -> int:
    if isinstance(size, int):
        return size
    return int(size[:-1] or 1) * (model.n if size.endswith("n") else len(model.bodies))


@dataclass(frozen=True)
class Signature:
    """One kernel.

    Attributes:
        function: the plain function, (model, *inputs) → one array, or a tuple of them.
        inputs, outputs: in order.
        optional: inputs that may be left out, which compiles another, shorter program.
        options: names of keyword arguments that are fixed when the kernel is compiled, such as `frame`.
        inverted: whether the result is the inverse of a matrix, and so loses as many digits as its condition number has.
        regroup: whether the result follows from the arm's motion alone, so that its inertial parameters may be regrouped.
        most_joints: of an arm that the kernel is offered for; None: of any. Derivatives take n² numbers and n² operations each.
    """

    function: Callable[..., Any]
    inputs: tuple[Operand, ...]
    outputs: tuple[Operand, ...]
    optional: tuple[Operand, ...] = ()
    options: tuple[str, ...] = ()
    regroup: bool = False
    inverted: bool = False
    most_joints: int | None = None

    @property
    def steps(self) -> tuple[Step, ...]:
        """The simplifying steps that keep the kernel's result."""
        return STEPS if self.regroup else (aligned_frames,)

    @property
    def name(self) -> str:
        """The function's name, which is the kernel's."""
        return self.function.__name__


Q = Operand("q", ("n",), "rad | m")
QD = Operand("qd", ("n",), "rad/s | m/s")
QDD = Operand("qdd", ("n",), "rad/s² | m/s²")
TAU = Operand("tau", ("n",), "N m | N")
VOLTAGE = Operand("voltage", ("n",), "V")
U = Operand("u", ("n",), "V | A | N m | N")
MASS = Operand("M", ("n", "n"), "kg m² | kg m | kg")
PER_POSITION = "N m/rad | N m/m, N/rad | N/m"
PER_SPEED = "N m s/rad | N m s/m, N s/rad | N s/m"
WRENCH = Operand("wrench", (6,), "N, N m")
MOST_DIFFERENTIATED = 30  # joints

SIGNATURES: dict[str, Signature] = {
    signature.name: signature
    for signature in (
        Signature(dynamics.inverse_dynamics, (Q, QD, QDD), (TAU,), (WRENCH,), regroup=True),
        Signature(dynamics.forward_dynamics, (Q, QD, TAU), (QDD,), (WRENCH,), regroup=True),
        Signature(dynamics.mass_matrix, (Q,), (MASS,), regroup=True),
        Signature(dynamics.bias_torques, (Q, QD), (Operand("h", ("n",), "N m | N"),), (WRENCH,), regroup=True),
        Signature(dynamics.gravity_torques, (Q,), (Operand("g", ("n",), "N m | N"),), regroup=True),
        Signature(dynamics.spring_torques, (Q,), (Operand("s", ("n",), "N m | N"),), regroup=True),
        Signature(kinematics.forward_kinematics, (Q,), (Operand("T", (4, 4), "- | m"),), options=("frame",)),
        Signature(kinematics.jacobian, (Q,), (Operand("J", (6, "n"), "m/rad | -, - | 1/m"),), options=("frame",)),
        Signature(actuators.motor_voltage, (QD, TAU), (VOLTAGE,)),
        Signature(actuators.motor_torque, (QD, VOLTAGE), (TAU,)),
        Signature(dynamics.forward_arm, (Q, QD, U), (QDD,), regroup=True),
        Signature(
            dynamics.inverse_dynamics_derivatives,
            (Q, QD, QDD),
            (
                Operand("dtau_dq", ("n", "n"), PER_POSITION),
                Operand("dtau_dqd", ("n", "n"), PER_SPEED),
                Operand("dtau_dqdd", ("n", "n"), MASS.unit),
            ),
            (WRENCH,),
            regroup=True,
            most_joints=MOST_DIFFERENTIATED,
        ),
        Signature(
            dynamics.forward_dynamics_derivatives,
            (Q, QD, TAU),
            (
                Operand("dqdd_dq", ("n", "n"), "1/s² | rad/(m s²), m/(rad s²)"),
                Operand("dqdd_dqd", ("n", "n"), "1/s | rad/(m s), m/(rad s)"),
                Operand("dqdd_dtau", ("n", "n"), "1/(kg m²) | 1/(kg m) | 1/kg"),
            ),
            (WRENCH,),
            regroup=True,
            most_joints=MOST_DIFFERENTIATED,
        ),
        Signature(
            dynamics.forward_arm_linearised,
            (Q, QD, U),
            (Operand("A", ("2n", "2n"), "1 | 1/s | 1/s²"), Operand("B", ("2n", "n"), "rad/s² | m/s², per unit of u")),
            regroup=True,
            most_joints=MOST_DIFFERENTIATED,
        ),
        Signature(
            dynamics.regressor,
            (Q, QD, QDD),
            (Operand("Y", ("n", "10N"), "N m | N, per kg, kg m, kg m²"),),
            most_joints=MOST_DIFFERENTIATED,
        ),
        Signature(
            dynamics.regressor_drive,
            (QD, QDD),
            (Operand("Y_drive", ("n", "7N"), "N m | N, per unit of arm.drive_parameters"),),
        ),
        Signature(
            dynamics.coriolis_matrix,
            (Q, QD),
            (Operand("C", ("n", "n"), PER_SPEED),),
            regroup=True,
            most_joints=MOST_DIFFERENTIATED,
        ),
        Signature(dynamics.energy, (Q, QD), (Operand("kinetic", (), "J"), Operand("potential", (), "J"))),
        Signature(dynamics.centre_of_mass, (Q,), (Operand("p", (3,), "m"),)),
        Signature(
            dynamics.operational_inertia,
            (Q,),
            (Operand("Lambda", (6, 6), "kg | kg m | kg m²"),),
            options=("frame",),
            regroup=True,
            inverted=True,
        ),
        Signature(kinematics.jacobian_dot_qd, (Q, QD), (Operand("a", (6,), "m/s², rad/s²"),), options=("frame",)),
    )
}


def trace_kernel(
    model: Model,
    signature: Signature,
    optional: tuple[str, ...] = (),
    *,
    steps: tuple[Step, ...] | None = None,
    varied: Varied | None = None,
    **options: Any,
):
    """The program of a kernel for one arm, with some optional inputs and the options' values.

    Args:
        model: the arm.   signature: a row of the table.   optional: names of the optional inputs that it takes.
        steps: simplifying steps on the arm before it is traced; by default those that keep the result.
        varied: the same arm with parameters left open, which are then an input behind the signature's own.
        options: values of the signature's options.
    Returns:
        program: inputs and outputs as the signature names them.

    Raises:
        ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip, or has too many joints for it.
    """
    if signature.most_joints is not None and model.n > signature.most_joints:
        place, most = f"{model.name}: joints of {signature.name}", f"{signature.most_joints} or fewer"
        raise ModelError(place=place, value=model.n, expected=most)
    if varied is not None and steps is None and signature.regroup:  # regrouping what varies costs more than it may save
        either = [
            trace_kernel(model, signature, optional, steps=s, varied=varied, **options) for s in (STEPS, STEPS[:1])
        ]
        return min(either, key=lambda program: program.operation_counts().total())
    from armwright.program import trace  # CasADi, which takes a while to import

    place = len(signature.inputs)
    arguments = [*signature.inputs, *(a for a in signature.optional if a.name in optional)]
    if varied is not None:
        arguments.insert(place, Operand(PARAMETERS, (len(varied.parameters),), "as each is named"))

    def function(*values: Any) -> Any:
        arm = model
        if varied is not None:
            arm, values = varied.model(values[place]), (*values[:place], *values[place + 1 :])
        for step in signature.steps if steps is None else steps:
            arm = step(arm)
        return signature.function(arm, *values, **options)

    inputs = {argument.name: argument.sized(model) for argument in arguments}
    outputs = tuple(a.name if a.name not in inputs else f"{a.name}_out" for a in signature.outputs)
    return trace(signature.name, function, inputs, outputs)


PARAMETERS = "parameters"  # the input of a kernel whose arm varies

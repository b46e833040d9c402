"""The table of kernels: name, function, inputs and outputs with shape and unit. The compiled API, its docstrings, the C
header and the tests over all kernels are made from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from armwright import actuators, dynamics, kinematics
from armwright.model import Model
from armwright.model.simplify import aligned_frames, simplified

Size = int | str  # "n": number of joints


@dataclass(frozen=True)
class Argument:
    """An input or output: its name, shape and unit."""

    name: str
    shape: tuple[Size, ...]
    unit: str

    def sized(self, model: Model) -> tuple[int, ...]:
        """The shape for one arm."""
        return tuple(model.n if size == "n" else int(size) for size in self.shape)


@dataclass(frozen=True)
class Signature:
    """One kernel.

    Attributes:
        function: the plain function, (model, *inputs) → one array, or a tuple of them.
        inputs, outputs: in order.
        optional: inputs that may be left out, which compiles another, shorter program.
        options: names of keyword arguments that are fixed when the kernel is compiled, such as `frame`.
        regroup: whether the result follows from the arm's motion alone, so that its inertial parameters may be regrouped.
    """

    function: Callable[..., Any]
    inputs: tuple[Argument, ...]
    outputs: tuple[Argument, ...]
    optional: tuple[Argument, ...] = ()
    options: tuple[str, ...] = ()
    regroup: bool = False

    @property
    def name(self) -> str:
        """The function's name, which is the kernel's."""
        return self.function.__name__


Q = Argument("q", ("n",), "rad | m")
QD = Argument("qd", ("n",), "rad/s | m/s")
QDD = Argument("qdd", ("n",), "rad/s² | m/s²")
TAU = Argument("tau", ("n",), "N m | N")
VOLTAGE = Argument("voltage", ("n",), "V")
U = Argument("u", ("n",), "V | A | N m | N")
WRENCH = Argument("wrench", (6,), "N, N m")

SIGNATURES: dict[str, Signature] = {
    signature.name: signature
    for signature in (
        Signature(dynamics.inverse_dynamics, (Q, QD, QDD), (TAU,), (WRENCH,), regroup=True),
        Signature(dynamics.forward_dynamics, (Q, QD, TAU), (QDD,), (WRENCH,), regroup=True),
        Signature(dynamics.mass_matrix, (Q,), (Argument("M", ("n", "n"), "kg m² | kg m | kg"),), regroup=True),
        Signature(dynamics.bias_torques, (Q, QD), (Argument("h", ("n",), "N m | N"),), (WRENCH,), regroup=True),
        Signature(dynamics.gravity_torques, (Q,), (Argument("g", ("n",), "N m | N"),), regroup=True),
        Signature(kinematics.forward_kinematics, (Q,), (Argument("T", (4, 4), "- | m"),), options=("frame",)),
        Signature(kinematics.jacobian, (Q,), (Argument("J", (6, "n"), "m/rad | -, - | 1/m"),), options=("frame",)),
        Signature(actuators.motor_voltage, (QD, TAU), (VOLTAGE,)),
        Signature(actuators.motor_torque, (QD, VOLTAGE), (TAU,)),
        Signature(dynamics.forward_arm, (Q, QD, U), (QDD,), regroup=True),
    )
}


def trace_kernel(model: Model, signature: Signature, given: tuple[str, ...] = (), **options: Any):
    """The program of a kernel for one arm, with the optional inputs named in `given` and the options' values.

    Raises:
        ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip.
    """
    from armwright.program import trace  # CasADi, which takes a while to import

    model = simplified(model) if signature.regroup else aligned_frames(model)
    arguments = [*signature.inputs, *(a for a in signature.optional if a.name in given)]
    return trace(
        signature.name,
        lambda *values: signature.function(model, *values, **options),
        {argument.name: argument.sized(model) for argument in arguments},
        tuple(
            argument.name if argument.name not in {a.name for a in arguments} else f"{argument.name}_out"
            for argument in signature.outputs
        ),
    )

"""One function of an exported C library: a kernel in one of its forms, traced for an arm, with its name in C.

A form says in one word which optional inputs the kernel takes and which of its options are fixed:

inverse_dynamics                  the kernel with its required inputs
inverse_dynamics+wrench           with an optional input
forward_kinematics:frame=tool     with an option fixed
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import ModelError, check_known
from armwright.kernels.c_syntax import identifier
from armwright.kernels.signatures import SIGNATURES, Operand, Signature, trace_kernel
from armwright.model import Model
from armwright.program import Program

WRITTEN = "NAME, NAME+INPUT or NAME:OPTION=VALUE"


@dataclass(frozen=True)
class Form:
    """One kernel with a choice of its optional inputs and options.

    Attributes:
        signature: the kernel's row of the table.   optional: the optional inputs that it takes, in the table's order.
        options: (name, value) of every option that is fixed, in the table's order.
    """

    signature: Signature
    optional: tuple[Operand, ...] = ()
    options: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        """The word for this form, as read by `parse_form`."""
        inputs = "".join(f"+{argument.name}" for argument in self.optional)
        return f"{self.signature.name}{inputs}{''.join(f':{option}={value}' for option, value in self.options)}"

    @property
    def words(self) -> tuple[str, ...]:
        """Kernel, inputs and values, which together give its name in C."""
        return (self.signature.name, *(a.name for a in self.optional), *(value for _, value in self.options))

    @property
    def arguments(self) -> tuple[Operand, ...]:
        """Names, shapes and units of its arrays, inputs first."""
        return (*self.signature.inputs, *self.optional, *self.signature.outputs)

    @property
    def left_out(self) -> tuple[Operand, ...]:
        """Optional inputs that are left out."""
        return tuple(argument for argument in self.signature.optional if argument not in self.optional)

    def trace(self, arm: Model) -> Any:
        """The form's program for an arm.

        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a frame of that name.
        """
        fixed: dict[str, Any] = dict(self.options)
        return trace_kernel(arm, self.signature, tuple(a.name for a in self.optional), **fixed)

    def evaluate(self, arm: Model, *inputs: np.ndarray) -> tuple[np.ndarray, ...]:
        """Results of the plain function for one state: an array for each output."""
        split = len(self.signature.inputs)
        named: dict[str, Any] = {a.name: array for a, array in zip(self.optional, inputs[split:], strict=True)}
        results = self.signature.function(arm, *inputs[:split], **named, **dict(self.options))
        return tuple(np.asarray(r, dtype=float) for r in (results if isinstance(results, tuple) else (results,)))


def parse_form(text: str) -> Form:
    """The form for a word.

    Raises:
        ModelError: an unknown kernel, input or option, one that is named twice, or an option without a value.
    """
    head, *fixed = re.split(r":(?=\w*(?:=|$))", text)  # a value may have a colon in it
    name, *inputs = head.split("+")
    check_known(ModelError, name, SIGNATURES, place="function")
    signature = SIGNATURES[name]
    _check(text, "optional input", inputs, [argument.name for argument in signature.optional])
    pairs = [option.partition("=") for option in fixed]
    _check(text, "option", [option for option, _, _ in pairs], signature.options)
    values = {option: value for option, _, value in pairs}
    for option, value in values.items():
        if not value:
            raise ModelError("no value", place=f"{text}: option {option}", expected=f"{name}:{option}=VALUE")
    return Form(
        signature,
        tuple(argument for argument in signature.optional if argument.name in inputs),
        tuple((option, values[option]) for option in signature.options if option in values),
    )


def _check(text: str, kind: str, names: Sequence[str], known: Sequence[str]) -> None:
    for k, name in enumerate(names):
        check_known(ModelError, name, known, place=f"{text}: {kind}")
        if name in names[:k]:
            raise ModelError("named twice", place=f"{text}: {kind}", value=name)


@dataclass(frozen=True)
class CFunction:
    """A kernel's form, its program for the arm, and the end of its name in C, after the library's name."""

    form: Form
    program: Program
    short_name: str
    library: str

    @property
    def name(self) -> str:
        """The C name, such as puma560_inverse_dynamics_wrench."""
        return f"{self.library}_{self.short_name}"


def c_functions(arm: Model, library: str, forms: Sequence[Form]) -> list[CFunction]:
    """The functions of a library, without duplicates of form or name.

    Raises:
        ModelError: the arm lacks what a kernel needs, or a form's name in C would be that of another form or kernel.
    """
    named: dict[str, Form] = {}
    for form in dict.fromkeys(forms):
        name = identifier("_".join(form.words))
        other = named.get(name) or (Form(SIGNATURES[name]) if name in SIGNATURES and name != form.name else None)
        if other is not None:
            same = f"its name in C would be {library}_{name}, as that of {other.name}; rename the frame"
            raise ModelError(same, place="function", value=form.name)
        named[name] = form
    return [CFunction(form, form.trace(arm), name, library) for name, form in named.items()]

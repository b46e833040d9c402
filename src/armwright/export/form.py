"""A kernel's form in one word: which optional inputs it takes, and which of its options are fixed.

inverse_dynamics                  the kernel with its own inputs
inverse_dynamics+wrench           with an optional input
forward_kinematics:frame=tool     with an option fixed
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armwright.errors import ModelError
from armwright.kernels.signatures import SIGNATURES, Argument, Signature, trace_kernel
from armwright.model import Model

WRITTEN = "NAME, NAME+INPUT or NAME:OPTION=VALUE"


@dataclass(frozen=True)
class Form:
    """One kernel with some of its optional inputs, and values of some of its options.

    Attributes:
        signature: the kernel's row of the table.   given: its optional inputs that are taken, in the table's order.
        options: (name, value) of every option that is fixed, in the table's order.
    """

    signature: Signature
    given: tuple[Argument, ...] = ()
    options: tuple[tuple[str, str], ...] = ()

    @property
    def name(self) -> str:
        """The word that `parse_form` reads as this form."""
        inputs = "".join(f"+{argument.name}" for argument in self.given)
        return f"{self.signature.name}{inputs}{''.join(f':{option}={value}' for option, value in self.options)}"

    @property
    def words(self) -> tuple[str, ...]:
        """What a name made from the form has in it: kernel, inputs, values."""
        return (self.signature.name, *(argument.name for argument in self.given), *(value for _, value in self.options))

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """What the arrays are, inputs first."""
        return (*self.signature.inputs, *self.given, *self.signature.outputs)

    @property
    def left_out(self) -> tuple[Argument, ...]:
        """The optional inputs that are not taken."""
        return tuple(argument for argument in self.signature.optional if argument not in self.given)

    @property
    def _fixed(self) -> dict[str, Any]:
        return dict(self.options)

    def trace(self, arm: Model) -> Any:
        """The form's program for an arm.

        Raises:
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a frame of that name.
        """
        return trace_kernel(arm, self.signature, tuple(a.name for a in self.given), **self._fixed)

    def evaluate(self, arm: Model, *inputs: np.ndarray) -> tuple[np.ndarray, ...]:
        """What the plain function gives for one state: an array an output."""
        split = len(self.signature.inputs)
        named = {a.name: array for a, array in zip(self.given, inputs[split:], strict=True)}
        results = self.signature.function(arm, *inputs[:split], **named, **self._fixed)
        return tuple(np.asarray(r, dtype=float) for r in (results if isinstance(results, tuple) else (results,)))


def parse_form(text: str) -> Form:
    """The form that a word means.

    Raises:
        ModelError: an unknown kernel, input or option, one that is named twice, or an option without a value.
    """
    head, *fixed = re.split(r":(?=\w*(?:=|$))", text)  # a value may have a colon in it
    name, *inputs = head.split("+")
    if name not in SIGNATURES:
        raise ModelError(f"no function {name!r}; there is {', '.join(SIGNATURES)}")
    signature = SIGNATURES[name]
    optional = [argument.name for argument in signature.optional]
    _check(text, "optional input", inputs, optional)
    pairs = [option.partition("=") for option in fixed]
    _check(text, "option", [option for option, _, _ in pairs], signature.options)
    for option, _, value in pairs:
        if not value:
            raise ModelError(f"{text}: option {option!r} has no value; expected {name}:{option}=VALUE")
    values = {option: value for option, _, value in pairs}
    return Form(
        signature,
        tuple(argument for argument in signature.optional if argument.name in inputs),
        tuple((option, values[option]) for option in signature.options if option in values),
    )


def _check(text: str, what: str, given: Sequence[str], known: Sequence[str]) -> None:
    for k, name in enumerate(given):
        if name not in known:
            there = f"there is {', '.join(known)}" if known else f"{re.split('[+:]', text)[0]} has none"
            raise ModelError(f"{text}: no {what} {name!r}; {there}")
        if name in given[:k]:
            raise ModelError(f"{text}: {what} {name!r} is named twice")

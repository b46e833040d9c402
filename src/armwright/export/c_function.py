"""One function of an exported C library, and its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armwright.errors import ModelError
from armwright.export.form import Form
from armwright.kernels.c_syntax import identifier
from armwright.kernels.signatures import SIGNATURES, Argument
from armwright.model import Model
from armwright.program import Program


@dataclass(frozen=True)
class CFunction:
    """A kernel's form, its program for the arm, and what it is called in C behind the library's name."""

    form: Form
    program: Program
    own_name: str
    library: str

    @property
    def name(self) -> str:
        """The C name, such as puma560_inverse_dynamics_wrench."""
        return f"{self.library}_{self.own_name}"

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """What the arrays are, inputs first."""
        return self.form.arguments


def c_functions(arm: Model, library: str, forms: Sequence[Form]) -> list[CFunction]:
    """The functions of a library, each form once, with names of which none is another's.

    Raises:
        ModelError: the arm lacks what a kernel needs, or a form's name in C would be that of another form or kernel.
    """
    named: dict[str, Form] = {}
    for form in dict.fromkeys(forms):
        name = identifier("_".join(form.words))
        other = named.get(name) or (Form(SIGNATURES[name]) if name in SIGNATURES and name != form.name else None)
        if other is not None:
            raise ModelError(
                f"{form.name}: would be called {library}_{name} in C, as is {other.name}; rename the frame"
            )
        named[name] = form
    return [CFunction(form, form.trace(arm), name, library) for name, form in named.items()]

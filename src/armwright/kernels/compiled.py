"""CompiledArm: the kernels of one arm as methods, compiled when first used."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from types import MethodType
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np

from armwright.entry import AnyArm, as_arm
from armwright.errors import ModelError, ShapeError, check_known
from armwright.features import Support
from armwright.kernels.format import DOUBLE, select_format
from armwright.kernels.kernel_methods import KernelMethods, Real
from armwright.kernels.signatures import PARAMETERS, SIGNATURES, trace_kernel
from armwright.model import Model
from armwright.notebook import repr_html
from armwright.other_names import advice
from armwright.progress import automatic

if TYPE_CHECKING:
    from armwright.model.vary import Varied

LIST = ", ".join(sorted(SIGNATURES))
CPU = "cpu"  # the device that code is made for unless another is named
KERNELS = Support(
    "kernels",
    approximated={
        "LuGre friction": "Coulomb's law with its Stribeck level stands for the bristles",
        "friction by temperature": "as at the motor's reference temperature",
        "heat": "as at the motor's reference temperature",
        "elasticity": "motor and link move as one",
        "play": "motor and link move as one",
        "kinematic error": "motor and link move as one",
        "stops": "nothing pushes a joint back at its limits",
        "cogging": "left out",
        "inductance": "a current follows at once",
        "current loop": "a current follows at once",
        "coasting": "the bridge shorts the motor while it is off",
        "dead zone": "every voltage acts in full",
        "supply": "its voltage does not sag",
    },
    without_effect={
        "brakes": "they are released",
        **dict.fromkeys(
            ("servo", "servo counts"), "its loop is not asked; `forward_arm` and `motor_voltage` refuse it"
        ),
    },
)
CASADI = KERNELS.named("CasADi functions")


class CompiledArm(KernelMethods[Real]):
    """Kernels for one arm. Arrays are (…, *shape) and broadcast over their leading axes; each method takes `out=`.

    A copy, or a pickle that is read elsewhere, is of the same arm and compiles its kernels anew when they are used.

    Attributes:
        arm: the model, frozen.   target: the processor that code is made for.
        dtype: NumPy's type of the numbers that kernels take, compute with and give; everything else is converted.
        varied: the arm with parameters left open, or None; `varied.names` and `varied.nominal` are their names and values.
    """

    def __init__(
        self,
        arm: Model,
        target: str | None = None,
        vary: Sequence[str] = (),
        dtype: str | type | np.dtype = DOUBLE.name,
    ):
        from armwright.kernels.target import select_target

        arm = as_arm(arm)
        if target is not None and not isinstance(target, str):
            raise ModelError(place="target", value=target, expected="the name of a processor level, such as x86-64-v3")
        if not isinstance(vary, Sequence):
            raise ModelError(place="vary", value=vary, expected="a list of names")
        self.arm = arm
        self.varied: Varied | None = None
        if len(vary):
            from armwright.model.vary import Varied

            self.varied = Varied(arm, vary)
        self.format = select_format(dtype)
        self.dtype = self.format.dtype
        self.target = select_target(target, self.format)
        self._asked = target
        self._threads = os.cpu_count() or 1
        self._kernels: dict[tuple[Any, ...], Any] = {}
        self._waiting: dict[str, list[Any]] = {}  # tables of native calls whose kernels are not compiled yet
        self._general: CompiledArm | None = None
        self._bare = self.varied is not None  # without native functions

    def __repr__(self) -> str:
        varying = f", varying {', '.join(self.varied.names)}" if self.varied is not None else ""
        format = "" if self.format is DOUBLE else f" in {self.format.name}"
        return f"<compiled {self.arm.name} for {self.target.cpu}{format}, {self.target.width} states at once{varying}>"

    _repr_html_ = repr_html

    def __reduce__(self) -> tuple[Any, ...]:
        vary = () if self.varied is None else self.varied.names
        settings = self._asked, vary, self.format.name
        return _again, (type(self), self.arm, *settings, self._threads)  # without the native code

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about effects of the record that these functions approximate; the simulator counts them in full."""
        return KERNELS.notes(self.arm)

    @property
    def threads(self) -> int:
        """Number of threads that share a large batch, 1 or more; results do not depend on it."""
        return self._threads

    @threads.setter
    def threads(self, count: int) -> None:
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or count < 1:
            raise ModelError(place="threads", value=count, expected="a whole number, 1 or more")
        self._threads = int(count)
        if self._general is not None:
            self._general.threads = count

    if not TYPE_CHECKING:  # a type checker refuses a kernel that there is not

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_"):  # Python's own questions
                raise AttributeError(name)
            text = f"no kernel is called {name!r}{advice(name, SIGNATURES) or f'; there is {LIST}'}"
            raise AttributeError(text, name=name, obj=self)  # Python adds the nearest name

    def kernel(self, name: str, *optional: str, **options: Any) -> Any:
        """The compiled kernel of that name; compiles it where this is its first use.

        Args:
            name: of the table.   optional: names of the optional inputs that it takes.
            options: keyword arguments that are fixed when it is compiled, such as `frame`.
        Returns:
            kernel: takes and returns arrays, (…, *shape).
        Raises:
            ShapeError: no kernel has that name.
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip, or has too many joints for it.
        """
        self._check_form(name, optional, options)
        key = (name, *optional, *sorted(options.items()))
        if key not in self._kernels:
            with automatic(None, f"compiling {name} of {self.arm.name}"):
                self._kernels[key] = self._compiled(name, self._traced(name, optional, options))
        return self._kernels[key]

    def derivative(self, name: str, by: str, *optional: str, **options: Any) -> Any:
        """The compiled kernel of that name with its derivatives by one input behind its outputs, exact.

        Args:
            name, optional, options: as in `kernel`.
            by: name of an input, such as "q"; or "parameters", of an arm that was compiled with `vary`.
        Returns:
            kernel: takes the kernel's inputs and returns a tuple: its outputs, then for each the derivative
                (…, *shape of the output, *shape of the input).
        Raises:
            ShapeError: no such kernel or input.   ModelError: as `kernel`.
        """
        self._check_form(name, optional, options)
        key = (name, "by", by, *optional, *sorted(options.items()))
        if key not in self._kernels:
            from armwright.program.derivative import derivative

            program = self._traced(name, optional, options)
            known = [port.name for port in program.inputs]
            check_known(ShapeError, by, known, place=f"{name}: input")
            with automatic(None, f"compiling {name} of {self.arm.name}"):
                self._kernels[key] = self._compiled(name, derivative(program, by))
        return self._kernels[key]

    def _traced(self, name: str, optional: tuple[str, ...], options: dict[str, Any]) -> Any:
        return trace_kernel(self.arm, SIGNATURES[name], optional, varied=self.varied, **options)

    def warm(self, names: Sequence[str]) -> None:
        """Compiles kernels now, together: one is traced while others are compiled, long ones each in a process of its own.

        Args:
            names: of kernels, in the form without optional inputs; those that are compiled already cost nothing.
        Raises:
            ShapeError: no kernel has that name.   ModelError: no list of names; otherwise as `kernel`.
        """
        if isinstance(names, str) or not isinstance(names, Sequence):
            raise ModelError(place="warm", value=names, expected="a list of names of kernels")
        for name in names:
            check_known(ShapeError, name, SIGNATURES, place="warm")
        missing = [name for name in dict.fromkeys(names) if (name,) not in self._kernels]
        if not missing:
            return
        from concurrent.futures import ThreadPoolExecutor

        with (
            automatic(None, f"compiling kernels of {self.arm.name}") as tell,
            ThreadPoolExecutor(os.cpu_count()) as pool,
        ):
            works = [
                pool.submit(self._compiled, name, self._traced(name, (), {}), other_process=len(missing) > 1)
                for name in missing
            ]
            for k, (name, work) in enumerate(zip(missing, works, strict=True), 1):
                self._kernels[(name,)] = work.result()
                tell(k, len(missing))

    def _compiled(self, name: str, program: Any, *, other_process: bool = False) -> Any:
        # This brings LLVM, which an arm that is compiled and not used does without.
        from armwright.kernels.batch import Kernel

        return Kernel(program, self.target, self._parameter_check(name), self.format, other_process=other_process)

    def _parameter_check(self, name: str) -> Callable[[tuple[Any, ...]], None] | None:
        """Check of the parameters that vary, made in every call of a kernel; None if none varies."""
        return None if self.varied is None else _checked(self.varied, len(SIGNATURES[name].inputs))

    def _method(self, method: Callable[..., Any], form: str) -> Callable[..., Any]:
        """A kernel's method of this arm, a native function where there can be one, which is kept in its place.

        It refers to a copy of this arm that has the same kernels and no native functions: if it referred to this one, which
        refers to it, both would wait for the garbage collector, and their code with them.
        """
        name = method.__name__
        if self._bare or getattr(type(self), name, None) is not method:  # a subclass has its own
            return MethodType(method, self)
        from armwright.kernels.native_call import native_call

        if self._general is None:
            copy = object.__new__(CompiledArm)
            vars(copy).update({key: value for key, value in vars(self).items() if key not in SIGNATURES})
            copy._bare, self._general = True, copy
        call = native_call(self._general, MethodType(method, self._general), form, self.format)
        if call is None:
            return MethodType(method, self)
        self._waiting.setdefault(name, []).append(call.table)
        setattr(self, name, call.function)
        return call.function

    def _enter(self, name: str, kernel: Any) -> None:
        """Tells the native functions of a kernel that it is compiled."""
        from armwright.kernels.native_call import enter

        for table in self._waiting.pop(name):
            enter(table, kernel)

    @staticmethod
    def _check_form(name: str, optional: tuple[str, ...], options: dict[str, Any]) -> None:
        """Refuses a kernel, an optional input or an option that the table does not have."""
        if not isinstance(name, str) or name not in SIGNATURES:
            raise ShapeError(place="kernel", value=name, choices=SIGNATURES)
        signature = SIGNATURES[name]
        for kind, names, known in (
            ("optional input", optional, [argument.name for argument in signature.optional]),
            ("option", options, list(signature.options)),
        ):
            for each in names:
                if each not in known:
                    raise ShapeError(place=f"{name}: {kind}", value=each, choices=known)
        for each, value in options.items():
            if not isinstance(value, str):
                raise ShapeError(place=f"{name}: {each}", value=value, expected="a name")

    def bind(self, name: str, *optional: str, lead: tuple[int, ...] = (), options: Any = None, **arrays: Any) -> Any:
        """A kernel with its arrays fixed: a call of it costs little more than the computing, for control loops.

        Args:
            name: of the table.   optional: names of the optional inputs that it takes.
            lead: leading axes of the arrays; () for one state.
            options: keyword arguments of the kernel, such as {"frame": "tool"}.
            arrays: by name, of `dyn.dtype` and contiguous, to use as inputs and outputs; the others are allocated.
                Parameters that vary begin at the record's values.
        Returns:
            bound: `bound.inputs["q"][:] = q; tau = bound()`.
        Raises:
            ShapeError: an unknown name, or an array that does not fit.
        """
        from armwright.kernels.bound import Bound

        wrong = not isinstance(lead, (tuple, list)) or not all(
            isinstance(k, (int, np.integer)) and k >= 0 for k in lead
        )
        if wrong:
            raise ShapeError(place=f"{name}: lead", value=lead, expected="leading axes such as () or (100,)")
        bound = Bound(self.kernel(name, *optional, **(options or {})), tuple(lead), arrays)
        if self.varied is not None and PARAMETERS not in arrays:
            bound.inputs[PARAMETERS][...] = self.varied.nominal
        return bound

    def casadi(self, name: str, *optional: str, **options: Any) -> Any:
        """The kernel's traced function for CasADi, for optimal control: symbols in, symbols out, differentiable.

        Args:
            name: of the table.   optional: names of the optional inputs that it takes.
            options: keyword arguments that are fixed, such as `frame`.
        Returns:
            function: `casadi.Function` with the table's names; vectors are columns, matrices keep their shape.
        Raises:
            ShapeError: no kernel has that name.
            ModelError: the arm lacks what the kernel needs, such as a motor constant or a tip, or has too many joints for it.
        """
        self._check_form(name, optional, options)
        return self._traced(name, optional, options).casadi()


def _again(
    kind: type[CompiledArm], arm: Model, target: str | None, vary: Sequence[str], dtype: str, threads: int
) -> CompiledArm:
    dyn = kind(arm, target, vary, dtype)
    dyn.threads = threads
    return dyn


def _checked(varied: Varied, place: int) -> Callable[[tuple[Any, ...]], None]:
    """Looks at a call's array of parameters, the one at `place`; one that is no array of them the kernel itself refuses.

    An array on a GPU is not looked at: it would have to be waited for and copied.
    """

    def check(arrays: tuple[Any, ...]) -> None:
        from armwright.kernels.batch import as_numbers

        if (
            len(arrays) > place
            and hasattr(arrays[place], "__dlpack_device__")
            and not isinstance(arrays[place], np.ndarray)
        ):
            return
        values = as_numbers(arrays[place], "parameters", PARAMETERS) if len(arrays) > place else np.empty(0)
        if values.shape[-1:] == (len(varied.parameters),):
            varied.check(values)

    return check


@overload
def compile_arm(
    arm: AnyArm,
    target: str | None = None,
    vary: Sequence[str] = (),
    dtype: Literal["float64"] | type[np.float64] | np.dtype[np.float64] = "float64",
    warm: Sequence[str] = (),
) -> CompiledArm[np.float64]: ...


@overload
def compile_arm(
    arm: AnyArm,
    target: str | None = None,
    vary: Sequence[str] = (),
    *,
    dtype: Literal["float32"] | type[np.float32] | np.dtype[np.float32],
    warm: Sequence[str] = (),
) -> CompiledArm[np.float32]: ...


@overload
def compile_arm(
    arm: AnyArm,
    target: str | None = None,
    vary: Sequence[str] = (),
    *,
    dtype: type | np.dtype,
    warm: Sequence[str] = (),
) -> CompiledArm[Any]: ...


@overload
def compile_arm(
    arm: AnyArm,
    target: None = None,
    vary: Sequence[str] = (),
    *,
    dtype: str | type | np.dtype = "float64",
    warm: Sequence[str] = (),
    device: str,
) -> Any: ...  # its methods take and give arrays of CuPy, PyTorch and JAX, which have no type here


def compile_arm(
    arm: AnyArm,
    target: str | None = None,
    vary: Sequence[str] = (),
    dtype: str | type | np.dtype = DOUBLE.name,
    warm: Sequence[str] = (),
    device: str = CPU,
) -> CompiledArm[Any]:
    """Kernels for an arm, compiled when first used.

    Args:
        arm: the model.
        target: a processor level such as "x86-64-v3" to make code for; by default the processor this runs on. One
            program gives the same bits on every target that has fused multiply-add.
        vary: numbers of the record that become inputs, such as "link6.mass_kg" or "joint2.friction.viscous_n_m_s_per_rad".
            Every kernel then takes one more array `parameters` (…, k) behind its own inputs, in the record's units and the
            order of `dyn.varied.names`; values that no record could hold are refused (not in a bound kernel).
        dtype: "float64", or "float32" for twice the lanes. Then arrays are float32 in and out, and the arm's numbers are
            rounded once. Half of all results are within 1 to 9 roundings (6e-8) of their largest entry on the built-in arms, but
            for `operational_inertia`; the worst that were found, where terms cancel or the mass matrix is ill-conditioned, are at
            1600. The documentation has a table by function and arm.
        warm: kernels to compile now, such as ["inverse_dynamics", "mass_matrix"], together and on all cores; `dyn.warm(names)`
            does it later.
        device: "cpu"; or "cuda" for a GPU of NVIDIA ("cuda:1" for the second), with arrays of CuPy, PyTorch or JAX in and out.
            That needs the extra `cuda`, and has the methods, `kernel`, `derivative` and `casadi`, no `target`, `out` and `bind`.
    Returns:
        dyn: the kernels as methods, (…, n) arrays in and out.
    Raises:
        ModelError: no arm, an unknown target, parameter, dtype or device, a target that this processor does not reach, or an arm
            that lacks what a kernel of `warm` needs; no GPU, driver or compiler for it.
        ShapeError: no kernel has a name of `warm`.
    Example:
        >>> dyn = aw.compile("cmu-dd")
        >>> q = np.zeros((1000, 6))  # a thousand states
        >>> dyn.mass_matrix(q).shape
        (1000, 6, 6)
    """
    if device == CPU:
        dyn: CompiledArm[Any] = CompiledArm(as_arm(arm), target, vary, dtype)
    else:
        from armwright.kernels.cuda_arm import CudaArm

        dyn = CudaArm(as_arm(arm), target, vary, dtype, device)
    dyn.warm(warm)
    return dyn

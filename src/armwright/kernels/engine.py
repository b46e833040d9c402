"""Engine: a module's native code in this process, compiled or from the cache, linked, and unmapped when nobody needs it.

Where LLVM has JITLink for the platform, code is position-independent in the *small* code model: constants and functions are
addressed relative to the instruction, ±2 GB. That holds by construction, however full the address space is: JITLink maps a
module in one piece, and reaches what lies elsewhere (libm) through stubs inside that piece. The older linker, MCJIT's, maps
each section where it finds room, so for it code is made in LLVM's *large* model: every address a 64-bit constant in a register.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, ClassVar, Protocol

from llvmlite import binding

from armwright.kernels import cache
from armwright.kernels.object_code import from_another_process, native_machine, object_code
from armwright.kernels.target import LIBM, Target

JITLINK = {"ELF": ("x86_64", "aarch64"), "MachO": ("x86_64", "arm64", "aarch64")}  # format: processors; not on Windows
LIBRARY = "module"  # a linker has one library, of this name
NO_SYMBOLS: Mapping[str, int] = MappingProxyType({})


class Text(Protocol):
    """A module that can be printed as LLVM text."""

    def text(self) -> str:
        """The text."""
        ...


class Engine:
    """Native code of one module. Functions obtained from it must keep it alive: dropping it unmaps the code."""

    def __init__(
        self,
        target: Target,
        build: Callable[..., Text],
        *ingredients: Any,
        symbols: Mapping[str, int] = NO_SYMBOLS,
        other_process: bool = False,
    ):
        """The code of `build(target.width, *ingredients)`, from the cache where it is there.

        Args:
            target: the processor.
            build: a function at the top level of a file of `kernels`; it sees nothing but its arguments.
            ingredients: programs, stages, numbers and strings that it makes the module of.
            symbols: addresses of functions that the code calls beside those of `LIBM`, by name.
            other_process: a long module is compiled in another process, while this one goes on in other threads.
        """
        linked = linker(binding.get_default_triple())
        processor = target.cpu, target.features, linked.CODE
        machine = native_machine(*processor)
        key = cache.key(build, ingredients, linked.__name__, machine.triple, target)
        code = cache.load(key)
        if code is None:
            module = build(target.width, *ingredients)
            code = from_another_process(module.text(), *processor) if other_process else None
            if code is None:
                code = compiled(module, machine)
            cache.store(key, code)
        self._linked = linked(code, machine, symbols)

    def function(self, name: str, *argument_types: type, result: type | None = None):
        """A callable of an exported function; the GIL is released while it runs."""
        bound = ctypes.CFUNCTYPE(result, *argument_types)(self._linked.address(name))
        bound.engine = self  # type: ignore[attr-defined]
        return bound


def compiled(module: Text, machine: binding.TargetMachine) -> bytes:
    """Object code of a module."""
    return object_code(module.text(), machine)


class JitLinked:
    """Object code that JITLink has mapped in one piece of memory; executable as long as this lives."""

    CODE: ClassVar[dict[str, Any]] = {"reloc": "pic", "codemodel": "small"}  # of the target machine

    def __init__(self, code: bytes, machine: binding.TargetMachine, symbols: Mapping[str, int] = NO_SYMBOLS):
        builder = binding.JITLibraryBuilder().add_object_img(code)
        for name in LIBM:
            builder.import_symbol(name, binding.address_of_symbol(name))
        for name, address in symbols.items():
            builder.import_symbol(name, address)
        # A linker each: one that is shared would keep some 10 kB of every module that it has ever seen.
        self._linker = binding.create_lljit_compiler(machine, use_jit_link=True)
        self._parts = [builder.link(self._linker, LIBRARY)]

    def address(self, name: str) -> int:
        """Address of an exported function."""
        functions = self._linker.lookup(LIBRARY, name)
        self._parts.append(functions)  # dropping it would unmap the library
        return functions[name]


class McjitLinked:
    """Object code that MCJIT has mapped, each section where it found room; executable as long as this lives."""

    CODE: ClassVar[dict[str, Any]] = {"jit": True}  # which is the large model

    def __init__(self, code: bytes, machine: binding.TargetMachine, symbols: Mapping[str, int] = NO_SYMBOLS):
        for name, address in symbols.items():
            binding.add_symbol(name, address)
        self._engine = binding.create_mcjit_compiler(binding.parse_assembly(""), machine)
        self._engine.add_object_file(binding.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Address of an exported function."""
        return self._engine.get_function_address(name)


def linker(triple: str) -> type[JitLinked] | type[McjitLinked]:
    """Linker for a platform: JITLink where llvmlite has it, MCJIT elsewhere."""
    processor = triple.split("-")[0]
    return JitLinked if processor in JITLINK.get(binding.get_object_format(triple), ()) else McjitLinked

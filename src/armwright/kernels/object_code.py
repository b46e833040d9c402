"""Object code of LLVM text, made in this process or in another one: llvmlite lets LLVM work on one module at a time.

Run as a program, it reads the processor as a line of JSON, then the text, and writes the code. It imports nothing of Armwright,
so that another process costs little more than starting Python.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from typing import Any

from llvmlite import binding

WORTH = 200_000  # characters, some 0.2 s: shorter text is compiled sooner than another Python has started


def native_machine(cpu: str, features: str, options: Mapping[str, Any]) -> binding.TargetMachine:
    """The machine that makes code for a processor; `options`: of the linker that the code is for."""
    return binding.Target.from_default_triple().create_target_machine(cpu=cpu, features=features, opt=3, **options)


def object_code(text: str, machine: binding.TargetMachine) -> bytes:
    """Object code of a module's text."""
    parsed = binding.parse_assembly(text)
    parsed.triple = machine.triple  # both before the passes run, which crash without
    parsed.data_layout = str(machine.target_data)
    # Our text has been simplified already, its functions are not to be inlined and its lanes are vectors: of LLVM's usual passes
    # these few give code of the same speed in a tenth of the time.
    passes = binding.create_new_module_pass_manager()
    passes.add_sroa_pass()
    passes.add_instruction_combine_pass()  # folds shuffles of tiles, and addresses
    passes.add_simplify_cfg_pass()
    options = binding.create_pipeline_tuning_options(speed_level=1)
    passes.run(parsed, binding.create_pass_builder(machine, options))
    return machine.emit_object(parsed)


def from_another_process(text: str, cpu: str, features: str, options: Mapping[str, Any]) -> bytes | None:
    """The same code from a process of its own; None where text is short, or where no such process can be run."""
    if len(text) < WORTH or not sys.executable or getattr(sys, "frozen", False):  # then it is no Python
        return None
    job = json.dumps([cpu, features, dict(options)]) + "\n" + text
    try:
        done = subprocess.run(
            [sys.executable, "-P", __file__],
            input=job.encode(),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout or None


def main() -> None:
    """One job."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    machine = native_machine(*json.loads(sys.stdin.buffer.readline()))
    sys.stdout.buffer.write(object_code(sys.stdin.buffer.read().decode(), machine))


if __name__ == "__main__":
    main()

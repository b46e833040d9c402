"""A Cortex-M board without hardware: programs linked for QEMU's MPS2 boards, which print and end by semihosting."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from kernels.c_compilers import CORTEX_M7, build, compiler

CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")
BOARDS = {"mps2-an500": CORTEX_M7, "mps2-an386": CORTEX_M4}  # QEMU's name, and the processor that is on it

_START = """\
#include <stdint.h>
extern void _start(void); /* newlib's, which asks for arguments, calls main and hands its result to the host */
extern uint32_t top_of_stack[];
void reset(void);
void reset(void)
{
    volatile uint32_t *const coprocessors = (volatile uint32_t *)0xE000ED88u; /* CPACR: no floating point after reset */
    *coprocessors |= 0xFu << 20;
    __asm volatile("dsb\\n isb");
    _start();
}
__attribute__((section(".vectors"), used)) const struct {
    uint32_t *stack;
    void (*reset)(void);
} vectors = {top_of_stack, reset};
"""

_MEMORY = """\
MEMORY { CODE (rx) : ORIGIN = 0x00000000, LENGTH = 4M  DATA (rwx) : ORIGIN = 0x20000000, LENGTH = 4M }
ENTRY(reset)
SECTIONS {
  .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) KEEP(*(.init)) KEEP(*(.fini)) . = ALIGN(8); } > CODE
  .ARM.exidx : { *(.ARM.exidx*) } > CODE
  .data : { *(.data*) . = ALIGN(8); } > DATA
  .bss : { __bss_start__ = .; *(.bss*) *(COMMON) . = ALIGN(8); __bss_end__ = .; end = .; __end__ = .; } > DATA
  top_of_stack = ORIGIN(DATA) + LENGTH(DATA);
}
"""


# Hooks of a controller's self-test: QEMU's -icount makes an instruction one nanosecond, SysTick counts every 40 of them.
_METER = """\
#include <stdint.h>
#include <stdio.h>
#define METER_CSR (*(volatile uint32_t *)0xE000E010u)
#define METER_RVR (*(volatile uint32_t *)0xE000E014u)
#define METER_CVR (*(volatile uint32_t *)0xE000E018u)
#define METER_WORDS 16384
static uint32_t meter_began, meter_steps, meter_stack;
static uint64_t meter_ticks;
static __attribute__((noinline)) uint32_t meter_painted(int paint)
{
    volatile uint32_t words[METER_WORDS]; /* where the step's stack will be, or was */
    uint32_t k = 0u;
    if (paint) {
        for (k = 0u; k < METER_WORDS; k++) {
            words[k] = 0xA5A5A5A5u;
        }
        return 0u;
    }
    while ((k < METER_WORDS) && (words[k] == 0xA5A5A5A5u)) {
        k++;
    }
    return 4u * (METER_WORDS - k);
}
static void meter_before(void)
{
    (void)meter_painted(1);
    METER_RVR = 0xFFFFFFu;
    METER_CSR = 5u;
    METER_CVR = 0u;
    meter_began = METER_CVR;
}
static void meter_after(void)
{
    const uint32_t now = METER_CVR;
    uint32_t used;
    meter_ticks += (meter_began - now) & 0xFFFFFFu;
    meter_steps++;
    used = meter_painted(0);
    meter_stack = used > meter_stack ? used : meter_stack;
    if (meter_steps == METER_STEPS) {
        printf("%-32s %lu instructions a step, %lu bytes of stack\\n", "meter",
            (unsigned long)(40u * meter_ticks / meter_steps), (unsigned long)meter_stack);
    }
}
"""


def meter(name: str, steps: int, folder: Path) -> list[str]:
    """Flags with which the self-test of a controller also prints the instructions of a step and its stack."""
    (folder / "meter.h").write_text(_METER, encoding="ascii")
    hooks = [f"-D{name.upper()}_SELFTEST_{when.upper()}=meter_{when}()" for when in ("before", "after")]
    return [*hooks, f"-DMETER_STEPS={steps}", "-include", str(folder / "meter.h"), "-Wno-unused-function"]


def run_on_board(
    board: str, sources: Sequence[Path], folder: Path, *flags: str, emulator: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    """Compiles a program for a board and runs it there; skips the test where compiler, newlib or QEMU is missing."""
    gcc, qemu = compiler("arm-none-eabi-gcc"), compiler("qemu-system-arm")
    asked = subprocess.run([gcc, "-print-file-name=rdimon.specs"], capture_output=True, text=True)
    if "/" not in asked.stdout:
        pytest.skip("newlib for arm-none-eabi is not installed")
    (folder / "start.c").write_text(_START, encoding="ascii")
    (folder / "board.ld").write_text(_MEMORY, encoding="ascii")
    program = folder / "program.elf"
    files = (*sources, folder / "start.c", "-T", folder / "board.ld", "-o", program, "-lm")
    build([gcc, "-std=c99", "-O2", *BOARDS[board], "-ffp-contract=off", *flags, "--specs=rdimon.specs", *files])
    semihosting = ("-nographic", "-semihosting-config", "enable=on,target=native")
    return subprocess.run(
        [qemu, "-M", board, *semihosting, *emulator, "-kernel", program], capture_output=True, text=True, timeout=60
    )

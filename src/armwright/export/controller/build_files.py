"""Files beside an exported controller: CMakeLists.txt and README.md."""

from __future__ import annotations

from armwright.export.controller.stages import ControllerStages

_CMAKE = """\
cmake_minimum_required(VERSION 3.13)
project({name} C)
include(CheckCCompilerFlag)

add_library({name} STATIC {name}.c)
target_include_directories({name} PUBLIC ${{CMAKE_CURRENT_SOURCE_DIR}})
set_target_properties({name} PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON)
target_compile_options({name} PRIVATE -O2 -ffp-contract=off)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|amd64)$")
  check_c_compiler_flag(-mfma HAS_FMA)
  if(HAS_FMA)
    target_compile_options({name} PRIVATE -mfma)
  endif()
endif()
target_link_libraries({name} PUBLIC m)

enable_testing()
add_executable({name}_selftest {name}_selftest.c)
set_target_properties({name}_selftest PROPERTIES C_STANDARD 99 C_STANDARD_REQUIRED ON)
target_link_libraries({name}_selftest PRIVATE {name})
add_test(NAME {name}_selftest COMMAND {name}_selftest)
"""

_README = """\
# {name}

The controller `{law}` of `{arm}`, one step every {period:g} ms, as C99. Made by Armwright from a scenario: do not edit it,
make it again. `{name}.h` has every struct with its units, `{name}.c` the code, and `{name}_selftest.c` inputs that were
recorded in the simulation, with the commands that {gave}.

```c
#include "{name}.h"

static {name}_state state;
{name}_measurement measurement = {{0}};
{name}_reference reference = {{0}};
{name}_command command = {{{{0.0}}}};

/* once: fill `measurement`, and `command` with what is in force */
{name}_init(&state, &{name}_default_parameters, &measurement, &command);

/* every {period:g} ms: fill `measurement` and `reference` */
uint32_t status = {name}_step(&state, &{name}_default_parameters, &reference, &measurement, &command);
/* give `command.u` to the drives */
```

The code allocates nothing, does not recurse, and takes the same way through every step but for checks. It keeps no state but in
`{name}_state`: several controllers may run side by side.

## Compile and test it

    gcc -std=c99 -O2 -mfma -ffp-contract=off {name}.c {name}_selftest.c -o selftest -lm && ./selftest

    cmake -B build && cmake --build build && ctest --test-dir build

`-mfma` is for x86 alone. Other processors need no such option where they fuse multiplication and addition in hardware, as a
Cortex-M7 with `-mfpu=fpv5-d16`, or in float a Cortex-M4 with `-mfpu=fpv4-sp-d16`. Never compile with `-ffast-math`. Run the
self-test once with the options of your firmware: it compares {ticks} steps to the bit, and ends with 0 if all are met.

## What it does in a step

1. A sample with `measurement.lost` set is replaced by the last one that arrived; `measurement.applied`, what the drives did
   in the last period, is always read.
2. The controller, in the time `state.tick` x {period:g} ms, and then the rate limit, limit and resolution of the command.
3. If an input that the controller reads, its state or the command is infinite or not a number, nothing of the step is kept: the
   controller's state stays, but for its counters of ticks, the last command is repeated, and the status word says `NOT_FINITE`.

Delays of the bus, jitter and losses of commands were simulated, and are no part of this code.

The tick counts steps since `{name}_init`; a step that is left out makes the controller's time stand still. {time}
`{name}_init` begins with the controller's state as the simulation does, from a measurement and the command in force;
a command that is infinite or not a number is taken as 0, and `state.status` then says `NOT_FINITE`. `{name}_reset` takes the
last command of this controller for that. Integrators then begin anew. `{name}_take_over` begins without a jump: its first
command is the one in force, and what the controller would have commanded differently goes away evenly over so many ticks.

`{name}.parameters` has the numbers of `{name}_default_parameters` with a checksum. `{name}_load` reads such a file from memory
into parameters of yours, and refuses a damaged one, one of another controller, numbers that are not finite and limits below 0.

Define `{macro}_WATCHDOG(state)` when you compile `{name}.c` to serve a watchdog at the end of every step, for instance
`-D'{macro}_WATCHDOG(state)=serve_watchdog((state)->status, (state)->lost)'` with a declaration included by `-include`.
"""


def cmake(name: str) -> str:
    """The text of CMakeLists.txt: a library, its self-test, and the test that runs it."""
    return _CMAKE.format(name=name)


def readme(stages: ControllerStages, ticks: int, real: str) -> str:
    """The text of README.md; `ticks` is the number of ticks of the self-test."""
    words = {"name": stages.name, "macro": stages.name.upper(), "law": stages.loop.controller.name}
    words["gave"] = {"double": "it gave", "float": "this code gives in single precision"}[real]
    last = stages.ticks_of_time(real)
    words["time"] = (
        "The controller does not read the time."
        if last is None
        else (
            f"The controller reads the time, right to 1 µs for {last * stages.period:.4g} s; then the status word says `TIME`."
        )
    )
    return _README.format(**words, arm=stages.arm.name, period=stages.period * 1e3, ticks=ticks)

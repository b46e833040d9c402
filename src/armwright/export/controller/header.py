"""Header of an exported controller: its functions, and structs made from the layouts of the loop's signals."""

from __future__ import annotations

from collections.abc import Sequence

from armwright.export.c_arithmetic import FAULTS
from armwright.export.c_header import comment, plain
from armwright.export.controller.parameters import declared, struct_lines
from armwright.export.controller.stages import ControllerStages
from armwright.kernels.c import REALS
from armwright.kernels.c_syntax import identifier, literal
from armwright.signals import Layout, Signal

#: Bits of the status word, in their order, and what they mean.
STATUS = {
    "SATURATED": "a command asks for its limit or more, or changes faster than its rate",
    "OUT_OF_RANGE": "a measured or wanted position or speed is beyond the limits of its joint",
    "NOT_FINITE": "an input that the controller reads, or a result, was infinite or not a number: the step only counted its tick",
    "LOST": "the sample was lost: the last one that arrived took its place",
    "TIME": "the controller reads the time, which is wrong by more than 1 us by now",
}

_FUNCTIONS = """\
{begin}
void {name}_init({name}_state *state, const {name}_parameters *parameters,
    const {name}_measurement *measurement, const {name}_command *in_force);

{reset}
void {name}_reset({name}_state *state, const {name}_parameters *parameters,
    const {name}_measurement *measurement);

{take_over}
void {name}_take_over({name}_state *state, const {name}_parameters *parameters,
    const {name}_reference *reference, const {name}_measurement *measurement,
    const {name}_command *in_force, uint32_t ticks);

{step}
uint32_t {name}_step({name}_state *state, const {name}_parameters *parameters,
    const {name}_reference *reference, const {name}_measurement *measurement, {name}_command *command);

{arithmetic}
int {name}_arithmetic(void);"""


def header(stages: ControllerStages, real: str) -> str:
    """The header's text."""
    name, guard = stages.name, f"{stages.name.upper()}_H"
    joints = stages.arm.names
    parts = [
        comment(_top(stages, real)),
        f"#ifndef {guard}\n#define {guard}",
        "#include <stdint.h>",
        '#ifdef __cplusplus\nextern "C" {\n#endif',
        f"#define {guard[:-1]}JOINTS {stages.arm.n}\n#define {guard[:-1]}PERIOD {literal(stages.period, REALS[real])} /* [s] */",
        _status(guard[:-1]),
        *_time(stages, real),
        _struct(name, "measurement", _measurement(stages, real, joints)),
        _struct(name, "reference", members(stages.reference, real, joints)),
        _struct(name, "command", members(stages.command, real, joints)),
        _struct(name, "parameters", struct_lines(stages, real)),
        f"/* The numbers of the scenario. */\nextern const {name}_parameters {name}_default_parameters;",
        declared(stages, real),
        _struct(name, "state", _state(stages, real)),
        _functions(name),
        "#ifdef __cplusplus\n}\n#endif",
        "#endif",
    ]
    return "\n\n".join(parts) + "\n"


def _top(stages: ControllerStages, real: str) -> list[str]:
    law = stages.loop.controller.name
    bits = {
        "double": "the bits of the simulation, where fma() rounds once",
        "float": "the simulation's, in single precision",
    }
    return [
        f"The controller {law!r} of {stages.arm.name}, every {stages.period * 1e3:g} ms: {bits[real]}.",
        "",
        "Made by Armwright from a scenario; do not edit, make it again. README.md says how it is used and compiled.",
        "",
        "Joints, in the order of every array over joints:",
        *(f"  [{k}] {joint}" for k, joint in enumerate(stages.arm.names)),
    ]


def _status(macro: str) -> str:
    """Macros of the status word's bits."""
    width = max(map(len, STATUS))
    lines = [f"#define {macro}{name:{width}} {1 << k}u /* {text} */" for k, (name, text) in enumerate(STATUS.items())]
    return "\n".join(["/* Bits of the status word; 0: nothing to report. */", *lines])


def _time(stages: ControllerStages, real: str) -> list[str]:
    """The macro with the tick up to which the controller's time is right, if the controller reads it."""
    last = stages.ticks_of_time(real)
    if last is None:
        return []
    about = f"/* The last tick whose time, {last * stages.period:.4g} s, the controller has to within 1 us. */"
    return [f"{about}\n#define {stages.name.upper()}_TIME_TICKS UINT64_C({last})"]


def _struct(name: str, kind: str, lines: Sequence[str]) -> str:
    body = "\n".join(f"    {line}" for line in lines)
    return f"typedef struct {{\n{body}\n}} {name}_{kind};"


def member(signal: Signal) -> str:
    """The name of a signal's member of a struct."""
    return identifier(signal.name)


def members(layout: Layout, real: str, joints: Sequence[str]) -> list[str]:
    """Struct members, one for each signal, with unit and meaning."""
    rows = []
    for signal in layout:
        sizes = "".join(f"[{size}]" for size in signal.shape)
        known = signal.joints is not None and len(signal.joints) < len(joints)
        whose = f", of {', '.join(joints[j] for j in signal.joints or ())}" if known else ""
        labels = f": {', '.join(signal.labels)}" if signal.labels else ""
        rows.append(
            f"{real} {member(signal)}{sizes}; /* [{plain(signal.unit)}] {plain(signal.about + whose + labels)} */"
        )
    return rows


def _measurement(stages: ControllerStages, real: str, joints: Sequence[str]) -> list[str]:
    rows = zip(stages.measured, members(stages.measured, real, joints), strict=True)
    return [
        "int32_t lost; /* not 0: the sample did not arrive; then only what the drives applied is read of this struct */",
        *(_counts(stages) if in_counts(stages, signal) else member_line for signal, member_line in rows),
        *members(stages.applied, real, joints),
    ]


def in_counts(stages: ControllerStages, signal: Signal) -> bool:
    """True if measured positions are passed as encoder counts."""
    return signal.name == "q" and stages.count.size > 0


def _counts(stages: ControllerStages) -> str:
    """The member for encoder counts in place of measured positions."""
    return f"int32_t counts[{stages.arm.n}]; /* [1] counts of the encoders in the joints' sense, 0 at position 0 */"


def _state(stages: ControllerStages, real: str) -> list[str]:
    n, states = stages.arm.n, stages.law.outputs[1].size
    return [
        "uint64_t tick; /* of the step that comes next: its time is tick * period; at 1 kHz it lasts 500 million years */",
        "uint32_t lost; /* samples that were lost one after another */",
        "uint32_t status; /* of the last step */",
        *(
            [f"{real} law[{states}]; /* the controller's own: integrators, filters, commands on their way */"]
            if states
            else []
        ),
        *(
            [f"{real} measured[{stages.measured.size}]; /* the last sample that arrived */"]
            if stages.measured.size
            else []
        ),
        f"{real} issued[{n}]; /* the last command */",
        "uint32_t bridge_ticks; /* in which it takes over from another controller; 0: it does not */",
        f"{real} bridge[{n}]; /* what it adds to its first command for that */",
        *([f"{real} kept[{n}]; /* the same before it was rounded, for the rate limit */"] if stages.remembers else []),
    ]


def _functions(name: str) -> str:
    macro = name.upper()
    texts = {
        "begin": [
            "Begins at tick 0 from a measurement, whose `lost` is not read, and the command that is in force, from which the",
            "rate limit starts. What is infinite or not a number in that command is taken as 0, and state->status says so;",
            "it does so, too, where the controller cannot begin from such a measurement: then begin again with another one.",
        ],
        "reset": [
            "Begins anew at tick 0, as init does, from the last command that this controller issued. Behind a fault, or when",
            "another controller hands back, call init with the command then in force instead.",
        ],
        "take_over": [
            "Begins as init does, without a jump: the first command is the one in force, up to rounding. The difference",
            "from the controller's own is added to its commands, less in every tick, and nothing of it from tick `ticks` on.",
        ],
        "step": [
            "One tick: the command, and the status word. To be called once a period.",
            "",
            f"At its end {macro}_WATCHDOG(state) is expanded, nothing by default: define it for the C file to serve a watchdog",
            "and to react to state->status and state->lost.",
        ],
        "arithmetic": ["0 if the C file was compiled by the rules of IEEE 754; else what breaks them:", ""]
        + [f"  {value}  {meaning}" for value, meaning in enumerate(FAULTS)],
    }
    return _FUNCTIONS.format(name=name, **{key: comment(lines) for key, lines in texts.items()})

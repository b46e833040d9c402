"""C file of an exported controller: the loop's programs, printed like kernels, and a step function that calls them.

Blocks of the loop's stages become members of the state, of the parameters, or arrays of the step.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from armwright.export.c_arithmetic import arithmetic
from armwright.export.c_header import comment
from armwright.export.controller.header import in_counts, member
from armwright.export.controller.parameters import default_parameters, gain_members, loading
from armwright.export.controller.stages import ControllerStages, inputs_read
from armwright.kernels.c import REALS, Unit, c_text
from armwright.kernels.c_syntax import literal
from armwright.kernels.stages import NEXT
from armwright.program import Program
from armwright.signals import Layout

_CHECKS = """\
/* 1 if all numbers are finite. */
static int {name}_finite(const {real} *values, int count)
{{
    int k, finite = 1;
    for (k = 0; k < count; k++) {{
        if (!(fabs{f}(values[k]) <= {largest})) {{
            finite = 0;
        }}
    }}
    return finite;
}}

/* 1 if a number is outside of its limits. */
static int {name}_outside(const {real} *values, const {real} *low, const {real} *high, int count)
{{
    int k, outside = 0;
    for (k = 0; k < count; k++) {{
        if ((values[k] < low[k]) || (values[k] > high[k])) {{
            outside = 1;
        }}
    }}
    return outside;
}}

/* 1 if the magnitude of a number is at its limit or beyond. */
static int {name}_reaches(const {real} *values, const {real} *limits, int count)
{{
    int k, reaches = 0;
    for (k = 0; k < count; k++) {{
        if (fabs{f}(values[k]) >= limits[k]) {{
            reaches = 1;
        }}
    }}
    return reaches;
}}"""

_INIT = """\
void {name}_init({name}_state *state, const {name}_parameters *parameters,
    const {name}_measurement *measurement, const {name}_command *in_force)
{{
{arrays}
    int k;
    state->tick = 0u;
    state->lost = 0u;
    state->status = 0u;
    for (k = 0; k < {n}; k++) {{
        state->issued[k] = in_force->u[k];
        if ({name}_finite(&in_force->u[k], 1) == 0) {{
            state->issued[k] = {zero}; /* which is within every limit */
            state->status = {macro}_NOT_FINITE;
        }}
    }}
    state->bridge_ticks = 0u;
    memset(state->bridge, 0, sizeof state->bridge);
{gather}
{calls}
{end}
}}

void {name}_reset({name}_state *state, const {name}_parameters *parameters,
    const {name}_measurement *measurement)
{{
    {name}_command in_force;
    memcpy(in_force.u, state->issued, sizeof in_force.u);
    {name}_init(state, parameters, measurement, &in_force);
}}"""

_TAKE_OVER = """\
/* The share of the bridge that was added to the command `back` ticks ago. */
static {real} {name}_bridged(const {name}_state *state, uint32_t back)
{{
    const uint64_t tick = state->tick - back;
    return ((state->tick < back) || (tick >= state->bridge_ticks))
        ? {zero} : ({real})(state->bridge_ticks - tick) / ({real})state->bridge_ticks;
}}

void {name}_take_over({name}_state *state, const {name}_parameters *parameters,
    const {name}_reference *reference, const {name}_measurement *measurement,
    const {name}_command *in_force, uint32_t ticks)
{{
    {name}_state next;
    const {real} tick[1] = {{{zero}}};
{arrays}
    {name}_init(state, parameters, measurement, in_force);
    next = *state;
{reference}
{gather}
{law}
    if ({name}_finite(u_asked, {n}) != 0) {{
        int k;
        state->bridge_ticks = ticks;
        for (k = 0; k < {n}; k++) {{
            state->bridge[k] = state->issued[k] - u_asked[k];
        }}
    }}
}}"""

_STEP = """\
uint32_t {name}_step({name}_state *state, const {name}_parameters *parameters,
    const {name}_reference *reference, const {name}_measurement *measurement, {name}_command *command)
{{
    {name}_state next = *state;
    const {real} tick[1] = {{{time}}};
{arrays}
    uint32_t status = {status};
    int finite;
{reference}
    if (measurement->lost != 0) {{
        status |= {macro}_LOST;
        next.lost += (next.lost < UINT32_MAX) ? 1u : 0u;
    }} else {{
        next.lost = 0u;
{arrived}
    }}
{gather}
    if (state->bridge_ticks > 0u) {{
        int k;
        for (k = 0; k < {n}; k++) {{
            y[{applied} + k] -= state->bridge[k] * {name}_bridged(state, {back}u); /* the controller is to see its own command */
        }}
    }}
{law}
    if (state->bridge_ticks > 0u) {{
        int k;
        for (k = 0; k < {n}; k++) {{
            u_asked[k] += state->bridge[k] * {name}_bridged(state, 0u);
        }}
    }}
{shape}
{finite}
    if (finite != 0) {{
{judge}
        *state = next;
    }} else {{
        status |= {macro}_NOT_FINITE;
        state->lost = next.lost;{counters}
    }}
    state->tick++;
    state->status = status;
    memcpy(command->u, state->issued, sizeof command->u);
    {macro}_WATCHDOG(state);
    return status;
}}"""


def source(stages: ControllerStages, real: str) -> str:
    """The C file's text."""
    name, dialect = stages.name, REALS[real]
    unit = Unit(dialect, f"{name}_")
    for program in (stages.begin, stages.law, stages.shape):
        if not any(port.size for port in program.outputs):
            continue  # a controller that remembers nothing
        unit.add_function(program, f"{name}_{program.name}")
    unit.functions[f"{name}_arithmetic"] = arithmetic(name, real)
    words = {"name": name, "macro": name.upper(), "real": real, "f": dialect.format.suffix}
    largest = f"{'FLT' if dialect.format.suffix else 'DBL'}_MAX"
    unit.functions["checks"] = _CHECKS.format(**words, largest=largest)
    unit.functions["parameters"] = default_parameters(stages, real)
    unit.functions["load"] = loading(stages, real)
    words |= {"n": str(stages.arm.n), "zero": literal(0.0, dialect)}
    unit.functions["init"] = _INIT.format(**words, **_init(stages, real))
    step = _step(stages, real)
    unit.functions["take over"] = _TAKE_OVER.format(**words, **step)
    unit.functions["step"] = _STEP.format(
        **words, **step, **_time(stages, real), applied=stages.measured.size, back=stages.delay_ticks + 1
    )
    hook = f"#ifndef {name.upper()}_WATCHDOG\n#define {name.upper()}_WATCHDOG(state) ((void)(state))\n#endif\n"
    top = comment([f"{name}.c: see {name}.h, and README.md, which says how this is compiled."])
    text = c_text(unit, [f'"{name}.h"', "<string.h>"])
    return f"{top}\n\n{hook}\n{text}"


def copies(layout: Layout, struct: str, flat: str, first: int = 0, *, into: bool = False) -> list[str]:
    """Statements that copy a struct's members into entries of a flat array, or, `into`, the array into the struct."""
    lines = []
    for signal in layout:
        place, value = f"{flat}[{first + layout.place(signal.name).start}]", f"{struct}{member(signal)}"
        if not signal.shape:
            lines.append(f"{value} = {place};" if into else f"{place} = {value};")
        elif signal.size:
            pair = (value, f"&{place}") if into else (f"&{place}", value)
            lines.append(f"memcpy({', '.join(pair)}, sizeof {value});")
    return lines


def measured_copies(stages: ControllerStages, real: str, flat: str, first: int = 0, *, into: bool = False) -> list[str]:
    """Statements as of `copies` for a measurement; encoder counts become positions."""
    lines: list[str] = []
    for signal in stages.measured:
        if not in_counts(stages, signal):
            lines += copies(
                Layout((signal,)), "measurement->", flat, first + stages.measured.place(signal.name).start, into=into
            )
            continue
        for k, place in enumerate(range(stages.measured.place("q").start, stages.measured.place("q").stop)):
            count, value = f"measurement->counts[{k}]", f"{flat}[{first + place}]"
            if into:
                lines.append(f"{count} = (int32_t){value};")
            else:
                lines.append(f"{value} = ({real}){count} * parameters->count[{k}];")
    return lines


def _call(name: str, program: Program, places: Mapping[str, str]) -> str:
    """A program called on the places of its blocks."""
    arrays = [places[port.name] for port in (*program.inputs, *program.outputs) if port.size]
    return f"{name}_{program.name}({', '.join(arrays)});"


def _indented(lines: Iterable[str], depth: int = 1) -> str:
    return "\n".join("    " * depth + line for line in lines)


def _gains(stages: ControllerStages, real: str) -> tuple[list[str], list[str]]:
    """The array of the controller's open fields, and the statements that fill it from the parameters."""
    size, first, lines = stages.gains.values.shape[1], 0, []
    for row in gain_members(stages):
        value = f"parameters->{row.name}"
        lines.append(f"memcpy(&c[{first}], {value}, sizeof {value});" if row.shape else f"c[{first}] = {value};")
        first += row.values.size
    return ([f"{real} c[{size}];"] if size else []), lines


def _init(stages: ControllerStages, real: str) -> dict[str, str]:
    """Parts of the text of `init`."""
    arrays, gains = _gains(stages, real)
    measured = stages.measured.size
    reads = stages.begin.outputs[0].size > 0
    filled = measured_copies(stages, real, "state->measured")
    total = measured + stages.applied.size
    if reads:
        arrays = [f"{real} y[{total}];", *arrays]
        filled += ["memcpy(y, state->measured, sizeof state->measured);"] if measured else []
        filled += copies(stages.applied, "measurement->", "y", measured) + gains
    else:
        arrays = []
    unread = [] if (reads and gains) or stages.count.size else ["(void)parameters;"]
    call = [_call(stages.name, stages.begin, {"y": "y", "c": "c", "s": "state->law"})] if reads else []
    kept = ["memcpy(state->kept, state->issued, sizeof state->kept);"] if stages.remembers else []
    if reads:
        bit, states = f"{stages.name.upper()}_NOT_FINITE", stages.begin.outputs[0].size
        kept.append(f"state->status |= ({stages.name}_finite(state->law, {states}) != 0) ? 0u : {bit};")
    parts = {"arrays": arrays, "gather": filled, "calls": [*unread, *call], "end": kept}
    return {key: _indented(lines) for key, lines in parts.items()}


def _time(stages: ControllerStages, real: str) -> dict[str, str]:
    """Parts of the text of `step` that depend on the tick: a controller that does not read it gets none."""
    last, macro = stages.ticks_of_time(real), stages.name.upper()
    if last is None:
        return {"time": literal(0.0, REALS[real]), "status": "0u"}
    return {"time": f"({real})state->tick", "status": f"(state->tick > {macro}_TIME_TICKS) ? {macro}_TIME : 0u"}


def _step(stages: ControllerStages, real: str) -> dict[str, str]:
    """Parts of the text of `step`."""
    n, measured, size = stages.arm.n, stages.measured.size, stages.reference.size
    total = measured + stages.applied.size
    arrays, gains = _gains(stages, real)
    arrays = [f"{real} r[{size}];", f"{real} y[{total}];", *arrays, f"{real} u_asked[{n}];"]
    remembers = stages.remembers
    places = {"tick": "tick", "r": "r", "y": "y", "c": "c", "s": "state->law", f"s{NEXT}": "next.law"}
    places |= {"u_asked": "u_asked", "u_issued": "state->issued", "u_kept": "state->kept"}
    places |= {"u": "next.issued", f"u_issued{NEXT}": "next.issued", f"u_kept{NEXT}": "next.kept"}
    results = [("next.law", stages.law.outputs[1].size), ("next.issued", n), ("u_asked", n)]
    finite = [*_read(stages.law, "r"), *_read(stages.law, "y"), *results]
    calls = [f"({stages.name}_finite({array}, {count}) != 0)" for array, count in finite if count]
    texts = {
        "arrays": arrays,
        "reference": copies(stages.reference, "reference->", "r"),
        "gather": [
            *(["memcpy(y, next.measured, sizeof next.measured);"] if measured else []),
            *copies(stages.applied, "measurement->", "y", measured),
            *gains,
        ],
        "law": [_call(stages.name, stages.law, places)],
        "shape": [_call(stages.name, stages.shape, places)],
        "finite": ["finite = " + "\n        && ".join(calls) + ";"],
    }
    arrived = measured_copies(stages, real, "next.measured")
    counted = [f"\n        state->law[{entry}] = next.law[{entry}]; /* counts ticks */" for entry in stages.counters]
    return {key: _indented(lines) for key, lines in texts.items()} | {
        "arrived": _indented(arrived, 2),
        "counters": "".join(counted),
        "judge": _indented(_judged(stages, remembers=remembers), 2),
    }


def _read(program: Program, block: str) -> list[tuple[str, int]]:
    """Runs of entries of an input that a program reads: where each begins in C, and its length.

    Others may be NaN: the current of a motor whose torque constant the record does not have.
    """
    entries = inputs_read(program, block)
    begins = [entry for entry in entries if entry - 1 not in entries]
    ends = [entry + 1 for entry in entries if entry + 1 not in entries]
    return [(f"&{block}[{begin}]", end - begin) for begin, end in zip(begins, ends, strict=True)]


def _judged(stages: ControllerStages, *, remembers: bool) -> list[str]:
    """Statements that set the bits of the status word."""
    name, macro, n = stages.name, stages.name.upper(), stages.arm.n
    saturated = [f"({name}_reaches(u_asked, parameters->command_limit, {n}) != 0)"]
    if remembers:
        saturated.append(f"({name}_outside(u_asked, next.kept, next.kept, {n}) != 0)")
    outside = []
    for layout, flat in ((stages.measured, "y"), (stages.reference, "r")):
        for signal, call in (
            ("q", "{name}_outside(&{flat}[{k}], parameters->position_low, parameters->position_high, {n})"),
            ("qd", "{name}_reaches(&{flat}[{k}], parameters->velocity, {n})"),
        ):
            if signal in layout and layout[signal].shape == (n,):
                text = call.format(name=name, flat=flat, k=layout.place(signal).start, n=n)
                outside.append(f"({text} != 0)")
    lines = [f"if ({' || '.join(saturated)}) {{", f"    status |= {macro}_SATURATED;", "}"]
    if outside:
        lines += [f"if ({' || '.join(outside)}) {{", f"    status |= {macro}_OUT_OF_RANGE;", "}"]
    return lines

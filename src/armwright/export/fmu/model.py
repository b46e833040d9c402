"""C code of an FMU's model: its state struct, its table of variables, and the functions called by the FMI layer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from armwright.errors import ScenarioError
from armwright.export.fmu.sampled import SampledModel
from armwright.export.fmu.variables import FmuVariable
from armwright.kernels.c import Unit, c_text
from armwright.kernels.c_loop import LoopText
from armwright.kernels.c_syntax import C_DOUBLE, identifier, literal

LARGEST = 4_000_000  # bytes of a state, which tools copy to go back in time
KINDS = {"input": "INPUT", "output": "COMPUTED", "local": "COMPUTED", "fixed": "FIXED", "tunable": "INPUT"}

_HEADER = """\
/* The model of an FMU made by Armwright: do not edit it, make it again. */
#ifndef MODEL_H
#define MODEL_H

#include <stddef.h>
#include <stdint.h>

#define MODEL_TOKEN "{token}"
#define MODEL_SAMPLED {sampled} /* 1: co-simulation, 0: model exchange */
#define MODEL_INTERFACE "{interface}"
#define MODEL_VARIABLES {count}u /* value references begin with 1; 0 is the time */
{constants}

/* Everything that changes; no pointers in it. */
typedef struct {{
{members}
}} model_state;

enum {{ COMPUTED, INPUT, FIXED, STATE }}; /* FIXED: until initialisation ends; STATE: from then on */

/* Where a variable's value is, and how it is set; of model exchange, its places among knowns and unknowns of derivatives. */
typedef struct {{
    size_t offset;
    int kind;
    int32_t known, unknown;
}} model_variable;

extern const model_variable model_variables[];

void model_create(model_state *l);
void model_begin(model_state *l);
{functions}

#endif
"""

CREATE = """\
static const model_state model_first = {{
{rows}
}};

void model_create(model_state *l)
{{
    *l = model_first;
}}"""


def model_header(
    token: str, variables: Sequence[FmuVariable], members: Iterable[str], constants: Mapping[str, str], functions: str
) -> str:
    """The text of model.h.

    Args:
        token: of this FMU.   variables: all but time.   members: of the struct.   constants: macros by name.
        functions: declarations of what this kind of model has beside the two that all have.
    """
    return _HEADER.format(
        token=token,
        sampled=int("MODEL_PERIOD" in constants),
        interface="co-simulation" if "MODEL_PERIOD" in constants else "model exchange",
        count=len(variables),
        constants="\n".join(f"#define {name} {value}" for name, value in constants.items()),
        members="\n".join(f"    {line}" for line in members),
        functions=functions,
    )


def variable_table(
    variables: Sequence[FmuVariable], known: Mapping[str, int] | None = None, unknown: Mapping[str, int] | None = None
) -> str:
    """The table of variables, by value reference.

    Args:
        variables: all but time.   known, unknown: places in the vectors of directional derivatives, by name.
    """
    rows = ["    {0, COMPUTED, -1, -1},"]
    for each in variables:
        kind = KINDS[each.variability if each.causality == "parameter" else each.causality]
        kind = "STATE" if each.state else kind
        offset = f"offsetof(model_state, {each.member}) + {each.entry} * sizeof(double)"
        places = [(where or {}).get(each.name, -1) for where in (known, unknown)]
        rows.append(f"    {{{offset}, {kind}, {places[0]}, {places[1]}}},")
    return "\n".join(["const model_variable model_variables[] = {", *rows, "};"])


def sampled_source(model: SampledModel, token: str) -> dict[str, str]:
    """The texts of model.h and model.c of a model for co-simulation."""
    unit = Unit(C_DOUBLE, "model_")
    loop = LoopText(unit, model.stages, "model_state", model.clock)
    known = {**model.blocks, **model.inputs}
    asked = [name for name in (*model.arguments.values(), *(each.member for each in model.variables)) if name in known]
    further = {port.name: port.size for port in model.begin.outputs if port.size}
    further |= {name: len(known[name]) for name in (*model.inputs, *asked)}
    further = {name: size for name, size in further.items() if name not in loop.sizes}
    sizes = {**loop.sizes, **further}
    _check_size(sizes, loop.rings)
    for name, stages in (("control", model.control), ("move", model.move), ("measure", model.measure)):
        loop.add_function(f"model_{name}", stages, advances=name == ("move" if model.move else "control"))
    unit.functions["model_begin"] = _begin(model, loop, sizes)
    unit.functions["model_tick"] = _tick(model, sizes)
    initial = loop.initial({name: values for name, values in known.items() if name in sizes})
    unit.functions["model_create"] = CREATE.format(rows=",\n".join(f"    {row}" for row in initial) or "    0")
    unit.functions["model_variables"] = variable_table(model.variables)
    constants = {"MODEL_PERIOD": literal(model.clock.period, C_DOUBLE), "MODEL_STATES": "0u", "MODEL_INDICATORS": "0u"}
    functions = (
        "int model_tick(model_state *l); /* 0, or 1 where the state is infinite or NaN, or the solver stalled */"
    )
    return {
        "model.h": model_header(token, model.variables, loop.members(further), constants, functions),
        "model.c": c_text(unit, ['"model.h"', "<string.h>"]),
    }


def _check_size(sizes: Mapping[str, int], rings: Mapping[str, tuple[int, int]]) -> None:
    """Refuses a state that no tool copies at its ease.

    Raises:
        ScenarioError: too large.
    """
    numbers = sum(sizes.values()) + sum(length * entries for length, entries in rings.values())
    if 8 * numbers > LARGEST:
        what = f"{8e-6 * numbers:.3g} MB of commands and measurements under way in an FMU's state"
        raise ScenarioError(what, place="loop.timing", expected=f"at most {1e-6 * LARGEST:g} MB: shorter delays")


def _begin(model: SampledModel, loop: LoopText, sizes: Mapping[str, int]) -> str:
    """`model_begin`: initial values of blocks and rings, then the first measurement."""
    lines = []
    if any(port.size for port in model.begin.outputs):
        places = {port: f"l->{identifier(name)}" for port, name in model.arguments.items()}
        lines.append(loop.call(model.begin, places))
    results = {port.name: port.size for port in model.begin.outputs}
    for block, result in model.begun.items():
        if block in sizes and results[result] and block != result:
            lines.append(f"memcpy(l->{block}, l->{result}, sizeof l->{block});")
    for ring, block in model.filled.items():
        length, _ = loop.rings[ring]
        copy = f"memcpy(l->ring_{ring}[k], l->{model.begun[block]}, sizeof l->ring_{ring}[k]);"
        lines += ["{", "    int k;", f"    for (k = 0; k < {length}; k++) {{", f"        {copy}", "    }", "}"]
    lines += [f"l->x_first[{k}] = l->x[{entry}];" for k, entry in enumerate(model.ranged)]
    lines += _entering(model, sizes, commands=False)
    if model.measure:
        lines.append("model_measure(l);")
    body = "\n".join(f"    {line}" for line in (lines or ["(void)l;"]))
    return f"void model_begin(model_state *l)\n{{\n{body}\n}}"


def _entering(model: SampledModel, sizes: Mapping[str, int], *, commands: bool) -> list[str]:
    """Statements that bring inputs into their blocks."""
    pairs = [(block, member) for block, member in model.entering if block in sizes]
    pairs = pairs if commands else [pair for pair in pairs if pair[0] not in ("u", "u_issued")]
    return [f"memcpy(l->{block}, l->{member}, sizeof l->{block});" for block, member in pairs]


def _tick(model: SampledModel, sizes: Mapping[str, int]) -> str:
    """`model_tick`: one tick, and the measurement at its end."""
    lines = _entering(model, sizes, commands=True)
    lines += [f"model_{name}(l);" for name in ("control", "move", "measure") if getattr(model, name)]
    lines.append("return (l->frozen[0] >= 0.0) ? 1 : 0;" if "frozen" in sizes else "return 0;")
    body = "\n".join(f"    {line}" for line in lines)
    return f"int model_tick(model_state *l)\n{{\n{body}\n}}"

"""Parameters of an exported controller: their struct, the scenario's numbers as a constant, and as a file with a checksum.

    file = layout (4 bytes), numbers in the struct's order, CRC-32 of all that (4 bytes); everything little-endian

The layout is the CRC-32 of the struct's names and sizes, the controller and its period: a file for another controller is refused.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from armwright.export.c_header import comment
from armwright.export.controller.stages import ControllerStages
from armwright.kernels.c import REALS
from armwright.kernels.c_syntax import identifier, literal

_DECLARED = """\
#define {macro}_PARAMETERS_BYTES {size}u
#define {macro}_PARAMETERS_LAYOUT {layout}u

{about}
int {name}_load({name}_parameters *parameters, const uint8_t *bytes, uint32_t count);"""

_ABOUT = [
    "Parameters from the bytes of a file NAME.parameters, wherever they are kept; 0, or why nothing was changed:",
    "",
    "  1  another number of bytes",
    "  2  the checksum is not that of the bytes",
    "  3  parameters of another controller, or of another version of this one",
    "  4  a number is infinite or not a number, where the scenario's is finite and no limit",
    "  5  a limit is below 0",
]

# What a number of the file may be, as bits of one byte each.
INFINITE, NOT_NEGATIVE = 1, 2
LIMITS = (
    "velocity",
    "acceleration",
    "jerk",
)  # fields of controllers that are limits and must be finite; others end with "limit"

_DEFINED = """\
/* A number of little-endian bytes. */
static {real} {name}_number(const uint8_t *bytes)
{{
    {word} word = 0u;
    {real} number;
    int k;
    for (k = (int)sizeof word - 1; k >= 0; k--) {{
        word = (word << 8) | ({word})bytes[k];
    }}
    memcpy(&number, &word, sizeof number);
    return number;
}}

/* The same of four bytes as a whole number. */
static uint32_t {name}_word(const uint8_t *bytes)
{{
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8) | ((uint32_t)bytes[2] << 16) | ((uint32_t)bytes[3] << 24);
}}

/* CRC-32 of Ethernet and zlib. */
static uint32_t {name}_checksum(const uint8_t *bytes, uint32_t count)
{{
    uint32_t sum = 0xFFFFFFFFu, k;
    int bit;
    for (k = 0u; k < count; k++) {{
        sum ^= bytes[k];
        for (bit = 0; bit < 8; bit++) {{
            sum = (sum >> 1) ^ (0xEDB88320u & (0u - (sum & 1u)));
        }}
    }}
    return sum ^ 0xFFFFFFFFu;
}}

typedef char {name}_parameters_are_numbers[(sizeof({name}_parameters) == {numbers}u * sizeof({real})) ? 1 : -1];

int {name}_load({name}_parameters *parameters, const uint8_t *bytes, uint32_t count)
{{
    /* {infinite}: may be infinite; {not_negative}: may not be below 0. */
    static const uint8_t rules[{numbers}] = {{{rules}}};
    uint32_t k;
    {real} number;
    if (count != {macro}_PARAMETERS_BYTES) {{
        return 1;
    }}
    if ({name}_checksum(bytes, count - 4u) != {name}_word(&bytes[count - 4u])) {{
        return 2;
    }}
    if ({name}_word(bytes) != {macro}_PARAMETERS_LAYOUT) {{
        return 3;
    }}
    for (k = 0u; k < {numbers}u; k++) {{
        number = {name}_number(&bytes[4u + (k * sizeof number)]);
        if (isnan(number) || (((rules[k] & {infinite}u) == 0u) && ({name}_finite(&number, 1) == 0))) {{
            return 4;
        }}
        if (((rules[k] & {not_negative}u) != 0u) && (number < {zero})) {{
            return 5;
        }}
    }}
    for (k = 0u; k < {numbers}u; k++) {{
        number = {name}_number(&bytes[4u + (k * sizeof number)]);
        memcpy((uint8_t *)parameters + (k * sizeof number), &number, sizeof number);
    }}
    return 0;
}}"""


@dataclass(frozen=True)
class Member:
    """A member of the struct: name, shape, meaning, the scenario's values, and what others may be, as bits."""

    name: str
    shape: tuple[int, ...]
    about: str
    values: np.ndarray
    rule: int = 0


def members(stages: ControllerStages) -> list[Member]:
    """The members of the struct, in its order."""
    n, ranges = stages.arm.n, stages.ranges
    outside, limit = "[rad | m] beyond which positions are out of range", INFINITE | NOT_NEGATIVE
    about_limits = "at and beyond which a command is saturated, in its own unit"
    rows = [
        Member("position_low", (n,), outside, ranges["position_low"], INFINITE),
        Member("position_high", (n,), "[rad | m] the same", ranges["position_high"], INFINITE),
        Member("velocity", (n,), "[rad/s | m/s] the same of speeds", ranges["velocity"], limit),
        Member("command_limit", (n,), about_limits, stages.limits, limit),
        Member("initial_command", (n,), "in force before the first tick of the simulation", stages.initial_command),
    ]
    if stages.count.size:
        rows.append(Member("count", (n,), "[rad | m] one count of each encoder", stages.count, NOT_NEGATIVE))
    taken = {row.name for row in rows}
    ends = np.cumsum([int(np.prod(shape, dtype=int)) for shape in stages.gains.shapes])
    values = np.split(stages.gains.values[0], ends[:-1]) if len(ends) else []
    for name, shape, value in zip(stages.gains.names, stages.gains.shapes, values, strict=True):
        word = identifier(name)
        rows.append(
            Member(f"law_{word}" if word in taken else word, shape, "the controller's", value, _rule(name, value))
        )
    return rows


def gain_members(stages: ControllerStages) -> list[Member]:
    """The members that are fields of the controller, in the order of its values."""
    rows = members(stages)
    return rows[len(rows) - len(stages.gains.names) :]


def _rule(name: str, values: np.ndarray) -> int:
    """Numbers that a field of a controller may have; what the scenario's break does not hold."""
    last = name.rpartition(".")[2]
    rule = INFINITE if last.endswith("limit") or np.isinf(values).any() else 0
    return rule | (NOT_NEGATIVE if (last.endswith("limit") or last in LIMITS) and (values >= 0.0).all() else 0)


def struct_lines(stages: ControllerStages, real: str) -> list[str]:
    """The members of the struct in C."""
    return [
        f"{real} {row.name}{''.join(f'[{size}]' for size in row.shape)}; /* {row.about} */" for row in members(stages)
    ]


def default_parameters(stages: ControllerStages, real: str) -> str:
    """The constant struct of the scenario's parameters."""
    lines = []
    for row in members(stages):
        numbers = [literal(float(value), REALS[real]) for value in np.ravel(row.values)]
        lines.append(f"    {{{', '.join(numbers)}}}" if row.shape else f"    {numbers[0]}")
    body = ",\n".join(lines)
    return f"const {stages.name}_parameters {stages.name}_default_parameters = {{\n{body}\n}};"


def layout_of(stages: ControllerStages, real: str) -> int:
    """Checksum of the struct's layout, which identifies parameter files of this controller."""
    rows = [f"{row.name}{row.shape}" for row in members(stages)]
    law = stages.loop.controller.name
    text = "\n".join([law, real, repr(stages.period), *stages.arm.names, *rows])
    return zlib.crc32(text.encode())


def parameter_file(stages: ControllerStages, real: str) -> bytes:
    """The scenario's parameters as a file for `NAME_load`."""
    dtype = REALS[real].format.dtype.newbyteorder("<")
    numbers = np.concatenate([np.ravel(row.values) for row in members(stages)]).astype(dtype)
    content = layout_of(stages, real).to_bytes(4, "little") + numbers.tobytes()
    return content + zlib.crc32(content).to_bytes(4, "little")


def declared(stages: ControllerStages, real: str) -> str:
    """Size, layout and load function of the parameters, for the header."""
    words = {"name": stages.name, "macro": stages.name.upper(), "about": comment(_ABOUT)}
    return _DECLARED.format(**words, size=len(parameter_file(stages, real)), layout=hex(layout_of(stages, real)))


def loading(stages: ControllerStages, real: str) -> str:
    """C functions that load parameters, for the C file."""
    bits = REALS[real].format.dtype.itemsize * 8
    rules = [str(row.rule) for row in members(stages) for _ in np.ravel(row.values)]
    words = {"name": stages.name, "macro": stages.name.upper(), "real": real, "rules": ", ".join(rules)}
    words |= {"word": f"uint{bits}_t", "zero": literal(0.0, REALS[real])}
    return _DEFINED.format(**words, numbers=len(rules), infinite=INFINITE, not_negative=NOT_NEGATIVE)

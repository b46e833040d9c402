"""Programs that run an exported controller on recorded inputs: the self-test, and one that reads longer inputs from a file.

A row of inputs is: 1 where the sample was lost else 0, the reference, the measurement and what the drives applied.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright.errors import ScenarioError
from armwright.export.c_arithmetic import FAULTS, TWO_ROUNDINGS
from armwright.export.c_header import comment
from armwright.export.controller.recording import ControllerRecording
from armwright.export.controller.source import copies, measured_copies
from armwright.export.controller.stages import ControllerStages
from armwright.kernels.c import REALS
from armwright.kernels.c_syntax import literal

#: A lost sample's numbers, which the controller must not read.
GARBAGE = -12345.5
#: The largest magnitude of a count: an int32_t's, also where single precision rounds it.
MOST = 2.0**31 - 128

_ROW = """\
/* A row of inputs as the controller's structs. */
static void from_row(const {real} *row, {name}_reference *reference, {name}_measurement *measurement)
{{
    measurement->lost = (row[0] > {half}) ? 1 : 0;
{copies}
}}"""

_SELFTEST = """\
/* What stands around every step, for instance to count time: statements that a board defines. */
#if !defined({macro}_BEFORE) || !defined({macro}_AFTER)
#define {macro}_BEFORE (void)0
#define {macro}_AFTER (void)0
#endif

int main(void)
{{
    static const char *const faults[] = {{
{faults}}};
    const int fault = {name}_arithmetic(), bits = fault != {two_roundings};
    static {name}_state state;
    {name}_reference reference;
    {name}_measurement measurement;
    {name}_command command;
    int k, others = 0, failed = (fault != 0) && bits;
    printf("%-32s %s%s\\n", "arithmetic", faults[fault], failed == 0 ? "" : ": FAILED");
    from_row(begin, &reference, &measurement);
    memcpy(command.u, in_force, sizeof command.u);
    {name}_init(&state, &{name}_default_parameters, &measurement, &command);
    for (k = 0; k < {ticks}; k++) {{
        from_row(rows[k], &reference, &measurement);
        {macro}_BEFORE;
        (void){name}_step(&state, &{name}_default_parameters, &reference, &measurement, &command);
        {macro}_AFTER;
        others += memcmp(command.u, expected[k], sizeof command.u) != 0;
    }}
    failed += bits && (others > 0);
    printf("%-32s %d of {ticks} commands with other bits%s\\n", "{name}_step", others,
        bits ? "" : ": not counted, since fma() rounds twice");
    printf("{name}: %s\\n", failed == 0 ? "ok" : "FAILED");
    return failed == 0 ? 0 : 1;
}}"""

_READER = """\
/* reader INPUTS COMMANDS STATUS REPEATS: runs all rows so many times and writes the results; prints the seconds taken. */
int main(int count, char **words)
{{
    FILE *file = fopen(words[count - 4], "rb");
    FILE *commands = fopen(words[count - 3], "wb");
    FILE *status = fopen(words[count - 2], "wb");
    const int repeats = atoi(words[count - 1]);
    static {name}_state state;
    {name}_reference reference;
    {name}_measurement measurement;
    {name}_command command;
    static {real} row[{width}];
    {real} *rows = NULL;
    {name}_command *results = NULL;
    uint32_t *words_of_status = NULL;
    size_t ticks = 0u, k = 0u;
    int repeat = 0;
    clock_t began;
    if ((file == NULL) || (commands == NULL) || (status == NULL)) {{
        return 2;
    }}
    while (fread(row, sizeof row, 1u, file) == 1u) {{
        ticks++;
    }}
    rewind(file);
    rows = malloc(ticks * sizeof row);
    results = malloc(ticks * sizeof *results);
    words_of_status = malloc(ticks * sizeof *words_of_status);
    if ((ticks < 2u) || (rows == NULL) || (results == NULL) || (words_of_status == NULL)
            || (fread(rows, sizeof row, ticks, file) != ticks)) {{
        return 2;
    }}
    began = clock();
    for (repeat = 0; repeat < repeats; repeat++) {{
        from_row(rows, &reference, &measurement);
        memcpy(command.u, in_force, sizeof command.u);
        {name}_init(&state, &{name}_default_parameters, &measurement, &command);
        for (k = 1u; k < ticks; k++) {{
            from_row(&rows[{width}u * k], &reference, &measurement);
            words_of_status[k] = {name}_step(&state, &{name}_default_parameters, &reference, &measurement, &results[k]);
        }}
    }}
    printf("%.17g\\n", (double)(clock() - began) / (double)CLOCKS_PER_SEC);
    k = fwrite(&results[1], sizeof *results, ticks - 1u, commands);
    k += fwrite(&words_of_status[1], sizeof *words_of_status, ticks - 1u, status);
    free(rows);
    free(results);
    free(words_of_status);
    return ((fclose(commands) == 0) && (fclose(status) == 0) && (fclose(file) == 0) && (k == 2u * (ticks - 1u))) ? 0 : 2;
}}"""


def input_rows(stages: ControllerStages, recording: ControllerRecording) -> np.ndarray:
    """(1 + ticks, width) inputs as rows: the initial one, then one for each tick.

    Entries of a sample that was lost are `GARBAGE`, as the controller must not read them.

    Raises:
        ScenarioError: positions that are to come in counts, and are no whole counts.
    """
    measured = stages.measured.size
    y, y_begin = _in_counts(stages, recording.y), _in_counts(stages, recording.y_begin)
    y[recording.lost, :measured] = GARBAGE
    begin = np.concatenate([np.zeros(1 + stages.reference.size), y_begin])
    return np.concatenate([begin[None], np.column_stack([recording.lost.astype(float), recording.r, y])])


def _in_counts(stages: ControllerStages, y: np.ndarray) -> np.ndarray:
    """A copy of measurements (…, size), their positions in counts where the code takes counts."""
    y = y.copy()
    if not stages.count.size:
        return y
    place = stages.measured.place("q")
    q, counts = y[..., place], np.rint(y[..., place] / stages.count)
    if not np.array_equal(counts * stages.count, q) or np.abs(counts).max() > MOST:
        what = "positions are no whole counts, or more than an int32_t has"
        raise ScenarioError(
            what, place="loop.sensors.counts", expected="sensors whose positions are counts of their encoders"
        )
    y[..., place] = counts
    return y


def selftest(stages: ControllerStages, recording: ControllerRecording, expected: np.ndarray, real: str) -> str:
    """The self-test's text: recorded inputs and expected commands, compared bit by bit. Exit code 0 if all are equal, else 1."""
    rows = input_rows(stages, recording)
    whose = {"double": "the commands that it gave", "float": "the commands in single precision"}[real]
    about = f"Self-test of {stages.name}.c: inputs recorded in a simulation, and {whose}, to the bit."
    tables = [
        _table(real, "begin", rows[0]),
        _table(real, "in_force", recording.u_begin),
        _table(real, "rows", rows[1:]),
        _table(real, "expected", expected),
    ]
    faults = ",\n".join(f'        "{fault}"' for fault in FAULTS)
    parts = [
        comment([about, "Ends with 0 if all are met, else with 1."]),
        f'#include <math.h>\n#include <stdio.h>\n#include <string.h>\n\n#include "{stages.name}.h"',
        *tables,
        _from_row(stages, real),
        _SELFTEST.format(
            name=stages.name,
            macro=f"{stages.name.upper()}_SELFTEST",
            ticks=recording.ticks,
            faults=faults,
            two_roundings=TWO_ROUNDINGS,
        ),
    ]
    return "\n\n".join(parts) + "\n"


def reader(stages: ControllerStages, recording: ControllerRecording, real: str) -> str:
    """The text of a program that reads inputs from a file, for runs too long for a table."""
    width = 1 + stages.reference.size + stages.measured.size + stages.applied.size
    parts = [
        "".join(f"#include <{each}.h>\n" for each in ("math", "stdio", "stdlib", "string", "time")),
        f'#include "{stages.name}.h"',
        _table(real, "in_force", recording.u_begin),
        _from_row(stages, real),
        _READER.format(name=stages.name, real=real, width=width),
    ]
    return "\n\n".join(parts) + "\n"


def _from_row(stages: ControllerStages, real: str) -> str:
    first = 1 + stages.reference.size
    lines = [
        *copies(stages.reference, "reference->", "row", 1, into=True),
        *measured_copies(stages, real, "row", first, into=True),
        *copies(stages.applied, "measurement->", "row", first + stages.measured.size, into=True),
    ]
    half = literal(0.5, REALS[real])
    return _ROW.format(name=stages.name, real=real, half=half, copies="\n".join(f"    {line}" for line in lines))


def _table(real: str, name: str, rows: Any) -> str:
    """A constant array of numbers, or of rows of them."""

    def numbers(row: Any) -> str:
        return f"{{{', '.join(literal(float(value), REALS[real]) for value in row)}}}"

    if np.ndim(rows) == 1:
        return f"static const {real} {name}[{len(rows)}] = {numbers(rows)};"
    lines = ",\n".join(f"    {numbers(row)}" for row in rows)
    return f"static const {real} {name}[{len(rows)}][{len(rows[0])}] = {{\n{lines}\n}};"

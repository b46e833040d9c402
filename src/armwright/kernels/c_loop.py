"""A simulation loop's stages as C99 or CUDA C: the loop that LLVM is given (`loop_printer`, `loop_steps`), for one lane.

Blocks and rings are members of one struct without pointers, so that a copy of it is the loop's whole state. What `stages` says of
every stage is done here by plain statements; the programs are printed as kernels are, so that the bits are those of the compiled
loop. Rows of schedules and tables are no stages of C99: whoever calls the functions writes into the blocks instead.
`cuda_loop_printer` adds them.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armwright.errors import ProgramError
from armwright.kernels import philox
from armwright.kernels.c import Unit
from armwright.kernels.c_syntax import C_DOUBLE, identifier, literal
from armwright.kernels.loop_steps import LOST, NEARLY
from armwright.kernels.stages import (
    HELD,
    NEARLY_DUE,
    NEXT,
    SECANTS,
    SECANTS_WITHIN,
    SEEN,
    SINCE,
    SWITCHES,
    TURNS,
    Adapt,
    Call,
    DelayStage,
    DrawStage,
    Integrate,
    Stage,
    Turn,
    block_sizes,
)
from armwright.program import Program

_PHILOX = f"""\
{{function}}void {{prefix}}draw({{integer}} lane, {{integer}} tick, {{integer}} channel, {{integer}} seed,
    int entries, double *numbers)
{{{{
    const {{integer}} low = {{LOW}};
    int call, half, k;
    for (call = 0; 2 * call < entries; call++) {{{{
        {{integer}} c0 = lane & low, c1 = tick & low, c2 = (tick >> 32) << 16 | channel, c3 = ({{integer}})call;
        {{integer}} k0 = seed & low, k1 = seed >> 32;
        for (k = 0; k < {philox.ROUNDS}; k++) {{{{
            const {{integer}} a = {{M0}} * c0, b = {{M1}} * c2;
            c0 = (b >> 32) ^ c1 ^ k0;
            c2 = (a >> 32) ^ c3 ^ k1;
            c1 = b & low;
            c3 = a & low;
            k0 = (k0 + {{W0}}) & low;
            k1 = (k1 + {{W1}}) & low;
        }}}}
        for (half = 0; half < 2 && 2 * call + half < entries; half++) {{{{
            const {{integer}} bits = half == 0 ? (c0 << 20 | c1 >> 12) : (c2 << 20 | c3 >> 12);
            const double number = (double)bits + 0.5;
            numbers[2 * call + half] = number * {2.0**-52!r};
        }}}}
    }}}}
}}}}"""

_ACCEPT = """\
{function}void {prefix}accept({struct} *l)
{{
    double poison = 0.0; /* 0 x is NaN where x is not finite, and NaN stays */
    int k;
    if (!(l->frozen[0] < 0.0)) {{
        return;
    }}
    for (k = 0; k < {size}; k++) {{
        poison = fma(l->x_next[k], 0.0, poison);
    }}
    if (poison == 0.0) {{
        memcpy(l->x, l->x_next, sizeof l->x);
    }} else {{
        l->frozen[0] = (double)l->{counter};
    }}
}}"""

COUNTER = "tick_number"  # the member that counts ticks


@dataclass(frozen=True)
class LoopClock:
    """Numbers of a loop that are constants of its code.

    Attributes:
        period: [s] of a tick.   substeps: of a tick, where the plant has a fixed step.
        seed, lane: that random numbers depend on.
    """

    period: float
    substeps: int = 1
    seed: int = 0
    lane: int = 0

    def words(self) -> ClockWords:
        """The numbers as literals."""
        period, part = (literal(number, C_DOUBLE) for number in (self.period, 1.0 / self.substeps))
        return ClockWords(period, part, f"{self.substeps}", f"UINT64_C({self.seed})", f"UINT64_C({self.lane})")


@dataclass(frozen=True)
class ClockWords:
    """A loop's clock as expressions of C: literals, or parameters of the function that the loop stands in.

    Attributes:
        period: [s] of a tick.   part: 1 / substeps.   substeps, seed, lane: as of `LoopClock`.
    """

    period: str
    part: str
    substeps: str
    seed: str
    lane: str


class LoopText:
    """C functions of a unit over one struct of blocks.

    Attributes:
        unit: whose functions these become.   struct: the type's name.   sizes: entries of every block.
        rings: length and entries of every delay's ring, by the block that it fills.
    """

    def __init__(self, unit: Unit, stages: Sequence[Stage], struct: str, clock: LoopClock | ClockWords):
        """Text of those stages.

        Raises:
            ProgramError: a stage that has no C: an integration that looks for events.
        """
        self.unit, self.struct, self._plan = unit, struct, tuple(stages)
        self.clock = clock.words() if isinstance(clock, LoopClock) else clock
        self.sizes = {name: size for name, size in block_sizes(self._plan).items() if size}
        self.rings = {stage.to: (stage.length, stage.entries) for stage in stages if isinstance(stage, DelayStage)}
        for stage in stages:
            if isinstance(stage, Adapt) and stage.events:
                raise ProgramError("looks for events", place="loop", expected="a solver without events")

    def members(self, further: Mapping[str, int]) -> list[str]:
        """Declarations of the struct's members: counter, blocks, further arrays, rings."""
        lines = [f"{self.unit.dialect.integer} {COUNTER};"]
        lines += [f"double {identifier(name)}[{size}];" for name, size in {**self.sizes, **further}.items()]
        return lines + [
            f"double ring_{identifier(to)}[{length}][{entries}];" for to, (length, entries) in self.rings.items()
        ]

    def initial(self, blocks: Mapping[str, np.ndarray]) -> list[str]:
        """Initialisers of the struct's arrays that are not all 0: values (entries,) by name."""
        lines = []
        for name, values in blocks.items():
            if np.any(values != 0.0):
                lines.append(f".{identifier(name)} = {{{_numbers(values)}}}")
        return lines

    def add_function(self, name: str, stages: Iterable[Stage], *, advances: bool = False) -> None:
        """`static void name(struct *l)`: the stages in order; `advances`: the counter goes on to the next tick at the end."""
        body = self.statements(stages)
        if "tick" in self.sizes:
            body.insert(0, f"l->tick[0] = (double)l->{COUNTER};")
        if advances:
            body.append(f"l->{COUNTER}++;")
        text = "\n".join(f"    {line}" for line in (body or ["(void)l;"]))
        self.unit.functions[name] = f"static void {name}({self.struct} *l)\n{{\n{text}\n}}"

    def statements(self, stages: Iterable[Stage]) -> list[str]:
        """The stages in order, of the lane that `l` points to."""
        body = []
        for stage in stages:
            body += getattr(self, f"_{type(stage).__name__.removesuffix('Stage').lower()}")(stage)
        return body

    def call(self, program: Program, places: Mapping[str, str] | None = None) -> str:
        """The statement that calls a program on blocks; `places`: arrays of other names, by port."""
        name = f"{self.unit.prefix}of_{identifier(program.name)}"
        if name not in self.unit.functions:
            self.unit.add_function(program, name)
        ports = [port for port in (*program.inputs, *program.outputs) if port.size]
        return f"{name}({', '.join((places or {}).get(port.name, f'l->{identifier(port.name)}') for port in ports)});"

    # Stages.

    def _run(self, program: Program) -> list[str]:
        """A program, and its results that replace blocks."""
        return [self.call(program), *_replace(program)]

    def _call(self, stage: Call) -> list[str]:
        return self._run(stage.program)

    def _draw(self, stage: DrawStage) -> list[str]:
        name, dialect = f"{self.unit.prefix}draw", self.unit.dialect
        numbers = {each: dialect.literal.format(getattr(philox, each)) for each in ("LOW", "M0", "M1", "W0", "W1")}
        words = {"prefix": self.unit.prefix, "function": dialect.function, "integer": dialect.integer}
        self.unit.functions[name] = _PHILOX.format(**words, **numbers)
        keys = f"{self.clock.lane}, l->{COUNTER}, {dialect.literal.format(stage.channel)}, {self.clock.seed}"
        return [f"{name}({keys}, {stage.entries}, l->{identifier(stage.block)});"]

    def _delay(self, stage: DelayStage) -> list[str]:
        block, to, by = identifier(stage.block), identifier(stage.to), identifier(stage.by)
        slot = f"(l->{COUNTER} + {stage.length}u - (uint64_t)l->{by}[0]) % {stage.length}u"
        return [
            f"memcpy(l->ring_{to}[l->{COUNTER} % {stage.length}u], l->{block}, sizeof l->{block});",
            f"memcpy(l->{to}, l->ring_{to}[{slot}], sizeof l->{to});",
        ]

    def _integrate(self, stage: Integrate) -> list[str]:
        self._add_accept()
        once = [self.call(stage.step), f"{self.unit.prefix}accept(l);"]
        inner = [
            f"const double length = (edge - t) * {self.clock.part};",
            "int substep;",
            "l->h[0] = length;",
            f"for (substep = 0; substep < {self.clock.substeps}; substep++) {{",
            *_indented(self._in_pieces(stage) if stage.switching else once),
            "}",
        ]
        return self._segments(stage, inner)

    def _in_pieces(self, stage: Integrate) -> list[str]:
        """A substep that is cut where something switches."""
        return [
            "double left = length;",
            "int piece, cut = 1;",
            "for (piece = 0; cut != 0; piece++) {",
            "    cut = 0;",
            "    l->h[0] = left;",
            *_indented([self.call(stage.switching[0]), self.call(stage.step)]),
            f"    if (piece < {SWITCHES} && l->frozen[0] < 0.0) {{",
            *_indented(self._cut(stage, "left"), 2),
            "    }",
            "    if (0.0 < left) {",
            f"        {self.unit.prefix}accept(l);",
            "    }",
            "    left = (cut != 0) ? left - l->h[0] : 0.0;",
            "}",
        ]

    def _cut(self, stage: Integrate | Adapt, length: str) -> list[str]:
        """The step just taken ends at the first place where something switches; `cut` says whether there is one."""
        _, switched, bracket, narrow = stage.switching
        within = stage.within if isinstance(stage, Adapt) else None
        guess = [f"l->h[0] = l->part[0] * {length};", self.call(stage.step)] if within is None else [self.call(within)]
        return [
            self.call(switched),
            "if (0.0 < l->switched[0]) {",
            "    int secant;",
            "    cut = 1;",
            f"    {self.call(bracket)}",
            f"    for (secant = 0; secant < {SECANTS if within is None else SECANTS_WITHIN}; secant++) {{",
            *_indented([*guess, *self._run(narrow)], 2),
            "    }",
            f"    l->h[0] = l->bracket[1] * {length};",
            f"    {self.call(stage.step)}",
            "}",
        ]

    def _adapt(self, stage: Adapt) -> list[str]:
        again = f"l->{SINCE}[0] < edge && l->frozen[0] < 0.0" if stage.ahead else "1"
        before, behind = self._about_trial(stage)
        inner = [
            *(self._begin_interval(stage) if stage.ahead else []),
            f"int again = {again};",
            "while (again != 0) {",
            *_indented([*self._try(stage, before, behind), *self._follow(), *self._take(stage)]),
            "}",
            *(self._look_back(stage) if stage.ahead else []),
        ]
        return ["l->tried[0] = 0.0;", *self._segments(stage, inner)]

    def _about_trial(self, stage: Adapt) -> tuple[list[str], list[str]]:
        """Statements before a trial and behind it: contacts are held, and a good trial ends where something switches."""
        touching, cut = [], []
        if stage.switching:
            touching = [self.call(stage.switching[0])]
            cut = ["if (active && l->error[0] <= 1.0) {", *_indented(self._cut(stage, "s")), "}", "s = l->h[0];"]
        if stage.settle is not None:
            cut += self._run(stage.settle)
        return touching, cut

    def _try(self, stage: Adapt, before: list[str], behind: list[str]) -> list[str]:
        """A trial of the wanted length or up to the edge."""
        length = "wanted" if stage.ahead else f"(left <= wanted * {NEARLY!r}) ? left : wanted"
        return [
            "const double now = l->since_tick[0];",
            *([] if stage.ahead else ["const double left = edge - now;"]),
            f"const double wanted = (0.0 < l->h_try[0]) ? l->h_try[0] : {self.clock.period};",
            "const int active = now < edge && l->frozen[0] < 0.0;",
            f"double s = {length}, grow, following, then;",
            *([] if stage.ahead else ["const int ends = left <= s;"]),
            "int good, measured, rejected, waits, over;",
            *(["int cut = 0;"] if stage.switching or not stage.ahead else []),
            *(["(void)cut;"] if stage.switching and stage.ahead else []),
            "l->h[0] = s;",
            *before,
            self.call(stage.trial),
            *behind,
            "good = active && l->error[0] <= 1.0;",
            "then = now + s;",
            *([] if stage.ahead else ["then = (ends && cut == 0) ? edge : then;"]),
        ]

    def _follow(self) -> list[str]:
        """Length of the next trial, and how many there were."""
        return [
            f"measured = l->error[0] <= {sys.float_info.max!r};",
            f"grow = measured ? l->grow[0] : {LOST!r};",
            "grow = (0.0 < l->rejected[0] && 1.0 < grow) ? 1.0 : grow; /* behind a step that was refused */",
            "following = s * grow;",
            "following = (good && s < wanted && following < wanted) ? wanted : following; /* it was cut short */",
            "l->h_try[0] = active ? following : wanted;",
            "rejected = active && !(l->error[0] <= 1.0);",
            "l->rejected[0] = (double)rejected;",
            "l->repeats[0] += (double)rejected;",
            "l->tried[0] += (double)active;",
            "l->trials[0] += (double)active;",
        ]

    def _take(self, stage: Adapt) -> list[str]:
        """The state behind a good trial; after too many of them, the lane stays where it is."""
        begun = ["l->span[0] = s;", "memcpy(l->x_from, l->x, sizeof l->x);"] if stage.ahead else []
        return [
            "if (good) {",
            *_indented([*begun, *_replace(stage.trial), "l->since_tick[0] = then;"]),
            "}",
            "waits = active && l->since_tick[0] < edge;",
            f"over = waits && {self._most(stage)} <= l->tried[0];",
            "if (over) {",
            f"    l->frozen[0] = (double)l->{COUNTER};",
            "    l->stalled[0] += (double)measured;",
            *(["    l->stalled_by[0] = l->worst[0];"] if "worst" in self.sizes else []),
            "}",
            "again = waits && !over;",
        ]

    def _most(self, stage: Adapt) -> str:
        """Trials that a tick may take."""
        most = literal(float(stage.most), C_DOUBLE)
        if stage.each is None:
            return most
        times = f"{self.clock.period} * {literal(1.0 / stage.each, C_DOUBLE)}"
        return f"{most} * ((1.0 < {times}) ? {times} : 1.0)"

    def _begin_interval(self, stage: Adapt) -> list[str]:
        """Continues a lane after its last step if its inputs are unchanged; else restarts it with steps that are no longer."""
        held, _ = stage.ahead
        before = [port for port in held.inputs if port.name.endswith(HELD) and port.name != f"x{HELD}"]
        return [
            self.call(held),
            "if (0.0 < l->same[0] && 0.0 < l->ahead[0]) {",
            f"    l->{SINCE}[0] = l->{SINCE}[0] + l->ahead[0];",
            "    memcpy(l->x, l->x_end, sizeof l->x);",
            "} else if (0.0 < l->ahead[0]) {",
            "    const double lasted = l->span[0] - l->ahead[0];",
            "    l->h_try[0] = (lasted < l->h_try[0]) ? lasted : l->h_try[0];",
            "}",
            *(
                f"memcpy(l->{identifier(port.name)}, l->{identifier(port.name.removesuffix(HELD))}, "
                f"sizeof l->{identifier(port.name)});"
                for port in before
            ),
        ]

    def _look_back(self, stage: Adapt) -> list[str]:
        """The state at the edge, within the last step; a lane that stopped stays where it is."""
        return [
            "{",
            f"    const double beyond = l->{SINCE}[0] - edge;",
            "    const int reaches = 0.0 < beyond && l->frozen[0] < 0.0;",
            "    const double span = reaches ? l->span[0] : 1.0;",
            "    l->ahead[0] = reaches ? beyond : 0.0;",
            "    l->part[0] = (span - beyond) / span;",
            f"    {self.call(stage.ahead[1])}",
            "    memcpy(l->x_end, l->x, sizeof l->x);",
            "    if (reaches) {",
            "        memcpy(l->x, l->x_at, sizeof l->x);",
            "    }",
            f"    memcpy(l->x{HELD}, l->x, sizeof l->x);",
            "}",
        ]

    def _segments(self, stage: Integrate | Adapt, inner: Sequence[str]) -> list[str]:
        """A tick from change to change: `inner` moves the plant from `t` to `edge`."""
        h, due = self.clock.period, self._next_rows()
        begins = [f"l->u_from[{s}]" for s in range(stage.planned - 1)] + ["l->see_at[0]"] * bool(stage.seen)
        lines = [f"l->{SINCE}[0] = 0.0;", "do {", *_indented(self._due_rows())]
        moves = bool(begins) or stage.turn is not None
        lines += [f"    const double t = l->{SINCE}[0];"] if moves or isinstance(stage, Integrate) else []
        lines += [f"    double edge = {h};"] if moves or due else [f"    const double edge = {h};"]
        lines += _indented(due)
        lines += [f"    edge = (t < {each} && {each} < edge) ? {each} : edge;" for each in begins]
        if stage.planned:
            n = self.sizes["u"]
            lines.append("    memcpy(l->u, l->u_plan, sizeof l->u);")
            for s in range(1, stage.planned):
                lines += [
                    f"    if (l->u_from[{s - 1}] <= t) {{",
                    f"        memcpy(l->u, &l->u_plan[{s * n}], sizeof l->u);",
                    "    }",
                ]
        if stage.turn is not None:
            lines += _indented(self._turn(stage.turn))
        lines += ["    {", *_indented(inner, 2), "    }"]
        if stage.seen:
            kept = [f"memcpy(l->{name}{SEEN}, l->{name}, sizeof l->{name});" for name in stage.seen]
            lines += ["    if (edge == l->see_at[0]) {", *_indented(kept, 2), "    }"]
        return [*lines, f"    l->{SINCE}[0] = edge;", f"}} while (l->{SINCE}[0] < {h});"]

    def _due_rows(self) -> list[str]:
        """Rows of schedules that are due come into force."""
        return []

    def _next_rows(self) -> list[str]:
        """The edge is where the next row of a schedule is due, if that is before it."""
        return []

    def _turn(self, turn: Turn) -> list[str]:
        """Servos' loops turn if it is time; the edge is when they next do if that is before it."""
        self._add_accept()
        period, near = literal(turn.period, C_DOUBLE), literal(NEARLY_DUE * turn.period, C_DOUBLE)
        due_at = f"l->{TURNS}[0] * {period} - (double)l->{COUNTER} * {self.clock.period}"
        return [
            f"double due_at = {due_at};",
            f"if (due_at <= t + {near}) {{",
            f"    {self.call(turn.program)}",
            f"    {self.unit.prefix}accept(l);",
            f"    l->{TURNS}[0] += 1.0;",
            "}",
            f"due_at = {due_at};",
            f"edge = (due_at < edge - {near}) ? due_at : edge;",
        ]

    def _add_accept(self) -> None:
        words = {"prefix": self.unit.prefix, "struct": self.struct, "size": self.sizes["x"], "counter": COUNTER}
        words["function"] = self.unit.dialect.function
        self.unit.functions[f"{self.unit.prefix}accept"] = _ACCEPT.format(**words)


def _replace(program: Program) -> list[str]:
    """Statements that copy next values of blocks into the blocks."""
    return [
        f"memcpy(l->{identifier(port.name.removesuffix(NEXT))}, l->{identifier(port.name)}, sizeof l->{identifier(port.name)});"
        for port in program.outputs
        if port.name.endswith(NEXT) and port.size
    ]


def _numbers(values: np.ndarray) -> str:
    return ", ".join(literal(float(value), C_DOUBLE) for value in np.ravel(values))


def _indented(lines: Iterable[str], depth: int = 1) -> list[str]:
    return ["    " * depth + line for line in lines]

"""Stages of one tick of a simulation loop, done in order by every lane for itself.

Between stages, numbers wait in *blocks*: named, of some entries a lane, keeping their values from tick to tick. Most are `Call`s
of traced programs, whose inputs and outputs are blocks by name. The others are what a trace cannot hold. In NumPy, for one
lane in tick k of h seconds, with `b` the dict of its blocks:

    Call(program):               b.update(program(**b)); an output called "m_next" is the new b["m"]
    TableStage("r", 6):          b["r"] = table[k - origin]                               (the same for all lanes)
    RowsStage("u", 6):           while due <= (k, 0): b["u"], due = next row              (a schedule of the lane's own)
    DrawStage("w", 2, channel=0): b["w"] = philox(seed, lane, k, channel)                  in (0, 1)
    DelayStage("y", "y_old", …): ring[k % length] = b["y"]; b["y_old"] = ring[(k - b["lag"]) % length]
    RecordStage("run", ("x", "u"), …): row = k - origin; if row % every == 0: run[row // every] = b["x"], b["u"]
    Integrate(step):           t = 0
                               while t < h:
                                   rows that are due at (k, t) replace their blocks
                                   edge = the next change behind t: of rows, of the plan, or the end h
                                   for _ in range(substeps): new = step(x, u, …, h=(edge - t) / substeps)
                                   if finite(new): b["x"] = new, else frozen = k
                                   t = edge
                                   if t == b["see_at"]: b["x_seen"] = b["x"], …          (of each block in `seen`)
    Adapt(trial):              the same, but each lane steps from t to the edge as it likes:
                               while t < edge:
                                   s = edge - t if 1.01 b["h_try"] >= edge - t else b["h_try"]
                                   new, error, grow, path = trial(x, u, …, h=s)
                                   if error <= 1: b["x"], t = new, t + s
                                   b["h_try"] = grow s            (a step that was cut short does not shorten the next)

    Adapt(…, ahead=…):         steps go on beyond the end of the tick, where the state is read from the path within the step:
                               if held(x, u, …) and b["ahead"] > 0: t, b["x"] = b["ahead"], b["x_end"]   (else anew from x)
                               while t < edge:
                                   new, error, grow, path = trial(x, u, …, h=b["h_try"])
                                   if error <= 1: b["x_from"], b["span"], b["x"], t = b["x"], h, new, t + h
                               b["ahead"], b["x_end"] = t - edge, b["x"]
                               b["x"] = along(x_from, path, part=(span - ahead) / span)

Where servos' loops turn by themselves, every `turn.period` s from t = 0 on, a step ends there:

    if b["turns"] turn.period <= k h + t: b["x"], b["turns"] = turn.program(x, u, …, turns), b["turns"] + 1    (behind the rows)

All others end a step at every change. With a plan, the command in force is chosen among several planned ones: entry s of
block "u_plan" from "u_from"[s - 1] seconds on. A lane whose state diverges keeps its last finite one, and
block "frozen" says in which tick it happened, -1 before. So does one that takes more than `most` trials in one tick; block
"stalled" is then 1, and "stalled_by" the entry with the largest error. "trials" counts them, "repeats" those that were too
long. With events, a step of `Adapt` in which one happens is halved along its path `HALVINGS` times to find when, taken again
to just behind it, and noted: "event_first" the first time [s], "event_count" how often.

Loops that search instead of simulating have no time: each lane works on a task until it is over.

    Exchange(…):               while b["over"] > 0:
                                   if has task and over == 1 and attempt_number + 1 < most: attempt_number += 1, fresh = 1
                                   else: results[task_number] = b["result"]; b["task"] = the next of tasks, fresh = 2,
                                         attempt_number = 0; if there is none, the lane has no task
                                   b["attempt"] = attempts[row], row = ranks[task_number, attempt_number], behind the
                                       ranked ones attempt_number - ranked, round and round
                               the loop ends where no lane has a task

Where something may switch within steps, each substep of s seconds of `Integrate` is, in NumPy,

    for piece in range(SWITCHES + 1):
        c = touching(x, …)
        new = step(x, …, c, h=s)
        if piece == SWITCHES or not switched(x, new, …, c): break
        weights, bracket, part = bracket(x, new, …, c)
        for _ in range(SECANTS): bracket, part = narrow(step(x, …, c, h=part s), …, c, weights, bracket, part)
        x, s = step(x, …, c, h=bracket[1] s), s - bracket[1] s                             (to just beyond the first place)
    b["x"] = new

and `Adapt` cuts a trial that is good in the same way; with `within`, guesses are states on the path of that trial.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from armwright.program import Program

NEXT = "_next"  # ending of an output that replaces the block it is named after
SEEN = "_seen"  # ending of a block that is kept for a measurement between ticks
TURNS = "turns"  # of servos' loops so far
NEARLY_DUE = 1e-6  # of their period: a change as near to a turn as this is meant to come with it
SINCE = "since_tick"  # [s] how far a lane is in the tick
# Of a lane's schedule: when its next row comes, which it is, the one behind its last.
CURSOR = ("due_tick", "due_offset", "row", "end")
NEVER = 2.0**62  # a tick that does not come
ADAPTING = ("h_try", "tried", "rejected", "trials", "repeats", "stalled")  # of a lane that chooses its steps
AHEAD = ("ahead", "span")  # [s] of a lane's last step: how far it reaches beyond the tick, and how long it is
HELD = "_held"  # ending of a block as it was when a lane's last step began
EXCHANGED = ("task", "attempt", "over", "fresh", "task_number", "attempt_number")  # blocks of a lane that searches
HALVINGS = 40  # of the step in which an event lies: 1e-12 of it are left
SWITCHES = 8  # places in one substep where something switches; the rest is then one step
TOO_MANY = -1.0  # block "grazed" of a lane in which that was not enough
SECANTS = 10  # of a substep, to find one: enough where the state bends by as much as it moves
SECANTS_WITHIN = 16  # the same along the path of a longer step, which costs little


Sizes = Iterator[tuple[str, int]]  # blocks and their entries
Names = tuple[set[str], set[str]]  # blocks that a stage reads, and those that it writes for later ones


@dataclass(frozen=True)
class Call:
    """A program over blocks."""

    program: Program

    def sizes(self) -> Sizes:
        """Entries of its blocks, by name."""
        return _ports(self.program)

    def uses(self) -> Names:
        """Blocks that it reads, and those that it writes."""
        names = {port.name for port in self.program.outputs}
        return {port.name for port in self.program.inputs}, names | {name.removesuffix(NEXT) for name in names}


class _Source:
    """A stage that fills one block."""

    block: str
    entries: int

    def sizes(self) -> Sizes:
        """Entries of its blocks, by name."""
        yield self.block, self.entries

    def uses(self) -> Names:
        """Blocks that it reads, and those that it writes."""
        return set(), {self.block}


@dataclass(frozen=True)
class TableStage(_Source):
    """Row k of a table that all lanes share.

    Attributes:
        block, entries: what the row is called, and its numbers.
        spread: each lane gets a copy of the row in its block; else the programs that read it read the row itself, which is
            faster for a long row that is used once, and no other stage may use it.
    """

    block: str
    entries: int
    spread: bool = True


@dataclass(frozen=True)
class RowsStage(_Source):
    """Rows of the lane's own schedule, each from its time on; `Integrate` ends a step at them."""

    block: str
    entries: int

    def sizes(self) -> Sizes:
        """Entries of its blocks, by name."""
        yield from super().sizes()
        yield SINCE, 1
        yield from ((f"{self.block}.{part}", 1) for part in CURSOR)


@dataclass(frozen=True)
class DrawStage(_Source):
    """Random numbers, uniform in (0, 1), that depend on seed, lane, tick and channel and on nothing else."""

    block: str
    entries: int
    channel: int


@dataclass(frozen=True)
class DelayStage:
    """The block's value some whole ticks ago: block `by` says how many for each lane, up to length - 1."""

    block: str
    to: str
    by: str
    entries: int
    length: int

    def sizes(self) -> Sizes:
        """Entries of its blocks, by name."""
        yield from ((self.block, self.entries), (self.to, self.entries), (self.by, 1))

    def uses(self) -> Names:
        """Blocks that it reads, and those that it writes."""
        return {self.block, self.by}, {self.to}


@dataclass(frozen=True)
class RecordStage:
    """Blocks that are recorded, side by side, in every so-many-th tick."""

    name: str
    blocks: tuple[str, ...]
    entries: tuple[int, ...]

    def sizes(self) -> Sizes:
        """Entries of its blocks, by name."""
        return zip(self.blocks, self.entries, strict=True)

    def uses(self) -> Names:
        """Blocks that it reads, and those that it writes."""
        return set(self.blocks), set()


@dataclass(frozen=True)
class Turn:
    """Changes in the drives at times of their own: (x, u, …, turns) → x_next, every `period` s from t = 0 on."""

    program: Program
    period: float


class _Moving:
    """A stage that moves the plant, in steps that end at changes and where something switches."""

    turn: Turn | None
    planned: int
    seen: tuple[str, ...]
    touching: Program | None
    switched: Program | None
    bracket: Program | None
    narrow: Program | None

    @property
    def switching(self) -> tuple[Program, ...]:
        """The programs that find where something switches within a step, if anything does."""
        return tuple(p for p in (self.touching, self.switched, self.bracket, self.narrow) if p is not None)

    def _of_changes(self, sizes: dict[str, int]) -> Sizes:
        """Blocks by which a step ends where the command changes, or something is measured, from those of its programs."""
        if self.planned:
            yield from (("u_plan", self.planned * sizes["u"]), ("u_from", self.planned - 1))
        if self.seen:
            yield from ((name + SEEN, sizes[name]) for name in self.seen)
            yield "see_at", 1
        if self.turn is not None:
            yield from _ports(self.turn.program, next_too=False)
        yield "frozen", 1

    def _uses(self, step: Program) -> Names:
        """Blocks that it reads, and those that it writes, with the program that advances the state."""
        inside = {port.name.removesuffix(NEXT) for program in self.switching for port in program.outputs} | {"h"}
        reads, writes = ({port.name for port in step.inputs} | {"frozen"}) - inside, {"x", "frozen"}
        if self.planned:
            reads, writes = reads | {"u_plan", "u_from"}, writes | {"u"}
        if self.seen:
            kept = {name + SEEN for name in self.seen}
            reads, writes = reads | {"see_at"} | kept, writes | kept
        if self.turn is not None:
            reads, writes = reads | {port.name for port in self.turn.program.inputs}, writes | {TURNS}
        return reads, writes


@dataclass(frozen=True)
class Integrate(_Moving):
    """One tick of the plant: `step(x, …, h) → x_next`, in segments between changes, each in equal substeps.

    Attributes:
        step: the program; its other inputs are blocks.
        planned: how many commands block "u_plan" holds, of which "u" is the one in force; 0: "u" is held.
        seen: blocks, "x" first, that are kept as they are at "see_at" seconds, in (0, h], as "x_seen" and so on; a step ends
            there. Inputs are those in force until then.
        touching: (x, …) → touching, the contacts of a state; `step` then holds them.
        switched: (x, x_next, …, touching) → whether something switches within a step.
        bracket: the same → weights, bracket, part: between which parts of the step, and which to try.
        narrow: (x_next, …, touching, weights, bracket, part) → bracket_next, part_next, after a step of `part` of it.
        landing: (x_next, …, touching, weights) → x_next: the state at the end of a step that was cut. A lane in which even
            `SWITCHES` pieces do not suffice is then frozen.
        grazing: (x, x_next, …, touching, h) → grazed: above 0 where a step has no derivative; the lane is frozen before it.
        tangents: how many stand behind the values of block "x", each as long as these.
        turn: of servos' loops.
    """

    step: Program
    planned: int = 0
    seen: tuple[str, ...] = ()
    touching: Program | None = None
    switched: Program | None = None
    bracket: Program | None = None
    narrow: Program | None = None
    landing: Program | None = None
    grazing: Program | None = None
    tangents: int = 0
    turn: Turn | None = None

    @property
    def further(self) -> tuple[Program, ...]:
        """The programs beside the step and those of switching."""
        return tuple(p for p in (self.landing, self.grazing) if p is not None)

    def sizes(self) -> Sizes:
        """Entries of its blocks, by name."""
        sizes = {port.name: port.size for port in self.step.inputs}
        yield from _ports(self.step, next_too=False)
        yield SINCE, 1
        for program in self.switching:
            yield from _ports(program)
        for program in self.further:
            yield from _ports(program, next_too=False)
        if self.switching:
            yield "left", 1
        if self.grazing is not None:
            yield from (("grazed", 1), ("x_before", sizes["x"]))
        yield from self._of_changes(sizes)

    def uses(self) -> Names:
        """Blocks that it reads, and those that it writes."""
        return self._uses(self.step)


@dataclass(frozen=True)
class Adapt(_Moving):
    """One tick of the plant in steps that every lane chooses for itself, in segments between changes.

    Attributes:
        trial: (x, …, h) → x_next, error, grow, path; its other inputs are blocks.
        most: trials in one tick, times its length over `each` [s] where it is longer than that.
        planned, seen: as in `Integrate`.
        cross: (x_next, after, side, …) → crossed, settled: which of E functions of the state changed sides in a step that ends at
            "after" seconds.   halve: (x, path, now, h, side, lower, upper) → lower_next, upper_next: where, in parts of the step.
        choose: (upper, crossed) → part, hit_new: the first place, and who is there.
        note: (hit, settled, landed, moved, after, side, event_first, event_count) → the last three, as they are next.
        touching, switched, bracket, narrow: as in `Integrate`.
        settle: (x_next, u, …, touching, directions) → x_next: speeds that passed 0 are 0.
        held: (x, u, …, x_held, u_held, …) → same: whether nothing has changed that acts on the plant; steps then end where the
            lane likes, behind its tick too.   along: (x_from, path, part) → x_at: the state after that part of a step.
        within: (x, path_next, part) → x_next: the same of the step just tried, where places are sought.
        turn: of servos' loops.
    """

    trial: Program
    most: int
    planned: int = 0
    seen: tuple[str, ...] = ()
    cross: Program | None = None
    halve: Program | None = None
    choose: Program | None = None
    note: Program | None = None
    touching: Program | None = None
    switched: Program | None = None
    bracket: Program | None = None
    narrow: Program | None = None
    each: float | None = None
    settle: Program | None = None
    held: Program | None = None
    along: Program | None = None
    within: Program | None = None
    turn: Turn | None = None

    @property
    def ahead(self) -> tuple[Program, ...]:
        """The programs of steps that go on beyond their tick, if they do."""
        return tuple(p for p in (self.held, self.along) if p is not None)

    @property
    def further(self) -> tuple[Program, ...]:
        """The programs beside the trial and those of events and switching."""
        return tuple(p for p in (self.settle, *self.ahead, self.within) if p is not None)

    @property
    def step(self) -> Program:
        """The program that advances the state."""
        return self.trial

    @property
    def events(self) -> tuple[Program, ...]:
        """The programs of events, if there are any."""
        return tuple(p for p in (self.cross, self.halve, self.choose, self.note) if p is not None)

    def sizes(self) -> Sizes:
        """Entries of its blocks, by name."""
        sizes = {port.name: port.size for port in self.trial.inputs}
        yield from _ports(self.trial, next_too=False)
        yield SINCE, 1
        yield from ((name, 1) for name in ADAPTING)
        if any(port.name == "worst" for port in self.trial.outputs):
            yield "stalled_by", 1
        for program in (*self.events, *self.switching):
            yield from _ports(program)
        if self.events:
            yield "h_land", 1
        for program in self.further:
            yield from _ports(program, next_too=False)
        if self.ahead:
            yield from (("x_end", sizes["x"]), *((name, 1) for name in AHEAD))
        yield from self._of_changes(sizes)

    def uses(self) -> Names:
        """Blocks that it reads, and those that it writes."""
        both = {"h_try", "trials", "repeats", "stalled"}
        both |= {port.name.removesuffix(NEXT) for port in self.trial.outputs if port.name.endswith(NEXT)}
        if self.events:
            both |= {"side", "event_first", "event_count"}
        if self.ahead:
            both |= {port.name for port in self.ahead[0].inputs} | set(AHEAD) | {"x_end", "x_from"}
        reads, writes = self._uses(self.trial)
        return reads | both, writes | both


@dataclass(frozen=True)
class Exchange:
    """Lanes whose attempt is over take their next attempt, or the next task of all; the loop ends when no task is left.

    Block "over" says how a lane stands: 0 it goes on, 1 this attempt failed, 2 the task is done. "fresh" is 1 for a new
    attempt and 2 for a new task; the program that works on them sets it back to 0.

    Attributes:
        task, attempt, result: entries of the blocks of these names.   most: attempts of one task.
        ranked: how many of them every task names itself; the others are all attempts in their order.
    """

    task: int
    attempt: int
    result: int
    most: int
    ranked: int

    def sizes(self) -> Sizes:
        """Entries of its blocks, by name."""
        return ((name, getattr(self, name, 1)) for name in (*EXCHANGED, "result"))

    def uses(self) -> Names:
        """Blocks that it reads, and those that it writes."""
        return {"over", "result"}, set(EXCHANGED)


Stage = Call | TableStage | RowsStage | DrawStage | DelayStage | RecordStage | Integrate | Adapt | Exchange


def state_blocks(stages: tuple[Stage, ...]) -> set[str]:
    """Names of the blocks that carry something from tick to tick: read before they are written, and written by some stage.

    Values of a schedule's rows, and its cursor, follow from the time: both are left out.
    """
    written: set[str] = set()
    early: set[str] = set()
    scheduled = {stage.block for stage in stages if isinstance(stage, RowsStage)}
    for stage in stages:
        reads, writes = stage.uses()
        early |= reads - written
        written |= writes
    return (early & written) - scheduled - {"tick", SINCE}


def block_sizes(stages: tuple[Stage, ...]) -> dict[str, int]:
    """Entries of every block, by name, in order of appearance."""
    sizes: dict[str, int] = {}
    for stage in stages:
        for name, entries in stage.sizes():
            assert sizes.setdefault(name, entries) == entries, f"block {name} of {sizes[name]} entries, not {entries}"
    rows = unspread(stages)
    return {name: entries for name, entries in sizes.items() if name not in rows}


def _ports(program: Program, *, next_too: bool = True) -> Sizes:
    """Blocks of a program, and with `next_too` those that its outputs replace."""
    for port in (*program.inputs, *program.outputs):
        yield port.name, port.size
        if next_too:
            yield port.name.removesuffix(NEXT), port.size


def unspread(stages: tuple[Stage, ...]) -> set[str]:
    """Names of the table rows that programs read in place."""
    return {stage.block for stage in stages if isinstance(stage, TableStage) and not stage.spread}

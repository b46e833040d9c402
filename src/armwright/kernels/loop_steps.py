"""The stages of a simulation loop that integrate the plant, in LLVM IR: equal substeps, or steps that each lane chooses.

Steps end where a schedule has a row, where another planned command comes into force, and where something switches.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from armwright.kernels.loop_blocks import BlockPrinter
from armwright.kernels.machine import Value
from armwright.kernels.stages import (
    HALVINGS,
    HELD,
    NEARLY_DUE,
    NEXT,
    SECANTS,
    SECANTS_WITHIN,
    SEEN,
    SINCE,
    SWITCHES,
    TOO_MANY,
    TURNS,
    Adapt,
    Integrate,
    Turn,
)

NEARLY = 1.01  # a step that would leave less than a hundredth of itself to the edge goes on to it
CLOSER, REMAINDER = 4, 2.0**-6  # steps up to where something switches, and what each but the last leaves
BEYOND = 2.0**-24  # of a step: how far behind a place where something switches it then ends
LOST = 0.1  # how much shorter the next trial is where the state is infinite or NaN


@dataclass(frozen=True)
class _Trial:
    """Values of a trial, one a lane."""

    length: Value
    then: Value  # time in the tick behind it
    error: Value  # above 1: it was too long
    grow: Value  # length of the next trial by that of this one
    good: Value  # lanes in which it was not too long
    located: Value | None  # lanes in which an event was found within it; None of a stage without events


class StepPrinter(BlockPrinter):
    """Prints the stages `Integrate` and `Adapt`."""

    def _integrate(self, stage: Integrate, label: str) -> None:
        m = self.m
        t, edge = self._segment(stage, label)
        length = m.mul(m.sub(edge, t), self._splat("%part"))
        self._store("h", 0, length)
        with m.repeat(f"{label}.substep", "%substeps"):
            if stage.switching:
                self._step_in_pieces(stage, label, length)
            else:
                self._program(stage.step)
                self._accept()
        self._end_segment(stage, label, t, edge)

    def _step_in_pieces(self, stage: Integrate, label: str, length: Value) -> None:
        """A substep of that length, in every lane of as many pieces as it needs; where nothing switches it is one step."""
        m = self.m
        self._store("left", 0, length)
        before = m.block
        m.jump(f"{label}.piece")
        m.begin(f"{label}.piece")
        self._out(f"  %{label}.i = phi i64 [ 0, %{before} ], [ %{label}.i.next, %{label}.cut ]")
        left = self._load("left")
        self._store("h", 0, left)
        self._program(stage.switching[0])
        self._program(stage.step)
        alive = m.both(self._moving(), self._not_frozen())
        cut = self._cut(stage, label, alive, left, m.emit(f"icmp ult i64 %{label}.i, {SWITCHES}"))
        goes_on = m.lt(m.constant(0.0), left)
        if stage.grazing is not None:
            self._program(stage.grazing)
            grazes = m.both(m.both(alive, goes_on), m.lt(m.constant(0.0), self._load(f"grazed{NEXT}")))
            self._set(grazes, "grazed", self._load(f"grazed{NEXT}"))
            self._set(grazes, "frozen", self._splat("%tick"))
        self._accept(goes_on)
        self._store("left", 0, m.select(cut, m.sub(left, self._load("h")), m.constant(0.0)))
        self._out(f"  %{label}.i.next = add i64 %{label}.i, 1")
        m.branch(m.any(cut), f"{label}.piece", f"{label}.whole")
        m.begin(f"{label}.whole")
        if stage.landing is not None:
            more = m.both(m.lt(m.constant(0.0), self._load("switched")), self._not_frozen())
            self._set(more, "frozen", self._splat("%tick"))
            self._set(more, "grazed", m.constant(TOO_MANY))

    def _cut(self, stage: Integrate | Adapt, label: str, where: Value, length: Value, allowed: Value) -> Value:
        """The lanes `where` something switches within the step just taken; their step now ends at the first such place.

        Where there is none in the whole tile, or it is not `allowed`, nothing is done. `length` is that of the step, and
        block h its length afterwards.
        """
        m, (_, switched, bracket, narrow) = self.m, stage.switching
        self._program(switched)
        none = m.lt(m.constant(0.0), m.constant(0.0))
        switches = m.both(where, m.lt(m.constant(0.0), self._load("switched")))
        some = m.emit(f"and i1 {m.any(switches)}, {allowed}")
        before = m.block
        with m.where(some, f"{label}.bracket", f"{label}.cut"):
            self._program(bracket)
            within = stage.within if isinstance(stage, Adapt) else None
            with m.repeat(f"{label}.secant", SECANTS if within is None else SECANTS_WITHIN):
                if within is None:
                    self._store("h", 0, m.mul(self._load("part"), length))
                self._program(within or stage.step)
                self._program(narrow)
                self._replace_blocks(narrow)
            part = self._load("bracket", 1)
            if isinstance(stage, Integrate) and stage.landing is not None:
                self._land(stage, switches, m.select(switches, m.mul(self._beyond(part), length), length))
            else:
                self._store("h", 0, m.select(switches, m.mul(part, length), length))
                self._program(stage.step)
            last = m.block
        return m.emit(f"phi {m.mask} [ {none}, %{before} ], [ {switches}, %{last} ]")

    def _land(self, stage: Integrate, switches: Value, cut: Value) -> None:
        """The state behind a step of length `cut` that ends where something switches, and the tangents that it carries.

        The last stage of a rule lies at the end of its step, which is just beyond that place, where slopes are others. Tangents
        are therefore those of steps that come closer and closer to it, until that stage weighs nothing.
        """
        m = self.m
        assert stage.landing is not None
        for k in range(self.sizes["x"]):
            self._store("x_before", k, self._load("x", k))
        self._store("h", 0, cut)
        self._program(stage.step)
        values = self.sizes["x"] // (1 + stage.tangents)
        located = [self._load(f"x{NEXT}", k) for k in range(values)]
        left = cut
        for closer in range(CLOSER if stage.tangents else 0):
            part = 1.0 if closer == CLOSER - 1 else 1.0 - REMAINDER
            h = m.mul(m.constant(part), left)
            left = m.sub(left, h)
            self._store("h", 0, m.select(switches, h, cut))
            self._program(stage.step)
            if closer < CLOSER - 1:
                self._set_all(switches, "x", f"x{NEXT}")
        for k, value in enumerate(located):
            self._store(f"x{NEXT}", k, value)
        self._program(stage.landing)
        for k in range(self.sizes["x"]):
            landed, moved = self._load(f"x{NEXT}{NEXT}", k), self._load(f"x{NEXT}", k)
            self._store(f"x{NEXT}", k, m.select(switches, landed, moved))
            self._store("x", k, self._load("x_before", k))
        self._store("h", 0, cut)

    def _beyond(self, part: Value) -> Value:
        """A place within a step, moved so far that no rounding takes it for one before it."""
        m, one = self.m, self.m.constant(1.0)
        moved = m.add(part, m.constant(BEYOND))
        return m.select(m.lt(moved, one), moved, one)

    def _accept(self, where: Value | None = None) -> None:
        """The state after a step, in lanes that move and stay finite; the others that move are frozen."""
        m = self.m
        moving = self._moving() if where is None else m.both(self._moving(), where)
        frozen = self._load("frozen")
        alive = m.both(moving, m.lt(frozen, m.constant(0.0)))
        new = [self._load(f"x{NEXT}", k) for k in range(self.sizes["x"])]
        poison = m.constant(0.0)
        for value in new:  # 0·x is NaN where x is not finite, and NaN stays
            poison = m.fma(value, m.constant(0.0), poison)
        finite = m.eq(poison, m.constant(0.0))
        good, bad = m.both(alive, finite), m.both(alive, m.inverse(finite))
        self._store("frozen", 0, m.select(bad, self._splat("%tick"), frozen))
        for k, value in enumerate(new):
            self._set(good, "x", value, k)

    def _moving(self) -> Value:
        """Lanes that have not ended their tick."""
        return self.m.lt(self._load(SINCE), self._splat("%h"))

    def _not_frozen(self) -> Value:
        return self.m.lt(self._load("frozen"), self.m.constant(0.0))

    def _adapt(self, stage: Adapt, label: str) -> None:
        """Trials while any lane has not reached its edge; a lane's state is written only where its own trial was good."""
        m = self.m
        self._store("tried", 0, m.constant(0.0))
        t, edge = self._segment(stage, label)
        if stage.ahead:
            self._begin_interval(stage, t)
            waits = m.any(m.both(m.lt(self._load(SINCE), edge), self._not_frozen()))
            m.branch(waits, f"{label}.trial", f"{label}.reached")
        else:
            m.jump(f"{label}.trial")
        m.begin(f"{label}.trial")
        now, wanted = self._load(SINCE), self._load("h_try")
        wanted = m.select(m.lt(m.constant(0.0), wanted), wanted, self._splat("%h"))
        active = m.both(m.lt(now, edge), self._not_frozen())
        trial = self._try(stage, label, now, wanted, edge, active)
        measured = self._follow(trial, wanted, active)
        tried = m.add(self._load("tried"), m.truth(active))
        self._store("tried", 0, tried)
        self._store("trials", 0, m.add(self._load("trials"), m.truth(active)))
        self._take(stage, trial)
        now = m.select(trial.good, trial.then, now)
        self._store(SINCE, 0, now)
        waits = m.both(active, m.lt(now, edge))
        over = m.both(waits, m.le(self._most(stage), tried))
        self._set(over, "frozen", self._splat("%tick"))
        self._store("stalled", 0, m.add(self._load("stalled"), m.truth(m.both(over, measured))))
        if "worst" in self.sizes:
            self._set_all(over, "stalled_by", "worst")
        again = m.any(m.both(waits, m.inverse(over)))
        m.branch(again, f"{label}.trial", f"{label}.reached")
        m.begin(f"{label}.reached")
        if stage.ahead:
            self._look_back(stage, edge)
        self._end_segment(stage, label, t, edge)

    def _try(self, stage: Adapt, label: str, now: Value, wanted: Value, edge: Value, active: Value) -> _Trial:
        """A trial of the wanted length or up to the edge, cut where something switches."""
        m, one = self.m, self.m.constant(1.0)
        left = m.sub(edge, now)
        s = wanted if stage.ahead else m.select(m.le(left, m.mul(wanted, m.constant(NEARLY))), left, wanted)
        if stage.events:
            s = m.select(m.lt(m.constant(0.0), self._load("landed")), self._load("h_land"), s)
        ends = m.le(left, s)
        self._store("h", 0, s)
        if stage.switching:
            self._program(stage.switching[0])
        self._program(stage.trial)
        if stage.switching:
            fine = m.both(active, m.le(self._load("error"), one))
            cut_short = self._cut(stage, label, fine, s, "true")
            s, ends = self._load("h"), m.both(ends, m.inverse(cut_short))
        if stage.settle is not None:
            self._program(stage.settle)
            self._replace_blocks(stage.settle)
        error, grow = self._load("error"), self._load("grow")
        good = m.both(active, m.le(error, one))
        then = m.add(now, s) if stage.ahead else m.select(ends, edge, m.add(now, s))
        located = None
        if stage.events:
            good, located = self._find_events(stage, label, now, then, active, good)
        return _Trial(s, then, error, grow, good, located)

    def _follow(self, trial: _Trial, wanted: Value, active: Value) -> Value:
        """Puts down the length of the next trial; lanes in which this one's error is a number."""
        m, zero, one = self.m, self.m.constant(0.0), self.m.constant(1.0)
        s, error = trial.length, trial.error
        measured = m.le(error, m.constant(sys.float_info.max))
        grow = m.select(measured, trial.grow, m.constant(LOST))
        # Behind a step that was refused, the next one does not grow.
        grow = m.select(m.both(m.lt(zero, self._load("rejected")), m.lt(one, grow)), one, grow)
        following = m.mul(s, grow)
        # A step that was cut short does not shorten the next.
        short = m.both(trial.good, m.both(m.lt(s, wanted), m.lt(following, wanted)))
        following = m.select(short, wanted, following)
        if trial.located is not None:
            following = m.select(trial.located, wanted, following)
        self._store("h_try", 0, m.select(active, following, wanted))
        rejected = m.truth(m.both(active, m.inverse(m.le(error, one))))
        self._store("rejected", 0, rejected)
        self._store("repeats", 0, m.add(self._load("repeats"), rejected))
        return measured

    def _take(self, stage: Adapt, trial: _Trial) -> None:
        """The state behind a trial, and all else that it computed, in lanes in which it was good."""
        if stage.ahead:
            self._set(trial.good, "span", trial.length)
            self._set_all(trial.good, "x_from", "x")
        for port in stage.trial.outputs:
            if port.name.endswith(NEXT):
                self._set_all(trial.good, port.name.removesuffix(NEXT), port.name)

    def _begin_interval(self, stage: Adapt, t: Value) -> None:
        """Continues lanes with unchanged inputs after their last step; restarts others, with steps no longer than that lasted."""
        m, (held, _) = self.m, stage.ahead
        zero = m.constant(0.0)
        self._program(held)
        ahead = self._load("ahead")
        same, reaches = m.lt(zero, self._load("same")), m.lt(zero, ahead)
        on, anew = m.both(same, reaches), m.both(m.inverse(same), reaches)
        wanted, lasted = self._load("h_try"), m.sub(self._load("span"), ahead)
        self._store("h_try", 0, m.select(m.both(anew, m.lt(lasted, wanted)), lasted, wanted))
        self._store(SINCE, 0, m.select(on, m.add(t, ahead), t))
        self._set_all(on, "x", "x_end")
        for port in held.inputs:
            if port.name.endswith(HELD) and port.name != f"x{HELD}":
                self._copy(f'%"{port.name}.at"', port.name.removesuffix(HELD), port.size)

    def _look_back(self, stage: Adapt, edge: Value) -> None:
        """The state at the edge, within the last step; a lane that stopped stays where it is."""
        m = self.m
        zero, one = m.constant(0.0), m.constant(1.0)
        beyond = m.sub(self._load(SINCE), edge)
        reaches = m.both(m.lt(zero, beyond), self._not_frozen())
        self._store("ahead", 0, m.select(reaches, beyond, zero))
        span = m.select(reaches, self._load("span"), one)
        self._store("part", 0, m.div(m.sub(span, beyond), span))
        self._program(stage.ahead[1])
        for k in range(self.sizes["x"]):
            end = self._load("x", k)
            at = m.select(reaches, self._load("x_at", k), end)
            for block, value in (("x_end", end), ("x", at), (f"x{HELD}", at)):
                self._store(block, k, value)

    def _most(self, stage: Adapt) -> Value:
        """Trials that a tick may take."""
        m, one = self.m, self.m.constant(1.0)
        most = m.constant(float(stage.most))
        if stage.each is None:
            return most
        times = m.mul(self._splat("%h"), m.constant(1.0 / stage.each))
        return m.mul(most, m.select(m.lt(one, times), times, one))

    def _find_events(
        self, stage: Adapt, label: str, now: Value, then: Value, active: Value, good: Value
    ) -> tuple[Value, Value]:
        """Good steps in which no event happened, or that end at one; and those in which one was found, to be taken again."""
        m = self.m
        cross, halve, choose, note = stage.events
        start = m.mul(self._splat("%tick"), self._splat("%h"))
        self._store("now", 0, m.add(start, now))
        self._store("after", 0, m.add(start, then))
        self._program(cross)
        landing = m.lt(m.constant(0.0), self._load("landed"))
        some = m.constant(0.0)
        for k in range(self.sizes["crossed"]):
            crossed = self._load("crossed", k)
            some = m.select(m.lt(some, crossed), crossed, some)
        located = m.both(m.both(good, m.inverse(landing)), m.lt(m.constant(0.0), some))
        with m.where(m.any(located), f"{label}.locate", f"{label}.note"):
            for k in range(self.sizes["upper"]):
                self._store("lower", k, m.constant(0.0))
                self._store("upper", k, m.constant(1.0))
            with m.repeat(f"{label}.halve", HALVINGS):
                self._program(halve)
                self._replace_blocks(halve)
            self._program(choose)
            shorter = m.mul(self._load("part"), self._load("h"))
            self._set(located, "h_land", shorter)
            self._set_all(located, "hit", "hit_new")
        good = m.both(good, m.inverse(located))
        self._store("moved", 0, m.truth(good))
        self._program(note)
        self._replace_blocks(note)
        # A step to an event that was refused is searched anew.
        self._store("landed", 0, m.select(active, m.truth(located), self._load("landed")))
        return good, located

    def _segment(self, stage: Integrate | Adapt, label: str) -> tuple[Value, Value]:
        """Time of each lane in the tick, and its next change after that; rows that are due have come into force."""
        m = self.m
        not_last = m.emit("icmp slt i64 %k, %last")
        m.branch(not_last, f"{label}.rows", "tick.end")
        m.begin(f"{label}.rows")
        for number, rows in enumerate(self.schedules):
            self._rows(rows, f"{label}.due{number}")
        h, t = self._splat("%h"), self._load(SINCE)
        edge = h
        for rows in self.schedules:
            due, offset = self._load(f"{rows.block}.due_tick"), self._load(f"{rows.block}.due_offset")
            here = m.eq(due, self._splat("%tick"))
            edge = m.select(m.both(here, m.lt(offset, edge)), offset, edge)
        changes = [self._load("u_from", s - 1) for s in range(1, stage.planned)]
        for begins in [*changes, self._load("see_at")] if stage.seen else changes:
            edge = m.select(m.both(m.lt(t, begins), m.lt(begins, edge)), begins, edge)
        commands = self.sizes["u"] if stage.planned else 0
        for entry in range(commands):
            chosen = self._load("u_plan", entry)
            for s in range(1, stage.planned):
                has_begun = m.le(self._load("u_from", s - 1), t)
                chosen = m.select(has_begun, self._load("u_plan", s * commands + entry), chosen)
            self._store("u", entry, chosen)
        return t, edge if stage.turn is None else self._turn(stage.turn, label, t, edge)

    def _turn(self, turn: Turn, label: str, t: Value, edge: Value) -> Value:
        """Servos' loops turn in lanes in which it is time; the edge, or when they next do if that is before it."""
        m = self.m
        period, near = m.constant(turn.period), m.constant(NEARLY_DUE * turn.period)

        def due_at() -> Value:
            return m.sub(m.mul(self._load(TURNS), period), m.mul(self._splat("%tick"), self._splat("%h")))

        due = m.both(self._moving(), m.le(due_at(), m.add(t, near)))
        with m.where(m.any(due), f"{label}.turn", f"{label}.turned"):
            self._program(turn.program)
            self._accept(due)
            self._store(TURNS, 0, m.add(self._load(TURNS), m.truth(due)))
        following = due_at()
        return m.select(m.lt(following, m.sub(edge, near)), following, edge)

    def _end_segment(self, stage: Integrate | Adapt, label: str, t: Value, edge: Value) -> None:
        """The state and its inputs that sensors see there; then another segment where any lane has not ended its tick."""
        m = self.m
        if stage.seen:
            now = m.both(m.eq(edge, self._load("see_at")), m.lt(t, self._splat("%h")))
            for name in stage.seen:
                for k in range(self.sizes[name]):
                    kept = self._load(name + SEEN, k)
                    self._store(name + SEEN, k, m.select(now, self._load(name, k), kept))
        self._store(SINCE, 0, edge)
        again = m.any(m.lt(edge, self._splat("%h")))
        m.branch(again, f"{label}.rows", f"{label}.end")
        m.begin(f"{label}.end")

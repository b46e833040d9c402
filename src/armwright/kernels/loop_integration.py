"""The stages of a simulation loop that move the plant, as LLVM IR: in equal substeps, or in steps that each lane chooses."""

from __future__ import annotations

import sys

from armwright.kernels.loop_landing import LandingPrinter
from armwright.kernels.machine import Value
from armwright.kernels.stages import CURSOR, HALVINGS, NEVER, NEXT, SINCE, Adapt, Integrate, Rows

ROWS = ("tick", "offset", "values")  # of all lanes' schedules, one behind another
NEARLY = 1.01  # a step that would leave less than a hundredth of itself to the edge goes on to it
LOST = 0.1  # how much shorter the next trial is where the state left the finite numbers


class IntegrationPrinter(LandingPrinter):
    """Prints the stages that schedules and the plant go through."""

    def _rows(self, stage: Rows, label: str) -> None:
        """What is due at the beginning of the tick, so that later stages of it see the row in force."""
        self._due(stage, label)

    def _integrate(self, stage: Integrate, label: str) -> None:
        m = self.m
        t, edge = self._segment(stage, label)
        span = m.sub(edge, t)
        length = span if stage.substeps == 1 else m.mul(span, m.constant(1.0 / stage.substeps))
        self._store("h", 0, length)
        before, last = m.block, f"{label}.whole" if stage.landing else f"{label}.substep"
        self._out(f"  br label %{label}.substep")
        m.begin(f"{label}.substep")
        self._out(f"  %{label}.j = phi i64 [ 0, %{before} ], [ %{label}.j.next, %{last} ]")
        if stage.landing:
            self._stepped_in_pieces(stage, label, length)
        else:
            self._stepped(stage)
        self._out(f"  %{label}.j.next = add i64 %{label}.j, 1")
        more = m.emit(f"icmp ult i64 %{label}.j.next, {stage.substeps}")
        self._out(f"  br i1 {more}, label %{label}.substep, label %{label}.landed")
        self._landed(stage, label, t, edge)

    def _adapt(self, stage: Adapt, label: str) -> None:
        """Trials while any lane has not reached its edge; a lane's state is written only where its own trial was good."""
        m = self.m
        self._store("tried", 0, m.constant(0.0))
        t, edge = self._segment(stage, label)
        self._out(f"  br label %{label}.trial")
        m.begin(f"{label}.trial")
        now, wanted = self._load(SINCE, 0), self._load("h_try", 0)
        wanted = m.select(m.lt(m.constant(0.0), wanted), wanted, self._splat("%h"))
        active = m.both(m.lt(now, edge), m.lt(self._load("frozen", 0), m.constant(0.0)))
        left = m.sub(edge, now)
        s = m.select(m.le(left, m.mul(wanted, m.constant(NEARLY))), left, wanted)
        if stage.watching:
            landing = m.lt(m.constant(0.0), self._load("landed", 0))
            s = m.select(landing, self._load("h_land", 0), s)
        ends = m.le(left, s)
        self._store("h", 0, s)
        if stage.landing:
            self._program(stage.landing[0])
        self._program(stage.trial)
        if stage.landing:
            fine = m.both(active, m.le(self._load("error", 0), m.constant(1.0)))
            cut_short = self._cut(stage, label, fine, s, "true")
            s, ends = self._load("h", 0), m.both(ends, m.inverse(cut_short))
        error, grow = self._load("error", 0), self._load("grow", 0)
        good = m.both(active, m.le(error, m.constant(1.0)))
        then = m.select(ends, edge, m.add(now, s))
        if stage.watching:
            good, found = self._watch(stage, label, now, then, active, good)
        else:
            found = None
        measured = m.le(error, m.constant(sys.float_info.max))
        grow = m.select(measured, grow, m.constant(LOST))
        held_back = m.lt(m.constant(0.0), self._load("rejected", 0))
        grow = m.select(m.both(held_back, m.lt(m.constant(1.0), grow)), m.constant(1.0), grow)
        following = m.mul(s, grow)
        cut = m.both(good, m.both(m.lt(s, wanted), m.lt(following, wanted)))
        following = m.select(cut, wanted, following)
        if found is not None:
            following = m.select(found, wanted, following)
        self._store("h_try", 0, m.select(active, following, wanted))
        bad = m.both(active, m.inverse(m.le(error, m.constant(1.0))))
        self._store("rejected", 0, m.truth(bad))
        one = m.truth(active)
        tried = m.add(self._load("tried", 0), one)
        self._store("tried", 0, tried)
        self._store("trials", 0, m.add(self._load("trials", 0), one))
        for k in range(self.sizes["x"]):
            self._store("x", k, m.select(good, self._load(f"x{NEXT}", k), self._load("x", k)))
        now = m.select(good, then, now)
        self._store(SINCE, 0, now)
        waits = m.both(active, m.lt(now, edge))
        over = m.both(waits, m.le(m.constant(float(stage.most)), tried))
        self._store("frozen", 0, m.select(over, self._splat("%tick"), self._load("frozen", 0)))
        stalled = m.truth(m.both(over, measured))
        self._store("stalled", 0, m.add(self._load("stalled", 0), stalled))
        again = self._any(m.both(waits, m.inverse(over)))
        self._out(f"  br i1 {again}, label %{label}.trial, label %{label}.landed")
        self._landed(stage, label, t, edge)

    def _watch(
        self, stage: Adapt, label: str, now: Value, then: Value, active: Value, good: Value
    ) -> tuple[Value, Value]:
        """Good steps in which no event happened, or that land on one; and those in which one was found, to be taken again."""
        m = self.m
        cross, halve, choose, note = stage.watching
        start = m.mul(self._splat("%tick"), self._splat("%h"))
        self._store("now", 0, m.add(start, now))
        self._store("after", 0, m.add(start, then))
        self._program(cross)
        landing = m.lt(m.constant(0.0), self._load("landed", 0))
        some = m.constant(0.0)
        for k in range(self.sizes["crossed"]):
            crossed = self._load("crossed", k)
            some = m.select(m.lt(some, crossed), crossed, some)
        found = m.both(m.both(good, m.inverse(landing)), m.lt(m.constant(0.0), some))
        self._out(f"  br i1 {self._any(found)}, label %{label}.locate, label %{label}.note")
        m.begin(f"{label}.locate")
        for k in range(self.sizes["upper"]):
            self._store("lower", k, m.constant(0.0))
            self._store("upper", k, m.constant(1.0))
        self._out(f"  br label %{label}.halve")
        m.begin(f"{label}.halve")
        self._out(f"  %{label}.i = phi i64 [ 0, %{label}.locate ], [ %{label}.i.next, %{label}.halve ]")
        self._program(halve)
        for port in halve.outputs:
            self._copied(port.name.removesuffix(NEXT), port.name, port.size)
        self._out(f"  %{label}.i.next = add i64 %{label}.i, 1")
        more = m.emit(f"icmp ult i64 %{label}.i.next, {HALVINGS}")
        self._out(f"  br i1 {more}, label %{label}.halve, label %{label}.choose")
        m.begin(f"{label}.choose")
        self._program(choose)
        shorter = m.mul(self._load("part", 0), self._load("h", 0))
        self._store("h_land", 0, m.select(found, shorter, self._load("h_land", 0)))
        for k in range(self.sizes["hit"]):
            self._store("hit", k, m.select(found, self._load("hit_new", k), self._load("hit", k)))
        self._out(f"  br label %{label}.note")
        m.begin(f"{label}.note")
        good = m.both(good, m.inverse(found))
        self._store("moved", 0, m.truth(good))
        self._program(note)
        for port in note.outputs:
            self._copied(port.name.removesuffix(NEXT), port.name, port.size)
        landed = m.select(
            active, m.truth(found), self._load("landed", 0)
        )  # a landing that was no good is searched anew
        self._store("landed", 0, landed)
        return good, found

    def _segment(self, stage: Integrate | Adapt, label: str) -> tuple[Value, Value]:
        """Where each lane is in the tick, and the next change behind that; what is due has come into force."""
        m = self.m
        h = self._splat("%h")
        not_last = m.emit("icmp slt i64 %k, %last")
        self._out(f"  br i1 {not_last}, label %{label}.rows, label %tick.end")
        m.begin(f"{label}.rows")
        for number, rows in enumerate(self.landed):
            self._due(rows, f"{label}.due{number}")
        t = self._load(SINCE, 0)
        edge = h
        for rows in self.landed:
            due, offset = self._load(f"{rows.block}.due_tick", 0), self._load(f"{rows.block}.due_offset", 0)
            here = m.emit(f"fcmp oeq {m.real} {due}, {self._splat('%tick')}")
            edge = m.select(m.both(here, m.lt(offset, edge)), offset, edge)
        changes = [self._load("u_from", s - 1) for s in range(1, stage.planned)]
        for begins in [*changes, self._load("see_at", 0)] if stage.seen else changes:
            edge = m.select(m.both(m.lt(t, begins), m.lt(begins, edge)), begins, edge)
        if stage.planned:
            commands = self.sizes["u"]
            for entry in range(commands):
                chosen = self._load("u_plan", entry)
                for s in range(1, stage.planned):
                    begun = m.le(self._load("u_from", s - 1), t)
                    chosen = m.select(begun, self._load("u_plan", s * commands + entry), chosen)
                self._store("u", entry, chosen)
        return t, edge

    def _landed(self, stage: Integrate | Adapt, label: str, t: Value, edge: Value) -> None:
        """The end of a segment: what is seen there; another one where any lane has not ended its tick."""
        m = self.m
        m.begin(f"{label}.landed")
        if stage.seen:
            now = m.both(m.eq(edge, self._load("see_at", 0)), m.lt(t, self._splat("%h")))
            for k in range(self.sizes["x"]):
                self._store("x_seen", k, m.select(now, self._load("x", k), self._load("x_seen", k)))
        self._store(SINCE, 0, edge)
        again = self._any(m.lt(edge, self._splat("%h")))
        self._out(f"  br i1 {again}, label %{label}.rows, label %{label}.end")
        m.begin(f"{label}.end")

    def _due(self, rows: Rows, label: str) -> None:
        """Rows that are due now, where any lane has one in this tick."""
        m, block = self.m, rows.block
        due = self._any(m.emit(f"fcmp oeq {m.real} {self._load(f'{block}.due_tick', 0)}, {self._splat('%tick')}"))
        self._out(f"  br i1 {due}, label %{label}.take, label %{label}.none")
        m.begin(f"{label}.take")
        name = f"advance.{rows.entries}"
        self.module.functions[name] = _advance(name, self.w, rows.entries)
        blocks = [f"{each}.at" for each in (SINCE, block, *(f"{block}.{part}" for part in CURSOR))]
        pointers = [*blocks, *(f"{block}.rows.{part}" for part in ROWS)]
        given = ", ".join(f'ptr %"{pointer}"' for pointer in pointers)
        self._out(f'  call void @"{name}"(double %tick, {given})')
        self._out(f"  br label %{label}.none")
        m.begin(f"{label}.none")


def _advance(name: str, w: int, entries: int) -> str:
    """For each lane of a tile: while its next row is due at (tick, since), that row's values, and on to the next row."""
    return f"""define internal void @"{name}"(double %tick, ptr %since, ptr %values, ptr %due_tick, ptr %due_offset, ptr %cursor,
    ptr %end, ptr %row_tick, ptr %row_offset, ptr %row_values) noinline nounwind {{
entry:
  br label %lane
lane:
  %l = phi i64 [ 0, %entry ], [ %l.next, %next ]
  %tick.at = getelementptr double, ptr %due_tick, i64 %l
  %offset.at = getelementptr double, ptr %due_offset, i64 %l
  %cursor.at = getelementptr double, ptr %cursor, i64 %l
  %end.at = getelementptr double, ptr %end, i64 %l
  %since.at = getelementptr double, ptr %since, i64 %l
  %now = load double, ptr %since.at, align 8
  %last = load double, ptr %end.at, align 8
  br label %check
check:
  %due = load double, ptr %tick.at, align 8
  %offset = load double, ptr %offset.at, align 8
  %this = fcmp oeq double %due, %tick
  %past = fcmp ole double %offset, %now
  %now.due = and i1 %this, %past
  br i1 %now.due, label %take, label %next
take:
  %row.number = load double, ptr %cursor.at, align 8
  %row = fptosi double %row.number to i64
  %row.first = mul i64 %row, {entries}
  br label %entry.copy
entry.copy:
  %e = phi i64 [ 0, %take ], [ %e.next, %entry.copy ]
  %from.index = add i64 %row.first, %e
  %from = getelementptr double, ptr %row_values, i64 %from.index
  %value = load double, ptr %from, align 8
  %to.first = mul i64 %e, {w}
  %to.index = add i64 %to.first, %l
  %to = getelementptr double, ptr %values, i64 %to.index
  store double %value, ptr %to, align 8
  %e.next = add i64 %e, 1
  %e.more = icmp ult i64 %e.next, {entries}
  br i1 %e.more, label %entry.copy, label %taken
taken:
  %row.following = fadd double %row.number, 1.0
  store double %row.following, ptr %cursor.at, align 8
  %is.more = fcmp olt double %row.following, %last
  br i1 %is.more, label %following, label %none
following:
  %row.next = add i64 %row, 1
  %f.tick.at = getelementptr double, ptr %row_tick, i64 %row.next
  %f.offset.at = getelementptr double, ptr %row_offset, i64 %row.next
  %f.tick = load double, ptr %f.tick.at, align 8
  %f.offset = load double, ptr %f.offset.at, align 8
  store double %f.tick, ptr %tick.at, align 8
  store double %f.offset, ptr %offset.at, align 8
  br label %check
none:
  store double {NEVER:e}, ptr %tick.at, align 8
  br label %check
next:
  %l.next = add i64 %l, 1
  %l.more = icmp ult i64 %l.next, {w}
  br i1 %l.more, label %lane, label %done
done:
  ret void
}}"""

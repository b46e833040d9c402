"""Steps of a stage that moves the plant, as LLVM IR: as wholes, or in pieces that end where something switches."""

from __future__ import annotations

from armwright.kernels.loop_syntax import LoopWords
from armwright.kernels.machine import Value
from armwright.kernels.stages import LANDINGS, NEXT, SECANTS, SINCE, Adapt, Integrate


class LandingPrinter(LoopWords):
    """Prints one substep of `Integrate`, and how a step of either stage is cut."""

    def _stepped(self, stage: Integrate) -> None:
        """One step of length h."""
        self._program(stage.step)
        self._taken()

    def _stepped_in_pieces(self, stage: Integrate, label: str, length: Value) -> None:
        """A substep of that length, in every lane of as many pieces as it needs; where nothing switches it is one step."""
        m = self.m
        self._store("left", 0, length)
        before = m.block
        self._out(f"  br label %{label}.piece")
        m.begin(f"{label}.piece")
        self._out(f"  %{label}.i = phi i64 [ 0, %{before} ], [ %{label}.i.next, %{label}.cut ]")
        left = self._load("left", 0)
        self._store("h", 0, left)
        self._program(stage.landing[0])
        self._program(stage.step)
        moving = m.lt(self._load(SINCE, 0), self._splat("%h"))
        alive = m.both(moving, m.lt(self._load("frozen", 0), m.constant(0.0)))
        cut = self._cut(stage, label, alive, left, m.emit(f"icmp ult i64 %{label}.i, {LANDINGS}"))
        self._taken(m.lt(m.constant(0.0), left))
        self._store("left", 0, m.select(cut, m.sub(left, self._load("h", 0)), m.constant(0.0)))
        self._out(f"  %{label}.i.next = add i64 %{label}.i, 1")
        self._out(f"  br i1 {self._any(cut)}, label %{label}.piece, label %{label}.whole")
        m.begin(f"{label}.whole")

    def _cut(self, stage: Integrate | Adapt, label: str, where: Value, length: Value, allowed: Value) -> Value:
        """The lanes `where` something switches within the step just taken; theirs now end at the first such place.

        Where there is none in the whole tile, or it is not `allowed`, nothing is done. `length` is that of the step, and h then
        what it has become.
        """
        m, (_, switched, bracket, narrow) = self.m, stage.landing
        self._program(switched)
        none = m.lt(m.constant(0.0), m.constant(0.0))
        found = m.both(where, m.lt(m.constant(0.0), self._load("switched", 0)))
        some = m.emit(f"and i1 {self._any(found)}, {allowed}")
        before = m.block
        self._out(f"  br i1 {some}, label %{label}.bracket, label %{label}.cut")
        m.begin(f"{label}.bracket")
        self._program(bracket)
        self._out(f"  br label %{label}.secant")
        m.begin(f"{label}.secant")
        self._out(f"  %{label}.n = phi i64 [ 0, %{label}.bracket ], [ %{label}.n.next, %{label}.secant ]")
        self._store("h", 0, m.mul(self._load("part", 0), length))
        self._program(stage.step)
        self._program(narrow)
        for port in narrow.outputs:
            self._copied(port.name.removesuffix(NEXT), port.name, port.size)
        self._out(f"  %{label}.n.next = add i64 %{label}.n, 1")
        more = m.emit(f"icmp ult i64 %{label}.n.next, {SECANTS}")
        self._out(f"  br i1 {more}, label %{label}.secant, label %{label}.there")
        m.begin(f"{label}.there")
        self._store("h", 0, m.select(found, m.mul(self._load("bracket", 1), length), length))
        self._program(stage.step)
        self._out(f"  br label %{label}.cut")
        m.begin(f"{label}.cut")
        self._out(f"  %{label}.found = phi {m.mask} [ {none}, %{before} ], [ {found}, %{label}.there ]")
        return f"%{label}.found"

    def _taken(self, where: Value | None = None) -> None:
        """Takes over what a step came to, in lanes that move and stay finite; the others that move are frozen."""
        m = self.m
        moving = m.lt(self._load(SINCE, 0), self._splat("%h"))
        if where is not None:
            moving = m.both(moving, where)
        frozen = self._load("frozen", 0)
        alive = m.both(moving, m.lt(frozen, m.constant(0.0)))
        new = [self._load(f"x{NEXT}", k) for k in range(self.sizes["x"])]
        poison = m.constant(0.0)
        for value in new:  # 0·x is NaN where x is not finite, and NaN stays
            poison = m.fma(value, m.constant(0.0), poison)
        finite = m.eq(poison, m.constant(0.0))
        good, bad = m.both(alive, finite), m.both(alive, m.inverse(finite))
        self._store("frozen", 0, m.select(bad, self._splat("%tick"), frozen))
        for k, value in enumerate(new):
            self._store("x", k, m.select(good, value, self._load("x", k)))

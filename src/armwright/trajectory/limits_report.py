"""Report of the share of its limits that a motion uses, and of those that it exceeds or that could not be checked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import AnyArm, AnyMotion, as_arm, as_motion, expect
from armwright.errors import ScenarioError
from armwright.kernels.compiled import KERNELS, compile_arm
from armwright.model import Model
from armwright.model.joint_signals import UNITS
from armwright.model.payload import Payload
from armwright.results.result import Result, bars_height, draw_bars
from armwright.results.table import Table, number
from armwright.trajectory.efforts import efforts, in_order, without_constants
from armwright.trajectory.joined import LARGEST_JUMP, Joined
from armwright.trajectory.limits import MotionLimits, current_torques
from armwright.trajectory.motion import Motion
from armwright.trajectory.piecewise import PiecewisePolynomial
from armwright.trajectory.rest_to_rest import RestToRest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SUPPORT = KERNELS.named("plan")

JUMP = 1e-6  # of the largest acceleration or speed: what is more, is no rounding
STILL = 1e-3  # of the joint that moves most: the rest of a motion of another joint may be rounding
KEPT = 1.0 + 1e-6  # share of a limit up to which it counts as kept
SAMPLES = 2000  # of a report, at least, and …
IN_A_PIECE = 10  # … between two breaks
ROUNDS, BETWEEN = 3, 8  # refinements near extremes, points in each interval
AS_LARGE = 0.5  # of the way to the next value
BESIDE = 1e-9  # [s], and of a time: where positions beside a jump are looked at
MECHANICAL = ("position", "velocity", "acceleration", "jerk")  # by their order as derivatives
SHOWN = 4  # jumps that are listed


@dataclass(frozen=True)
class Excess:
    """A limit that a motion exceeds; `str` gives the sentence.

    Attributes:
        joint: its name.   quantity: whose limit it is.   value: that exceeds it, infinite at a jump.   limit: of it.
        unit: of both.   time: [s].   share: of the limit; of positions see `LimitsReport`.   why: what else is to be said.
    """

    joint: str
    quantity: str
    value: float
    limit: float
    unit: str
    time: float
    share: float
    why: str = ""

    def __str__(self) -> str:
        if np.isinf(self.share):
            return f"{self.joint}: {self.why}: its limit of {self.quantity}, {self.limit:.4g} {self.unit}, is not kept"
        value = f"{self.quantity} {self.value:.4g} {self.unit} at {self.time:.4g} s"
        more = f" ({self.why})" if self.why else ""
        return f"{self.joint}: {value}, {_percent(self.share)} of its limit {self.limit:.4g} {self.unit}{more}"


@dataclass(frozen=True)
class MotionJump:
    """A jump of a joint's position, speed or acceleration, at which higher derivatives are infinite.

    Attributes:
        joint: its number.   order: 0: of the position, 1: of the speed, 2: of the acceleration.   time: [s].   size: of it.
    """

    joint: int
    order: int
    time: float
    size: float


@dataclass(frozen=True, eq=False)
class LimitsReport(Result):
    """Share of its limits that a motion uses; `str` gives the table.

    Attributes:
        limits: that were asked.
        lowest, highest: by quantity (n,) extreme values.   share: by quantity (n,) the largest part of the limit that is used,
            1: all of it; of positions the part of the way from the middle of the range to its ends, with a limit on one side
            1 and the distance beyond it; NaN without a limit.
        times: by quantity (n,) [s] of the largest share.
        bands: by quantity (n, 2) lowest and highest torque, or voltage, that holds a joint which stands all the time in its dry
            friction or gear loss; NaN for others. Of a band the part nearest to 0 is compared with the limit.
        jumps: (k,) [s] beside which the acceleration of a joint with a limit of jerk jumps: no such limit can be kept there,
            and the values of jerk are those between the jumps.
        excess: all limits that are exceeded, in the order of time for each joint and quantity.
        unchecked: limits that are stated but could not be checked, and why.
        parts: of a `Joined` motion the reports of its motions, in order; else empty.
        notes: about effects of the record that torques and voltages approximate.
    """

    limits: MotionLimits
    lowest: dict[str, np.ndarray]
    highest: dict[str, np.ndarray]
    share: dict[str, np.ndarray]
    times: dict[str, np.ndarray]
    jumps: np.ndarray
    excess: tuple[Excess, ...] = ()
    unchecked: tuple[str, ...] = ()
    parts: tuple[LimitsReport, ...] = ()
    bands: dict[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def largest(self) -> float:
        """The largest share over joints and quantities; 0 without any limit."""
        return float(np.nanmax([0.0, *np.concatenate(list(self.share.values()))]))

    @property
    def kept(self) -> bool:
        """True if no limit is exceeded by more than 1e-6 of it, and nothing jumps that a limit does not let jump.

        Limits in `unchecked` do not count.
        """
        return not self.excess

    @property
    def limited(self) -> bool:
        """True if any limit was checked."""
        return any(np.isfinite(share).any() for share in self.share.values())

    def worst(self, quantity: str, joint: int) -> float:
        """The value with the largest share of its limit; without a limit the largest value."""
        ends = np.array([self.lowest[quantity], self.highest[quantity]])
        used = _shares(self.limits, quantity, ends)[:, joint]
        ends = ends[:, joint]
        return float(ends[np.argmax(np.abs(ends) if np.isnan(used).any() else used)])

    def excesses(self) -> list[str]:
        """Sentences, one for each limit that is exceeded."""
        return [str(each) for each in self.excess]

    def verdict(self) -> str:
        """The result in one sentence."""
        if self.excess:
            return f"exceeds limits: {'; '.join(self.excesses())}"
        if self.unchecked:
            return "all limits that could be checked are kept" if self.limited else "no limit could be checked"
        return "all limits that are known are kept" if self.limited else "no limit is known"

    @property
    def heading(self) -> str:
        """Name above its table and on its page."""
        return "limit utilisation"

    @property
    def good(self) -> bool:
        """True if no limit is exceeded."""
        return self.kept

    def sentences(self) -> list[str]:
        """The verdict, limits that were not checked, notes."""
        return [self.verdict(), *(f"not checked: {each}" for each in self.unchecked), *self.notes]

    def tables(self) -> list[Table]:
        """A row for each joint and quantity: the value with the largest share of its limit, that share, and when."""
        rows = []
        for k, name in enumerate(self.limits.names):
            for (quantity, share), when in zip(self.share.items(), self.times.values(), strict=True):
                value, unit = number(self.worst(quantity, k)), self.limits.unit(quantity, k)
                rows.append([name, quantity, value, unit, number(100.0 * share[k]), number(when[k])])
        heads = ("joint", "quantity", "value", "unit", "limit utilisation [%]", "time [s]")
        return [Table(self.heading, heads, rows, ("quantity", "unit"))]

    def __str__(self) -> str:
        return "\n".join([self.table(), *self.sentences()])

    @property
    def height(self) -> float:
        """Of its picture [inch]."""
        return bars_height(self._used())

    def draw(self, figure: Figure, ink: str, quiet: str) -> None:
        """Draws the share of every limit that has one.

        Args:
            figure: to draw in.   ink, quiet: colours of words and of what is less important.
        Raises:
            ArmwrightError: no limit is known.
        """
        draw_bars(figure, self._used(), ink)

    def _used(self) -> Table:
        """The main table without values and times: its bars."""
        table = self.tables()[0]
        kept = [k for k, name in enumerate(table.names) if name in ("joint", "quantity", "limit utilisation")]
        rows = [[row[k] for k in kept] for row in table.cells if row[kept[-1]].value is not None]
        return Table(table.title, [table.heads[k] for k in kept], rows, ("quantity",))

    def table(self) -> str:
        """A row for each joint: of every quantity the value with the largest share of its limit, and that share."""
        rows = [["joint", *self.share]]
        infinite = {(each.joint, each.quantity) for each in self.excess if np.isinf(each.share)}
        for k, name in enumerate(self.limits.names):
            cells = [name]
            for quantity, share in self.share.items():
                part = "no limit" if np.isnan(share[k]) else _percent(share[k])
                part = "jumps" if (name, quantity) in infinite else part
                low, high = self.bands[quantity][k] if quantity in self.bands else (np.nan, np.nan)
                value = f"{self.worst(quantity, k):.3g}" if np.isnan(low) else f"{low:.3g} … {high:.3g}"
                cells.append(f"{value} {self.limits.unit(quantity, k)} {part:>8}")
            rows.append(cells)
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        padded = [[f"{cell:>{w}}" for cell, w in zip(row[1:], widths[1:], strict=True)] for row in rows]
        return "\n".join("   ".join([f"{row[0]:{widths[0]}}", *cells]) for row, cells in zip(rows, padded, strict=True))


def limits_report(
    arm: AnyArm,
    motion: AnyMotion,
    limits: MotionLimits | None = None,
    *,
    payload: Payload | Sequence[Payload] | None = None,
    wrench: Any = None,
    samples: int = IN_A_PIECE,
) -> LimitsReport:
    """Largest share of every limit that a motion uses, on a dense grid between its breaks; exact for piecewise polynomials.

    Torques and voltages are those of the compiled inverse dynamics and `motor_voltage`, where the record can tell them; where
    it cannot, a limit of them is named as not checked. Before and after the motion the arm stands.

    Args:
        arm: the model.   motion: of its joints, with an end.   limits: None: the record's.
        payload: bodies in the hand, each from its time on.   wrench: (6,) [N, N m] on the tip, in base axes.
        samples: grid points between two breaks, at least.
    Returns:
        report: lowest and highest values, shares of limits and their times, by quantity and joint; what is exceeded.
    Raises:
        ScenarioError: a motion of other joints, or one that does not end.
    Example:
        >>> limits = aw.trajectories.MotionLimits.of("two-link", torque=[100.0, 30.0])
        >>> move = aw.trajectories.Quintic([0.0, 0.0], [0.5, -0.5], duration=0.4)
        >>> report = aw.trajectories.limits_report("two-link", move, limits)
        >>> report.kept
        False
    """
    arm = as_arm(arm)
    motion = as_motion(motion, arm)
    expect(limits, MotionLimits | None, "limits", "MotionLimits.of(arm, velocity=…)", ScenarioError)
    stated = limits is None
    limits = MotionLimits.of(arm) if limits is None else limits
    if motion.n != arm.n or limits.n != arm.n:
        what = f"a motion of {motion.n} joints with limits of {limits.n}"
        raise ScenarioError(what, place=arm.name, expected=f"{arm.n} of both")
    bodies = in_order(payload)
    motions = list(_in_sequence(motion))
    parts = [_of_one(arm, each, limits, bodies, wrench, samples) for each in motions]
    for k, jumps in enumerate(jumps_of(motions)):
        parts[k] = _with_jumps(arm, motions[k], parts[k], jumps)
    unchecked = _unchecked(arm, limits, parts[0].share, currents=stated)
    notes = SUPPORT.notes(arm) if "torque" in parts[0].share else ()
    parts = [replace(each, unchecked=unchecked, notes=notes) for each in parts]
    return parts[0] if len(parts) == 1 else _joined(limits, tuple(parts))


def _in_sequence(motion: Motion) -> Iterator[Motion]:
    """The motions that a motion consists of, one after the other."""
    if not np.isfinite(motion.duration):
        raise ScenarioError("does not end", place=type(motion).__name__, expected="a motion with a duration")
    if isinstance(motion, Joined):
        for each in motion.motions:
            yield from _in_sequence(each)
    else:
        yield motion


def _joined(limits: MotionLimits, parts: tuple[LimitsReport, ...]) -> LimitsReport:
    """The report of motions in sequence."""
    found: list[dict[str, np.ndarray]] = [{}, {}, {}, {}]
    for quantity in parts[0].share:
        share = np.array([part.share[quantity] for part in parts])
        low, high = (np.array([getattr(part, name)[quantity] for part in parts]) for name in ("lowest", "highest"))
        used = np.where(np.isnan(share), np.maximum(np.abs(low), np.abs(high)), share)
        at = np.array([part.times[quantity] for part in parts])
        times = np.take_along_axis(at, used.argmax(axis=0)[None], axis=0)[0]
        rows = (low.min(axis=0), high.max(axis=0), np.fmax.reduce(share), times)
        for store, value in zip(found, rows, strict=True):
            store[quantity] = value
    jumps = np.concatenate([part.jumps for part in parts])
    excess = tuple(each for part in parts for each in part.excess)
    bands = {}  # NaN where a joint moves in one of them
    for quantity in parts[0].bands:
        low, high = np.array([part.bands[quantity] for part in parts]).transpose(2, 0, 1)
        bands[quantity] = np.stack([low.min(axis=0), high.max(axis=0)], axis=1)
    unchecked, notes = parts[0].unchecked, parts[0].notes
    return LimitsReport(
        limits, *found, jumps=jumps, excess=excess, unchecked=unchecked, parts=parts, bands=bands, notes=notes
    )


def _of_one(
    arm: Model, motion: Motion, limits: MotionLimits, bodies: Sequence[Payload], wrench: Any, samples: int
) -> LimitsReport:
    """The report of one motion, without what jumps."""
    polynomial = _polynomial(motion)
    t = _times(motion, samples, [float(each.time) for each in bodies])
    end = float(t[-1])

    def values(at: np.ndarray) -> dict[str, np.ndarray]:
        q, qd, qdd = motion.at(at)
        found = {"position": q, "velocity": qd, "acceleration": qdd, "jerk": _jerk(motion, at, qdd)}
        inside = np.where(at >= end, np.nextafter(end, -np.inf), at)  # what is gripped at the end, counts from there on
        known = efforts(arm, inside, q, qd, qdd, bodies, wrench, fastest)
        return found | {quantity: each.least for quantity, each in known.items()}

    fastest = np.abs(motion.at(t)[1]).max(axis=0, initial=0.0)
    rows = values(t)
    sampled = [name for name in rows if polynomial is None or name not in MECHANICAL]
    for _ in range(ROUNDS):
        close = _near_extremes(t, [rows[name] for name in sampled])
        if not len(close):
            break
        finer = values(close)
        order = np.argsort(t := np.concatenate([t, close]), kind="stable")
        t, rows = t[order], {name: np.concatenate([rows[name], finer[name]])[order] for name in rows}
    found: list[dict[str, np.ndarray]] = [{}, {}, {}, {}]
    columns = np.arange(arm.n)
    for quantity, each in rows.items():
        used = _shares(limits, quantity, each)
        size = np.where(np.isnan(used), np.abs(each), used)
        low, high = each.min(axis=0), each.max(axis=0)
        at = t[size.argmax(axis=0)]
        if quantity in MECHANICAL and polynomial is not None:
            lows, highs = polynomial.extrema(MECHANICAL.index(quantity))
            low, high = lows.min(axis=0), highs.max(axis=0)
            ends = np.array([_shares(limits, quantity, lows), _shares(limits, quantity, highs)])
            ends = np.where(np.isnan(ends), np.abs([lows, highs]), ends).max(axis=0)
            piece = ends.argmax(axis=0)
            outside = (t[:, None] < polynomial.knots[piece]) | (t[:, None] > polynomial.knots[piece + 1])
            at = t[np.where(outside, -np.inf, size).argmax(axis=0)]
        share = np.fmax(_shares(limits, quantity, low), _shares(limits, quantity, high))
        for store, value in zip(found, (low, high, share, at), strict=True):
            store[quantity] = value
    known = efforts(arm, t, *motion.at(t), bodies, wrench, fastest)
    bands = {
        quantity: np.where(each.held.all(axis=0), [each.low.min(axis=0), each.high.max(axis=0)], np.nan).T
        for quantity, each in known.items()
    }
    report = LimitsReport(limits, *found, jumps=np.empty(0), bands=bands)
    most = current_torques(arm)
    excess = []
    for quantity, share in report.share.items():
        for k in columns[share > KEPT]:
            value, limit = report.worst(quantity, int(k)), _limit(limits, quantity, int(k), report)
            why = ""
            if quantity == "torque" and np.isclose(limit, most[k], rtol=1e-12):
                current = float(arm.coordinates[k].limits.current)
                why = f"its current {abs(value) / limit * current:.4g} A of {current:.4g} A"
            unit, at = limits.unit(quantity, int(k)), float(report.times[quantity][k])
            excess.append(Excess(limits.names[k], quantity, value, limit, unit, at, float(share[k]), why))
    return replace(report, excess=tuple(excess))


def _limit(limits: MotionLimits, quantity: str, joint: int, report: LimitsReport) -> float:
    """The limit of a joint that its worst value is nearest to or beyond."""
    if quantity != "position":
        return float(getattr(limits, quantity)[joint])
    low, high = limits.position[joint]
    return float(low if report.worst(quantity, joint) < low else high)


def _times(motion: Motion, samples: int, changes: Sequence[float] = ()) -> np.ndarray:
    """(k,) [s] dense times, with both sides of changes of the payload and of the end."""
    t = dense_times(motion, samples)
    inner = [at for at in changes if t[0] < at < t[-1]]
    before = np.nextafter([*inner, *t[1:][-1:]], -np.inf)
    return np.unique(np.concatenate([t, inner, before]))


def dense_times(motion: Motion, samples: int = IN_A_PIECE) -> np.ndarray:
    """(k,) [s] increasing times of a motion: both ends of every piece, from inside, and `samples` between.

    Raises:
        ScenarioError: a motion that does not end.
    """
    if not np.isfinite(motion.duration):
        raise ScenarioError("does not end", place=type(motion).__name__, expected="a motion with a duration")
    breaks = np.asarray(motion.breaks, dtype=float)
    samples = max(samples, -(-SAMPLES // max(len(breaks) - 1, 1)))
    begin, end = breaks[:-1, None], np.nextafter(breaks[1:, None], -np.inf)
    end[-1] = breaks[-1]
    return np.unique(begin + (end - begin) * np.linspace(0.0, 1.0, samples + 2))


def _near_extremes(t: np.ndarray, quantities: Sequence[np.ndarray]) -> np.ndarray:
    """Times between those at which a quantity may be larger or smaller than at any of them."""
    if len(t) < 3:
        return np.empty(0)
    steps = np.diff(t)
    wide = steps > 1e-9 * (t[-1] - t[0])
    chosen = np.zeros(len(steps), dtype=bool)
    for rows in quantities:
        bend = np.abs(np.diff(rows, 2, axis=0, prepend=rows[:1], append=rows[-1:]))
        bend[0], bend[-1] = bend[1:2], bend[-2:-1]
        above = np.maximum(rows[:-1], rows[1:]) + AS_LARGE * np.maximum(bend[:-1], bend[1:])
        below = np.minimum(rows[:-1], rows[1:]) - AS_LARGE * np.maximum(bend[:-1], bend[1:])
        high, low = rows.max(axis=0), rows.min(axis=0)
        room = 1e-8 * np.maximum(np.abs(high), np.abs(low))
        chosen |= ((above > high + room) | (below < low - room)).any(axis=1)
    k = np.flatnonzero(chosen & wide)[:SAMPLES]
    return (t[k, None] + steps[k, None] * (np.arange(1, BETWEEN) / BETWEEN)).ravel()


def _polynomial(motion: Motion) -> PiecewisePolynomial | None:
    """The motion as polynomials of time; None of a motion that is none."""
    if isinstance(motion, RestToRest):  # of degree 5 at most: the one with the same states at both ends
        return PiecewisePolynomial.hermite(motion.breaks, *motion.at(motion.breaks))
    return getattr(motion, "polynomial", None)


def _jerk(motion: Motion, t: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """(k, n) jerk at times t (k,): exact where the motion tells it, else differences of the acceleration.

    Across a jump of it, where two times lie next to each other, those beside it.
    """
    exact = getattr(motion, "jerk", None)
    if exact is not None:
        return exact(t)
    if len(t) < 2:
        return np.zeros_like(qdd)
    steps = np.diff(t)[:, None]
    usual = steps > 1e-6 * np.median(steps)
    rate = np.divide(np.diff(qdd, axis=0), steps, out=np.zeros_like(qdd[1:]), where=usual)
    return np.concatenate([rate, rate[-1:]])


def jumps_of(motions: Sequence[Motion]) -> list[list[MotionJump]]:
    """Jumps of position, speed and acceleration in motions in sequence, each with the motion that does not rest beside it.

    Args:
        motions: each begins when the one before ends; before the first and after the last the arm stands.
    """
    found: list[list[MotionJump]] = []
    for k, motion in enumerate(motions):
        breaks = np.asarray(motion.breaks, dtype=float)
        after, before = np.array(motion.at(breaks)), np.array(motion.at(np.nextafter(breaks, -np.inf)))
        before[1:, 0], after[1:, -1] = 0.0, 0.0
        beside = BESIDE * (1.0 + np.abs(breaks))
        before[0], after[0] = motion.at(breaks - beside)[0], motion.at(breaks + beside)[0]
        if k:
            last = motions[k - 1]
            end = np.nextafter(last.breaks[-1], -np.inf)
            before[:, 0] = np.array(last.at(end))
            after[0, 0] = motion.at(breaks[0])[0]
        if k + 1 < len(motions):
            following = motions[k + 1]
            after[:, -1] = np.array(following.at(following.breaks[0]))
            before[0, -1] = motion.at(breaks[-1])[0]
        largest = np.abs(motion.at(dense_times(motion))).max(axis=1)
        largest = np.maximum(largest, np.abs([before, after]).max(axis=(0, 2)))
        small = JUMP * np.maximum(largest, STILL * largest.max(axis=1, keepdims=True))
        small[0] = LARGEST_JUMP + 4.0 * beside.max() * largest[1]  # what `Joined` allows
        sizes = after - before
        jumps: list[MotionJump] = []
        for order in range(3):
            for row, joint in np.argwhere(np.abs(sizes[order]) > small[order]):
                sides = [np.nextafter(breaks[row], -np.inf), breaks[row]]
                for side, at in zip((before, after), sides, strict=True):
                    own = not (side is before and row == 0) and not (side is after and row == len(breaks) - 1)
                    moves = order == 0 or abs(side[order, row, joint]) > small[order, joint]
                    if own and moves:
                        jumps.append(MotionJump(int(joint), order, float(at), float(sizes[order, row, joint])))
        found.append(jumps)
    return found


def _with_jumps(arm: Model, motion: Motion, report: LimitsReport, jumps: Sequence[MotionJump]) -> LimitsReport:
    """The report with the limits that no finite value keeps where something jumps."""
    limits, excess = report.limits, list(report.excess)
    words = (("position", "q"), ("speed", "qd"), ("acceleration", "qdd"))
    for order, quantities in enumerate((MECHANICAL[1:], MECHANICAL[2:], MECHANICAL[3:])):
        own = [each for each in jumps if each.order == order]
        for joint in sorted({each.joint for each in own}):
            of_joint = [each for each in own if each.joint == joint]
            times = list(dict.fromkeys(f"{each.time:.4g}" for each in of_joint))
            listed = ", ".join(times[:SHOWN]) + (
                f" s and at {len(times) - SHOWN} other times" if len(times) > SHOWN else " s"
            )
            largest = max(of_joint, key=lambda each: abs(each.size))
            word, symbol = words[order]
            unit = UNITS[symbol][limits.prismatic[joint]]
            why = f"{word} jumps by up to {abs(largest.size):.3g} {unit} at {listed}"
            for quantity in quantities:
                limit = float(getattr(limits, quantity)[joint])
                if np.isfinite(limit):
                    name, shown = limits.names[joint], limits.unit(quantity, joint)
                    excess.append(Excess(name, quantity, np.inf, limit, shown, largest.time, np.inf, why))
    excess += _impacts(arm, motion, report, [each for each in jumps if each.order == 1])
    jerky = [each.time for each in jumps if each.order == 2 and np.isfinite(limits.jerk[each.joint])]
    return replace(report, excess=tuple(excess), jumps=np.unique(jerky))


def _impacts(arm: Model, motion: Motion, report: LimitsReport, jumps: Sequence[MotionJump]) -> list[Excess]:
    """Limits of torque and voltage where speeds jump: M Δq̇ is an impulse of torque."""
    found: dict[tuple[str, int], Excess] = {}
    for time in dict.fromkeys(each.time for each in jumps) if "torque" in report.share else ():
        change = np.zeros(arm.n)
        for each in jumps:
            if each.time == time:
                change[each.joint] = each.size
        impulse = np.abs(np.asarray(compile_arm(arm).mass_matrix(motion.at(time)[0])) @ change)
        for joint in np.flatnonzero(impulse > JUMP * impulse.max()):
            for quantity in ("torque", "voltage"):
                limit = float(getattr(report.limits, quantity)[joint])
                if quantity in report.share and np.isfinite(limit):
                    why = f"the jump of speed at {time:.4g} s would take an infinite {quantity}"
                    unit = report.limits.unit(quantity, int(joint))
                    name = report.limits.names[joint]
                    each = Excess(name, quantity, np.inf, limit, unit, time, np.inf, why)
                    found.setdefault((quantity, int(joint)), each)
    return list(found.values())


def _unchecked(arm: Model, limits: MotionLimits, found: dict[str, np.ndarray], *, currents: bool) -> tuple[str, ...]:
    """Limits that are stated, but that a report does not know the values for."""
    said = []
    for quantity in ("torque", "voltage"):
        names = [name for name, each in zip(limits.names, getattr(limits, quantity), strict=True) if np.isfinite(each)]
        if names and quantity not in found:
            why = "the record has no masses"
            if "torque" in found:
                why = f"the record has no motor constants of {', '.join(without_constants(arm))}"
            said.append(f"{quantity} of {', '.join(names)}: {why}")
    return (*said, *(unchecked_currents(arm) if currents else ()))


def unchecked_currents(arm: Model) -> list[str]:
    """Sentences on limits of currents in the record that no torque follows from."""
    bodies = [body for body in arm.coordinates if np.isfinite(float(body.limits.current))]
    names = [body.joint for body in bodies if body.drive.torque_constant is None]
    return [f"current of {', '.join(names)}: the record has no torque constant"] if names else []


def _percent(share: float) -> str:
    """A share in percent; one decimal, or more where it would look like exactly the limit."""
    return f"{share:.5%}" if KEPT < share < 1.0005 else f"{share:.1%}"


def _shares(limits: MotionLimits, quantity: str, rows: np.ndarray) -> np.ndarray:
    """Part of the limit that each value uses, (…, n); NaN without a limit."""
    most = getattr(limits, quantity)
    if quantity != "position":
        finite = np.isfinite(most)
        return np.where(finite, np.abs(rows) / np.where(finite, most, 1.0), np.nan)
    low, high = most.T
    with np.errstate(invalid="ignore"):  # of a joint without limits
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        both, one = np.isfinite(half), np.isfinite(low) != np.isfinite(high)
        part = np.abs(rows - np.where(both, middle, 0.0)) / np.where(both, half, 1.0)
        beyond = np.where(np.isfinite(high), rows - high, low - rows)
        return np.where(both, part, np.where(one, np.maximum(1.0 + beyond, 0.0), np.nan))

"""Exact steps of one motor whose equations are affine while its direction of motion is held, up to the next change of direction.

    d/dt y = A y + c,  y = (w) or (w, i),   dq/dt = w

A and c are those of the plant; c has the dry friction of the direction. The rotor stops where w(t) = 0, by Newton's method within
a bracket. It stands while neither direction accelerates it; the current that breaks it loose is reached at a time in closed form.
With m = tr A / 2 and D = m² - det A,  e^{At} = C I + S (A - m I),  C = e^{mt} cosh(√D t),  S = e^{mt} sinh(√D t) / √D.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armwright import scalar
from armwright.program.where_needed import WhereNeeded
from armwright.scalar import Array, Scalar
from armwright.simulation.integrate.exponential import phi
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant

STATES = ("q", "qd", "current")
TRIALS = 12  # of Newton's method within a bracket
NEAR = 1e-2  # |D t²| below which C and S are summed as series
ROUNDING = 1e-9  # by which the matrices of the two directions may differ
SEGMENTS = 3  # of a held command: a stop, a rest, and a start


def is_affine(plant: Plant) -> bool:
    """True for one motor whose derivative is affine in speed and current, with the same matrix either way."""
    sticking = plant.sticking
    if plant.model.n != 1 or sticking is None or sticking.places != ((0, False),):
        return False
    if not set(plant.layout.names) <= set(STATES):
        return False
    x = scalar.array([scalar.Symbol.named(f"x{k}") for k in range(plant.size)])
    command = scalar.array([scalar.Symbol.named("u")])
    forth, back = (scalar.jacobian(lambda at, w=way: plant.derivative(at, _held(command, w)), x) for way in (1.0, -1.0))
    if scalar.is_symbolic(forth, back):
        return False
    return bool(np.allclose(forth, back, rtol=ROUNDING, atol=0.0) and not forth[:, 0].any())


def _held(command: Array, way: Scalar) -> PlantInputs:
    return replace(PlantInputs(command), directions=scalar.array([way]))


def equations(plant: Plant, command: Array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (k, k), and c (k,) of moving forward and of moving backward."""
    x = scalar.zeros(plant.size)
    slopes = scalar.jacobian(lambda at: plant.derivative(at, _held(command, 1.0)), x)
    forth, back = (plant.derivative(x, _held(command, way)) for way in (1.0, -1.0))
    return slopes[1:, 1:], forth[1:], back[1:]


def direction(A: Array, forth: Array, back: Array, y: Array, way: Scalar) -> Scalar:
    """Direction of motion: that of the speed; at rest `way` where it is not 0, else the one that the rotor begins with, or 0."""
    pushed = 0.0 if len(y) == 1 else A[0, 1] * y[1]
    begins = scalar.less(0.0, pushed + forth[0]) - scalar.less(pushed + back[0], 0.0)
    return scalar.where(scalar.equal(y[0], 0.0), scalar.where(scalar.equal(way, 0.0), begins, way), scalar.sign(y[0]))


def moved(A: Array, c: Array, y: Array, t: Scalar) -> tuple[np.ndarray, Scalar]:
    """y a time t later, and by how much q has moved.

    Args:
        A: (k, k).   c: (k,).   y: (k,) before, k = 1 or 2.   t: () [s].
    """
    if len(y) == 1:
        rate, slope = A[0, 0], c[0] + A[0, 0] * y[0]
        _, first, second, _ = phi(rate * t)
        return scalar.array([y[0] + t * first * slope]), t * (y[0] + t * second * slope)
    det = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    rest = scalar.array([A[0, 1] * c[1] - A[1, 1] * c[0], A[1, 0] * c[0] - A[0, 0] * c[1]]) / det
    m, C, S = _functions(A, det, t)
    z = y - rest
    turned = scalar.array([(A[0, 0] - m) * z[0] + A[0, 1] * z[1], A[1, 0] * z[0] + (A[1, 1] - m) * z[1]])
    after = rest + C * z + S * turned
    change = after - y
    return after, (A[1, 1] * change[0] - A[0, 1] * change[1]) / det + rest[0] * t


def _functions(A: Array, det: Scalar, t: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """m, C and S, of a real pair of poles, of a complex pair, and of a double pole."""
    m, half = 0.5 * (A[0, 0] + A[1, 1]), 0.5 * (A[0, 0] - A[1, 1])
    D = half * half + A[0, 1] * A[1, 0]
    y = D * t * t
    real, swinging = scalar.less(NEAR, y), scalar.less(y, -NEAR)
    root = scalar.sqrt(scalar.where(real, D, 1.0))
    fast = m - root
    slow, quick = scalar.exp(scalar.where(real, det / scalar.where(real, fast, 1.0), 0.0) * t), scalar.exp(fast * t)
    turn = scalar.sqrt(scalar.where(swinging, -D, 1.0))
    decay = scalar.exp(m * t)
    cosh = 1.0 + y * (1 / 2 + y * (1 / 24 + y * (1 / 720 + y / 40320)))
    sinh = 1.0 + y * (1 / 6 + y * (1 / 120 + y * (1 / 5040 + y / 362880)))
    C = scalar.where(real, 0.5 * (slow + quick), decay * scalar.where(swinging, scalar.cos(turn * t), cosh))
    S = scalar.where(
        real, 0.5 * (slow - quick) / root, decay * scalar.where(swinging, scalar.sin(turn * t) / turn, t * sinh)
    )
    return m, C, S


def rested(A: Array, c: Array, y: Array, t: Scalar) -> np.ndarray:
    """y a time t later, the rotor at rest."""
    if len(y) == 1:
        return y
    _, first, _, _ = phi(A[1, 1] * t)
    return scalar.array([0.0 * y[0], y[1] + t * first * (c[1] + A[1, 1] * y[1])])


def event(A: Array, forth: Array, back: Array, y: Array, way: Scalar, left: Scalar) -> tuple[Scalar, Scalar]:
    """Time at which the rotor stops or breaks loose, and the direction in which it then moves (0: it stands, or neither happens).

    Returns:
        time: [s], `left` where neither happens.   way: ().
    """
    c = _forcing(way, forth, back)
    sliding = scalar.less(0.0, scalar.abs(way))
    begin, end = scalar.maximum(way * y[0], 0.0), way * moved(A, c, y, left)[0][0]
    stops = sliding * scalar.less(end, 0.0)
    given = {"A": A, "c": c, "y": y, "way": way, "left": left, "begin": begin, "end": end}
    stop = WhereNeeded("stop", _stop, {name: np.shape(value) for name, value in given.items()})
    (t,) = stop(stops, scalar.array([left]), *given.values())
    time = scalar.where(stops, t, left)
    if len(y) == 1:
        return time, 0.0 * way
    loose, ways = _breakaway(A, forth, back, y, left)
    breaks = (1.0 - sliding) * scalar.less(0.0, scalar.abs(ways))
    return scalar.where(breaks, loose, time), scalar.where(breaks, ways, 0.0)


def _stop(A: Array, c: Array, y: Array, way: Scalar, left: Scalar, begin: Scalar, end: Scalar) -> np.ndarray:
    """Time (1,) at which a speed along `way` falls from `begin` through 0 to `end`."""
    low, high = 0.0 * left, left
    t = left * begin / scalar.where(scalar.less(0.0, begin - end), begin - end, 1.0)
    for _ in range(TRIALS):
        after, _ = moved(A, c, y, t)
        now, slope = way * after[0], way * (sum(A[0, k] * after[k] for k in range(len(y))) + c[0])
        low, high = scalar.where(scalar.less(now, 0.0), low, t), scalar.where(scalar.less(now, 0.0), t, high)
        trial = t - now / scalar.where(scalar.less(slope, 0.0), slope, -1.0)
        inside = scalar.less(slope, 0.0) * scalar.less_equal(low, trial) * scalar.less_equal(trial, high)
        t = scalar.where(inside, trial, 0.5 * (low + high))
    return scalar.array([t])


def _breakaway(A: Array, forth: Array, back: Array, y: Array, left: Scalar) -> tuple[Scalar, Scalar]:
    """Time [s] at which the current breaks a rotor at rest loose, and the direction; 0: it does not within `left`."""
    current = rested(A, forth, y, left)[1]
    ways = scalar.less(0.0, A[0, 1] * current + forth[0]) - scalar.less(A[0, 1] * current + back[0], 0.0)
    return breaking(A, forth, back, y, ways), ways


def breaking(A: Array, forth: Array, back: Array, y: Array, way: Scalar) -> Scalar:
    """Time [s] at which the current of a rotor at rest reaches what a direction needs."""
    breaks = scalar.less(0.0, scalar.abs(way))
    final = -forth[1] / A[1, 1]
    least = -_forcing(way, forth, back)[0] / A[0, 1]
    share = scalar.where(breaks, (least - final) / scalar.where(breaks, y[1] - final, 1.0), 1.0)
    return scalar.log(scalar.maximum(share, 1e-300)) / A[1, 1]


def _forcing(way: Scalar, forth: Array, back: Array) -> np.ndarray:
    """c of a direction."""
    backward = scalar.less(way, 0.0)
    return scalar.array([scalar.where(backward, b, f) for f, b in zip(forth, back, strict=True)])


def segment(
    A: Array, forth: Array, back: Array, x: Array, left: Scalar, found: tuple[Scalar, Scalar, Scalar], last: bool
) -> tuple[np.ndarray, Scalar]:
    """The state at the end of a segment, and its length, both exactly differentiable.

    Args:
        x: (1 + k,) position, then y.   left: () [s].   last: it takes all the time that is left.
        found: direction, time of the event, and direction behind it, as numbers without derivatives.
    """
    way, time, behind = found
    y, c = x[1:], _forcing(way, forth, back)
    sliding, ends = scalar.less(0.0, scalar.abs(way)), scalar.less(time, left)
    turns, t = 0.0 * left, left
    if not last:
        stops = ends * sliding
        at, _ = moved(A, c, y, time)  # one step of Newton's carries the derivatives of the time
        slope = sum(A[0, k] * at[k] for k in range(len(y))) + c[0]
        t = scalar.where(stops, time - at[0] / scalar.where(stops, slope, 1.0), left)
        turns = stops
        if len(y) == 2:
            loose = ends * (1.0 - sliding)
            t = scalar.where(loose, breaking(A, forth, back, y, loose * behind), t)
    after, way_on = moved(A, c, y, t)
    still = rested(A, forth, y, t)
    q = x[0] + scalar.where(sliding, way_on, 0.0)
    new = [scalar.where(sliding, a, s) for a, s in zip(after, still, strict=True)]
    if last:
        turns = scalar.less(way * new[0], 0.0)
    new[0] = scalar.where(turns, 0.0, scalar.where(sliding, new[0], 0.0))
    return scalar.array([q, *new]), t

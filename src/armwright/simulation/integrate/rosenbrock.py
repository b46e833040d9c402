"""A linearly implicit rule for stiff arms: Rodas3, L-stable, of order 3 with an error estimate of order 2.

For  E x' = E f(x, u)  with E held over the step (the mass matrix in the rows of the accelerations, 1 elsewhere), A = E ∂f/∂x at
its beginning, and W = E - γ h A, stage i solves one linear system with the matrix of all stages:

    W K_i = E (γ h f(x + Σ_j a_ij K_j, u) + γ Σ_j c_ij K_j),   x⁺ = x + Σ m_i K_i,   e = K_4   [SanduEtAl1997] [HairerWanner1996]

The last stage begins in x + 2 K_1 + K_3, which is x⁺ less its own K_4: the rule is stiffly accurate, and parts of the motion that
die away within the step are gone after it. Nothing is iterated, so that lanes that take different steps run the same
instructions. Where the linear system does not describe f over the whole step (friction that turns round), e is large, and the
step is repeated shorter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from armwright import scalar
from armwright.program import call, trace
from armwright.scalar import Array, Scalar, Symbol

GAMMA = 0.5
STAGES = (  # of each stage its a and c; the second is at x, where f is known from the first
    ((), ()),
    ((0.0,), (4.0,)),
    ((2.0, 0.0), (1.0, -1.0)),
    ((2.0, 0.0, 1.0), (1.0, -1.0, -8 / 3)),
)
END = (2.0, 0.0, 1.0, 1.0)
ERROR = (0.0, 0.0, 0.0, 1.0)
ORDER = 3  # of the error estimate, in h

Derivative = Callable[..., Array]
Slopes = Callable[..., tuple[Array, Array, Array]]


def rodas3_step(slopes: Slopes, f: Derivative, x: Array, u: Array, h: Scalar) -> tuple[np.ndarray, np.ndarray]:
    """State after a step and an estimate of its error.  [SanduEtAl1997]

    W is eliminated without pivoting (`scalar.factor_sparse`). With the positions eliminated, the rows of the speeds are
    M + γ h D + (γ h)² S with the mass matrix M, and the slopes D by speeds and S by positions of what resists. Friction,
    dampers, windings (once their currents are eliminated), stops and springs have symmetric parts of D and S that are not
    negative, which leaves the sum positive definite, and its leading minors positive. Gravity and Coriolis terms do not, and
    are small beside M for steps that are short beside the arm's motion. Where they are not, a pivot near 0 gives large or
    infinite K, an error far beyond any tolerance, and a shorter step.

    Args:
        slopes: (x, u) → dx/dt (nx,), A (nx, nx), E (nx, nx) symmetric; entries that are numbers, 0 above all, cost little.
        f: (x, u) → dx/dt alone.   x: (nx,) state.   u: (nu,) commands, held.   h: () [s].
    Returns:
        x⁺: (nx,) the state h later, to order 3.   e: (nx,) its difference from one of order 2.
    """
    rate, slope, mass = slopes(x, u)
    factors = scalar.factor_sparse(mass - (GAMMA * h) * slope)
    k: list[np.ndarray] = []
    for places, weights in STAGES:
        if any(places):
            rate = f(_sum(places, k, x), u)
        right = _sum([GAMMA * c for c in weights], k, (GAMMA * h) * rate)
        k.append(scalar.solve_sparse(factors, scalar.array(mass @ right)))
    return _sum(END, k, x), _sum(ERROR, k, scalar.zeros(len(x)))


def rodas3_trial(
    derivative: Derivative,
    slopes: Slopes,
    shapes: Mapping[str, tuple[int, ...]],
    settled: Callable[[Array], Array],
    lands: bool,
) -> Callable[..., tuple[Array, ...]]:
    """(x, u, …, h) → x⁺, error and, with events to land on, the path of `rodas3_step`, for arguments of those shapes.

    Args:
        derivative: (x, u, …) → dx/dt.   slopes: (x, u, …) → dx/dt, A, E.   settled: x → the state that it stands for.
    """
    whole = trace("plant", derivative, shapes, ("xd",), noinline=True)
    linear = as_program(slopes, shapes)

    def step(x: Array, u: Array, *rest: Array) -> tuple[Array, ...]:
        *inputs, h = rest
        f = lambda at, u: call(whole, at, u, *inputs)  # noqa: E731
        new, error = rodas3_step(lambda at, u: linear(at, u, *inputs), f, x, u, h)
        new = settled(new)
        return (new, error, hermite_path(x, new, f(x, u), f(new, u), h)) if lands else (new, error)

    return step


def hermite_path(x: Array, new: Array, rate: Array, rate_new: Array, h: Scalar) -> np.ndarray:
    """Coefficients (4, nx) for `dormand_prince.along` of the cubic through both ends of a step, with the slopes there.

    Args:
        x, new: (nx,) states at its ends.   rate, rate_new: (nx,) dx/dt there.   h: () [s].
    """
    moved = new - x
    bent = h * rate - moved
    return scalar.stack([moved, bent, moved - h * rate_new - bent, scalar.zeros(len(x))])


def as_program(slopes: Slopes, shapes: Mapping[str, tuple[int, ...]]) -> Slopes:
    """The same by a call of one program, never inlined, that returns the entries of A and E that are no constants.

    Args:
        slopes: (x, u, …) → dx/dt, A, E.   shapes: of its arguments by name, "x" first.
    """
    constants: list[np.ndarray] = []

    def entries(*arguments: Array) -> tuple[Array, ...]:
        rate, *constants[:] = slopes(*arguments)
        return rate, *(scalar.array([v for v in matrix.flat if isinstance(v, Symbol)]) for matrix in constants)

    program = trace("plant_slopes", entries, shapes, ("xd", "slope", "mass"), noinline=True)

    def called(*arguments: Array) -> tuple[Array, Array, Array]:
        rate, *values = call(program, *arguments)
        slope, mass = (_filled(matrix, column) for matrix, column in zip(constants, values, strict=True))
        return rate, slope, mass

    return called


def _filled(matrix: np.ndarray, values: Sequence[Scalar]) -> np.ndarray:
    """The matrix with the values in place of its symbols, row by row."""
    left = iter(values)
    return scalar.array([[next(left) if isinstance(v, Symbol) else v for v in row] for row in matrix])


def _sum(weights: Sequence[float], k: list[np.ndarray], start: Array) -> np.ndarray:
    for weight, stage in zip(weights, k, strict=True):
        start = start + weight * stage if weight else start
    return scalar.array(start)

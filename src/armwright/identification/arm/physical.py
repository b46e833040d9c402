"""Physically possible parameters of an arm: semidefinite programming and the log-Cholesky parametrisation.

Both minimise ‖R π − z‖² + 2 w Σ d(P_i ‖ P0_i) over  π = (links' inertial parameters, rotors and friction, …), where each link's
pseudo-inertia P = [[Σ, m c], [m cᵀ, m]] is positive semidefinite, [Wensing2018], and rotors' inertia and friction are
not negative. d is the entropic divergence from a prior P0, as of CAD:  d(P ‖ P0) = tr(P0⁻¹ P) − log det(P0⁻¹ P) − 4,  the Bregman
divergence of −log det, [LeeWensingPark2020]: 0 at the prior, infinite for an impossible body, the same in all units and frames.

Without a prior a neutral body stands in for it, with a weight that the data does not feel: a typical mass and a typical radius
of gyration. It keeps every link possible and chooses among the values that the data do not distinguish.

`physical_by_sdp` finds the global minimum. `physical_by_log_cholesky` writes P = U0 V Vᵀ U0ᵀ with V upper triangular, its
diagonal exponentials, [RuckerWensing2022], in coordinates where the prior U0 U0ᵀ is the unit matrix: there
d = Σ_(i<j) V_ij² + Σ_i (V_ii² − 1 − 2 log V_ii),  a sum of squares, so that all is one least-squares problem without constraints.
"""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from armwright.errors import IdentificationError
from armwright.spatial import TENSOR

PER_LINK = 10  # [m, m c_x, m c_y, m c_z, Ixx, Ixy, Ixz, Iyy, Iyz, Izz], about the link frame's origin
# smallest eigenvalue of a pseudo-inertia in its units, by the largest: no more than the solver's rounding
AT_BOUND = 1e-5
FLAT = 1e-8  # eigenvalue of a prior, as AT_BOUND: below, its divergence says nothing
ACTIVE = 1e-6  # a number above its bound by no more, in units of its column
STEEPEST = 15.0  # of the exponents of the diagonal: a body 3e6 times thinner than the prior is flat
NEUTRAL = 1e-3  # weight of the neutral body: far below one measurement
LEAST = 1e-12  # weight of the norm of rotors and friction that no row shows, in units of their columns
STEPS = 300  # of the search by log-Cholesky at each weight, most take 20 to 50
COARSE, FINE = 1e-8, 1e-13  # relative change of cost at which it ends, at weights on the way and at the last one
STRONG, STAGES = 100.0, 6  # first weight of a weak prior, and number of weights until its own


def _pseudo_inertia_basis() -> np.ndarray:
    """E (10, 4, 4) with  P = Σ_k π_k E_k;  Σ = ½ tr(I) 1 − I."""
    basis = np.zeros((PER_LINK, 4, 4))
    basis[0, 3, 3] = 1.0
    for i in range(3):
        basis[1 + i, i, 3] = basis[1 + i, 3, i] = 1.0
    for k, (i, j) in enumerate(TENSOR.values(), start=4):
        basis[k, i, j] = basis[k, j, i] = -1.0
        if i == j:
            basis[k, :3, :3] += 0.5 * np.eye(3)
    return basis


BASIS = _pseudo_inertia_basis()
# π from P: entries of P by rows, then the linear map back. P has as many free entries as a link has parameters, so it is exact.
TO_PARAMETERS = np.linalg.pinv(BASIS.reshape(PER_LINK, 16).T)


def pseudo_inertias(parameters: np.ndarray) -> np.ndarray:
    """P (…, 4, 4) of inertial parameters (…, 10): [kg m²] and [kg m] and [kg]."""
    return np.tensordot(np.asarray(parameters, dtype=float), BASIS, axes=1)


def inertial_parameters(pseudo: np.ndarray) -> np.ndarray:
    """π (…, 10) of pseudo-inertias (…, 4, 4)."""
    return np.asarray(pseudo, dtype=float).reshape(*np.shape(pseudo)[:-2], 16) @ TO_PARAMETERS.T


@dataclass(frozen=True, eq=False)
class PhysicalBounds:
    """Limits of physically possible parameters π (p,).

    Attributes:
        names: of all p parameters.   links: (L, 10) places of each link's inertial parameters in π.
        nonnegative: places of rotor inertias, viscous and Coulomb friction.
        mass: by number of the link, lowest and highest mass [kg].   total_mass: lowest and highest mass of all links [kg].
        length: typical size of a link [m], and mass a typical mass [kg]: units of the computation, which change no result.
    """

    names: Sequence[str]
    links: np.ndarray
    nonnegative: Sequence[int] = ()
    mass: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    total_mass: tuple[float, float] | None = None
    length: float = 0.1
    typical_mass: float = 1.0

    def __post_init__(self) -> None:
        links = np.asarray(self.links, dtype=int).reshape(-1, PER_LINK)
        used = np.concatenate([links.ravel(), np.asarray(self.nonnegative, dtype=int)])
        if len(set(used.tolist())) < len(used) or (len(used) and not 0 <= used.min() <= used.max() < len(self.names)):
            expected = f"places from 0 to {len(self.names) - 1}, every one once"
            raise IdentificationError(place="PhysicalBounds.links and nonnegative", value=used, expected=expected)
        for name, (low, high) in [*self.mass.items(), *([("total_mass", self.total_mass)] if self.total_mass else [])]:
            if not 0 <= low <= high:
                expected = "0 or more, the lowest first"
                raise IdentificationError(place=f"PhysicalBounds mass {name}", value=(low, high), expected=expected)
        low, high = (sum(self.mass.get(k, (0.0, np.inf))[end] for k in range(len(links))) for end in (0, 1))
        if self.total_mass and not (low <= self.total_mass[1] and high >= self.total_mass[0]):
            expected = f"something between {low:g} and {high:g} kg, which the bounds of links allow"
            raise IdentificationError(place="PhysicalBounds.total_mass", value=self.total_mass, expected=expected)
        object.__setattr__(self, "links", links)

    @property
    def congruence(self) -> np.ndarray:
        """D (4,) with  D P D  of order 1 for a typical link."""
        return np.array([1 / self.length] * 3 + [1.0]) / np.sqrt(self.typical_mass)


@dataclass(frozen=True, eq=False)
class PhysicalEstimate:
    """Physically possible parameters.

    Attributes:
        values: (p,) π.   cost: ‖R π − z‖².   cost_free: the least that it can be without constraints.
        margins: (L,) smallest eigenvalue of each link's pseudo-inertia by its largest, in the units of the bounds.
        at_bound: (p,) a rotor or friction that is 0, a mass at its bound, all parameters of a link at the edge of the possible.
        remarks: sentences.   method: "sdp" or "log-cholesky".
    """

    values: np.ndarray
    cost: float
    cost_free: float
    margins: np.ndarray
    at_bound: np.ndarray
    remarks: tuple[str, ...]
    method: str


def physical_by_sdp(
    R: np.ndarray, z: np.ndarray, bounds: PhysicalBounds, *, prior: np.ndarray | None = None, weight: float = 1.0
) -> PhysicalEstimate:
    """Physically possible parameters by semidefinite programming: the global minimum. [Wensing2018] [SousaCortesao2014]

        min ‖R π − z‖² + 2 weight Σ d(P_i ‖ P0_i)   subject to   P_i ⪰ 0,  π_k ≥ 0 for rotors and friction,  bounds of masses

    Rows of R and z count in standard deviations of the noise, so that `weight` has a meaning: 1 counts the prior as much as one
    measurement of each number that is as uncertain as itself. What the data do not determine comes from the prior, or without one
    from the neutral body, with a remark.

    Args:
        R: (k, p), best the triangular factor of all weighted rows.   z: (k,).   bounds: of the p parameters.
        prior: (p,) parameters of a possible arm, of which the links' count.   weight: of the prior, 0 or more.
    Returns:
        estimate: its values in the order of `bounds.names`.
    Raises:
        IdentificationError: a prior that no real arm can have, cvxpy or Clarabel not installed, no solution.
    """
    cp = _cvxpy()
    R, z = _checked(R, z, bounds)
    given, prior, weight = prior is not None, *_prior(prior, weight, bounds)
    unit, size = _units(R, z, bounds)
    x = cp.Variable(len(unit))  # π in `unit`
    A, b = _reduced(R * (unit / size), z / size)
    others = np.setdiff1d(np.arange(len(unit)), bounds.links)
    cost = cp.sum_squares(A @ x - b) + LEAST * cp.sum_squares(x[others])
    D = np.outer(bounds.congruence, bounds.congruence)  # makes P of order 1
    for link in bounds.links:
        P = cp.sum([x[j] * (unit[j] * BASIS[i] * D) for i, j in enumerate(link)])
        toward = np.linalg.inv(pseudo_inertias(prior[link]) * D)
        cost = cost + (2 * weight / size**2) * (cp.trace(toward @ P) - cp.log_det(P))  # log det asks for P > 0
    constraints = [x[np.asarray(bounds.nonnegative, dtype=int)] >= 0]
    masses = cp.multiply(x[bounds.links[:, 0]], unit[bounds.links[:, 0]])
    limits = [(masses[k], limit) for k, limit in bounds.mass.items()]
    for value, (low, high) in [*limits, *([(cp.sum(masses), bounds.total_mass)] if bounds.total_mass else [])]:
        constraints += [value >= low] + ([value <= high] if np.isfinite(high) else [])
    problem = cp.Problem(cp.Minimize(cost), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of a solution within the looser tolerance, which is tight enough
        with contextlib.suppress(cp.error.SolverError):
            problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-11, tol_gap_rel=1e-11, tol_feas=1e-11)
    if x.value is None:
        raise IdentificationError(f"no physically possible parameters found: the solver ends with {problem.status!r}")
    values = x.value * unit
    values[list(bounds.nonnegative)] = np.maximum(values[list(bounds.nonnegative)], 0.0)
    return _estimate("sdp", values, R, z, bounds, unit, given)


def physical_by_log_cholesky(
    R: np.ndarray, z: np.ndarray, bounds: PhysicalBounds, *, prior: np.ndarray | None = None, weight: float = 1.0
) -> PhysicalEstimate:
    """Physically possible parameters as a least-squares problem without constraints on the links. [RuckerWensing2022]

    Minimises the cost of `physical_by_sdp` over exponents and off-diagonal entries of V, P = U0 V Vᵀ U0ᵀ, and over the other
    parameters with their bounds at 0, by SciPy's trust-region method with the exact slope, from the prior on. It needs no extra
    package and is the slower of the two; a remark says if it did not settle.

    Args, Returns, Raises: as `physical_by_sdp`; bounds of masses are refused here.
    """
    if bounds.mass or bounds.total_mass is not None:
        raise IdentificationError("bounds of masses", place="bounds", expected="none of them, or physical_by_sdp")
    R, z = _checked(R, z, bounds)
    given, prior, weight = prior is not None, *_prior(prior, weight, bounds)
    unit = _units(R, z, bounds)[0]
    A, b = _reduced(R, z)
    links, roots = bounds.links, np.array([_upper_root(pseudo_inertias(prior[link])) for link in bounds.links])
    others = np.setdiff1d(np.arange(len(unit)), links)

    def bodies(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """V (L, 4, 4), and π."""
        shapes = theta[: links.size].reshape(-1, PER_LINK)
        V = np.zeros((len(links), 4, 4))
        V[:, DIAGONAL, DIAGONAL] = np.exp(shapes[:, :4])
        V[:, ABOVE[0], ABOVE[1]] = shapes[:, 4:]
        values = np.zeros(len(unit))
        U = roots @ V
        values[links] = inertial_parameters(U @ U.transpose(0, 2, 1))
        values[others] = theta[links.size :] * unit[others]
        return V, values

    def residuals(theta: np.ndarray, pull: float) -> np.ndarray:
        return np.concatenate([A @ bodies(theta)[1] - b, pull * _roots_of_divergence(theta[: links.size])])

    def slope(theta: np.ndarray, pull: float) -> np.ndarray:
        V = bodies(theta)[0]
        J = np.zeros((len(b) + links.size, len(theta)))
        for k, link in enumerate(links):
            dV = np.zeros((PER_LINK, 4, 4))
            dV[DIAGONAL, DIAGONAL, DIAGONAL] = V[k][DIAGONAL, DIAGONAL]
            dV[np.arange(4, 10), ABOVE[0], ABOVE[1]] = 1.0
            half = roots[k] @ dV @ V[k].T @ roots[k].T
            J[: len(b), k * PER_LINK : (k + 1) * PER_LINK] = (
                A[:, link] @ inertial_parameters(half + half.transpose(0, 2, 1)).T
            )
        J[: len(b), links.size :] = A[:, others] * unit[others]
        rows = np.arange(links.size)
        J[len(b) + rows, rows] = pull * _slopes_of_divergence(theta[: links.size])
        return J

    low, high, start = _search_range(bounds, others, prior[others] / unit[others])
    # Weak priors have long flat valleys at the edge of the possible: from a strong one on they are short ways.
    weights = np.append(np.geomspace(STRONG, weight, STAGES)[:-1], weight) if weight < STRONG else [weight]
    found: Any = None
    for weight in weights:
        fine = FINE if weight == weights[-1] else COARSE
        ends: Any = {"xtol": fine, "ftol": fine, "gtol": fine, "max_nfev": STEPS, "jac": slope, "bounds": (low, high)}
        found = least_squares(residuals, start, args=(np.sqrt(2 * weight),), **ends)
        start = found.x
    remark = () if found.status > 0 else (f"the search by log-Cholesky did not settle in {STEPS} steps",)
    return _estimate("log-cholesky", bodies(found.x)[1], R, z, bounds, unit, given, remark)


def _search_range(
    bounds: PhysicalBounds, others: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bounds and start of a search over the shapes of all links, then over other parameters.

    Args:
        bounds: of the parameters.   others: numbers of those that are no link's.   start: their values to begin with.
    """
    count = bounds.links.size
    low, high = np.full(count + len(others), -np.inf), np.full(count + len(others), np.inf)
    exponents = (np.arange(count) % PER_LINK) < 4
    low[:count][exponents], high[:count][exponents] = -STEEPEST, STEEPEST
    positive = np.isin(others, np.asarray(bounds.nonnegative, dtype=int))
    low[count:][positive] = 0.0
    return low, high, np.concatenate([np.zeros(count), np.where(positive, np.maximum(start, ACTIVE), start)])


DIAGONAL = np.arange(4)
ABOVE = np.triu_indices(4, 1)


def _roots_of_divergence(theta: np.ndarray) -> np.ndarray:
    """Signed roots of the parts of d: √(e^(2 s) − 1 − 2 s) with the sign of s for the exponents, the entries V_ij themselves."""
    shapes = theta.reshape(-1, PER_LINK).copy()
    s = shapes[:, :4]
    shapes[:, :4] = s * np.sqrt(_share(s))
    return shapes.ravel()


def _share(s: np.ndarray) -> np.ndarray:
    """(e^(2 s) − 1 − 2 s) / s²; 2 at s = 0, where both cancel."""
    small = np.abs(s) < 1e-3
    safe = np.where(small, 1.0, s)
    series = 2.0 + s * (4.0 / 3.0 + s * (2.0 / 3.0 + s * 4.0 / 15.0))
    return np.where(small, series, (np.expm1(2 * safe) - 2 * safe) / safe**2)


def _slopes_of_divergence(theta: np.ndarray) -> np.ndarray:
    """Derivative of `_roots_of_divergence`, of each by itself: (e^(2 s) − 1) / root, √2 at 0."""
    shapes = np.ones_like(theta.reshape(-1, PER_LINK))
    s = theta.reshape(-1, PER_LINK)[:, :4]
    small = np.abs(s) < 1e-3
    safe = np.where(small, 1.0, s)
    series = 2.0 + s * (2.0 + s * 4.0 / 3.0)  # (e^(2 s) − 1) / s
    shapes[:, :4] = np.where(small, series, np.expm1(2 * safe) / safe) / np.sqrt(_share(s))
    return shapes.ravel()


def divergence(parameters: np.ndarray, prior: np.ndarray) -> np.ndarray:
    """d(P ‖ P0) = tr(P0⁻¹ P) − log det(P0⁻¹ P) − 4  (…) of links, 0 if equal. [LeeWensingPark2020]

    Args:
        parameters: (…, 10) of possible bodies.   prior: (…, 10), too.
    """
    ratio = np.linalg.solve(pseudo_inertias(prior), pseudo_inertias(parameters))
    return np.trace(ratio, axis1=-2, axis2=-1) - np.linalg.slogdet(ratio)[1] - 4.0


def _upper_root(P: np.ndarray) -> np.ndarray:
    """U upper triangular with P = U Uᵀ: Cholesky's factor of the matrix with rows and columns in reverse."""
    return np.linalg.cholesky(P[::-1, ::-1])[::-1, ::-1]


def _checked(R: np.ndarray, z: np.ndarray, bounds: PhysicalBounds) -> tuple[np.ndarray, np.ndarray]:
    R, z = np.asarray(R, dtype=float), np.asarray(z, dtype=float)
    if R.ndim != 2 or z.shape != R.shape[:1] or R.shape[1] != len(bounds.names):
        expected = f"(k, {len(bounds.names)}) and (k,)"
        raise IdentificationError(f"shapes {R.shape} and {z.shape}", place="R and z", expected=expected)
    if not (np.isfinite(R).all() and np.isfinite(z).all()):
        raise IdentificationError("infinite or not a number", place="R and z", expected="finite numbers")
    return R, z


def _prior(prior: Any, weight: float, bounds: PhysicalBounds) -> tuple[np.ndarray, float]:
    """Prior (p,) and its weight; the neutral body's if absent."""
    if not weight > 0:
        raise IdentificationError(place="weight", value=weight, expected="above 0; without a prior, leave both out")
    if prior is None:
        neutral = np.zeros(len(bounds.names))
        neutral[bounds.links] = inertial_parameters(np.diag(bounds.congruence**-2))
        return neutral, NEUTRAL
    prior = np.asarray(prior, dtype=float)
    if prior.shape != (len(bounds.names),):
        raise IdentificationError(f"shape {prior.shape}", place="prior", expected=f"({len(bounds.names)},)")
    for k, link in enumerate(bounds.links):
        eigenvalues = np.linalg.eigvalsh(pseudo_inertias(prior[link]) * np.outer(bounds.congruence, bounds.congruence))
        if not eigenvalues[0] > FLAT * eigenvalues[-1]:
            what = f"link {k + 1} ({bounds.names[link[0]]}, …) is no body with a volume"
            raise IdentificationError(what, place="prior", expected="a positive definite pseudo-inertia of every link")
    return prior, weight


def _units(R: np.ndarray, z: np.ndarray, bounds: PhysicalBounds) -> tuple[np.ndarray, float]:
    """Units of the parameters (p,), and of the rows: links by the typical mass and length, all others by their column's size."""
    size = max(float(np.linalg.norm(z)), np.finfo(float).tiny ** 0.5)
    norms = np.linalg.norm(R, axis=0)
    unit = np.where(norms > 0, size / np.where(norms > 0, norms, 1.0), 1.0)
    m, l = bounds.typical_mass, bounds.length
    for link in bounds.links:
        unit[link] = np.array([m] + [m * l] * 3 + [m * l * l] * 6)
    return unit, size


def _reduced(R: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """At most p + 1 rows that say the same."""
    p = R.shape[1]
    if len(z) <= p + 1:
        return R, z
    reduced = np.asarray(np.linalg.qr(np.column_stack([R, z]), mode="r"))
    return reduced[:, :p], reduced[:, p]


def _estimate(
    method: str,
    values: np.ndarray,
    R: np.ndarray,
    z: np.ndarray,
    bounds: PhysicalBounds,
    unit: np.ndarray,
    given: bool,
    remarks: tuple[str, ...] = (),
) -> PhysicalEstimate:
    """The result with what is at its bound, and how much the constraints cost."""
    free, *_ = np.linalg.lstsq(R * unit, z, rcond=1e-10)
    cost, cost_free = float(np.sum((R @ values - z) ** 2)), float(np.sum((R * unit @ free - z) ** 2))
    margins, at_bound, found = np.zeros(len(bounds.links)), np.zeros(len(values), dtype=bool), list(remarks)
    for k, link in enumerate(bounds.links):
        scaled = pseudo_inertias(values[link]) * np.outer(bounds.congruence, bounds.congruence)
        eigenvalues = np.linalg.eigvalsh(scaled)
        margins[k] = eigenvalues[0] / max(eigenvalues[-1], np.finfo(float).tiny)
        if margins[k] < AT_BOUND:
            at_bound[link] = True
            found.append(
                f"link {k + 1} ({bounds.names[link[0]]}, …) is at the edge of what a body can be: "
                "the log alone would have it impossible, or does not determine its shape"
            )
        for limit in bounds.mass.get(k, ()):
            if np.isfinite(limit) and abs(values[link[0]] - limit) <= ACTIVE * max(abs(limit), unit[link[0]]):
                at_bound[link[0]] = True
                found.append(f"{bounds.names[link[0]]} is at its bound, {limit:g} kg")
    for j in bounds.nonnegative:
        if values[j] <= ACTIVE * unit[j]:
            at_bound[j] = True
            wanted = _wanted(R, z, j, unit)
            why = "the log does not determine it" if wanted is None else f"the log alone wants {wanted:.3g}"
            found.append(f"{bounds.names[j]} is at its bound, 0: {why}")
    if not given and np.linalg.matrix_rank(R * unit, tol=1e-9 * np.linalg.norm(R * unit, 2)) < len(values):
        found.append(
            "the log does not distinguish all parameters and there is no prior: a neutral body chose among the possible values; "
            "only base parameters are measured"
        )
    return PhysicalEstimate(values, cost, cost_free, margins, at_bound, tuple(found), method)


def _wanted(R: np.ndarray, z: np.ndarray, j: int, unit: np.ndarray) -> float | None:
    """Value of one parameter without constraints; None if it is no combination of the rows."""
    A = R * unit
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    kept = s > 1e-9 * s[0]
    known = Vt[kept]
    if 1.0 - float(np.sum(known[:, j] ** 2)) > 1e-6:
        return None
    return float((known.T @ ((U.T @ z)[kept] / s[kept]))[j] * unit[j])


def _cvxpy() -> Any:
    """The package cvxpy with its solver Clarabel."""
    try:
        import clarabel  # noqa: F401
        import cvxpy
    except ImportError:
        what = "semidefinite programming needs cvxpy and clarabel, which are not installed: pip install armwright[identify]"
        raise IdentificationError(what) from None
    return cvxpy

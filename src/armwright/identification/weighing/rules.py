"""Mass by a scale, centre of mass by two supports, moments of inertia by pendulums. [SchedlinskiLink2001], [GentaDelprete1994]"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from armwright.errors import IdentificationError
from armwright.identification.estimate import Estimate
from armwright.identification.weighing.measured_number import MeasuredNumber, ValueWithStd, propagated, reading_of
from armwright.scalar import numbers_or_nan

STANDARD_GRAVITY = 9.80665  # [m/s²]; CGPM 1901
SURE = 3.0  # deviations by which a scale may seem to hold more than the link
LARGEST = 0.6  # [rad] of a swing, beyond which the series of its period is too short
ENTRIES = (("xx", (0, 0)), ("xy", (0, 1)), ("xz", (0, 2)), ("yy", (1, 1)), ("yz", (1, 2)), ("zz", (2, 2)))
INDEPENDENT = 1e-3  # of the largest singular value of the axes


def measured_mass(
    readings: Sequence[float], *, scale_std: float = 0.0, resolution: float = 0.0, tare: ValueWithStd = 0.0
) -> MeasuredNumber:
    """Mass by repeated weighing:  m = mean of readings − tare,  u² = s²/k + resolution²/12 + u_scale² + u_tare².

    Args:
        readings: (k,) [kg] of the scale.   scale_std: [kg] standard deviation of its calibration.
        resolution: [kg] its last digit.   tare: [kg] of what was weighed too, a number or (value, std).
    Returns:
        mass: [kg]. The buoyancy of air, 0.015 % of a mass of aluminium by more than of a steel weight, is not corrected.
    Raises:
        IdentificationError: no readings, a mass of 0 or less, a negative deviation.
    Example:
        >>> mass = aw.identification.measured_mass([1.251, 1.249, 1.250], resolution=0.001)
        >>> print(f"{mass.value:.4f} ± {mass.std:.4f} kg")
        1.2500 ± 0.0006 kg
    """
    values = np.atleast_1d(numbers_or_nan(readings))
    if values.ndim != 1 or not len(values) or not np.isfinite(values).all():
        raise IdentificationError(place="readings", value=readings, expected="one reading [kg] or more")
    scatter = float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else 0.0
    calibrated, digit = (reading_of(n, v, 0.0)[0] for n, v in (("scale_std", scale_std), ("resolution", resolution)))
    parts = {
        "mean of readings [kg]": (float(values.mean()), scatter),
        "scale [kg]": (0.0, calibrated),
        "resolution [kg]": (0.0, digit / np.sqrt(12.0)),
        "tare [kg]": reading_of("tare", tare, 0.0),
    }
    how = f"mass by a scale, mean of {len(values)} readings less tare"
    found = propagated("mass", "kg", how, lambda mean, scale, last, empty: mean + scale + last - empty, parts)
    if found.value <= 0.0:
        raise IdentificationError("not above 0", place="mass", value=found.value, expected="readings above the tare")
    if scatter == 0.0:
        return found
    freedom = (len(values) - 1) * (found.std / scatter) ** 4  # Welch and Satterthwaite, [JCGM100] eq. (G.2b)
    return replace(found, freedom=float(freedom))


def measured_centre(
    reading: ValueWithStd, span: ValueWithStd, mass: ValueWithStd, *, origin: ValueWithStd = 0.0
) -> MeasuredNumber:
    """Coordinate of the centre of mass of a link that lies on two supports, one of them a scale:  c = o + L m₂ / m.

    Moments about the first support: what the scale under the second reads, m₂, holds the weight at distance c − o.

    Args:
        reading: [kg] of the scale under the second support.   span: L [m] from the first support to the second.
        mass: m [kg].   origin: o [m] coordinate of the first support on the link's axis. Each a number or (value, std).
    Returns:
        centre: [m] along the axis from the first support to the second, in link coordinates.
    Raises:
        IdentificationError: readings that are none, a span or a mass of 0 or less, a scale that holds less than 0 or more than
            the link, as of a centre beside the supports.
    Example:
        >>> reading, mass = (0.6, 0.001), (1.25, 0.001)  # kg, with standard deviations
        >>> centre = aw.identification.measured_centre(reading, span=0.4, mass=mass)
        >>> print(f"{centre.value:.4f} ± {centre.std:.4f} m")
        0.1920 ± 0.0004 m
    """
    parts = {
        "reading [kg]": reading_of("reading", reading),
        "span [m]": reading_of("span", span, above=0.0),
        "mass [kg]": reading_of("mass", mass, above=0.0),
        "origin [m]": reading_of("origin", origin),
    }
    (held, off), (whole, beside) = parts["reading [kg]"], parts["mass [kg]"]
    if not -SURE * off <= held <= whole + SURE * np.hypot(off, beside):
        expected = f"from 0 to the link's mass, {whole:g} kg: it lies on both supports"
        raise IdentificationError(place="reading", value=held, expected=expected)
    how = "centre of mass by two supports, c = o + L m₂ / m"
    return propagated("centre", "m", how, lambda held, length, whole, first: first + length * held / whole, parts)


def measured_inertia_pendulum(
    period: ValueWithStd,
    mass: ValueWithStd,
    distance: ValueWithStd,
    *,
    amplitude: float = 0.0,
    gravity: float = STANDARD_GRAVITY,
) -> MeasuredNumber:
    """Moment of inertia about the centre of mass by a compound pendulum:  I = m g d T₀² / 4π² − m d².

    T₀ = T / (1 + φ²/16 + 11 φ⁴/3072) is the period of small swings, φ the amplitude. It is sure where d is small: of a link on
    a long arm two large numbers are subtracted, as the deviation says.

    Args:
        period: T [s] of a full swing.   mass: m [kg].   distance: d [m] from the axis of suspension to the centre.
        amplitude: φ [rad].   gravity: g [m/s²]. The first three are each a number or (value, std).
    Returns:
        inertia: [kg m²] about the axis through the centre, parallel to that of suspension.
    Raises:
        IdentificationError: readings that are none, or no pendulum: the moment is not above 0.
    Example:
        >>> period, mass, distance = (1.2, 0.001), (1.25, 0.001), (0.2, 0.001)  # ± each
        >>> found = aw.identification.measured_inertia_pendulum(period, mass, distance)
        >>> print(f"{found.value:.4f} ± {found.std:.4f} kg m²")
        0.0394 ± 0.0002 kg m²
    """
    swing, g = reading_of("amplitude", amplitude, 0.0)[0], reading_of("gravity", gravity, above=0.0)[0]
    if swing > LARGEST:
        raise IdentificationError(place="amplitude", value=amplitude, expected=f"{LARGEST} rad or less")
    longer = 1.0 + swing**2 / 16.0 + 11.0 * swing**4 / 3072.0
    parts = {
        "period [s]": reading_of("period", period, above=0.0),
        "mass [kg]": reading_of("mass", mass, above=0.0),
        "distance [m]": reading_of("distance", distance, above=0.0),
    }
    how = f"inertia by a compound pendulum, I = m g d T² / 4π² − m d², amplitude {swing:g} rad"

    def formula(T: Any, m: Any, d: Any) -> Any:
        return m * g * d * (T / longer) ** 2 / (4.0 * np.pi**2) - m * d * d

    return _above_0(propagated("inertia", "kg m²", how, formula, parts))


def measured_inertia_bifilar(
    period: ValueWithStd,
    mass: ValueWithStd,
    length: ValueWithStd,
    spacing: ValueWithStd,
    *,
    spacing_top: ValueWithStd | None = None,
    gravity: float = STANDARD_GRAVITY,
) -> MeasuredNumber:
    """Moment of inertia about the vertical through the centre of mass, by a bifilar pendulum:  I = m g D D' T² / 16 π² h.

    The link hangs on two wires of height h, D apart at the link and D' at the top, its centre midway between them, and turns.

    Args:
        period: T [s] of a full swing.   mass: m [kg].   length: h [m] height of the wires.   spacing: D [m].
        spacing_top: D' [m]; None: parallel wires.   gravity: g [m/s²]. All but gravity a number or (value, std).
    Returns:
        inertia: [kg m²].
    Raises:
        IdentificationError: readings that are none, or 0 or less.
    Example:
        >>> period, mass = (1.2, 0.001), (1.25, 0.001)  # with standard deviations
        >>> found = aw.identification.measured_inertia_bifilar(period, mass, 0.8, spacing=0.3)
        >>> print(f"{found.value:.6f} ± {found.std:.6f} kg m²")
        0.012576 ± 0.000023 kg m²
    """
    g = reading_of("gravity", gravity, above=0.0)[0]
    given = {"period [s]": period, "mass [kg]": mass, "length [m]": length, "spacing [m]": spacing}
    given |= {} if spacing_top is None else {"spacing_top [m]": spacing_top}
    parts = {name: reading_of(name.split()[0], value, above=0.0) for name, value in given.items()}
    how = "inertia by a bifilar pendulum, I = m g D D' T² / 16 π² h"

    def formula(T: Any, m: Any, h: Any, below: Any, *top: Any) -> Any:
        return m * g * below * (top[0] if top else below) * T**2 / (16.0 * np.pi**2 * h)

    return _above_0(propagated("inertia", "kg m²", how, formula, parts))


def measured_tensor(axes: Any, moments: Sequence[ValueWithStd | MeasuredNumber]) -> Estimate:
    """Tensor of inertia from moments about six axes or more through the centre:  uᵀ I u = moment, by weighted least squares.

    Args:
        axes: (k, 3) directions u in link axes, of any length but 0.
        moments: (k) [kg m²] about each, numbers with deviations or `MeasuredNumber`s.
    Returns:
        tensor: estimate of xx, xy, xz, yy, yz, zz [kg m²] about the centre, with covariance.
    Raises:
        IdentificationError: axes that do not determine the tensor, or a tensor that no body has.
    Example:
        >>> axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]]
        >>> moments = [0.010, 0.012, 0.005, 0.010, 0.0085, 0.0095]  # kg m² about each
        >>> tensor = aw.identification.measured_tensor(axes, moments)
        >>> print(tensor.names, tensor.values.round(4))
        ('xx', 'xy', 'xz', 'yy', 'yz', 'zz') [ 0.01  -0.001  0.001  0.012  0.001  0.005]
    """
    directions = np.atleast_2d(numbers_or_nan(axes))
    if (
        directions.shape[1:] != (3,)
        or not np.isfinite(directions).all()
        or not np.linalg.norm(directions, axis=1).all()
    ):
        raise IdentificationError(place="axes", value=axes, expected="(k, 3) directions, none of them 0")
    if not isinstance(moments, (list, tuple)) or len(moments) != len(directions):
        raise IdentificationError(place="moments", value=moments, expected=f"{len(directions)}, one for each axis")
    read = [(m.value, m.std) if isinstance(m, MeasuredNumber) else reading_of("moments", m, above=0.0) for m in moments]
    values, stds = np.array(read, dtype=float).T
    if (stds > 0.0).any() and not (stds > 0.0).all():
        raise IdentificationError("one is exact and others are not", place="moments", expected="a deviation of each")
    u = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    rows = np.array([[each[i] * each[j] * (1.0 if i == j else 2.0) for _, (i, j) in ENTRIES] for each in u])
    singular = np.linalg.svd(rows, compute_uv=False)
    if len(rows) < len(ENTRIES) or singular[-1] < INDEPENDENT * singular[0]:
        raise IdentificationError(
            "do not determine a tensor", place="axes", expected="six directions or more, not all in a cone"
        )
    weight = 1.0 / stds if (stds > 0.0).all() else np.ones_like(stds)
    covariance = np.linalg.inv((rows * weight[:, None]).T @ (rows * weight[:, None]))
    found = covariance @ (rows.T @ (weight**2 * values))
    tensor = np.zeros((3, 3))
    for (_, (i, j)), value in zip(ENTRIES, found, strict=True):
        tensor[i, j] = tensor[j, i] = value
    least = np.linalg.eigvalsh(tensor)
    if least[0] <= 0.0 or least[2] > least[0] + least[1]:
        what = f"principal moments {', '.join(f'{each:.4g}' for each in least)} kg m²"
        raise IdentificationError(what, place="tensor", expected="those of a body")
    return Estimate(
        tuple(name for name, _ in ENTRIES),
        found,
        covariance if (stds > 0.0).all() else np.zeros_like(covariance),
        "",
        f"tensor of inertia from moments about {len(u)} axes, weighted least squares",
        units=("kg m²",) * len(ENTRIES),
        log="measured tensor",
    )


def _above_0(found: MeasuredNumber) -> MeasuredNumber:
    if found.value <= 0.0:
        what = "the period is shorter than that of a point mass at this distance"
        raise IdentificationError(what, place=found.quantity, value=found.value, expected="a moment above 0")
    return found

"""DriveNumbers of a drive that contradict each other, with the mistake that would explain it and the value that would fit.

Every comparison is a ratio of two products of a joint's numbers, and the band in which it may lie: narrow where both are equal
in any motor (Kt = Ke), some decades where they only go together. Where a ratio leaves its band, each known mistake (a unit, the
wrong side of the gear, another basis) is undone in turn. The question is about those that bring ratios back into their bands
and move none out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import inf, isnan, log, nan, pi, sqrt
from typing import Any, get_args

import numpy as np

from armwright.description.drive import DC_EQUIVALENT, Basis
from armwright.description.robot import MovingJoint, RobotDescription
from armwright.errors import Findings, Problem

CLOSE = 0.03  # by which constants of one motor in two bases may differ; √2 and 3/2 lie 6 % from each other
GEARED = 3.0  # below this ratio a torque without the gear is not distinguished from a low limit
EQUAL = 10.0  # weight of a ratio that is 1 in any motor, beside those that only go together
LOOSE = 0.2  # of one that differs by decades between the base and the wrist of an arm
DERATED = 0.2  # of what the motor gives: a lower limit is not what a mistake leads back to
RARE = 2.0  # added to the distance of a mistake that is seldom made
ALTERNATIVES = 1.7  # of the distance: other explanations up to a factor 5 less typical are named too
MOST_NAMED = 3
RPM = 2 * pi / 60  # [rad/s]


@dataclass(frozen=True)
class DriveNumbers:
    """The numbers of a joint's drive as its record has them; NaN if absent."""

    n: float = nan
    rotor: float = nan  # [kg m²], also NaN for 0: that of a direct drive is part of its link
    kt: float = nan
    ke: float = nan
    r: float = nan
    inductance: float = nan
    voltage: float = nan
    current: float = nan
    effort: float = nan  # [N m | N]
    speed: float = nan  # [rad/s | m/s]
    winding_c: float = nan  # [J/K]
    winding_r: float = nan  # [K/W]
    housing_c: float = nan
    housing_r: float = nan
    ambient: float = nan
    reference: float = nan
    copper: float = nan  # [1/K]
    magnet: float = nan  # [1/K]
    links: float = nan  # [kg m² | kg] of the whole arm
    basis: Basis = "dc"
    slides: bool = False

    @property
    def turns(self) -> float:
        """Gear ratio without its sign."""
        return abs(self.n)

    @cached_property
    def dc(self) -> DriveNumbers:
        """Magnitudes, as DC-equivalents; a back-EMF constant that is absent is the torque constant."""
        to = DC_EQUIVALENT[self.basis]
        kt = to.torque_constant * self.kt
        return replace(
            self,
            n=self.turns,
            magnet=abs(self.magnet),
            kt=kt,
            ke=kt if isnan(self.ke) else to.back_emf_constant * self.ke,
            r=to.impedance * self.r,
            inductance=to.impedance * self.inductance,
            voltage=to.voltage * self.voltage,
            current=to.current * self.current,
            basis="dc",
        )


KEYS = {  # field of DriveNumbers → table and key; those of limits by their unit on a slide
    "n": "motor.gear_ratio",
    "rotor": "motor.rotor_inertia_kg_m2",
    "kt": "motor.torque_constant_n_m_per_a",
    "ke": "motor.back_emf_constant_v_s_per_rad",
    "r": "motor.resistance_ohm",
    "inductance": "motor.inductance_h",
    "voltage": "limits.voltage_v",
    "current": "limits.current_a",
    "effort": "limits.torque_n_m",
    "speed": "limits.velocity_rad_per_s",
    "winding_c": "motor.thermal.winding_capacity_j_per_k",
    "winding_r": "motor.thermal.winding_resistance_k_per_w",
    "housing_c": "motor.thermal.housing_capacity_j_per_k",
    "housing_r": "motor.thermal.housing_resistance_k_per_w",
    "ambient": "motor.thermal.ambient_c",
    "reference": "motor.thermal.reference_c",
    "copper": "motor.thermal.resistance_temperature_coefficient_per_k",
    "magnet": "motor.thermal.magnet_temperature_coefficient_per_k",
    "basis": "motor.basis",
}
ON_A_SLIDE = {"effort": "limits.force_n", "speed": "limits.velocity_m_per_s"}


@dataclass(frozen=True)
class DriveComparison:
    """One product of a drive's numbers beside another: `one / other` lies within `band` in any sound record.

    Attributes:
        key: of `DriveNumbers`, where a ratio that no mistake explains is reported.   name, other_name: of both in a sentence.
        one, other: the products, of DC-equivalents.   unit: of both; after a bar that on a slide.
        band: lowest, typical and highest ratio; without `other` of the number itself.
        weight: of a distance from what is typical.   is_outside: the ratio must not lie within the band.
    """

    key: str
    name: str
    one: Callable[[DriveNumbers], float]
    unit: str
    band: tuple[float, float, float]
    other_name: str = ""
    other: Callable[[DriveNumbers], float] = lambda d: 1.0
    weight: float = 1.0
    is_outside: bool = False

    @property
    def is_equal(self) -> bool:
        """True where both are equal in any motor."""
        return self.weight == EQUAL

    def ratio(self, numbers: DriveNumbers) -> float:
        """The ratio, NaN where a number is absent."""
        return float(self.one(numbers.dc) / self.other(numbers.dc))

    def fails(self, numbers: DriveNumbers) -> bool:
        """True where the ratio is not as it should be; one that is not known says nothing."""
        ratio, (low, _, high) = self.ratio(numbers), self.band
        return not isnan(ratio) and (low <= ratio <= high) == self.is_outside

    def distance(self, numbers: DriveNumbers) -> float:
        """The distance from what is typical, the logarithm of the ratio times the weight."""
        ratio = self.ratio(numbers)
        if self.is_outside or not 0 < ratio < inf:
            return 0.0
        return abs(log(ratio / self.band[1])) * self.weight

    def sentence(self, numbers: DriveNumbers) -> str:
        """The comparison in words."""
        dc, ratio, (low, _, high) = numbers.dc, self.ratio(numbers), self.band
        rotary, _, linear = self.unit.partition(" | ")
        unit = linear if linear and numbers.slides else rotary
        if not self.other_name:
            return f"{self.name} is {ratio:.4g} {unit}, real ones {f'{low:g} at least' if ratio < low else f'{high:g} at most'}"
        times = "just" if self.is_outside else f"{ratio:.4g} times"
        return f"{self.name}, {self.one(dc):.4g} {unit}, is {times} {self.other_name}, {self.other(dc):.4g}"

    def plain(self, numbers: DriveNumbers) -> Problem:
        """The contradiction without an explanation."""
        keys = KEYS | ON_A_SLIDE if numbers.slides else KEYS
        return Problem(self.sentence(numbers), keys[self.key], float(getattr(numbers, self.key)))


COMPARISONS = (
    DriveComparison(
        *("kt", "the torque constant (DC-equivalent)", lambda d: d.kt, "N m/A", (0.9, 1.0, 1.1)),
        *("the back-EMF constant", lambda d: d.ke, EQUAL),
    ),
    DriveComparison(
        *("effort", "the limit of torque", lambda d: d.effort, "N m | N", (0.02, 1.0, 1.15)),
        *("n Kt I at the limit of current", lambda d: d.n * d.kt * d.current, EQUAL),
    ),
    DriveComparison(
        *("effort", "the limit of torque", lambda d: d.effort, "N m", (1 - CLOSE, 1.0, 1 + CLOSE)),
        *("Kt I without the gear", lambda d: nan if d.slides or d.n < GEARED else d.kt * d.current, 1.0, True),
    ),
    DriveComparison(
        *("speed", "the limit of speed", lambda d: d.speed, "rad/s | m/s", (1e-3, 0.5, 2.0)),
        *("the no-load speed V / (n Ke)", lambda d: d.voltage / (d.n * d.ke)),
    ),
    DriveComparison(
        *("rotor", "the rotor's inertia at the joint n² J", lambda d: d.n**2 * d.rotor, "kg m² | kg", (0.0, 0.1, 1e4)),
        *("that of all links", lambda d: d.links, LOOSE),
    ),
    DriveComparison(
        *("r", "R I at the limit of current", lambda d: d.r * d.current, "V", (1e-4, 0.3, 10.0)),
        *("the limit of voltage", lambda d: d.voltage),
    ),
    DriveComparison(
        *("kt", "the no-load speed V / (n Ke)", lambda d: nan if d.slides else d.voltage / (d.n * d.ke), "rad/s"),
        (0.03, 5.0, inf),
    ),
    DriveComparison(
        *("kt", "the no-load speed V / (n Ke)", lambda d: d.voltage / (d.n * d.ke) if d.slides else nan, "m/s"),
        (1e-3, 0.3, inf),
    ),
    DriveComparison(
        *("rotor", "the rotor's time constant R J / (Kt Ke)", lambda d: d.r * d.rotor / (d.kt * d.ke), "s"),
        (2e-5, 0.01, 3.0),
    ),
    DriveComparison(
        *("rotor", "the time in which the rotor alone reaches the limit of speed, J n q̇ / (Kt I),"),
        *(lambda d: d.rotor * d.n * d.speed / (d.kt * d.current), "s", (1e-6, 0.03, 10.0)),
    ),
    DriveComparison("rotor", "the rotor's inertia", lambda d: d.rotor, "kg m²", (0.0, 1e-4, 10.0), weight=LOOSE),
    DriveComparison("inductance", "the time constant L / R", lambda d: d.inductance / d.r, "s", (1e-7, 1e-3, 0.2)),
    DriveComparison(
        *("winding_c", "the winding's time constant, capacity times resistance,"),
        *(lambda d: d.winding_c * d.winding_r, "s", (0.3, 30.0, 2e4)),
    ),
    DriveComparison(
        *("housing_c", "the housing's time constant, capacity times resistance,"),
        *(lambda d: d.housing_c * d.housing_r, "s", (10.0, 1e3, 1e5)),
    ),
    DriveComparison(
        *("winding_c", "the winding's time constant", lambda d: d.winding_c * d.winding_r, "s", (0.0, 0.03, 1.5)),
        *("the housing's", lambda d: d.housing_c * d.housing_r),
    ),
    DriveComparison(
        *("winding_r", "the winding's warming at the limit of current, R I² times its resistance,"),
        *(lambda d: d.r * d.current**2 * d.winding_r, "K", (1e-3, 200.0, 1e5)),
    ),
    DriveComparison("ambient", "the ambient temperature", lambda d: d.ambient, "°C", (-100.0, 25.0, 150.0)),
    DriveComparison("reference", "the reference temperature", lambda d: d.reference, "°C", (-100.0, 25.0, 150.0)),
    DriveComparison("copper", "the coefficient of the resistance", lambda d: d.copper, "1/K", (0.0, 0.004, 0.02)),
    DriveComparison("magnet", "the coefficient of the magnets", lambda d: d.magnet, "1/K", (0.0, 0.001, 0.02)),
)


@dataclass(frozen=True)
class Mistake:
    """A number in another unit, on the wrong side of the gear or in another basis, and the numbers without it."""

    key: str  # of DriveNumbers
    question: str
    fit: Callable[[DriveNumbers], dict[str, Any]]
    closely: bool = False  # explains only what is then equal within CLOSE
    rarity: float = 0.0

    def changes(self, numbers: DriveNumbers) -> dict[str, Any]:
        """The numbers that differ without the mistake; none where it cannot be."""
        if isnan(getattr(numbers, self.key)):
            return {}
        fit = self.fit(numbers).items()
        return {key: value for key, value in fit if value == value and value != getattr(numbers, key)}


def _scaled(
    key: str, question: str, factor: float, *, joints: str = "rotary and slides", rarity: float = 0.0
) -> Mistake:
    """A number in another unit, `factor` of the record's; of all joints, of "rotary" ones or of "slides" only."""
    return Mistake(
        key,
        question,
        lambda d: {key: getattr(d, key) * factor} if ("slides" if d.slides else "rotary") in joints else {},
        rarity=rarity,
    )


def _of_basis(basis: Basis) -> Iterator[Mistake]:
    """Line or phase, peak or rms: constants of another basis than the record says, or of two bases."""
    to = DC_EQUIVALENT[basis]
    rms = to.torque_constant < 1  # its currents
    other = sqrt(2) if rms else 1 / sqrt(2)  # a torque constant per A peak as one per A rms, or the other way round
    yield Mistake("ke", f"line or phase, peak or rms: constants of {basis}?", lambda d: {"basis": basis}, closely=True)
    peak_or_rms = f"a torque constant per A {'peak' if rms else 'rms'}"
    yield Mistake(
        "ke",
        f"peak or rms: {peak_or_rms}?"
        if basis == "dc"
        else f"line or phase, peak or rms: {basis} beside {peak_or_rms}?",
        lambda d: {"kt": d.kt * other, "current": d.current / other, "basis": basis},
        closely=True,
    )
    if basis != "dc":
        for per, factor in (("peak", 1.0), ("rms", sqrt(2))):
            yield Mistake(
                *("kt", f"line or phase, peak or rms: a back-EMF constant of {basis}, the current in A {per}?"),
                lambda d, factor=factor: {"kt": d.kt * to.back_emf_constant * factor} if isnan(d.ke) else {},
                closely=True,
            )
    else:
        yield Mistake("current", "peak or rms: A rms?", lambda d: {"current": d.current * sqrt(2)}, closely=True)


MISTAKES = (
    _scaled("kt", "mN m/A?", 1e-3),
    Mistake("kt", "at the gear's output?", lambda d: {"kt": d.kt / d.turns}),
    Mistake("kt", "rpm/V?", lambda d: {"kt": 1 / (RPM * d.kt)}, rarity=RARE),
    _scaled("ke", "mV s/rad?", 1e-3),
    _scaled("ke", "V/rpm?", 1 / RPM),
    _scaled("ke", "V per 1000 rpm?", 1e-3 / RPM),
    Mistake("ke", "rpm/V?", lambda d: {"ke": 1 / (RPM * d.ke)}, rarity=RARE),
    Mistake("ke", "at the gear's output?", lambda d: {"ke": d.ke / d.turns}),
    _scaled("rotor", "g cm²?", 1e-7),
    Mistake("rotor", "n² J, referred to the joint?", lambda d: {"rotor": d.rotor / d.n**2}),
    _scaled("rotor", "kg cm²?", 1e-4, rarity=RARE),
    _scaled("r", "mΩ?", 1e-3),
    _scaled("inductance", "mH?", 1e-3),
    _scaled("current", "mA?", 1e-3),
    _scaled("effort", "N mm?", 1e-3, joints="rotary"),
    _scaled("effort", "N cm?", 1e-2, joints="rotary"),
    Mistake("effort", "of the motor, before the gear?", lambda d: {"effort": d.effort * d.turns}),
    _scaled("speed", "rpm?", RPM, joints="rotary"),
    _scaled("speed", "degrees/s?", pi / 180, joints="rotary"),
    _scaled("speed", "mm/s?", 1e-3, joints="slides"),
    Mistake("speed", "of the motor, before the gear?", lambda d: {"speed": d.speed / d.turns}),
    Mistake("speed", "of the motor, in rpm?", lambda d: {"speed": RPM * d.speed / d.turns}),
    Mistake("n", "joint per motor?", lambda d: {} if d.slides or d.turns >= 1 else {"n": 1 / d.n}, rarity=RARE),
    _scaled("n", "rad/mm?", 1e3, joints="slides"),
    *(_scaled(f"{body}_c", "kJ/K?", 1e3) for body in ("winding", "housing")),
    *(_scaled(f"{body}_c", "mJ/K?", 1e-3) for body in ("winding", "housing")),
    *(_scaled(f"{body}_r", "K/kW?", 1e-3) for body in ("winding", "housing")),
    *(_scaled(f"{body}_r", "K/mW?", 1e3) for body in ("winding", "housing")),
    Mistake("ambient", "kelvin?", lambda d: {"ambient": d.ambient - 273.15}),
    Mistake("reference", "kelvin?", lambda d: {"reference": d.reference - 273.15}),
    _scaled("copper", "% per kelvin?", 1e-2),
    _scaled("magnet", "% per kelvin?", 1e-2),
    *(mistake for basis in get_args(Basis) for mistake in _of_basis(basis)),
)


def contradictions(robot: RobotDescription) -> list[Problem]:
    """Warnings about numbers of a drive that contradict each other, with the mistake that explains it and the value that fits."""
    findings, links = Findings(), {}
    with np.errstate(all="ignore"):
        for joint in robot.moving_joints:
            if joint.motor is None:
                continue
            slides = joint.kind.units.linear
            links[slides] = links.get(slides) or _of_links(robot, slides) or nan
            for problem in _of_drive(_numbers_of(joint, joint.motor.basis, links[slides])):
                findings.add("joint", joint.name, problem)
    return findings.problems()


def _numbers_of(joint: MovingJoint, basis: Basis, links: float) -> DriveNumbers:
    slides = joint.kind.units.linear
    found: dict[str, float] = {"links": links}
    for field, path in (KEYS | ON_A_SLIDE if slides else KEYS).items():
        entry: Any = joint
        for key in path.split("."):
            entry = getattr(entry, key, None)
        if field != "basis" and entry is not None:
            found[field] = np.float64(float(entry))  # whose quotients overflow silently
    return DriveNumbers(**found | {"rotor": found["rotor"] or nan}, basis=basis, slides=slides)


def _of_links(robot: RobotDescription, slides: bool) -> float:
    """The mass of all links [kg]; for joints that turn, the sum of their largest moments about their frames [kg m²]."""
    total = 0.0
    for link in robot.links:
        if link.mass_kg is not None:
            mass, tensor = float(link.mass_kg), link.inertia_kg_m2.matrix()
            total += mass if slides else np.linalg.eigvalsh(tensor)[-1] + mass * np.dot(link.com_m, link.com_m)
    return float(total)


def _of_drive(numbers: DriveNumbers) -> Iterator[Problem]:
    """Problems of one drive. A single mistake that explains all is preferred, then two, then what explains most."""
    while failing := [row for row in COMPARISONS if row.fails(numbers)]:
        singles = _explanations(numbers, [(mistake,) for mistake in MISTAKES])
        best = singles[0] if singles else None
        if (best is None or len(best.fixed) < len(failing)) and (len(failing) > 1 or not failing[0].is_equal):
            units = [mistake for mistake in MISTAKES if not mistake.closely and mistake.changes(numbers)]
            pairs = [pair for pair in combinations(units, 2) if pair[0].key != pair[1].key]
            both = [pair for pair in _explanations(numbers, pairs) if len(pair.fixed) == len(failing)]
            best, singles = (both[0], []) if both else (best, singles)
        if best is None:
            yield from (row.plain(numbers) for row in failing)
            return
        most = best.distance + ALTERNATIVES
        others = [each for each in singles[1:] if len(each.fixed) == len(best.fixed) and each.distance <= most]
        for mistake in best.mistakes:
            yield _question(numbers, mistake, best, [each.mistakes[0] for each in others[: MOST_NAMED - 1]])
        numbers = best.numbers


@dataclass(frozen=True)
class _Explanation:
    """Mistakes that were undone, the numbers without them, the comparisons that are then sound, and how typical those are."""

    mistakes: tuple[Mistake, ...]
    numbers: DriveNumbers
    fixed: list[DriveComparison]
    distance: float


def _explanations(numbers: DriveNumbers, candidates: list[tuple[Mistake, ...]]) -> list[_Explanation]:
    """The candidates that mend a comparison and spoil none: those that mend most first, then the most typical."""
    found = []
    for mistakes in candidates:
        after = numbers
        for mistake in mistakes:
            after = replace(after, **mistake.changes(after))
        if after == numbers:
            continue
        fixed = [row for row in COMPARISONS if row.fails(numbers) and not row.fails(after)]
        spoilt = [row for row in COMPARISONS if row.fails(after) and not row.fails(numbers)]
        loose = [row for row in fixed if not (row.is_equal and abs(row.ratio(after) - 1) <= CLOSE)]
        low = any(row.is_equal and row.ratio(after) < DERATED for row in fixed)
        if fixed and not spoilt and not low and not (loose and any(mistake.closely for mistake in mistakes)):
            distance = sum(row.distance(after) for row in COMPARISONS) + sum(mistake.rarity for mistake in mistakes)
            found.append(_Explanation(mistakes, after, fixed, round(distance, 6)))
    return sorted(found, key=lambda each: (-len(each.fixed), each.distance))


def _question(numbers: DriveNumbers, mistake: Mistake, found: _Explanation, others: list[Mistake]) -> Problem:
    """The mistake as a question, with the comparisons that are sound without it, or else the mistake that it goes with."""
    after = replace(numbers, **mistake.changes(numbers))
    keys = KEYS | ON_A_SLIDE if numbers.slides else KEYS
    reasons = [row.sentence(numbers) for row in found.fixed if row.ratio(after) != row.ratio(numbers)]
    reasons = reasons or [
        f"only together with {keys[each.key]}: {each.question}" for each in found.mistakes if each is not mistake
    ]
    why = "; ".join(reasons[:2])
    what = f"{mistake.question} {why[0].upper()}{why[1:]}"
    for other in others:
        what += f"; or {keys[other.key]}: {other.question} {_fit(numbers, other)} would fit"
    return Problem(what, keys[mistake.key], float(getattr(numbers, mistake.key)), _fit(numbers, mistake))


def _fit(numbers: DriveNumbers, mistake: Mistake) -> str:
    """The values that would fit: of the mistake's own key alone, or with the names of the keys."""
    changes, keys = mistake.changes(numbers), KEYS | ON_A_SLIDE if numbers.slides else KEYS
    texts = {key: f'"{value}"' if isinstance(value, str) else f"{value:.6g}" for key, value in changes.items()}
    if list(texts) == [mistake.key]:
        return texts[mistake.key]
    return " and ".join(f"{keys[key].rpartition('.')[2]} = {text}" for key, text in texts.items())

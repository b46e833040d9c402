"""Mistakes of a record or a log that an arm's masses make up for, and what is said about them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import stats

FALSE_ALARMS = 0.01  # share of clean logs
LOAD, SPRING, GEAR, ZERO, LATE = "load", "spring", "gear", "position zero", "lateness"
ELASTIC = ("elasticity", "elasticity of links")  # by the side of the logged positions
# of a joint's squared residuals: one that explains more is missing
MOST = {"load": 0.0, "spring": 0.75, "gear": 0.5, **dict.fromkeys(ELASTIC, 0.5)}
HALF_TURN = np.pi  # [rad]: no zero is farther off
BESIDE = 0.7  # of the largest |z|: mistakes with less follow from that one


@dataclass(frozen=True)
class Mistake:
    """A kind of mistake: in words with its size, the least size that counts, and its unit."""

    words: str
    least: float


REMEDY = "the fit takes it for rigid; state `elasticity` in its record, and fit slower motion"
MISTAKES = {
    "torque scale": Mistake(
        "its torques are {size:+.0%} off in scale: is the torque constant, or the unit, right?", 0.05
    ),
    "lateness": Mistake("its torques come {size:.3g} s after its motion", 2e-3),
    "friction": Mistake("its friction changes by {size:+.0%} over the log", 0.1),
    "position zero": Mistake("the zero of its position is {size:+.3g} {unit} off", 0.02),
    "position scale": Mistake("its positions are {size:+.1%} off in scale: are counts and gear ratio right?", 0.02),
    "spring": Mistake(
        "its torques change with its position by {size:+.0%} of their spread, as with a spring that the record lacks or "
        "has otherwise, and masses make up for it: --springs fits one",
        0.02,
    ),
    "load": Mistake("what loads add to its friction is {size:+.0%} off the record's, and masses make up for it", 0.005),
    "gear": Mistake(
        "its friction grows by {size:.1%} of the torque that its links take, as of a gear with loss that the record lacks, and "
        "Coulomb friction makes up for it: --fit-efficiency fits one",
        0.005,
    ),
    ELASTIC[0]: Mistake(
        "its gear gives way by {size:.2g} {unit} under the torque of its links, as its motor's positions show, and masses make "
        "up for it: " + REMEDY,
        0.0,
    ),
    ELASTIC[1]: Mistake(
        "its torque is that of a rotor behind a gear that gives way (inertia by stiffness: {size:.2g} {unit}), as its links' "
        "positions show, and masses make up for it: " + REMEDY,
        0.0,
    ),
}
KINDS = [each for each in MISTAKES if each not in ELASTIC]


@dataclass(frozen=True)
class Score:
    """A mistake of a joint: size a, its deviation, and a by it; infinite deviation: the log says nothing about it.

    Attributes:
        unit: of the joint's position; of elasticity that of the size.
        explains: share of the joint's squared residuals that goes with the mistake.
    """

    joint: str
    unit: str
    mistake: str
    size: float
    std: float
    z: float
    explains: float


def limit_of(count: int) -> float:
    """Deviations that the largest of so many scores leaves in one of a hundred clean logs."""
    return float(stats.norm.isf(FALSE_ALARMS / max(2 * count, 1)))


def _seen(scores: list[Score]) -> list[Score]:
    """Mistakes that are there, on one in a hundred clean logs."""
    limit = limit_of(len(scores))
    return [
        each
        for each in scores
        if each.mistake in ELASTIC
        or (
            abs(each.z) > limit
            and abs(each.size) > MISTAKES[each.mistake].least
            # no spring pushes from its rest, no gear gives power
            and (each.mistake not in (SPRING, GEAR) or each.size > 0.0)
            and not (each.mistake == ZERO and each.unit == "rad" and abs(each.size) > HALF_TURN)
        )
    ]


def gives_way(scores: list[Score]) -> bool:
    """True if the log shows gears that give way, which seem to shift torques in time."""
    return any(each.mistake in ELASTIC for each in scores)


def made_up_for(scores: list[Score]) -> list[str]:
    """Sentences about mistakes of the record that masses make up for.

    Friction that grows otherwise with the load than the record says, whose numbers the fit takes; a spring or a gear's loss with
    which most of a joint's residual would be gone.
    """
    return [_words(each) for each in _seen(scores) if _is_made_up_for(each)]


def _is_made_up_for(score: Score) -> bool:
    return score.explains > MOST.get(score.mistake, np.inf)


def _words(score: Score) -> str:
    words = MISTAKES[score.mistake].words.format(size=score.size, unit=score.unit)
    return f"{score.joint}: {words} ({abs(score.z):.0f} deviations)"


def suspicions(scores: list[Score], all_late: bool = False) -> Iterator[str]:
    """Sentences about mistakes that are there, but for those of `made_up_for`.

    Args:
        scores: of all joints.   all_late: the lateness of all joints together is said already.
    """
    seen = [each for each in _seen(scores) if not _is_made_up_for(each)]
    first = max(seen, key=lambda each: abs(each.z) * (each.mistake not in ELASTIC), default=None)
    for each in seen:
        assert first is not None
        follows = (
            abs(each.z) < BESIDE * abs(first.z)
            and not each.mistake == first.mistake == GEAR  # each gear has its own loss
            and each.mistake not in ELASTIC
        )
        if not follows and not (all_late and each.mistake == "lateness"):
            yield _words(each)

"""Options of `identify_arm`: the rows of a log that are fitted, and the terms of the torque model."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from armwright.entry import expect_names
from armwright.errors import IdentificationError


@dataclass(frozen=True)
class FitRows:
    """Rows of a log that are fitted.

    Attributes:
        runs: names; None: those that the log marks so.   cutoff: of the low-pass, in Hz; None: chosen.
        decimate: every how many rows to keep; None: chosen.
    """

    runs: Sequence[str] | None = None
    cutoff: float | None = None
    decimate: int | None = None

    def __post_init__(self) -> None:
        expect_names(self.runs, "runs", IdentificationError)


@dataclass(frozen=True)
class ArmTerms:
    """Terms of an arm's torque model beside links, rotors and friction, and those that its measured torques lack.

    Attributes:
        springs: names of joints whose spring and counterbalance stay if they lower the held-out error by 1 % or more.
        stribeck_speed: of the friction term "stribeck", at the joint [rad/s | m/s].
        lacks: terms that the measured torque is without, such as "gravity"; None: what the log's file says.
        fit_efficiency: names of joints whose gear efficiency is one more parameter, or "all"; others have the record's.
    """

    springs: Collection[str] = ()
    stribeck_speed: float | None = None
    lacks: Collection[str] | None = None
    fit_efficiency: Collection[str] | Literal["all"] = ()

    def __post_init__(self) -> None:
        lossy = None if self.fit_efficiency == "all" else self.fit_efficiency
        for place, names in (("springs", self.springs), ("lacks", self.lacks), ("fit_efficiency", lossy)):
            expect_names(names, place, IdentificationError)

"""Limits of validation, `limits.toml`: requirements on a record, for all joints or for one."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import Field

from armwright.description.toml_file import toml_tables
from armwright.errors import LogError
from armwright.fitting.measures import Agreement
from armwright.identification.validation.prediction import Quantity
from armwright.model import Model
from armwright.quantity import Record
from armwright.validation import validated

Share = Annotated[float, Field(le=1)]
Percent = Annotated[float, Field(le=100)]
Above0 = Annotated[float, Field(gt=0)]
UNIT_KEYS = {"n_m": "N m", "n": "N", "rad": "rad", "m": "m", "rad_per_s": "rad/s", "m_per_s": "m/s"}


class SignalLimits(Record):
    """Limits of the measures of one quantity."""

    r2_at_least: Share | None = Field(default=None, description="R², at most 1.")
    fit_at_least: Percent | None = Field(default=None, description="Fit in per cent.")
    vaf_at_least: Percent | None = Field(default=None, description="VAF in per cent, which forgives an offset.")
    nrmse_at_most: Above0 | None = Field(default=None, description="NRMSE, 1 − fit / 100.")


class TorqueLimits(SignalLimits):
    """Limits of the torque prediction."""

    rms_at_most_n_m: Above0 | None = Field(default=None, description="RMS of the residual of revolute joints.")
    rms_at_most_n: Above0 | None = Field(default=None, description="RMS of the residual of prismatic joints.")


class PositionLimits(SignalLimits):
    """Limits of simulated positions."""

    rms_at_most_rad: Above0 | None = Field(default=None, description="RMS of the error of revolute joints.")
    rms_at_most_m: Above0 | None = Field(default=None, description="RMS of the error of prismatic joints.")


class SpeedLimits(SignalLimits):
    """Limits of simulated speeds."""

    rms_at_most_rad_per_s: Above0 | None = Field(default=None, description="RMS of the error of revolute joints.")
    rms_at_most_m_per_s: Above0 | None = Field(default=None, description="RMS of the error of prismatic joints.")


class JointLimits(Record):
    """Limits of one joint; absent ones are those of all joints."""

    torque: TorqueLimits = TorqueLimits()
    position: PositionLimits = PositionLimits()
    speed: SpeedLimits = SpeedLimits()


class Limits(JointLimits):
    """Limits of all joints, and of single ones."""

    joints: dict[str, JointLimits] = Field(default_factory=dict, description="By joint, instead of those of all.")

    def of(self, joint: str, quantity: Quantity, unit: str) -> dict[str, float]:
        """Limits of a quantity of a joint by key: its own, then those of all joints; those of other units are left out."""
        both = [getattr(self, quantity)]
        if joint in self.joints:
            both.append(getattr(self.joints[joint], quantity))
        found = {key: value for each in both for key, value in each.model_dump(exclude_none=True).items()}
        return {key: value for key, value in found.items() if _unit_of(key) in (None, unit)}

    def limited(self, quantity: Quantity) -> bool:
        """True if any joint has a limit of the quantity."""
        return any(getattr(each, quantity).model_dump(exclude_none=True) for each in (self, *self.joints.values()))


DEFAULT = Limits(
    torque=TorqueLimits(r2_at_least=0.9), position=PositionLimits(fit_at_least=70), speed=SpeedLimits(fit_at_least=70)
)  # of a usable model: a tenth of the torque's power unexplained, three tenths of the motion's amplitude


@dataclass(frozen=True)
class Check:
    """One limit compared with the measured value.

    Attributes:
        joint, quantity.   key: of the limit.   limit, value: in the measure's unit.   passed: whether the value keeps it.
    """

    joint: str
    quantity: Quantity
    key: str
    limit: float
    value: float
    passed: bool

    def __str__(self) -> str:
        sign = "≥" if "_at_least" in self.key else "≤"
        name = {"r2": "R²", "fit": "fit", "vaf": "VAF", "nrmse": "NRMSE", "rms": "RMS"}[self.key.partition("_")[0]]
        return f"{name} = {self.value:.4g}, {'' if self.passed else 'not '}{sign} {self.limit:g}"


def read_limits(limits: Any) -> Limits:
    """Limits from a file, a mapping with the same tables, or as they are.

    Args:
        limits: path of a TOML file, a mapping, or `Limits`.
    Raises:
        LogError: no such file, no limit in it, an unknown key, a limit that no value keeps; one line.
    """
    if isinstance(limits, Limits):
        return limits
    if isinstance(limits, Mapping):
        return validated(Limits, limits, place="limits", error=LogError)
    if not isinstance(limits, (str, os.PathLike)):
        raise LogError(place="limits", value=limits, expected="the path of a TOML file, or tables")
    with toml_tables(Path(limits), LogError) as tables:
        found = validated(Limits, tables, file=limits, error=LogError)
    if not any(found.limited(quantity) for quantity in get_args(Quantity)):
        raise LogError("the file has no limit", expected="one at least, such as torque.r2_at_least", file=limits)
    return found


def check_limits(limits: Limits, arm: Model, file: Any = "") -> None:
    """Refuses limits of joints that the arm does not have, or in units of the other kind of joint.

    Raises:
        LogError: names joint and key.
    """
    kinds = {body.joint: body.kind for body in arm.coordinates}
    for joint, table in limits.joints.items():
        if joint not in kinds:
            raise LogError("no joint of the arm", place="limits.joints", value=joint, choices=arm.names, file=file)
        for quantity in get_args(Quantity):
            unit = getattr(kinds[joint].units, quantity)
            for key in getattr(table, quantity).model_dump(exclude_none=True):
                if _unit_of(key) not in (None, unit):
                    expected = f"{unit}, as the joint is {kinds[joint].name}"
                    raise LogError(place=f"limits.joints.{joint}.{quantity}.{key}", expected=expected, file=file)


def checks_of(
    limits: dict[str, float], joint: str, quantity: Quantity, found: Agreement, diverged: bool
) -> list[Check]:
    """Every limit of a quantity of a joint against its measures; all fail for a simulation that diverged."""
    checks = []
    for key, limit in limits.items():
        name = key.partition("_at_")[0]
        value = float("nan") if diverged else float(getattr(found, name))
        passed = value >= limit if "_at_least" in key else value <= limit
        checks.append(Check(joint, quantity, key, limit, value, passed))
    return checks


def _unit_of(key: str) -> str | None:
    """The unit that a key ends in; None of a key without."""
    return UNIT_KEYS.get(key.partition("_at_most_")[2])

"""Friction that rises as a logistic function of speed, as identified of the Panda. [Gaz2019]"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armwright import scalar
from armwright.friction_laws.law import FrictionLaw, Loads, OwnKey
from armwright.scalar import Scalar

MOST = 80.0  # of the exponent: e⁻⁸⁰ is nothing beside 1, and a larger e^x overflows, first in single precision: a slope of NaN


class Sigmoid(FrictionLaw):
    """A logistic function of speed, 0 at standstill."""

    name = "sigmoid"
    equation = """
    `law = "sigmoid"`:  f = a / (1 + exp(-b (q̇ + c))) - a / (1 + exp(-b c)) + viscous q̇ + offset. [Gaz2019]"""
    own = (
        OwnKey(
            "sigmoid_amplitude", "torque", "a of the sigmoid law.", "NotNegative", True, lambda level, _: 2 * level, 0.0
        ),
        OwnKey(
            "sigmoid_slope", "slope", "b of the sigmoid law.", "Positive", False, lambda _, fastest: 10 / fastest, 1e-6
        ),
        OwnKey("sigmoid_shift", "speed", "c of the sigmoid law.", start=lambda level, fastest: 0.0),
    )
    dry = "none"
    feature = "sigmoid friction"
    lost = "friction by the law 'sigmoid' (its viscous part is written)"
    step_limits = (("the sigmoid friction", 1, 0),)

    def add(
        self, torque: Scalar, friction: Any, speed: Scalar, load: Loads | Scalar | None, warming: Scalar | None
    ) -> Scalar:
        """torque + a/(1 + exp(-b (q̇ + c))) - a/(1 + exp(-b c)).  [Gaz2019]"""
        a, b, c = friction.parameters
        exponent = scalar.minimum(-b * (speed + c), MOST)
        return torque + a / (1.0 + scalar.exp(exponent)) - a / (1.0 + scalar.exp(-b * c))

    def steep(self, friction: Any) -> tuple[Scalar, Scalar]:
        """About -c, over 1/b."""
        return -friction.parameters[2], 1 / friction.parameters[1]

    def holding(self, friction: Any) -> tuple[Scalar, Scalar]:
        """-a/(1 + exp(-b c)) and a - a/(1 + exp(-b c)), the law's values far from standstill: it stands for dry friction."""
        a, b, c = friction.parameters
        low = -a / (1.0 + scalar.exp(-b * c))
        return low, low + a

    def fitted(self, values: Mapping[str, float], speed: np.ndarray) -> np.ndarray:
        """a (σ(b (q̇ + c)) - σ(b c)),  σ the logistic function by tanh, which no speed takes out of range."""
        a, b, c = (values[key.stem] for key in self.own)
        return a * (_logistic(b * (speed + c)) - _logistic(np.array(b * c)))


def _logistic(x: np.ndarray) -> np.ndarray:
    return 0.5 * (1 + np.tanh(0.5 * x))

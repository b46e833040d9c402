"""Signals centred and scaled for a fit, and models of them in units again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from armwright.identification.linear.prediction_error import Orders, Polynomials
from armwright.identification.linear.records import RecordedStretch, Records
from armwright.identification.linear.state_space import StateSpace


class SignalUnits:
    """Mean and size of every signal, and the way back to units."""

    def __init__(self, records: Records, inputs_centred: bool, outputs_centred: bool):
        u, y = (np.concatenate([getattr(each, name) for each in records.fit]) for name in ("u", "y"))
        self.u0, self.y0 = inputs_centred * u.mean(axis=0), outputs_centred * y.mean(axis=0)
        self.us, self.ys = u.std(axis=0), y.std(axis=0)

    def scaled(self, each: RecordedStretch) -> RecordedStretch:
        """Rows of size 1, and of mean 0 where they are centred."""
        return RecordedStretch(each.run, (each.u - self.u0) / self.us, (each.y - self.y0) / self.ys)

    def polynomials(self, model: Polynomials) -> Polynomials:
        """Polynomials of signals in units."""
        b = model.b * self.ys[0] / self.us[0]
        constant = model.a.sum() * self.y0[0] - b.sum() * self.u0[0] + self.ys[0] * model.constant
        return replace(model, b=b, constant=float(constant))

    def jacobian(self, orders: Orders) -> np.ndarray:
        """(k, k) derivative of the parameters in units by the scaled ones."""
        ratio = self.ys[0] / self.us[0]
        matrix = block_diag(
            np.eye(orders.na), ratio * np.eye(orders.nb), np.eye(orders.nc), *([self.ys[:1, None]] * orders.constant)
        )
        if orders.constant:
            matrix[-1, : orders.na] = self.y0[0]
            matrix[-1, orders.na : orders.na + orders.nb] = -self.u0[0] * ratio
        return np.asarray(matrix)

    def state_space(self, model: StateSpace) -> StateSpace:
        """The model of signals in units, of inputs that were not centred: at their mean an integrator is never at rest."""
        b, c = model.b / self.us, model.c * self.ys[:, None]
        d = model.d * self.ys[:, None] / self.us
        return replace(model, b=b, c=c, d=d, offset=self.y0 + self.ys * model.offset)


def scale(records: Records, *, inputs_centred: bool, outputs_centred: bool) -> tuple[Records, SignalUnits]:
    """Records scaled and centred, and the way back."""
    units = SignalUnits(records, inputs_centred, outputs_centred)
    return records.changed(units.scaled), units

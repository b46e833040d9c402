"""Stand-in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armwright import scalar
from armwright.actuators import limited_drive, told_command
from armwright.dynamics import forward_dynamics
from armwright.model import Model


@dataclass(frozen=True, eq=False)
class Plant:
    """x = (q, qd)."""

    model: Model
    stiff = False

    @classmethod
    def of(cls, model):
        """Of."""
        return cls(model)

    @property
    def size(self):
        """Size."""
        return 2 * self.model.n

    def part(self, x, name):
        """Part."""
        n = self.model.n
        return {"q": x[..., :n], "qd": x[..., n:]}[name]

    def initial(self, q, qd):
        """Initial."""
        return np.concatenate([q, qd], axis=-1)

    def derivative(self, x, u):
        """Derivative."""
        q, qd = self.part(x, "q"), self.part(x, "qd")
        qdd = forward_dynamics(self.model, q, qd, limited_drive(self.model, qd, u).tau)
        return scalar.array(np.concatenate([qd, qdd]))

    def outputs(self, x, u):
        """Outputs."""
        q, qd = self.part(x, "q"), self.part(x, "qd")
        drive = limited_drive(self.model, qd, u)
        qdd = forward_dynamics(self.model, q, qd, drive.tau)
        return {"qdd": qdd, "tau": drive.tau, "voltage": drive.voltage, "current": drive.current}

    def measured(self, x, u, side):
        """Measured."""
        qd = self.part(x, "qd")
        return self.part(x, "q"), qd, limited_drive(self.model, qd, u).current

    def applied(self, x, u):
        """Applied."""
        return told_command(self.model, limited_drive(self.model, self.part(x, "qd"), u))

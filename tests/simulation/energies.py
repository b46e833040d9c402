"""Plants with the energies that go each way as four more states, moved by the same stages in the compiled loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.kernels.loop import NativeLoop
from armwright.kernels.stages import Integrate
from armwright.kernels.target import select_target
from armwright.model import Model
from armwright.program import trace
from armwright.signals import Layout
from armwright.simulation.integrate.exponential import Split
from armwright.simulation.integrate.integrators import INTEGRATORS
from armwright.simulation.integrate.step_control import Allowed
from armwright.simulation.integrate.stepping import Adaptivity, adaptive_stage, dormand_prince_trial, speed_pairs
from armwright.simulation.plant.inputs import PlantInputs
from armwright.simulation.plant.plant import Plant
from armwright.simulation.plant.switching import Watched, switching_programs

WAYS = ("electrical", "heat", "friction", "mechanical")


class Balance:
    """The power balance of an arm under constant commands.

    Args:
        arm: the model.   rule: a name of `INTEGRATORS`, or rk45 with that `tolerance`.
        landing: whether steps end where contacts switch; False to see that it matters.
    """

    def __init__(self, arm: Model, rule: str = "rk3", *, tolerance: float | None = None, landing: bool = True):
        self.plant = plant = Plant.of(arm)
        size, n = plant.size, arm.n
        shapes = {"x": (size + len(WAYS),), "u": (n,)}

        def slopes(y: Any, u: Any, touching: Any = None) -> tuple[Any, Any]:
            inputs = PlantInputs(u, contacts=touching)
            rates = plant.energy_rates(y[:size], inputs)
            xd, fast = plant.split(y[:size], inputs)
            return scalar.array([*xd, *(rates[way] for way in WAYS)]), fast

        contacts = sum(plant.contacts)
        watched = Watched(
            lambda y, u: plant.contact_depths(y[:size]),
            lambda y, u, touching: plant.switching_functions(y[:size], PlantInputs(u, contacts=touching)),
            contacts,
        )
        held = watched.block if contacts else {}

        def step(y: Any, u: Any, *rest: Any) -> Any:
            *touching, h = rest
            chosen = INTEGRATORS[rule].paired(speed_pairs(plant.layout))
            if not plant.stiff:
                return chosen.step(lambda y, u: slopes(y, u, *touching)[0], y, u, h)
            touched = touching[0] if touching else None
            fast = lambda y, u: plant.fast(y[:size], PlantInputs(u, contacts=touched))  # noqa: E731
            moved = chosen.exponential(Split(lambda y, u: slopes(y, u, *touching), fast, plant.stiff), y, u, h)
            return scalar.array([*plant.settled(moved[:size]), *moved[size:]])

        if tolerance is not None:
            adaptivity, switching = (
                Adaptivity(Allowed(tolerance, 0.1 * tolerance), 10**5),
                watched if contacts else None,
            )
            derivative = lambda *given: slopes(*given)[0]  # noqa: E731
            trial = dormand_prince_trial(derivative, {**shapes, **held})
            stage = adaptive_stage(trial, shapes, adaptivity, Layout(), watched=switching)
        elif landing:
            landing_programs = switching_programs(watched if contacts else None, shapes)
            stage = Integrate(trace("step", step, {**shapes, **held, "h": ()}, ("x_next",)), **landing_programs)
        else:
            stage = Integrate(trace("step", lambda y, u, h: step(y, u, h), {**shapes, "h": ()}, ("x_next",)))
        self.loop = NativeLoop((stage,), select_target())

    def moved(self, begun: np.ndarray, u: np.ndarray, h: float, ticks: int = 1) -> tuple[np.ndarray, dict[str, float]]:
        """The last state, and the energies [J] that went each way, from a state under commands (rows, n), each so many ticks."""
        lanes, size = self.loop.lanes(1), self.plant.size
        lanes.set("x", np.concatenate([begun, np.zeros(len(WAYS))]))
        for row in u:
            lanes.set("u", row)
            self.loop.run(lanes, h, (0, ticks))
        assert lanes.get("frozen")[0, 0] < 0.0
        y = lanes.get("x")[0]
        return y[:size], dict(zip(WAYS, y[size:], strict=True))

    def lack(self, q: Any, qd: Any, u: Any, h: float, duration: float) -> float:
        """The energy that the balance lacks, as a share of the largest that went any way."""
        begun = self.plant.initial(q, qd)
        return self.lacking(begun, *self.moved(begun, np.array([u], dtype=float), h, round(duration / h)))

    def lacking(self, begun: np.ndarray, last: np.ndarray, went: dict[str, float]) -> float:
        """The same, from the states at both ends and what went each way."""
        stored = float(self.plant.stored_energy(last)) - float(self.plant.stored_energy(begun))
        lack = went["electrical"] - went["heat"] - went["friction"] - went["mechanical"] - stored
        return abs(lack) / max(abs(value) for value in went.values())

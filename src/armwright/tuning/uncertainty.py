"""Uncertainty for tuning: masses, friction, any parameters, payloads, poses and delays, drawn for each lane."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from armwright import scalar
from armwright.description.paths import split_path
from armwright.errors import ScenarioError, check_known
from armwright.model import Model
from armwright.model.payload import Payload
from armwright.parameters import Batch, Draw, numbers_by_lane, uniform_numbers
from armwright.scalar import Array, Scalar
from armwright.simulation.loop.references import reference_rows
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Start
from armwright.trajectory.motion import Motion

USUAL = {"mass": 0.3, "friction": 2.0, "record": True}  # of a scenario that is a single run
TIMES = {"payload": "payload_kg", "jitter": "jitter_s", "delay": "delay_s"}  # keys of files by field


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Differences between the lanes; absent fields do not vary.

    Attributes:
        mass: share of each link's mass, either way, evenly.   friction: factor either way of each joint's friction, all of its
            torques together, evenly in its logarithm.   record: whether numbers with a standard deviation are drawn by it.
        poses: [rad | m] by which start and reference are moved together either way, evenly, within the position limits.
        payload: (least, most) [kg] of a point mass at the tip.   jitter: [s] the most that any command is late, of all lanes.
        delay: [s] the most that a lane's commands are late beyond the loop's.   vary: draws of the record's numbers by name.
    """

    mass: float | None = None
    friction: float | None = None
    record: bool = False
    poses: float | None = None
    payload: tuple[float, float] | None = None
    jitter: float | None = None
    delay: float | None = None
    vary: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, draws: Any) -> Uncertainty:
        """The uncertainty in a mapping: these fields by their names in Python or in files, and parameters by path.

        Raises:
            ScenarioError: an unknown key, or a value that is none.
        """
        if not isinstance(draws, Mapping):
            expected = "values by name, such as {'mass': 0.3, 'link6.mass_kg': aw.Draw()}"
            raise ScenarioError(place="draws", value=draws, expected=expected)
        known, keys = [each.name for each in fields(cls)], {key: name for name, key in TIMES.items()}
        own: dict[str, Any] = {
            keys.get(str(name), str(name)): value for name, value in draws.items() if "." not in str(name)
        }
        for name in own:
            check_known(ScenarioError, name, known, "unknown", place="draws")
        vary = {**own.pop("vary", {}), **{name: value for name, value in draws.items() if "." in str(name)}}
        found = cls(**own, vary=vary)
        for name, (low, high) in {"mass": (0.0, 1.0), "friction": (1.0, np.inf)}.items():
            found._check(name, low, high)
        for name in ("poses", "jitter", "delay"):
            found._check(name, 0.0, np.inf)
        ends = found.payload
        if ends is not None and (np.shape(ends) != (2,) or not 0.0 <= ends[0] < ends[1] < np.inf):
            raise ScenarioError(place="draws.payload_kg", value=ends, expected="the least and the most [kg]")
        return found

    def _check(self, name: str, low: float, high: float) -> None:
        value, number = getattr(self, name), scalar.real_number(getattr(self, name))
        if value is not None and (number is None or not low < number < high):
            between = f"a number above {low:g}" + f" and below {high:g}" * bool(np.isfinite(high))
            raise ScenarioError(place=f"draws.{TIMES.get(name, name)}", value=value, expected=between)

    def applied(self, scenario: Scenario, lanes: int, seed: int) -> Scenario:
        """The scenario with this uncertainty as batches, beside its own batches.

        Args:
            scenario: resolved, of one lane or as many.   lanes: how many.   seed: of the draws.
        Raises:
            ScenarioError: what cannot be drawn, names what and why.
        """

        def even(name: str, count: int = 1) -> np.ndarray:
            return uniform_numbers(seed, f"tuning.{name}", range(lanes), count)

        vary: dict[str, Any] = self.of_record(scenario.arm, lanes, seed) | dict(self.vary)
        changed = replace(
            scenario,
            vary={**{name: value for name, value in vary.items() if name not in scenario.vary}, **scenario.vary},
            lanes=lanes,
            seed=scenario.seed,
        ).resolved
        if self.payload is not None:
            if scenario.inputs.payload is not None:
                what, expected = "the scenario has payloads of its own", "their draws in [lanes.vary]"
                raise ScenarioError(what, place="draws.payload_kg", expected=expected)
            low, high = self.payload
            body = Payload(0.0, Batch(low + (high - low) * even("payload")[:, 0]), np.zeros(3), np.zeros(3))
            changed = replace(changed, inputs=replace(changed.inputs, payload=body))
        loop = changed.loop
        assert loop is not None
        timing = loop.timing
        if self.jitter is not None:
            timing = replace(timing, jitter=self.jitter)
        if self.delay is not None:
            own = numbers_by_lane(timing.command_delay)
            timing = replace(timing, command_delay=Batch(own + self.delay * even("delay")[:, 0]))
        changed = replace(changed, loop=replace(loop, timing=timing))
        return changed if self.poses is None else self._moved(changed, even("poses", changed.arm.n))

    def of_record(self, arm: Model, lanes: int, seed: int) -> dict[str, Any]:
        """Masses, friction and parameters with a standard deviation by name, a batch or draw each.

        Args:
            arm: made from a record.   lanes: how many.   seed: of the draws.
        """
        found: dict[str, Any] = {}
        rubs = "friction" not in arm.changes
        for row in arm.parameters if arm.description is not None else ():
            owner, key = split_path(row.name)
            frictional = rubs and key.startswith("friction.") and row.unit.startswith("N")
            if self.record and row.std:
                found[row.path] = Draw()
            elif self.mass is not None and key == "mass_kg" and row.value > 0.0:
                u = uniform_numbers(seed, row.name, range(lanes), 1)[:, 0]
                found[row.name] = Batch(row.value * (1.0 + self.mass * (2.0 * u - 1.0)))
            elif self.friction is not None and frictional and row.value != 0.0 and row.entry is None:
                u = uniform_numbers(seed, f"{owner}.friction", range(lanes), 1)[:, 0]
                found[row.name] = Batch(row.value * self.friction ** (2.0 * u - 1.0))
        return found

    def _moved(self, scenario: Scenario, even: np.ndarray) -> Scenario:
        """The scenario with start and reference moved by the same (lanes, n)."""
        assert scenario.loop is not None
        assert self.poses is not None
        start, reference, arm = scenario.start, scenario.loop.reference, scenario.arm
        if not isinstance(start, Start):
            raise ScenarioError(
                "a run that goes on", place="draws.poses", expected="a scenario with a start of its own"
            )
        q = np.zeros((1, arm.n)) if start.q is None else np.atleast_2d(numbers_by_lane(start.q))
        rows = [q]
        if reference is not None and not isinstance(reference, Batch):
            times = np.arange(scenario.ticks + 1) * scenario.tick
            try:
                rows.append(reference_rows(arm, reference, times)[:, : arm.n])
            except ScenarioError:
                raise ScenarioError(
                    "a reference of lanes", place="draws.poses", expected="one motion or pose"
                ) from None
        all_rows = np.concatenate(rows)
        limits = np.array([body.limits.position for body in arm.coordinates], dtype=float).T
        low = np.clip(limits[0] - all_rows.min(axis=0), -self.poses, 0.0)
        high = np.clip(limits[1] - all_rows.max(axis=0), 0.0, self.poses)
        offset = low + (high - low) * even
        if isinstance(reference, Batch):
            reference = Batch(numbers_by_lane(reference) + offset)
        elif isinstance(reference, Motion):
            reference = Moved(reference, Batch(offset))
        elif reference is not None:
            try:
                reference = Batch(scalar.real_numbers(reference).reshape(1, arm.n) + offset)
            except ValueError:
                what, expected = "neither a pose nor a motion", "no draws of poses, or a reference that is one of them"
                raise ScenarioError(what, place="draws.poses", expected=expected) from None
        moved = replace(scenario.loop, reference=reference)
        return replace(scenario, start=replace(start, q=Batch(q + offset)), loop=moved)

    def words(self, arm: Model) -> list[str]:
        """The uncertainty in words, with the items that do not apply to the arm."""
        found = []
        if self.mass is not None:
            found.append(f"masses within ±{100 * self.mass:g} %")
        if self.friction is not None:
            rubs = any(".friction." in name for name in replace(self, record=False).of_record(arm, 1, 0))
            found.append(
                f"friction within a factor of {self.friction:g}" if rubs else "no friction, of which the arm has none"
            )
        if self.payload is not None:
            found.append(f"{self.payload[0]:g} … {self.payload[1]:g} kg at the tip")
        if self.poses is not None:
            found.append(f"poses moved by ±{self.poses:g} rad | m")
        if self.jitter is not None:
            found.append(f"jitter up to {1e3 * self.jitter:g} ms")
        if self.delay is not None:
            found.append(f"up to {1e3 * self.delay:g} ms more delay")
        return found + [f"{name} as drawn" for name in self.vary]


@dataclass(frozen=True, eq=False)
class Moved(Motion):
    """A motion with its positions shifted by an offset.

    Args:
        motion: the motion.   offset: (n,) [rad | m], or a `Batch` of such.
    """

    motion: Any
    offset: Any

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.motion.n

    @property
    def time(self) -> float:  # type: ignore[override]
        """[s] of the beginning."""
        return self.motion.time

    @property
    def duration(self) -> float:  # type: ignore[override]
        """[s]."""
        return self.motion.duration

    def __call__(self, t: Scalar) -> tuple[Array, Array, Array]:
        """q (n,) [rad | m], q̇ and q̈ at t [s]."""
        q, qd, qdd = self.motion(t)
        return scalar.array(q + self.offset), qd, qdd

"""Plant of each joint with the others fixed: inertia, damping, slope and lag per unit of its command.

The inverse of a joint's transfer function from command to position, with the other joints held, is at low frequencies

    1/P(s) = g + b s + m s² + c s³ + …  =  (g + b s + m s²)(1 + τ s) + …,   τ = c / m

for a drive of any kind: of a current-driven joint m = H_jj / (n Kt), and of a voltage-driven one b holds the back-EMF and τ the
winding's time constant. The coefficients are those of Taylor's series, from values of 1/P on a circle.  [AstromHagglund2006]
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armwright.control.analysis.linear_loop import LinearLoop
from armwright.control.analysis.small_signal import SmallPlant
from armwright.control.analysis.workspace import joint_inertias
from armwright.errors import ScenarioError
from armwright.model import Model
from armwright.parameters import numbers_by_lane
from armwright.simulation.loop.sensors import Sensors

CIRCLE = 1e-2 * np.exp(2j * np.pi * np.arange(16) / 16)  # [1/s] far below all resonances


@dataclass(frozen=True, eq=False)
class JointPlants:
    """Low-frequency models of all joints at poses, U being the unit of a joint's command.

    Attributes:
        poses: (k, n) [rad | m], where an inertia, slope or coupling is extreme.
        inertia: (k, n) m [U s²/rad | U s²/m].   damping: (k, n) b [U s/rad | U s/m].   slope: (k, n) g [U/rad | U/m].
        lag: (n,) [s] sum of all small delays and time constants of the speed loop: half a period of hold, delays of the loop, the
            filter of the measured speed, the drive.
    """

    poses: np.ndarray
    inertia: np.ndarray
    damping: np.ndarray
    slope: np.ndarray
    lag: np.ndarray

    @classmethod
    def of(cls, loop: LinearLoop, control: Any, poses: int, seed: int) -> JointPlants:
        """The joints of a loop.

        Args:
            loop: linear.   control: the controller whose gains are designed.   poses: to draw.   seed: of these.
        """
        inner = getattr(control, "current_kp", None) is not None
        plant = SmallPlant(current_driven(loop.scenario.arm)) if inner else loop.plant
        found = joint_inertias(plant.arm, poses, seed)
        q = found.q[found.extremes()]
        slope, damping, inertia, further = np.moveaxis(_coefficients(plant, q), -1, 0)
        drive = np.maximum(further / inertia, 0.0).max(axis=0)
        every = getattr(control, "speed_every", 1)
        lag = drive + loop.period * every / 2.0 + loop.delay + _speed_lag(loop)
        if inner:
            lag = lag + 2.0 * current_lag(loop)  # of a current loop by the magnitude optimum
        return cls(q, inertia, damping, slope, lag)

    @property
    def worst(self) -> np.ndarray:
        """(n,) indices of the poses of each joint's largest inertia."""
        return self.inertia.argmax(axis=0)

    @property
    def largest(self) -> tuple[np.ndarray, np.ndarray]:
        """Inertia and damping (n,) of each joint at its pose of largest inertia."""
        joints = np.arange(self.inertia.shape[1])
        return self.inertia[self.worst, joints], np.maximum(self.damping[self.worst, joints], 0.0)


def current_driven(arm: Model) -> Model:
    """The arm with ideal current sources for motors, as an inner current loop makes them."""
    bodies = (replace(body, drive=replace(body.drive, command="current", inductance=None)) for body in arm.bodies)
    return replace(arm, bodies=tuple(bodies))


def current_lag(loop: LinearLoop) -> float:
    """[s] of the current loop's hold and delays."""
    return loop.period / 2.0 + loop.delay


def _coefficients(plant: SmallPlant, q: np.ndarray) -> np.ndarray:
    """(k, n, 4) g, b, m and c of every joint, positive whatever a gear's sense."""
    e, a, b = plant.slopes(q)
    n, found = plant.arm.n, []
    for joint in range(n):
        states = plant.states_of(joint)
        own, whole = ((each[:, states[:, None], states]) for each in (e, a))
        pencil = CIRCLE[:, None, None, None] * own - whole
        column = np.broadcast_to(b[:, states, joint, None], (len(CIRCLE), len(q), len(states), 1))
        position = np.linalg.solve(pencil, column.astype(complex))[..., 0, 0]  # q is the first of a joint's states
        series = np.fft.fft(1.0 / position, axis=0)[:4].real / len(CIRCLE)
        found.append((series / np.abs(CIRCLE[0]) ** np.arange(4)[:, None]).T)
    values = np.stack(found, axis=1)
    if not np.isfinite(values).all():
        raise ScenarioError("a joint's command does not move it", place="arm", expected="a drive on every joint")
    return values * np.sign(values[..., 2:3])


def _speed_lag(loop: LinearLoop) -> float:
    """[s] by which the measured speed is late."""
    sampled, period, lag = loop.scenario.loop, loop.period, 0.0
    assert sampled is not None
    for each in sampled.sensor_list:
        if isinstance(each, Sensors) and each.velocity != "exact":
            cutoff = np.inf if each.cutoff_hz is None else float(numbers_by_lane(each.cutoff_hz).min())
            poles = 2 if each.velocity == "observer" else 1
            lag = max(lag, period / 2.0 * (each.velocity != "observer") + poles / (2.0 * np.pi * cutoff))
    return lag

"""An arm with its drives about a pose at rest, as a system of python-control."""

from __future__ import annotations

from typing import Any

import numpy as np

from armwright import scalar
from armwright.control.analysis.hold import sampled_system
from armwright.control.analysis.small_signal import SmallPlant
from armwright.entry import AnyArm, as_arm
from armwright.errors import ScenarioError
from armwright.model import Model

OUTPUTS = ("q", "qd")


def state_space(arm: AnyArm, q: Any = None, *, period: float | None = None, delay: float = 0.0) -> Any:
    """Linear model of an arm with its drives about a pose at rest, as a `control.StateSpace` with named signals.

        d(x - x₀)/dt = A (x - x₀) + B (u - u₀),   y = (q, q̇) - (q₀, 0)

    with x₀, u₀ the state and the commands that hold the arm. States are those of the plant, q and q̇ first: `q[joint1]`,
    `qd[joint1]`, then currents and motors where the record has them. Inputs are the joints' own commands: `voltage[joint1]`,
    `current[joint1]` or `torque[joint1]`. Dry friction, gear loss, play, stops and limits are left out.

    Args:
        arm: the model.   q: (n,) pose [rad | m]; None: 0.
        period: [s] of a zero-order hold, exactly discretised; None: continuous time.
        delay: [s] of the commands, of a sampled system; its further states are the commands under way.
    Returns:
        system: of python-control, with n inputs and 2n outputs [units of the joints' commands, positions and speeds].
    Raises:
        ScenarioError: a pose of another length, a delay without a period, or python-control is not installed.
    Example:
        >>> system = aw.loops.state_space("two-link", [-1.5708, 0.0])  # hanging
        >>> np.sort(system.poles().imag).round(3)
        array([-7.177, -2.859,  2.859,  7.177])
    """
    arm = as_arm(arm)
    control = import_control()
    pose = _pose(arm, q)
    if period is None and delay:
        raise ScenarioError("goes with a period", place="delay", value=delay, expected="period = …, or no delay")
    small = SmallPlant(arm)
    e, a, b = small.slopes(pose)
    a, b = np.linalg.solve(e, a), np.linalg.solve(e, b)
    layout, n = small.plant.layout, arm.n
    c = np.zeros((len(OUTPUTS) * n, len(a)))
    for k, name in enumerate(OUTPUTS):
        c[k * n : (k + 1) * n, layout.place(name)] = np.eye(n)
    system = control.ss(a, b, c, 0.0) if period is None else sampled_system(a, b, c, period, delay)
    inputs = [f"{body.drive.command}[{body.joint}]" for body in arm.coordinates]
    states = [
        f"{name}[{arm.names[joint]}]" if layout[name].joints is not None else name
        for name in layout.names
        for joint in layout[name].joints or (0,)
    ]
    waiting = range(1, 1 + (system.nstates - len(states)) // n)
    states += [f"{name}, {age} ago" for age in waiting for name in inputs]
    outputs = [f"{name}[{joint}]" for name in OUTPUTS for joint in arm.names]
    return control.ss(system, inputs=inputs, states=states, outputs=outputs, name=arm.name)


def _pose(arm: Model, q: Any) -> np.ndarray:
    """A pose (n,), 0 by default.

    Raises:
        ScenarioError: another length, or what is not finite.
    """
    pose = scalar.numbers_or_nan(np.zeros(arm.n) if q is None else q)
    if pose.shape != (arm.n,) or not np.isfinite(pose).all():
        raise ScenarioError(place="q", value=q, expected=f"{arm.n} finite numbers: {', '.join(arm.names)}")
    return pose


def import_control() -> Any:
    """The module of python-control.

    Raises:
        ScenarioError: it is not installed.
    """
    try:
        import control
    except ImportError:
        what = "needs python-control, which is not installed"
        raise ScenarioError(what, expected="pip install armwright[control]") from None
    return control

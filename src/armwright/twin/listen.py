"""Rows of an arm from the frames of its drives on a bus; the listener sends nothing.

A row is a SYNC with the process data that answer it, TPDO 1 of the LWA 4P's mapping: statusword, actual torque in thousandths of
the rated one, actual position in counts.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.actuators import drive_torque
from armwright.actuators.coupling import shares_of, to_joints
from armwright.entry import AnyArm, as_arm
from armwright.errors import BusError
from armwright.model import Model
from armwright.model.joint_signals import LONG_NAMES, joint_units
from armwright.results.recording import bare_dataset
from armwright.simulation.loop.sensors import Sensors
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop
from armwright.twin.bus import check_bus, node_numbers, open_bus
from armwright.twin.units import BusUnits

if TYPE_CHECKING:
    from armwright.shadow.alarms import ShadowAlarm
    from armwright.shadow.observer import Residuals
    from armwright.shadow.shadow import ArmShadow

SYNC, ANSWER = 0x80, 0x180  # COB-IDs; a node's number is added to the second
DATA = struct.Struct("<Hhi")  # 6041, 6077, 6064
SILENCE = 2.0  # [s] without a frame after which there is nobody
POLL = 0.1  # [s] from look to look whether to stop


class BusListener:
    """Rows of an arm as its drives send them; a context manager that opens and closes the bus.

    Args:
        arm: the model, whose limits are the rated torques.   bus: "socketcan:can0", "udp_multicast:ADDRESS" or "virtual:NAME".
        nodes: numbers of the joints' nodes; default: from 3.   counts: of the encoders in a turn of the joint; default: 360,000.
        period: [s] from SYNC to SYNC, where their time stamps mean nothing, as of a twin in lock-step; default: the stamps.

    Attributes:
        incomplete: cycles to which an answer was missing; they are no rows.   latest: [s] of the last SYNC, as rows have it.
    Example:
        >>> loop = aw.Loop(aw.Cascade(10.0, speed_kp=[15, 21, 16, 15, 1.4, 1.3]), period=0.004)
        >>> scenario = aw.Scenario("lwa4p", 0.2, loop=loop)
        >>> with aw.bus.BusListener(scenario.arm, "virtual") as listener, aw.bus.Twin(scenario):
        ...     run = aw.bus.run_controller(scenario)  # its frames wait on the bus
        ...     rows = list(listener.rows(silence=0.1))
        >>> len(rows) > 50, listener.incomplete  # cycles
        (True, 0)
    """

    def __init__(
        self,
        arm: Model,
        bus: str,
        *,
        nodes: Sequence[int] | None = None,
        counts: Any = None,
        period: float | None = None,
    ):
        if period is not None and not (isinstance(period, (int, float)) and 0.0 < period < np.inf):
            raise BusError(place="period", value=period, expected="a time above 0 [s]")
        check_bus(bus)
        self.arm, self.name, self._period, self.incomplete, self.latest = arm, bus, period, 0, 0.0
        self._joints = {ANSWER + number: k for k, number in enumerate(node_numbers(nodes, arm.n))}
        sensors = Sensors() if counts is None else Sensors(counts=counts, side="link")
        self._units = BusUnits.of(Scenario(arm, 1.0, loop=Loop(period=1e-3, sensors=sensors)))
        self._bus: Any = None
        self._stopped = False

    def stop(self) -> None:
        """Ends `rows` after the frames received so far; to be called from another thread."""
        self._stopped = True

    def __enter__(self) -> BusListener:
        self._bus = open_bus(self.name)
        return self

    def __exit__(self, *exception: object) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            bus.shutdown()

    def rows(
        self, duration: float | None = None, silence: float = SILENCE
    ) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
        """t [s] since the first SYNC, q (n,) [rad | m] and torques of the motors on the joints (n,) [N m | N], row by row.

        Args:
            duration: [s] after which it ends; None: only by silence, or `stop`.
            silence: [s] without a frame after which it ends.
        Raises:
            BusError: nothing came at all.
        """
        heard, cycles, first, at = False, 0, 0.0, None
        answers: dict[int, tuple[int, int]] = {}
        end = np.inf if duration is None else time.monotonic() + duration
        latest = time.monotonic()
        while (left := min(end, latest + silence) - time.monotonic()) > 0.0:
            frame = self._bus.recv(0.0 if self._stopped else min(left, POLL))
            if frame is None:
                if self._stopped:
                    break
                continue
            latest = time.monotonic()
            if frame.arbitration_id == SYNC:
                self.incomplete += at is not None and len(answers) < self.arm.n
                first = frame.timestamp if not heard else first
                heard, answers = True, {}
                at = cycles * self._period if self._period is not None else frame.timestamp - first
                cycles, self.latest = cycles + 1, at
            joint = self._joints.get(frame.arbitration_id)
            if joint is None or at is None or len(frame.data) != DATA.size:
                continue
            _, torque, counts = DATA.unpack(bytes(frame.data))
            answers[joint] = (torque, counts)
            if len(answers) == self.arm.n:
                yield (at, *self._row(answers))
                at = None
                latest = time.monotonic()  # what the caller did meanwhile is no silence of the bus
        if not heard:
            expected = f"a SYNC within {min(silence, duration or silence):g} s, by a master that drives the arm"
            raise BusError("no frames were received", place="bus", value=self.name, expected=expected)

    def _row(self, answers: dict[int, tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
        torque, counts = np.array([answers[k] for k in range(self.arm.n)], dtype=float).T
        command = np.asarray(self._units.command(torque))
        tau = to_joints(shares_of(self.arm), drive_torque(self.arm, np.zeros(self.arm.n), command))
        return np.asarray(self._units.position(counts)), np.asarray(tau, dtype=float)


def bus_recording(
    arm: AnyArm, rows: Sequence[tuple[float, np.ndarray, np.ndarray]], residuals: Sequence[Residuals] = ()
) -> Any:
    """A run of the recorded rows, for `save`: q, tau and, with a shadow, its residuals.

    Args:
        arm: the model.   rows: as of `BusListener.rows`.   residuals: of each row, as `ArmShadow.last` has them.
    Returns:
        run: with dimensions time and joint.
    Example:
        >>> rows = [(0.0, np.zeros(2), np.zeros(2)), (0.01, np.full(2, 0.1), np.ones(2))]
        >>> run = aw.bus.bus_recording("two-link", rows)
        >>> run.q.values
        array([[0. , 0. ],
               [0.1, 0.1]])
    """
    arm = as_arm(arm)
    t, q, tau = (np.array([row[k] for row in rows], dtype=float) for k in range(3))
    values = {"q": q.reshape(-1, arm.n), "tau": tau.reshape(-1, arm.n)}
    names = {"residual_torque": ("torque", "tau"), "residual_position": ("position", "q")}
    units = {name: " | ".join(dict.fromkeys(joint_units(arm, name))) for name in values}
    about = dict(LONG_NAMES)
    for name, (field, like) in names.items() if residuals else ():
        values[name] = np.concatenate([getattr(each, field) for each in residuals])
        units[name], about[name] = units[like], f"{field} that the model does not explain"
    run = bare_dataset(arm, {"source": "bus"}, None)
    run = run.assign_coords(time=("time", t, {"units": "s", "long_name": "time"}))
    return run.assign(
        {n: (("time", "joint"), v, {"units": units[n], "long_name": about[n]}) for n, v in values.items()}
    )


def shadow_bus(
    shadow: ArmShadow, listener: BusListener, duration: float | None = None, silence: float = SILENCE
) -> Iterator[tuple[tuple[float, np.ndarray, np.ndarray], list[ShadowAlarm]]]:
    """Rows of a bus, each with the alarms that it raises; `shadow.last` has the row's residuals.

    Args:
        shadow: of the listener's arm.   listener: open.
        duration: [s] after which it ends; None: only by silence.   silence: [s] without a frame after which it ends.
    Returns:
        rows: t, q and torques as of `BusListener.rows`, and the alarms.
    Raises:
        BusError: as `BusListener.rows`.
    Example:
        >>> loop = aw.Loop(aw.Cascade(10.0, speed_kp=[15, 21, 16, 15, 1.4, 1.3]), period=0.004)
        >>> scenario = aw.Scenario("lwa4p", 0.2, loop=loop)
        >>> shadow = aw.shadow.ArmShadow("lwa4p", deviation=5.0)
        >>> with aw.bus.BusListener(scenario.arm, "virtual") as bus, aw.bus.Twin(scenario):
        ...     run = aw.bus.run_controller(scenario)  # its frames wait on the bus
        ...     [each for row, each in aw.bus.shadow_bus(shadow, bus, silence=0.1) if each]
        []
    """
    last = np.nan
    for t, q, tau in listener.rows(duration, silence):
        if t != last:  # two SYNCs of one time stamp are no two rows
            last = t
            yield (t, q, tau), shadow.update([t], q[None], tau[None])
    if listener.latest > last:  # a drive no longer answers: no rows since, and nothing was judged
        shadow.without_rows(listener.latest - last)

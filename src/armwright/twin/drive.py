"""One drive: its reaction to a controlword and a set-point at every SYNC, in counts and thousandths. [IEC2015]

A drive whose motor has no torque is held by its brake: the twin moves it along the same ramp as a quick stop, and then keeps
it where it is. The records of arms say nothing about brakes of this kind.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armwright.twin import faults
from armwright.twin import objects as od
from armwright.twin.objects import ENTRIES, Key
from armwright.twin.profile import approach, slowed
from armwright.twin.state_machine import POWERED, Command, Event, State, StateMachine, Transition

VOLTAGE_ENABLED, REMOTE, REACHED, LIMITED, OF_MODE, MISSED = 1 << 4, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13
START, AT_ONCE, RELATIVE, HALT = (
    1 << 4,
    1 << 5,
    1 << 6,
    1 << 8,
)  # bits of the controlword in profile position and homing
SPEEDING = 1.1  # of the largest speed: what is measured in counts may be above it a little
HOME_HERE = (35, 37)  # methods of homing: where the joint stands is home
STAYS = (5, 6, 7)  # options of a quick stop that stay in it, at rest
VOLTS, SAGGING = 24.0, 16.0  # [V] of the supply as object 6079 shows it, and sagging


@dataclass
class SetPoint:
    """Set-point of a drive's servo for one tick: a torque, or a position with its speed.

    Attributes:
        torque: [thousandths]; None: the position is followed.   position: [counts].   speed: [counts/s].
    """

    torque: float | None
    position: float
    speed: float


class Drive:
    """A drive with its objects.

    Attributes:
        name: of its joint.   machine: its state.   values: of its objects, by index and subindex.
        error: the code of its fault; 0: none.   emergencies: (code, register) that were not sent yet.
        stuck, hot, sagging: faults that are there.
    """

    def __init__(self, name: str, defaults: Mapping[Key, int], period: float):
        self.name, self.period = name, period
        numbers = {key: entry.default for key, entry in ENTRIES.items() if isinstance(entry.default, int)}
        self.values: dict[Key, int] = {**numbers, **defaults}
        self.machine = StateMachine()
        self.error, self.emergencies = 0, list[tuple[int, int]]()
        self.stuck = self.hot = self.sagging = False
        self.raw: int | None = None  # the position that it sends, without homing [counts]
        self.encoder, self.speed = 0, 0.0  # what its own encoder says [counts], [counts/s]
        self.true, self.true_speed = 0, 0.0  # of the motor, whatever the encoder says
        self.offset = 0  # of homing [counts]
        self.demand, self.demand_speed = 0.0, 0.0  # without homing [counts], [counts/s]
        self._target: float | None = None  # of a profile [counts]
        self._word = 0  # the last controlword in this mode
        self._bits = 0  # of the statusword that the mode sets
        self._late = 0.0  # [s] that the following error is too large for
        self._silent = 0  # cycles without process data
        self._heard = False  # since it was enabled

    # What a master sees.

    @property
    def state(self) -> State:
        """State of the machine."""
        return self.machine.state

    @property
    def mode(self) -> int:
        """The active mode of operation; 0: none."""
        return self.values[od.MODE_DISPLAY]

    @property
    def statusword(self) -> int:
        """Object 6041."""
        return self.state.value | (not self.sagging) * VOLTAGE_ENABLED | REMOTE | self._bits

    @property
    def moves(self) -> bool:
        """True while the motor has torque, or the brake has not yet stopped the joint."""
        return self.state in POWERED or self.demand_speed != 0.0

    def read(self, key: Key) -> int | None:
        """Present value of an object; None for an object that the drive does not have."""
        if key == od.STATUSWORD:
            return self.statusword
        if key == od.POSITION:
            return (self.raw or 0) + self.offset
        if key == od.POSITION_DEMAND:
            return round(self.demand) + self.offset
        if key == od.FOLLOWING_ERROR:
            return round(self.demand) - self.encoder
        if key == od.VELOCITY:
            return round(self.speed)
        if key == od.SUPPLY:
            return round(1e3 * (SAGGING if self.sagging else VOLTS))
        if key == od.ERROR_CODE:
            return self.error
        if key == od.ERROR_REGISTER:
            return self.register
        return self.values.get(key)

    @property
    def register(self) -> int:
        """Object 1001: bit 0 for any error, and one bit for its kind."""
        return 0 if not self.error else 1 | faults.REGISTER.get(self.error >> 12, 0)

    # What happens to it.

    def measured(self, sent: int, torque: int, true: int) -> None:
        """Takes a measurement.

        Args:
            sent: position that the bus carries, with the delays, losses and noise of the scenario [counts].
            torque: [thousandths] that acts.   true: where the motor is [counts].
        """
        if self.raw is None:
            self.true = self.encoder = true
            self.demand = float(true)
        self.true_speed, self.true = (true - self.true) / self.period, true
        if not self.stuck or self.raw is None:
            self.raw = sent
            self.speed, self.encoder = (true - self.encoder) / self.period, true
        self.values[od.TORQUE] = torque
        if abs(true - self.encoder) > max(1.0, 0.2 * self.values[od.WINDOW]):  # a degree off the commutation's angle
            self.fail(faults.ENCODER)

    def fail(self, code: int) -> None:
        """Reacts to a fault and reports it, once."""
        if self.machine.happened(Event.FAULT) is None:
            return
        self.error = code
        self.emergencies.append((code, self.register))
        self._begin_stop()
        if code == faults.ENCODER or self.values[od.REACTION_OPTION] == 0:
            self._settle(self.machine.happened(Event.REACTED))

    def abort_connection(self, code: int) -> None:
        """Reacts to a lost connection as object 6007 says."""
        option = self.values[od.ABORT_OPTION]
        if option != 1:
            self.emergencies.append((code, 1 | faults.REGISTER[code >> 12]))
        if option == 1:
            self.fail(code)
        elif option == 2:
            self.command(Command.DISABLE_VOLTAGE.value[1])
        elif option == 3:
            self.command(Command.QUICK_STOP.value[1])

    def command(self, word: int) -> None:
        """Executes a controlword."""
        persists = self.hot or self.sagging or self.stuck
        row = self.machine.command(word, resettable=not persists)
        if row is not None and row.number == 15:
            self.error = 0
            self.emergencies.append((0, 0))
        self._settle(row)

    def _settle(self, row: Transition | None) -> None:
        """Carries out the actions of a transition."""
        if row is None:
            return
        if row.target is State.ENABLED:
            self.demand, self.demand_speed = float(self.encoder), 0.0
            self._target, self._word, self._bits, self._late, self._heard = None, 0, 0, 0.0, False
            self._silent = 0
        elif row.source in POWERED:
            self._bits = 0
            self._begin_stop()

    def _begin_stop(self) -> None:
        """From where the joint is and as fast as it moves, the ramp of a quick stop."""
        self.demand = float(self.true)
        least = self.values[od.STOP_DECELERATION] * self.period  # what a ramp takes off in a tick
        self.demand_speed = self.true_speed if abs(self.true_speed) > least else 0.0

    # A tick.

    def tick(self, *, received: bool) -> SetPoint:
        """Set-point of the servo until the next SYNC.

        Args:
            received: True if process data came since the last SYNC.
        """
        if self.hot or self.sagging:
            self.fail(faults.OVER_TEMPERATURE if self.hot else faults.UNDERVOLTAGE)
        self.values[od.MODE_DISPLAY] = self._entered_mode()
        if self.state is State.ENABLED:
            self._watch(received)
        if self.state is State.ENABLED:
            point = self._followed()
            self._word = self.values[od.CONTROLWORD]
            return point
        return self._stopping()

    def _entered_mode(self) -> int:
        """The mode that is in force now; the drive stays where it is when the mode changes."""
        asked = self.values[od.MODE]
        if asked == self.mode or asked not in od.MODES:
            return self.mode
        self._target, self._word, self._bits = None, self.values[od.CONTROLWORD], 0
        self.demand, self.demand_speed = float(self.encoder), 0.0
        return asked

    def _watch(self, received: bool) -> None:
        """Finds the faults that a drive looks for while it is enabled."""
        values, raw = self.values, self.encoder
        self._heard, self._silent = self._heard or received, 0 if received else self._silent + 1
        limit, cyclic = values[od.TIMEOUT], self.mode in od.CYCLIC
        if cyclic and self._heard and limit and 1e3 * self._silent * self.period > limit:
            self.fail(faults.NO_DATA)
        elif abs(self.speed) > SPEEDING * values[od.MAX_SPEED]:
            self.fail(faults.SPEEDING)
        elif not values[od.LOWEST] - values[od.WINDOW] <= raw + self.offset <= values[od.HIGHEST] + values[od.WINDOW]:
            self.fail(faults.BEYOND_LIMITS)
        elif self.mode in (1, 6, 7, 8) and abs(self.demand - raw) > values[od.WINDOW]:
            self._late += self.period
            if 1e3 * self._late > values[od.WINDOW_TIME]:
                self._bits |= MISSED
                self.fail(faults.FOLLOWING)
        else:
            self._late = 0.0

    def _stopping(self) -> SetPoint:
        """The ramp to rest, and what follows when it has come there."""
        stop = self.values[od.STOP_DECELERATION]
        self.demand, self.demand_speed = slowed(self.demand, self.demand_speed, stop, self.period)
        if self.demand_speed == 0.0:
            if self.state is State.REACTION:
                self._settle(self.machine.happened(Event.REACTED))
            elif self.state is State.QUICK_STOP and self.values[od.QUICK_STOP_OPTION] not in STAYS:
                self._settle(self.machine.happened(Event.STOPPED))
        return SetPoint(None, self.demand, self.demand_speed)

    def _followed(self) -> SetPoint:
        """Set-point of an enabled drive in its mode."""
        values, mode, most = self.values, self.mode, self.values[od.MAX_TORQUE]
        if mode == 10:
            asked = values[od.TARGET_TORQUE] + values[od.TORQUE_OFFSET]
            torque = int(np.clip(asked, -most, most))
            self._bits = OF_MODE | (torque != asked) * LIMITED
            self.demand, self.demand_speed = float(self.encoder), 0.0
            return SetPoint(torque, self.demand, 0.0)
        if mode == 9:
            speed = values[od.TARGET_VELOCITY] + values[od.VELOCITY_OFFSET]
            self._reach(self.demand + speed * self.period, OF_MODE)
        elif mode == 8:
            self._reach(values[od.TARGET_POSITION] - self.offset, OF_MODE)
        elif mode == 7 and values[od.CONTROLWORD] & START:
            self._reach(values[od.SET_POINT] - self.offset, OF_MODE)
        elif mode == 1:
            self._profile()
        elif mode == 6:
            self._home()
        else:
            self.demand_speed, self._bits = 0.0, 0
        return SetPoint(None, self.demand, self.demand_speed)

    def _reach(self, position: float, bits: int) -> None:
        """Follows a position [counts] within the limits of position and speed."""
        most = self.values[od.MAX_SPEED] * self.period
        within = float(np.clip(position, self.values[od.LOWEST] - self.offset, self.values[od.HIGHEST] - self.offset))
        step = float(np.clip(within - self.demand, -most, most))
        limited = within != position or step != within - self.demand
        self.demand, self.demand_speed = self.demand + step, step / self.period
        self._bits = bits | limited * LIMITED

    def _profile(self) -> None:
        """Profile position: takes a new target at the rising edge of bit 4, and goes there by a trapezoid of speed."""
        values, word = self.values, self.values[od.CONTROLWORD]
        if word & START and not self._word & START and (self._target is None or word & AT_ONCE):
            base = (self.demand if self._target is None else self._target) if word & RELATIVE else -self.offset
            target = base + values[od.TARGET_POSITION]
            low, high = values[od.LOWEST] - self.offset, values[od.HIGHEST] - self.offset
            self._target, self._bits = float(np.clip(target, low, high)), (not low <= target <= high) * LIMITED
        if word & HALT or self._target is None:
            target = None if word & HALT or self.demand_speed else self.demand
        else:
            target = self._target
        if target is None:
            self.demand, self.demand_speed = slowed(
                self.demand, self.demand_speed, values[od.DECELERATION], self.period
            )
        else:
            speed = min(values[od.PROFILE_SPEED], values[od.MAX_SPEED])
            rates = values[od.ACCELERATION], values[od.DECELERATION]
            self.demand, self.demand_speed = approach(
                self.demand, self.demand_speed, target, speed, *rates, self.period
            )
        bits = self._bits & LIMITED | (OF_MODE if word & START else 0)
        there = self._target is not None and self.demand == self._target
        if there and abs(self.demand - self.encoder) <= values[od.REACHED]:
            self._target = None  # the next one may come
        if self._target is None and self.demand_speed == 0.0:
            bits |= REACHED
        self._bits = bits

    def _home(self) -> None:
        """Homing where the joint stands: its position becomes the home offset."""
        word = self.values[od.CONTROLWORD]
        self.demand_speed = 0.0
        if not word & START:
            self._bits &= OF_MODE
        elif not self._word & START:
            if self.values[od.HOMING_METHOD] not in HOME_HERE:
                self._bits = MISSED | REACHED
                return
            self.offset = self.values[od.HOME_OFFSET] - self.encoder
            self._bits = OF_MODE | REACHED

"""One drive: its reaction to a controlword and a set-point at every SYNC, in counts and thousandths. [IEC2015]

A drive whose motor has no torque is held by its brake: the twin moves it along the same ramp as a quick stop, and then keeps
it where it is. The records of arms say nothing about brakes of this kind.

Codes of the options 605A to 605E by which a drive slows down: 0 at once without torque, 1 along the ramp of its mode, 2 along the
ramp of a quick stop, 3 with all the current that it has. 605A adds 4 to them to stay in quick stop active.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from armwright.twin import faults, objects as od
from armwright.twin.homing import ATTAINED, Homing
from armwright.twin.objects import ENTRIES, Key
from armwright.twin.profile import approach, slowed
from armwright.twin.state_machine import POWERED, Command, Event, State, StateMachine, Transition, commanded

VOLTAGE_ENABLED, REMOTE, REACHED, LIMITED, OF_MODE, MISSED = 1 << 4, 1 << 9, 1 << 10, 1 << 11, 1 << 12, 1 << 13
START, AT_ONCE, RELATIVE, HALT = 1 << 4, 1 << 5, 1 << 6, 1 << 8  # of the controlword, in profile position and homing
SPEEDING = 1.1  # of the largest speed: what is measured in counts may be above it a little
AT_ONCE_OFF, SLOW_RAMP, QUICK_RAMP, ALL_CURRENT = 0, 1, 2, 3  # codes of the options
STAYING = 4  # added to a code of 605A: the drive stays in quick stop active
LEAVES = {Command.SHUTDOWN: od.SHUTDOWN_OPTION, Command.SWITCH_ON: od.DISABLE_OPTION}  # operation enabled, by an option
BEYOND = 1e3  # times the largest speed: a set-point of speed that brings any servo to its limit of current
VOLTS, SAGGING = 24.0, 16.0  # [V] of the supply as object 6079 shows it, and sagging


@dataclass
class SetPoint:
    """Set-point of a drive's servo for one tick: a torque, or a position with its speed.

    Attributes:
        torque: [thousandths]; None: the position is followed.   position: [counts].   speed: [counts/s].
        feedforward: torque that is added to that of the servo [thousandths].
    """

    torque: float | None
    position: float
    speed: float
    feedforward: float = 0.0


class TwinDrive:
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
        self.homing = Homing()
        self._ends = self.values[od.LOWEST], self.values[od.HIGHEST]  # where the limit switches are [counts]
        self.demand, self.demand_speed = 0.0, 0.0  # without homing [counts], [counts/s]
        self._target: float | None = None  # of a profile [counts]
        self._word = 0  # the last controlword in this mode
        self._bits = 0  # of the statusword that the mode sets
        self._late = 0.0  # [s] that the following error is too large for
        self._silent = 0  # cycles without process data
        self._heard = False  # since it was enabled
        self._leaving: Command | None = None  # that takes effect when the joint has come to rest
        self._braked = False  # by 60FE
        self._before: float | None = None  # speed a tick ago, while it slows down with all its current [counts/s]

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
        if key == od.CURRENT:  # of 6075, as the torque is of 6076: a motor's torque is in proportion to its current
            return self.values[od.TORQUE]
        if key == od.INPUTS:
            return self.inputs
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

    @property
    def inputs(self) -> int:
        """Object 60FD: limit switches at both ends of the record's range, and a home switch that is closed from 0 on."""
        low, high = self._ends
        return (self.true <= low) * od.NEGATIVE | (self.true >= high) * od.POSITIVE | (self.true >= 0) * od.HOME

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
        if code == faults.ENCODER or self.values[od.REACTION_OPTION] == AT_ONCE_OFF:
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
        cause = commanded(word, self.machine.word)
        if self.state is State.ENABLED and cause in LEAVES and self.values[LEAVES[cause]] == SLOW_RAMP and self._turns:
            if self._leaving is None:
                self._begin_stop()
            self._leaving, self.machine.word = cause, word  # what was asked for later takes its place
            return
        persists = self.hot or self.sagging or self.stuck
        stays = self.values[od.QUICK_STOP_OPTION] > STAYING
        row = self.machine.command(word, resettable=not persists, resumable=stays)
        if row is not None and row.number == 15:
            self.error = 0
            self.emergencies.append((0, 0))
        self._settle(row)

    def _settle(self, row: Transition | None) -> None:
        """Carries out the actions of a transition."""
        if row is None:
            return
        if row.target is State.ENABLED:
            self._start_over()
            self._late, self._heard, self._silent = 0.0, False, 0
        elif row.source in POWERED:
            self._bits = 0
            self._begin_stop()

    def _start_over(self) -> None:
        """Stands where it is, and waits for set-points."""
        self.demand, self.demand_speed = float(self.encoder), 0.0
        self._target, self._before, self._word, self._bits = None, None, 0, 0

    @property
    def _turns(self) -> bool:
        """True while the motor is faster than what a ramp takes off in a tick, and than a count in a tick."""
        return abs(self.true_speed) > max(self.values[od.STOP_DECELERATION] * self.period, 1.0 / self.period)

    @property
    def _at_rest(self) -> bool:
        """True when the ramp has come to its end, and the joint with it."""
        return self.demand_speed == 0.0 and not self._turns

    def _begin_stop(self) -> None:
        """From where the joint is and as fast as it moves, the ramp to rest."""
        self.homing.interrupt()
        self._leaving, self._braked, self._before = None, False, None
        self.demand = float(self.true)
        self.demand_speed = self.true_speed if self._turns else 0.0

    # A tick.

    def tick(self, *, received: bool) -> SetPoint:
        """Set-point of the servo until the next SYNC.

        Args:
            received: True if process data came since the last SYNC.
        """
        if self.hot or self.sagging:
            self.fail(faults.OVER_TEMPERATURE if self.hot else faults.UNDERVOLTAGE)
        self._settle(self.machine.proceed())
        self.values[od.MODE_DISPLAY] = self._entered_mode()
        if self.state is State.ENABLED:
            self._watch(received)
        if self.state is State.ENABLED and not self._brakes():
            point = self._followed()
            self._word = self.values[od.CONTROLWORD]
            return point
        return self._stopping()

    def _entered_mode(self) -> int:
        """The mode that is in force now; the drive stays where it is when the mode changes."""
        asked = self.values[od.MODE]
        if asked == self.mode or asked not in od.MODES or self._leaving is not None:
            return self.mode
        self.homing.interrupt()
        self._start_over()
        self._word = self.values[od.CONTROLWORD]
        return asked

    def _brakes(self) -> bool:
        """True while an enabled drive does not follow: its brake is set, or it slows down to be disabled."""
        values = self.values
        braked = bool(values[od.OUTPUT] & values[od.OUTPUT_MASK] & od.BRAKE)
        if braked != self._braked and self._leaving is None:
            if braked:
                self._begin_stop()
            else:
                self._start_over()
                self._word = values[od.CONTROLWORD]
        self._braked = braked
        return braked or self._leaving is not None

    def _watch(self, received: bool) -> None:
        """Finds the faults that a drive looks for while it is enabled."""
        values, raw = self.values, self.encoder
        self._heard, self._silent = self._heard or received, 0 if received else self._silent + 1
        limit, cyclic = values[od.TIMEOUT], self.mode in od.CYCLIC
        low, high = values[od.LOWEST] - values[od.WINDOW], values[od.HIGHEST] + values[od.WINDOW]
        if cyclic and self._heard and limit and 1e3 * self._silent * self.period > limit:
            self.fail(faults.NO_DATA)
        elif abs(self.speed) > SPEEDING * values[od.MAX_SPEED]:
            self.fail(faults.SPEEDING)
        elif not self.homing.running and not low <= raw + self.offset <= high:
            self.fail(faults.BEYOND_LIMITS)
        elif self.mode in (1, 6, 7, 8) and abs(self.demand - raw) > values[od.WINDOW]:
            self._late += self.period
            if 1e3 * self._late > values[od.WINDOW_TIME]:
                self._bits |= MISSED
                self.fail(faults.FOLLOWING)
        else:
            self._late = 0.0

    def _stopping(self) -> SetPoint:
        """The way to rest, and what follows when it has come there."""
        values, option = self.values, QUICK_RAMP  # of the brake, where the motor has no torque
        if self.state is State.QUICK_STOP:
            option = values[od.QUICK_STOP_OPTION]
            if option == AT_ONCE_OFF:
                self._settle(self.machine.happened(Event.STOPPED))
        elif self.state is State.REACTION:
            option = values[od.REACTION_OPTION]
        elif self._leaving is not None:
            option = SLOW_RAMP
        point, at_rest = self._slowed(option), self._at_rest
        if self.state is not State.REACTION:  # which shows what brought it there
            self._bits = 0
        if at_rest and self.state is State.REACTION:
            self._settle(self.machine.happened(Event.REACTED))
        elif at_rest and self.state is State.QUICK_STOP:
            if option > STAYING:
                self._bits = REACHED
            else:
                self._settle(self.machine.happened(Event.STOPPED))
        elif at_rest and self._leaving is not None:
            self._settle(self.machine.happened(self._leaving))
        return point

    def _slowed(self, option: int) -> SetPoint:
        """Set-point a tick nearer to rest, as an option says."""
        values, code = self.values, option - STAYING if option > STAYING else option
        if code == ALL_CURRENT and self.demand_speed:
            speed, before = abs(self.true_speed), self._before
            self.demand, self.demand_speed = float(self.true), self.true_speed
            if self._turns:
                # a command acts a tick later: two ticks before the joint would turn back, the servo takes it to rest
                rests = before is not None and speed <= 2.0 * (before - speed)
                self._before = np.inf if rests else speed
                push = -BEYOND * values[od.MAX_SPEED] * float(np.sign(self.true_speed))
                return SetPoint(None, self.demand, 0.0 if rests else push)
            self.demand_speed, self._before = 0.0, None
        self._take_over()
        slow = od.HOMING_ACCELERATION if self.mode == 6 else od.DECELERATION
        rate = values[slow if code == SLOW_RAMP else od.STOP_DECELERATION]
        self.demand, self.demand_speed = slowed(self.demand, self.demand_speed, rate, self.period)
        return SetPoint(None, self.demand, self.demand_speed)

    def _take_over(self) -> None:
        """Goes on from where the joint is, if it was braked with all its current."""
        if self._before is not None:
            self.demand, self.demand_speed, self._before = float(self.true), self.true_speed, None

    def _followed(self) -> SetPoint:
        """Set-point of an enabled drive in its mode."""
        values, mode, most = self.values, self.mode, self.values[od.MAX_TORQUE]
        feedforward, more = 0.0, 0.0  # torque, and speed
        if not values[od.CONTROLWORD] & HALT:
            self._take_over()
        if mode == 10:
            asked = values[od.TARGET_TORQUE] + values[od.TORQUE_OFFSET]
            torque = int(np.clip(asked, -most, most))
            self._bits = OF_MODE | (torque != asked) * LIMITED
            self.demand, self.demand_speed = float(self.encoder), 0.0
            return SetPoint(torque, self.demand, 0.0)
        if mode == 9:
            speed, feedforward = values[od.TARGET_VELOCITY] + values[od.VELOCITY_OFFSET], values[od.TORQUE_OFFSET]
            self._reach(self.demand + speed * self.period, OF_MODE)
        elif mode == 8:
            fastest, feedforward = values[od.MAX_SPEED], values[od.TORQUE_OFFSET]
            more = float(np.clip(values[od.VELOCITY_OFFSET], -fastest, fastest))
            self._reach(values[od.TARGET_POSITION] + values[od.POSITION_OFFSET] - self.offset, OF_MODE)
        elif mode == 6:
            return self._home()
        elif mode == 1:
            self._take_target()
            if values[od.CONTROLWORD] & HALT:
                return self._halted(self._bits & (OF_MODE | LIMITED))
            self._profile()
        elif mode == 7 and values[od.CONTROLWORD] & HALT:
            return self._halted(0)
        elif mode == 7 and values[od.CONTROLWORD] & START:
            self._reach(values[od.SET_POINT] - self.offset, OF_MODE)
        else:
            self.demand_speed, self._bits = 0.0, 0
        return SetPoint(None, self.demand, self.demand_speed + more, feedforward)

    def _halted(self, bits: int) -> SetPoint:
        """Set-point of a halt, by 605D; then the drive stays enabled."""
        point = self._slowed(self.values[od.HALT_OPTION])
        self._bits = bits | self._at_rest * REACHED
        return point

    def _reach(self, position: float, bits: int) -> None:
        """Follows a position [counts] within the limits of position and speed."""
        most = self.values[od.MAX_SPEED] * self.period
        within = float(np.clip(position, self.values[od.LOWEST] - self.offset, self.values[od.HIGHEST] - self.offset))
        step = float(np.clip(within - self.demand, -most, most))
        limited = within != position or step != within - self.demand
        self.demand, self.demand_speed = self.demand + step, step / self.period
        self._bits = bits | limited * LIMITED

    def _take_target(self) -> None:
        """Profile position: a new target at the rising edge of bit 4, which bit 12 acknowledges."""
        values, word = self.values, self.values[od.CONTROLWORD]
        if word & START and not self._word & START and (self._target is None or word & AT_ONCE):
            base = (self.demand if self._target is None else self._target) if word & RELATIVE else -self.offset
            target = base + values[od.TARGET_POSITION]
            low, high = values[od.LOWEST] - self.offset, values[od.HIGHEST] - self.offset
            self._target, self._bits = float(np.clip(target, low, high)), (not low <= target <= high) * LIMITED
        self._bits = self._bits & LIMITED | (OF_MODE if word & START else 0)

    def _profile(self) -> None:
        """The way to the target by a trapezoid of speed; without one, to rest."""
        values = self.values
        if self._target is None and self.demand_speed:
            rate = values[od.DECELERATION]
            self.demand, self.demand_speed = slowed(self.demand, self.demand_speed, rate, self.period)
        else:
            target = self.demand if self._target is None else self._target
            speed = min(values[od.PROFILE_SPEED], values[od.MAX_SPEED])
            rates = values[od.ACCELERATION], values[od.DECELERATION]
            self.demand, self.demand_speed = approach(
                self.demand, self.demand_speed, target, speed, *rates, self.period
            )
        there = self._target is not None and self.demand == self._target
        if there and abs(self.demand - self.encoder) <= values[od.REACHED]:
            self._target = None  # the next one may come
        if self._target is None and self.demand_speed == 0.0:
            self._bits |= REACHED

    def _home(self) -> SetPoint:
        """Homing: starts at the rising edge of bit 4; the position of home becomes the home offset."""
        values, word, homing = self.values, self.values[od.CONTROLWORD], self.homing
        if word & HALT or not word & START:
            homing.interrupt()
        elif not self._word & START:
            homing.begin(values[od.HOMING_METHOD], values[od.SEARCH_SPEED], values[od.HOME_SPEED])
        searched, speed = homing.running, homing.speed(self.inputs)
        if searched and homing.outcome == ATTAINED:
            self.offset = values[od.HOME_OFFSET] - self.encoder
        if homing.running:
            most, change = values[od.MAX_SPEED], values[od.HOMING_ACCELERATION] * self.period
            wanted = float(np.clip(speed, -most, most))
            self.demand_speed += float(np.clip(wanted - self.demand_speed, -change, change))
            self.demand += self.demand_speed * self.period
            point = SetPoint(None, self.demand, self.demand_speed)
        else:
            point = self._slowed(values[od.HALT_OPTION] if word & HALT else SLOW_RAMP)
        self._bits = homing.bits(at_rest=self._at_rest)
        return point

"""Rules of Feetech's STS servos. [Feetech2024] docs/bus-servos.md says which of them the maker's software shows and which
nobody has checked on a servo."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import ClassVar

from armwright.twin.serial.plant import Goal
from armwright.twin.serial.registers import Register
from armwright.twin.serial.servo import Servo, Status

OFF, ON, DAMPING, CENTRE = 0, 1, 2, 128  # of the torque switch; 128 makes the present position the middle one
FINE_SPEED, ZERO_IS_FASTEST, MULTI_TURN = 0x04, 0x08, 0x10  # bits of `phase`
VOLTAGE, TEMPERATURE, OVERCURRENT, OVERLOAD = 0x01, 0x04, 0x08, 0x20  # bits of status and protection
POSITION, SPEED, DUTY, STEP = 0, 1, 2, 3  # operating modes; the goal of the last one is counted from the goal before


class FeetechServo(Servo):
    """An STS servo. Values are sign and magnitude; the position shown is the encoder's less the offset."""

    def started(self) -> None:
        """The torque limit of the EEPROM is in force."""
        self["torque_limit"] = self["max_torque_limit"]
        self._lasted: dict[int, float] = {OVERCURRENT: 0.0, OVERLOAD: 0.0}  # [s]

    @property
    def error(self) -> int:
        """The status register, whose bit 7 is never set: the maker's software discards such answers."""
        return self["hardware_error_status"] & 0x7F

    def answers(self, instruction: str) -> bool:
        """Level 0 answers ping and reading alone."""
        return self["status_return_level"] > 0 or instruction in ("ping", "read", "sync-read")

    def read(self, address: int, count: int) -> Status:
        """Error byte and the bytes from an address on; 0 where the table has none."""
        self.show()
        count = min(count, self.model.framing.longest - 2)
        data = bytes(self.memory[address : address + count])
        return self.error, data + bytes(count - len(data))

    def write(self, address: int, data: bytes) -> int:
        """Writes registers. A value that is not allowed is not taken, without an error: the protocol has none for it."""
        self.show()
        self.store([each for each in self.overlaid(address, data) if self._allows(*each)])
        return self.error

    def _allows(self, register: Register, value: int) -> bool:
        if register.name == "torque_enable":
            return value in (OFF, ON, DAMPING, CENTRE)
        return register.writable and register.allows(value)

    def keep(self, *names: str) -> None:
        """Stores EEPROM registers if they are not locked: locked ones act, and are lost when the supply goes."""
        if not self["lock"]:
            super().keep(*names)

    # Positions.

    @property
    def turns(self) -> int:
        """Whole turns [counts] that the position shown leaves out."""
        if self["phase"] & MULTI_TURN:
            return 0
        return (round(self.now.position) - self["homing_offset"]) // self.model.counts * self.model.counts

    @property
    def _speed_unit(self) -> float:
        return self.model.units["speed" if self["phase"] & FINE_SPEED else "coarse_speed"]

    def show(self) -> None:
        """Puts what was measured into the registers that show it."""
        now, units = self.now, self.model.units
        self["present_position"] = round(now.position) - self["homing_offset"] - self.turns
        self["present_velocity"] = round(now.speed / self._speed_unit)
        self["present_load"] = round(now.load / units["duty"])
        self["present_voltage"] = round(10.0 * now.voltage)
        self["present_temperature"] = round(now.temperature)
        self["present_current"] = round(now.current / units["current"])
        self["moving"] = int(abs(now.speed) >= self._speed_unit * max(self["moving_threshold"], 1))
        self["target_position"] = self["target_position_2"] = self["goal_position"]

    @property
    def goal(self) -> Goal:
        """Command to the inner loop. Both limits 0 mean many turns; with damping the motor is short-circuited."""
        units, mode, switch = self.model.units, self["operating_mode"], self["torque_enable"]
        limit = self["torque_limit"] * units["duty"]
        if self.error & OVERLOAD:
            limit = min(limit, 0.01 * self["holding_torque"])
        off = self.error & self["shutdown"] & (VOLTAGE | TEMPERATURE | OVERCURRENT)
        common = {
            "torque": switch != OFF and not off,
            "limit": limit,
            "gains": self._gains,
            "dead_band": self._dead_band,
        }
        if switch == DAMPING:
            return Goal(mode="duty", **common)
        if mode == SPEED:
            return Goal(mode="speed", value=self["profile_velocity"] * self._speed_unit, **common)
        if mode == DUTY:
            return Goal(mode="duty", value=self["goal_pwm"] * units["duty"], **common)
        low, high, position = self["min_position_limit"], self["max_position_limit"], self["goal_position"]
        if low or high:
            position = max(min(position, high), low)
        speed = abs(self["profile_velocity"]) * self._speed_unit
        return Goal(
            value=position + self["homing_offset"] + self.turns,
            speed=speed if speed or not self["phase"] & ZERO_IS_FASTEST else math.inf,
            acceleration=self["profile_acceleration"] * units["acceleration"] or math.inf,
            **common,
        )

    @property
    def _gains(self) -> tuple[int, int, int]:
        return self["position_p_gain"], self["position_i_gain"], self["position_d_gain"]

    @property
    def _dead_band(self) -> tuple[int, int]:
        return self["cw_dead_band"], self["ccw_dead_band"]

    # What follows from writes.

    def _torque(self, old: int) -> None:
        if self["torque_enable"] == CENTRE:
            self["torque_enable"] = old
            middle = self.model.counts // 2
            self["homing_offset"] = round(self.now.position) % self.model.counts - middle
            self.keep("homing_offset")
            self.hold()
            return
        self["hardware_error_status"] &= ~(OVERCURRENT | OVERLOAD)
        self._lasted = dict.fromkeys(self._lasted, 0.0)
        self.torque_switched(old)

    def _position(self, old: int) -> None:
        """A goal switches torque on. One that lies on the other side than the load ends an overload."""
        if self["operating_mode"] == STEP:
            self["goal_position"] += old
        if (self["goal_position"] - self["present_position"]) * self.now.load <= 0.0:
            self["hardware_error_status"] &= ~OVERLOAD
            self._lasted[OVERLOAD] = 0.0
        self["torque_enable"] = self["torque_enable"] or ON
        self._goal_written = True

    effects: ClassVar[Mapping[str, Callable[..., None]]] = {"torque_enable": _torque, "goal_position": _position}

    def hear(self) -> None:
        """Nothing: an STS has no watchdog of the bus."""

    def watch(self, seconds: float) -> None:
        """Supply and temperature as they are; load and current if they last."""
        now, status = self.now, self["hardware_error_status"]
        supplied = self["min_voltage_limit"] <= 10.0 * now.voltage <= self["max_voltage_limit"]
        status = status & ~(VOLTAGE | TEMPERATURE) | (not supplied) * VOLTAGE
        status |= (now.temperature >= self["temperature_limit"]) * TEMPERATURE
        current = self["protection_current"] * self.model.units["current"]
        for bit, beyond, allowed in (
            (OVERLOAD, abs(now.load) >= 0.01 * self["overload_torque"], self["overload_time"]),
            (OVERCURRENT, abs(now.current) >= current, self["overcurrent_time"]),
        ):
            self._lasted[bit] = (self._lasted[bit] + seconds) * beyond
            if beyond and self["shutdown"] & bit and self._lasted[bit] > 0.01 * allowed:
                status |= bit
        self["hardware_error_status"] = status

"""Rules of Dynamixel's X series. [Robotis2024] docs/bus-servos.md says which of them the maker's software shows and which nobody
has checked on a servo."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import ClassVar

from armwright.twin.serial.plant import Goal
from armwright.twin.serial.registers import Register
from armwright.twin.serial.servo import Servo, Status

FAIL, RANGE, LENGTH, LIMIT, ACCESS, ALERT = 1, 4, 5, 6, 7, 0x80  # errors; the last one is a bit beside them
CURRENT, VELOCITY, POSITION, EXTENDED, CURRENT_POSITION, PWM = 0, 1, 3, 4, 5, 16  # operating modes
REVERSE, TIMED_PROFILE = 0x01, 0x04  # bits of the drive mode
VOLTAGE, TEMPERATURE = 0x01, 0x04  # bits of the hardware error status
WATCHDOG, EXPIRED = 0.02, -1  # [s] of one count of the watchdog; its value when it has run out
GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
LIMITS = {"goal_pwm": "pwm_limit", "goal_current": "current_limit", "goal_velocity": "velocity_limit"}
CLEAR_TURNS = b"\x01\x44\x58\x4c\x22"
KEPT_BY_RESET = {0xFF: (), 1: ("id",), 2: ("id", "baud_rate")}  # by option


class DynamixelServo(Servo):
    """A servo of the X series. Values are two's complement; the position shown is the encoder's plus the offset."""

    def started(self) -> None:
        """Goals that act as limits are the limits; no goal moves a motor."""
        self._silent, self._seconds, self._turned = 0.0, 0.0, 0
        self.started_goals()

    def started_goals(self) -> None:
        """Goals of duty, current and speed as after power-up or another operating mode."""
        mode = self["operating_mode"]
        for goal, still in (("goal_pwm", PWM), ("goal_current", CURRENT), ("goal_velocity", mode)):
            if goal in self:
                self[goal] = 0 if mode == still else self[LIMITS[goal]]

    @property
    def error(self) -> int:
        """The alert bit, set while the hardware error status is not 0."""
        return ALERT if self["hardware_error_status"] else 0

    def answers(self, instruction: str) -> bool:
        """Level 0 answers ping, 1 reading too, 2 everything."""
        level = self["status_return_level"]
        return level > 1 or instruction == "ping" or (level == 1 and instruction.endswith("read"))

    def read(self, address: int, count: int) -> Status:
        """Error byte and the bytes from an address on; 0 between registers, an error behind the last one."""
        if not count or address + count > self.model.size:
            return self.error | ACCESS, b""
        self.show()
        return self.error, bytes(self.memory[address : address + count])

    def write(self, address: int, data: bytes) -> int:
        """Writes registers, all or none; returns the error byte."""
        self.show()
        values = self.overlaid(address, data)
        mistake = self._mistake(address, data, values)
        if not mistake:
            self.store(values)
        return self.error | mistake

    def _mistake(self, address: int, data: bytes, values: list[tuple[Register, int]]) -> int:
        covered = sum(register.size for register, _ in values)
        if not data or not values or not all(register.writable for register, _ in values):
            return ACCESS
        if values[0][0].address < address or values[-1][0].end > address + len(data):
            return LENGTH
        if covered != len(data) or (address < self.model.eeprom and self["torque_enable"]):
            return ACCESS
        if not all(register.allows(value) for register, value in values):
            return RANGE
        names = [register.name for register, _ in values]
        if self["bus_watchdog"] == EXPIRED and any(name in GOALS for name in names):
            return RANGE
        return 0 if all(self._within(register.name, value) for register, value in values) else LIMIT

    def _within(self, name: str, value: int) -> bool:
        """True if a value keeps the limits that other registers set."""
        if name == "operating_mode":
            return value in (VELOCITY, POSITION, EXTENDED, PWM) or ("goal_current" in self and value in (0, 5))
        if name == "goal_position" and self["operating_mode"] == POSITION:
            return self["min_position_limit"] <= value <= self["max_position_limit"]
        return name not in LIMITS or abs(value) <= self[LIMITS[name]]

    # Positions.

    @property
    def _sign(self) -> int:
        return -1 if self["drive_mode"] & REVERSE else 1

    @property
    def turns(self) -> int:
        """Whole turns [counts] that the position shown leaves out."""
        return self._turned

    def _forget_turns(self) -> None:
        """The encoder knows where it is within one turn only."""
        self._turned = round(self._sign * self.now.position) // self.model.counts * self.model.counts

    def settle(self) -> None:
        """First measurement after power-up: positions are counted within one turn."""
        self._forget_turns()
        self.hold()

    def show(self) -> None:
        """Puts what was measured into the registers that show it."""
        now, units, sign = self.now, self.model.units, self._sign
        self["present_position"] = round(sign * now.position) - self._turned + self["homing_offset"]
        self["present_velocity"] = round(sign * now.speed / units["speed"])
        self["present_pwm"] = round(sign * now.load / units["duty"])
        if "present_current" in self:
            self["present_current"] = round(sign * now.current / units["current"])
        else:
            self["present_load"] = round(1000.0 * sign * now.load)
        self["present_voltage"] = round(10.0 * now.voltage)
        self["present_temperature"] = round(now.temperature)
        self["moving"] = int(abs(self["present_velocity"]) > self["moving_threshold"])
        self["realtime_tick"] = int(1000.0 * self._seconds) % 32768
        self["position_trajectory"] = self["goal_position"]

    @property
    def goal(self) -> Goal:
        """Command to the inner loop. A profile by time is not served: it counts as one without limits."""
        units, mode, sign = self.model.units, self["operating_mode"], self._sign
        by_speed = not self["drive_mode"] & TIMED_PROFILE
        name, value = {
            CURRENT: ("current", self._amperes("goal_current")),
            VELOCITY: ("speed", self["goal_velocity"] * units["speed"]),
            PWM: ("duty", self["goal_pwm"] * units["duty"]),
        }.get(mode, ("position", self["goal_position"] - self["homing_offset"] + self._turned))
        return Goal(
            torque=bool(self["torque_enable"]),
            mode=name,
            value=sign * value,
            speed=by_speed * self["profile_velocity"] * units["speed"] or math.inf,
            acceleration=by_speed * self["profile_acceleration"] * units["acceleration"] or math.inf,
            limit=min(abs(self["pwm_limit" if mode == PWM else "goal_pwm"]) * units["duty"], 1.0),
            current=abs(self._amperes("goal_current" if mode == CURRENT_POSITION else "current_limit")),
            gains=(self["position_p_gain"], self["position_i_gain"], self["position_d_gain"]),
        )

    def _amperes(self, name: str) -> float:
        """A current [A], inf for a model that limits none."""
        return self[name] * self.model.units["current"] if name in self else math.inf

    # What follows from writes.

    def _torque(self, old: int) -> None:
        """A fault that shuts down keeps the motor off until a reboot."""
        if self["hardware_error_status"] & self["shutdown"]:
            self["torque_enable"] = 0
        self._silent = 0.0
        self.torque_switched(old)

    def _mode(self, old: int) -> None:
        self.started_goals()
        self.hold()

    def _position(self, old: int) -> None:
        self._goal_written = True

    def _watchdog(self, old: int) -> None:
        self._silent = 0.0

    effects: ClassVar[Mapping[str, Callable[..., None]]] = {
        "torque_enable": _torque,
        "operating_mode": _mode,
        "goal_position": _position,
        "bus_watchdog": _watchdog,
    }

    # Time.

    def hear(self) -> None:
        """Any instruction on the bus keeps the watchdog quiet."""
        self._silent = 0.0

    def watch(self, seconds: float) -> None:
        """Supply and temperature, which switch torque off where `shutdown` says so; the bus watchdog."""
        now, status = self.now, self["hardware_error_status"]
        supplied = self["min_voltage_limit"] <= 10.0 * now.voltage <= self["max_voltage_limit"]
        status |= (not supplied) * VOLTAGE | (now.temperature > self["temperature_limit"]) * TEMPERATURE
        self["hardware_error_status"] = status
        if status & self["shutdown"]:
            self["torque_enable"] = 0
        self._seconds += seconds
        self._silent += seconds
        limit = self["bus_watchdog"]
        if self["torque_enable"] and limit > 0 and self._silent > WATCHDOG * limit:
            self["bus_watchdog"] = EXPIRED
            for name in ("profile_acceleration", "profile_velocity", "goal_velocity"):
                self[name] = 0
            if self["operating_mode"] in (PWM, CURRENT):
                self["goal_pwm" if self["operating_mode"] == PWM else "goal_current"] = 0
            self.hold()

    # Instructions that Feetech does not have.

    def _ping(self, rest: bytes) -> Status:
        model = self.model.by_name["model_number"]
        return self.error, bytes(self.memory[model.address : model.end]) + bytes((self["firmware_version"],))

    def _reboot(self, rest: bytes) -> Status:
        self.power_up()
        return self.error, b""

    def _reset(self, rest: bytes) -> Status | None:
        if len(rest) != 1 or rest[0] not in KEPT_BY_RESET:
            return self.error | RANGE, b""
        kept = {name: self[name] for name in KEPT_BY_RESET[rest[0]]}
        self.factory()
        for name, value in kept.items():
            self[name] = value
        self.keep(*self.model.by_name)
        self.power_up()
        return self.error, b""

    def _clear(self, rest: bytes) -> Status:
        """Counts the position within one turn again."""
        if rest != CLEAR_TURNS:
            return self.error | RANGE, b""
        self.show()
        if self["moving"]:
            return self.error | FAIL, b""
        self._forget_turns()
        self.hold()
        return self.error, b""

    nothing_registered: ClassVar[int] = 2
    actions: ClassVar[Mapping[str, tuple[Callable[..., Status | None], int]]] = {
        **Servo.actions,
        "ping": (_ping, 0),
        "reset": (_reset, 0),
        "reboot": (_reboot, 0),
        "clear": (_clear, 0),
    }

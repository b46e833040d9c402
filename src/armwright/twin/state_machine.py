"""State machine of the power drive system of CiA 402, as one table of its transitions. [IEC2015]

A command is what bits 0 to 3 and 7 of the controlword say; an event is something that happens within the drive. The table is
the whole machine: what has no row changes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class State(Enum):
    """States with the statusword's bits 0, 1, 2, 3, 5 and 6 in them."""

    NOT_READY = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY = 0x21
    SWITCHED_ON = 0x23
    ENABLED = 0x27  # operation enabled: the motor follows set-points
    QUICK_STOP = 0x07
    REACTION = 0x0F  # fault reaction active
    FAULT = 0x08


POWERED = (State.ENABLED, State.QUICK_STOP, State.REACTION)  # the motor has torque
HELD = tuple(state for state in State if state not in POWERED)  # the brake holds the joint


class Command(Enum):
    """Commands of the controlword: (mask, bits)."""

    FAULT_RESET = (0x80, 0x80)  # its rising edge
    DISABLE_VOLTAGE = (0x02, 0x00)
    QUICK_STOP = (0x06, 0x02)
    SHUTDOWN = (0x07, 0x06)
    SWITCH_ON = (0x0F, 0x07)  # in operation enabled: disable operation
    ENABLE = (0x0F, 0x0F)


class Event(Enum):
    """Events within the drive."""

    STARTED = "power is there"
    INITIALISED = "initialisation is done"
    FAULT = "a fault was found"
    REACTED = "the reaction to the fault is done"
    STOPPED = "the quick stop has come to rest"


@dataclass(frozen=True)
class Transition:
    """A row of the table: number in the standard, state before, trigger, state after."""

    number: int
    source: State
    cause: Command | Event
    target: State


TRANSITIONS = (
    Transition(0, State.NOT_READY, Event.STARTED, State.NOT_READY),
    Transition(1, State.NOT_READY, Event.INITIALISED, State.SWITCH_ON_DISABLED),
    Transition(2, State.SWITCH_ON_DISABLED, Command.SHUTDOWN, State.READY),
    Transition(3, State.READY, Command.SWITCH_ON, State.SWITCHED_ON),
    Transition(3, State.READY, Command.ENABLE, State.SWITCHED_ON),  # 4 follows at the next word
    Transition(4, State.SWITCHED_ON, Command.ENABLE, State.ENABLED),
    Transition(5, State.ENABLED, Command.SWITCH_ON, State.SWITCHED_ON),
    Transition(6, State.SWITCHED_ON, Command.SHUTDOWN, State.READY),
    Transition(7, State.READY, Command.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    Transition(7, State.READY, Command.QUICK_STOP, State.SWITCH_ON_DISABLED),
    Transition(8, State.ENABLED, Command.SHUTDOWN, State.READY),
    Transition(9, State.ENABLED, Command.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    Transition(10, State.SWITCHED_ON, Command.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    Transition(10, State.SWITCHED_ON, Command.QUICK_STOP, State.SWITCH_ON_DISABLED),
    Transition(11, State.ENABLED, Command.QUICK_STOP, State.QUICK_STOP),
    Transition(12, State.QUICK_STOP, Command.DISABLE_VOLTAGE, State.SWITCH_ON_DISABLED),
    Transition(12, State.QUICK_STOP, Event.STOPPED, State.SWITCH_ON_DISABLED),
    *(
        Transition(13, state, Event.FAULT, State.REACTION)
        for state in State
        if state not in (State.REACTION, State.FAULT)
    ),
    Transition(14, State.REACTION, Event.REACTED, State.FAULT),
    Transition(15, State.FAULT, Command.FAULT_RESET, State.SWITCH_ON_DISABLED),
    Transition(16, State.QUICK_STOP, Command.ENABLE, State.ENABLED),
)
NEXT = {(row.source, row.cause): row for row in TRANSITIONS}


def commanded(word: int, last: int) -> Command | None:
    """The command of a controlword; None if its bits match no command.

    Args:
        word: the controlword.   last: the one before, since a fault is reset by a rising edge.
    """
    if word & ~last & 0x80:
        return Command.FAULT_RESET
    return next((each for each in list(Command)[1:] if word & each.value[0] == each.value[1]), None)


class StateMachine:
    """The state of one drive.

    Attributes:
        state: where it is.   word: the last controlword.   passed: numbers of the transitions that it made, in order.
    """

    def __init__(self) -> None:
        self.state, self.word = State.NOT_READY, 0
        self.passed: list[int] = []
        self.happened(Event.STARTED)
        self.happened(Event.INITIALISED)

    def command(self, word: int, *, resettable: bool = True) -> Transition | None:
        """Makes the transition that a controlword causes, and returns it; None if it causes none.

        Args:
            word: the controlword.   resettable: False while the cause of a fault persists, which then stays.
        """
        cause, self.word = commanded(word, self.word), word
        if cause is None or (cause is Command.FAULT_RESET and not resettable):
            return None
        return self._made(cause)

    def happened(self, event: Event) -> Transition | None:
        """Makes the transition that an event causes, and returns it; None if it causes none."""
        return self._made(event)

    def _made(self, cause: Command | Event) -> Transition | None:
        row = NEXT.get((self.state, cause))
        if row is not None:
            self.state = row.target
            self.passed.append(row.number)
        return row

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
    """Commands of the controlword: (mask, bits). Bit 7 is in every mask: a word that has it set is no other command."""

    FAULT_RESET = (0x80, 0x80)  # its rising edge
    DISABLE_VOLTAGE = (0x82, 0x00)
    QUICK_STOP = (0x86, 0x02)
    SHUTDOWN = (0x87, 0x06)
    SWITCH_ON = (0x8F, 0x07)  # in operation enabled: disable operation
    ENABLE = (0x8F, 0x0F)  # in ready to switch on: switch on and enable operation


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
    Transition(3, State.READY, Command.ENABLE, State.SWITCHED_ON),  # 4 follows by itself
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
    Transition(16, State.QUICK_STOP, Command.ENABLE, State.ENABLED),  # where 605A stays in quick stop active
)
NEXT = {(row.source, row.cause): row for row in TRANSITIONS}
CODES = tuple(  # commands by the low bits of the controlword, bit 7 clear
    next((each for each in list(Command)[1:] if word & each.value[0] == each.value[1]), None) for word in range(16)
)


def commanded(word: int, last: int) -> Command | None:
    """The command of a controlword; None if its bits match no command.

    Args:
        word: the controlword.   last: the one before, since a fault is reset by a rising edge.
    """
    if word & 0x80:
        return None if last & 0x80 else Command.FAULT_RESET
    return CODES[word & 0x0F]


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

    def command(self, word: int, *, resettable: bool = True, resumable: bool = True) -> Transition | None:
        """Makes the transition that a controlword causes, and returns it; None if it causes none.

        Args:
            word: the controlword.   resettable: False while the cause of a fault persists, which then stays.
            resumable: False where a quick stop must end in switch on disabled: without transition 16.
        """
        cause, self.word = commanded(word, self.word), word
        if cause is None or (cause is Command.FAULT_RESET and not resettable):
            return None
        if cause is Command.ENABLE and self.state is State.QUICK_STOP and not resumable:
            return None
        return self.happened(cause)

    def proceed(self) -> Transition | None:
        """Makes transition 4 where 3 was made by a word that enables as well, and returns it."""
        both = self.state is State.SWITCHED_ON and self.passed[-1:] == [3]
        return self.happened(Command.ENABLE) if both and commanded(self.word, self.word) is Command.ENABLE else None

    def happened(self, cause: Command | Event) -> Transition | None:
        """Makes the transition that an event or a command causes, and returns it; None if it causes none."""
        row = NEXT.get((self.state, cause))
        if row is not None:
            self.state = row.target
            self.passed.append(row.number)
        return row

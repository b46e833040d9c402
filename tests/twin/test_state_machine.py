"""The state machine of CiA 402, cell by cell, by the tables of documents and by the canopen package's own.

The tables of commands, of transitions and of the statusword below were written from what these manuals print of IEC 61800-7-201
(CiA 402-2), and they agree; not from the code:

    Nanotec, PD6-E EtherNet/IP technical manual, "CiA 402 Power State Machine": commands with bits and transitions, statusword
    ABB, FEPL-02 Ethernet POWERLINK adapter user's manual, page 79: commands with bits and transitions; 3 goes on to 4 by itself
    Toshiba, TOSVERT VF-S15 CANopen option, 6.1.2: command coding of DSP-402 V3.0, table 27; masks of words and of states
    MovingCap, MC-ETH software manual, "Controlword 6040h": transitions 4 and 16 by "enable operation"
    Beckhoff, AX8000, object 605A: 2 goes into switch on disabled, 6 stays in quick stop active
"""

import itertools

import pytest

from armwright.twin import objects as od
from armwright.twin.drive import TwinDrive
from armwright.twin.state_machine import TRANSITIONS, Command, Event, State, StateMachine, commanded

p402 = pytest.importorskip("canopen.profiles.p402", reason='the independent table: pip install "armwright[twin]"')
NAMES = {
    State.NOT_READY: "NOT READY TO SWITCH ON",
    State.SWITCH_ON_DISABLED: "SWITCH ON DISABLED",
    State.READY: "READY TO SWITCH ON",
    State.SWITCHED_ON: "SWITCHED ON",
    State.ENABLED: "OPERATION ENABLED",
    State.QUICK_STOP: "QUICK STOP ACTIVE",
    State.REACTION: "FAULT REACTION ACTIVE",
    State.FAULT: "FAULT",
}


# command: bits 7 3 2 1 0 of the controlword, X for either; its transitions
COMMANDS = """
    shutdown             0 X 1 1 0    2 6 8
    switch-on            0 0 1 1 1    3 5
    enable-operation     0 1 1 1 1    3 4 16
    disable-voltage      0 X X 0 X    7 9 10 12
    quick-stop           0 X 0 1 X    7 10 11
    fault-reset          R X X X X    15
"""
# number of the transition: state before, state after
DIAGRAM = """
    2 SWITCH_ON_DISABLED READY
    3 READY SWITCHED_ON
    4 SWITCHED_ON ENABLED
    5 ENABLED SWITCHED_ON
    6 SWITCHED_ON READY
    7 READY SWITCH_ON_DISABLED
    8 ENABLED READY
    9 ENABLED SWITCH_ON_DISABLED
    10 SWITCHED_ON SWITCH_ON_DISABLED
    11 ENABLED QUICK_STOP
    12 QUICK_STOP SWITCH_ON_DISABLED
    15 FAULT SWITCH_ON_DISABLED
    16 QUICK_STOP ENABLED
"""
STATUS = """
    NOT_READY x0xx0000
    SWITCH_ON_DISABLED x1xx0000
    READY x01x0001
    SWITCHED_ON x01x0011
    ENABLED x01x0111
    QUICK_STOP x00x0111
    REACTION x0xx1111
    FAULT x0xx1000
"""


def rows(table):
    return [line.split() for line in table.strip().splitlines()]


WAYS = {int(number): (State[before], State[after]) for number, before, after in rows(DIAGRAM)}
STAYING = (5, 6, 7)  # values of 605A that stay in quick stop active, from where 16 leads; 8 is a limit of voltage
LEAVING = (0, 1, 2, 3)  # those that go into switch on disabled


def asked(state, last, word):
    """Transition that the tables give for a word after another: its number and the state after it; none: (None, state)."""
    for row in rows(COMMANDS):
        bits, numbers = row[1:6], [int(each) for each in row[6:]]
        matches = all(
            b == "X" or b == "R" or int(b) == word >> k & 1 for b, k in zip(bits, (7, 3, 2, 1, 0), strict=True)
        )
        rises = bool(word & ~last & 0x80)
        if matches and (bits[0] != "R" or rises):
            for number in numbers:
                if WAYS[number][0] is state:
                    return number, WAYS[number][1]
    return None, state


def differing(state, option=2, hot=False):
    """Cells of one state in which the drive does something else than the table says, and the number of cells.

    A cell is a pair of low bytes: the controlword before, and the present one, of a drive whose joint is at rest.
    """
    drive = TwinDrive("joint", {od.QUICK_STOP_OPTION: option}, 4e-3)
    drive.hot, machine, wrong, cells = hot, drive.machine, [], 0
    expected = {(edge, word): asked(state, edge, word) for edge in (0x00, 0x80) for word in range(256)}
    for last in range(256):
        for word in range(256):
            number, after = expected[last & 0x80, word]
            if (number == 16 and option not in STAYING) or (number == 15 and hot):
                number, after = None, state
            machine.state, machine.word = state, last
            machine.passed.clear()
            drive.command(word)
            cells += 1
            if machine.state is not after or machine.passed != ([] if number is None else [number]):
                wrong.append((state.name, option, hex(last), hex(word), machine.state.name, after.name))
    return wrong, cells


def test_every_cell_is_that_of_the_standards_table():
    """8 states x 256 words before x 256 words; quick stop active for each value of 605A, fault with its cause there as well."""
    lines = [(state, 2, False) for state in State if state is not State.QUICK_STOP]
    lines += [(State.QUICK_STOP, option, False) for option in (*LEAVING, *STAYING)]
    lines += [(State.FAULT, 2, True)]
    found = [differing(*line) for line in lines]
    assert [cell for wrong, _ in found for cell in wrong] == []
    assert sum(cells for _, cells in found) == 983_040 == 15 * 256 * 256


@pytest.mark.parametrize("state", State)
def test_the_high_byte_is_no_command(state):
    for word in range(256):
        found = machine(state), machine(state)
        assert found[0].command(word) == found[1].command(word | 0xFF00)


def test_ready_to_switch_on_goes_on_to_operation_enabled_by_itself():
    """Switch on with enable operation, 0x0F: transition 3, and 4 when what 3 asks for is done: a SYNC later at the latest."""
    drive = TwinDrive("joint", {od.MODE: 8}, 4e-3)
    drive.measured(0, 0, 0)
    drive.command(0x06)
    drive.command(0x0F)
    assert drive.state is State.SWITCHED_ON
    drive.tick(received=False)
    assert drive.state is State.ENABLED
    assert drive.machine.passed == [0, 1, 2, 3, 4]
    drive.command(0x07)
    drive.tick(received=False)
    assert drive.state is State.SWITCHED_ON


def test_the_statusword_shows_the_state():
    for name, pattern in rows(STATUS):
        for k, bit in enumerate(reversed(pattern)):
            assert bit == "x" or int(bit) == State[name].value >> k & 1, name


def machine(state):
    found = StateMachine()
    found.state = state
    return found


def test_there_are_all_transitions_of_the_standard():
    assert {row.number for row in TRANSITIONS} == set(range(17))
    ends = {}
    for row in TRANSITIONS:
        if isinstance(row.cause, Command):  # a number is one way from state to state, whatever asks for it
            assert ends.setdefault(row.number, (row.source, row.target)) == (row.source, row.target)
    assert len(set(ends.values())) == len(ends)


def test_canopen_names_every_state_by_its_statusword():
    for state, name in NAMES.items():
        mask, bits = p402.State402.SW_MASK[name]
        assert state.value & mask == bits
        others = [n for n, (m, b) in p402.State402.SW_MASK.items() if state.value & m == b]
        assert others == [name]


@pytest.mark.parametrize(("way", "word"), [(k, v) for k, v in p402.State402.TRANSITIONTABLE.items() if v])
def test_canopens_words_do_what_its_table_says(way, word):
    states = {name: state for state, name in NAMES.items()}
    source, target = (states[name] for name in way)
    found = machine(source)
    found.command(word)
    assert found.state is target


def test_what_is_not_in_the_table_changes_nothing():
    rows = {(row.source, row.cause) for row in TRANSITIONS}
    for state, command in itertools.product(State, Command):
        if (state, command) not in rows:
            found = machine(state)
            assert found.command(command.value[1]) is None
            assert found.state is state


def test_a_fault_is_reset_by_an_edge_and_only_without_its_cause():
    found = machine(State.FAULT)
    found.word = 0x80
    assert found.command(0x80) is None
    found.command(0x00)
    assert found.command(0x80, resettable=False) is None
    found.command(0x00)
    assert found.command(0x80).number == 15


def test_every_state_but_faults_goes_into_fault_reaction():
    for state in State:
        found = machine(state)
        row = found.happened(Event.FAULT)
        assert (row is None) == (state in (State.REACTION, State.FAULT))
        assert row is None or (row.number == 13 and found.state is State.REACTION)
    assert found.state is State.FAULT


def test_every_word_is_at_most_one_command():
    for word in range(256):
        masks = [c for c in list(Command)[1:] if word & c.value[0] == c.value[1]]
        assert len(masks) <= (not word & 0x80)  # none with bit 7
        assert commanded(word, word) is (masks[0] if masks else None)

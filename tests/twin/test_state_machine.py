"""The state machine of CiA 402: its transitions by the canopen package's own table, and what the standard says of its edges."""

import itertools

import pytest

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


def machine(state):
    found = StateMachine()
    found.state = state
    return found


def test_there_are_all_transitions_of_the_standard():
    assert {row.number for row in TRANSITIONS} == set(range(17))


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
        assert len(masks) <= 1
        assert commanded(word, word) is (masks[0] if masks else None)

"""Conditions of agents: the commands that change them, and the agents concerned."""

from math import nan
from typing import get_args

import pytest

from phalanx.faults.commands import (
    EFFECTS,
    LINK_COMMANDS,
    ActiveCommands,
    Command,
    CommandKind,
    Condition,
    FaultState,
    refusal,
    turns,
)
from phalanx.faults.process import ProcessFault

KILL, RESTART = CommandKind.KILL, CommandKind.RESTART
FREEZE, THAW, TURN = CommandKind.FREEZE, CommandKind.THAW, CommandKind.TURN
HIJACK = CommandKind.HIJACK


def after(*kinds: CommandKind) -> tuple[Condition, bool]:
    """Return agent a's condition after these commands, and whether the last one changed it."""
    state = FaultState(("b", "a"))
    changed = [state.apply(Command(0.0, kind, "a")) for kind in kinds]
    assert state.condition[0] is Condition.FINE
    return state.condition[1], changed[-1] == 1


@pytest.mark.parametrize(
    ("kinds", "condition"),
    [
        ((KILL,), Condition.DEAD),
        ((FREEZE,), Condition.FROZEN),
        ((FREEZE, THAW), Condition.FINE),
        ((FREEZE, KILL), Condition.DEAD),
        ((KILL, RESTART), Condition.FINE),
        ((TURN,), Condition.TURNED),
        ((TURN, FREEZE, THAW), Condition.TURNED),
        ((HIJACK,), Condition.TURNED),
        ((TURN, KILL, RESTART), Condition.TURNED),
    ],
)
def test_a_command_leads_on_from_the_conditions_that_it_fits(kinds, condition):
    assert after(*kinds) == (condition, True)


@pytest.mark.parametrize(
    ("kinds", "condition"),
    [
        ((RESTART,), Condition.FINE),
        ((THAW,), Condition.FINE),
        ((FREEZE, RESTART), Condition.FROZEN),
        ((FREEZE, FREEZE), Condition.FROZEN),
        ((FREEZE, TURN), Condition.FROZEN),
        ((KILL, KILL), Condition.DEAD),
        ((KILL, FREEZE), Condition.DEAD),
        ((KILL, THAW), Condition.DEAD),
        ((KILL, TURN), Condition.DEAD),
        ((TURN, TURN), Condition.TURNED),
        ((TURN, HIJACK), Condition.TURNED),
        ((HIJACK, TURN), Condition.TURNED),
    ],
)
def test_in_any_other_condition_a_command_has_no_effect(kinds, condition):
    assert after(*kinds) == (condition, False)


@pytest.mark.parametrize(("kind", "most"), [(CommandKind.LOSS, 1.0), (CommandKind.DELAY, 1e6)])
def test_a_command_has_no_more_than_the_largest_value(kind, most):
    values = {-0.1: True, 0.0: False, most / 2: False, most: False, 1.1 * most: True, nan: True}
    assert {v: bool(refusal(Command(0.0, kind, value=v), ())) for v in values} == values


@pytest.mark.parametrize("kind", EFFECTS)
def test_a_command_concerns_an_agent_that_there_is(kind):
    assert [refusal(Command(0.0, kind, name), ("a", "b")) for name in "ab"] == [None, None]
    assert refusal(Command(0.0, kind, "c"), ("a", "b")) == "agent: expected one of a, b, got 'c'"


def test_failures_are_all_that_harms_agents_or_links():
    harmless = {RESTART, THAW, CommandKind.SPEED, CommandKind.PAUSE, CommandKind.STEP}
    kinds = {kind for kind in CommandKind if not Command(0.0, kind, "a").is_failure}
    assert kinds & {*EFFECTS, *LINK_COMMANDS} == harmless & {*EFFECTS}
    assert kinds >= harmless


def test_only_the_frozen_and_the_dead_are_silent():
    state = FaultState(("a",))
    silent = []
    for kind in (TURN, FREEZE, THAW, KILL, RESTART):
        state.apply(Command(0.0, kind, "a"))
        silent.append(state.condition[0].silent)
    assert silent == [False, True, False, True, False]


def test_active_commands_are_those_on_links_and_the_agents_own_turn():
    state = FaultState(("a", "b"))
    assert state.active_commands(0) is None
    state.apply(Command(0.0, TURN, "a"))
    assert state.active_commands(1) is None
    assert state.active_commands(0).adversary
    assert not state.active_commands(0).hidden
    state.apply(Command(0.0, CommandKind.LOSS, value=0.25))
    state.apply(Command(0.0, CommandKind.DELAY, value=0.5))
    assert state.active_commands(1) == ActiveCommands(loss=0.25, delay=0.5)


def test_a_hijacked_agent_hides_its_attack():
    state = FaultState(("a", "b"))
    state.apply(Command(0.0, HIJACK, "b"))
    assert state.active_commands(0) is None
    assert state.active_commands(1) == ActiveCommands(adversary=True, hidden=True)


def test_a_turn_counts_from_when_it_has_an_effect():
    commands = [
        Command(0.1, FREEZE, "a"),
        Command(0.2, TURN, "a"),  # it stands still
        Command(0.3, TURN, "b"),
        Command(0.4, TURN, "b"),
        Command(0.5, THAW, "a"),
        Command(0.6, TURN, "a"),
        Command(0.7, FREEZE, "b"),
        Command(0.8, THAW, "b"),  # an adversary, as before
    ]
    assert turns(("a", "b"), commands) == {"b": 0.3, "a": 0.6}


def test_every_command_is_on_an_agent_on_links_or_on_the_pace():
    pace = {CommandKind.PAUSE, CommandKind.RESUME, CommandKind.STEP, CommandKind.SPEED}
    assert set(CommandKind) == EFFECTS.keys() | LINK_COMMANDS | pace
    assert not EFFECTS.keys() & (LINK_COMMANDS | pace)


@pytest.mark.parametrize("fault", get_args(ProcessFault))
def test_a_fault_of_processes_begins_with_a_command_that_harms_and_ends_with_one_that_does_not(
    fault,
):
    assert EFFECTS[fault.begins_with].is_failure
    assert fault.ends_with is None or not EFFECTS[fault.ends_with].is_failure

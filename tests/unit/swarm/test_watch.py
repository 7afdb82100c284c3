"""Agents that were taken over: how they attack, and windows in which others watch them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.network.inbox import AnnouncedInput
from phalanx.swarm.attack import Attack
from phalanx.swarm.watch import covering
from tests.unit.swarms import rows_of_scenario

SENT = {k: AnnouncedInput(0.01 * k, (float(k),)) for k in range(10)}


def test_a_window_within_one_input_has_one_part():
    ((claim, seconds),) = covering(SENT, 0.031, 0.036) or []
    assert claim.u == (3.0,)
    assert seconds == pytest.approx(0.005)


def test_a_window_that_straddles_an_apply_time_is_split_there():
    parts = covering(SENT, 0.035, 0.052) or []
    assert [claim.u for claim, _ in parts] == [(3.0,), (4.0,), (5.0,)]
    assert [seconds for _, seconds in parts] == pytest.approx([0.005, 0.01, 0.002])


@pytest.mark.slow
@given(lost=st.sets(st.integers(0, 9)), begin=st.floats(0.0, 0.08), length=st.floats(1e-3, 0.05))
def test_a_lost_broadcast_leaves_its_windows_unchecked(lost, begin, length):
    arrived = {k: claim for k, claim in SENT.items() if k not in lost}
    parts, end = covering(arrived, begin, begin + length), begin + length
    in_force = {k for k in SENT if k in (max(j for j in SENT if SENT[j].t_apply <= begin),)}
    in_force |= {k for k in SENT if begin < SENT[k].t_apply < end}
    following = max(in_force) + 1
    if in_force & lost or following not in arrived:
        # An older one may look as if it were still in force, but then a number is missing.
        assert parts is None
    else:
        assert sum(seconds for _, seconds in parts or []) == pytest.approx(length)


def test_announcements_that_go_back_in_time_are_not_checked():
    back = {
        0: AnnouncedInput(0.0, (0.0,)),
        1: AnnouncedInput(0.02, (0.0,)),
        2: AnnouncedInput(0.01, (0.0,)),
    }
    assert covering({**back, 3: AnnouncedInput(0.05, (0.0,))}, 0.0, 0.04) is None


@pytest.mark.parametrize("victim", [1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_hijacked_agent_goes_for_the_one_it_sees_as_fast_as_it_can(victim, side):
    x = np.full(8, np.nan)
    x[:2], x[2 * victim : 2 * victim + 2] = 0.0, (2.0 * side, -1.0 * side)
    rows = rows_of_scenario("faults/hijack")
    decision, wish = Attack(rows, 0)(x, (0, victim), 0.5)
    assert decision.origin == "attack"
    assert decision.u.tolist() == wish.tolist() == [4.0 * side, -4.0 * side]

"""Malformed messages with a valid seal: every receiver drops and counts them."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phalanx_plant.hub.joining import Joining

from tests.hostile.messages import SEALER, Receiver, put, receivers, spoilt, spoilt_token
from tests.unit.swarms import swarm_of_scenario

EVERYBODY = receivers()


def names(receiver: Receiver) -> str:
    return receiver.key


@pytest.mark.parametrize("receiver", EVERYBODY, ids=names)
def test_what_is_right_is_taken(receiver: Receiver):
    good = receiver.good(1)
    assert put(receiver, SEALER.seal(receiver.key, good)) == "taken"


@pytest.mark.slow
@pytest.mark.parametrize("receiver", EVERYBODY, ids=names)
@given(seed=st.integers(0, 2**32))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_what_is_not_is_dropped_and_nothing_else_happens(receiver: Receiver, seed: int):
    assert put(receiver, spoilt(receiver, 2 + seed % 1000, random.Random(seed)))


@given(seed=st.integers(0, 2**32))
@settings(max_examples=100, deadline=None, derandomize=True)
def test_a_token_under_any_key_is_read(seed: int):
    joining = Joining(swarm_of_scenario("unicycles"), may_leave=False)
    said = joining.on_token(spoilt_token(random.Random(seed)), True)
    assert said is None or "agent 1 runs another scenario" in said

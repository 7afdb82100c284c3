"""Malformed messages with a valid seal, and frames of other runs: dropped, and counted."""

import math
import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from phalanx_plant.hub.hub import Joining
from phalanx_viewer.feeds.live import check_frame
from phalanx_viewer.scene.model import scene_model

from phalanx.messages.frames import AgentStatus, LinkEvent
from phalanx.messages.seal import Malformed
from tests.hostile.messages import (
    KEYS,
    SCENARIO,
    SEALER,
    Receiver,
    put,
    receivers,
    spoilt,
    spoilt_token,
)
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


GOOD = next(receiver for receiver in receivers() if receiver.key == KEYS.frames).good(0)
STEP = GOOD.agents[0].step


@pytest.mark.parametrize(
    "changes",
    [
        {"x": GOOD.x[:-8]},
        {"x": struct.pack("<d", math.nan) + GOOD.x[8:]},
        {"agents": GOOD.agents[:-1]},
        {"agents": (AgentStatus(step=replace(STEP, u=(0.0,))), *GOOD.agents[1:])},
        {"agents": (AgentStatus(step=replace(STEP, u_nom=())), *GOOD.agents[1:])},
        {"pair": -1},
        {"link_events": (LinkEvent(0, 5, 0.1),)},
    ],
)
def test_a_frame_of_another_run_is_refused(changes: dict[str, object]):
    model = scene_model(SCENARIO)
    check_frame(GOOD, model)
    with pytest.raises(Malformed):
        check_frame(replace(GOOD, **changes), model)

"""Frames that are none of the run that a viewer shows."""

import math
import struct

import pytest
from msgspec.structs import replace
from phalanx_viewer.feeds.live import check_frame
from phalanx_viewer.scene.model import scene_model

from phalanx.messages.kinds import AgentStatus, LinkEvent
from phalanx.messages.seal import Malformed
from tests.hostile.messages import KEYS, SCENARIO, receivers

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

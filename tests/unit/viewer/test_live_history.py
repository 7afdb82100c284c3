"""What a live run's past keeps of the frames that came."""

import numpy as np

from phalanx.scenario.load import load
from phalanx.viewer.feeds.live_history import LiveHistory
from phalanx.viewer.scene.model import scene_model
from phalanx.wire.frames import AgentStatus, Frame, LinkEvent

MODEL = scene_model(load("unicycles", []))


def frame(t: float, *events: LinkEvent) -> Frame:
    """One at the start's state, with link events."""
    return Frame(
        t=t, x=MODEL.swarm.start().tobytes(), h_tot=-1.0, worst_h=-1.0, pair=0,
        agents=(AgentStatus(),) * 5, link_events=events, steps=0, real_time_factor=1.0,
        assumptions=(), violations=(), log=(), paused=False, speed=1.0, loss=None, delay=None,
    )  # fmt: skip


def test_links_that_were_late_or_lost_are_counted_beside_all_that_lead_to_an_agent() -> None:
    past = LiveHistory(MODEL)
    past.add(frame(0.0))
    past.add(frame(0.1, LinkEvent(0, 2, -1.0), LinkEvent(1, 2, 0.01)))
    fates = past.history.fates()
    np.testing.assert_array_equal(fates.t, [0.0] * 5 + [0.1] * 5)
    np.testing.assert_array_equal(fates.receiver, [*range(5)] * 2)
    np.testing.assert_array_equal(fates.sent, [2.0, 2.0, 2.0, 0.0, 0.0] * 2)
    np.testing.assert_array_equal(fates.lost, [0.0] * 7 + [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(fates.late, [0.0] * 7 + [1.0, 0.0, 0.0])

"""What a live run's past keeps of the frames that came."""

import msgspec
import numpy as np

from phalanx.guarantee.verdict import Violation
from phalanx.recording.records import Step
from phalanx.scenario.load import load
from phalanx.viewer.feeds.agent_steps import AgentSteps
from phalanx.viewer.feeds.history import AgentSeries
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


def test_a_pair_that_was_unsafe_stays_marked_when_frames_tell_of_others_as_it_was_last_told():
    past = LiveHistory(MODEL)
    told = [[("1-2", 0.5), ("1-3", 0.1)], [("1-2", 0.7)], []]
    for k, violations in enumerate(told):
        each = tuple(Violation(pair, 0.0, worst, 0.0, 0.1) for pair, worst in violations)
        past.add(msgspec.structs.replace(frame(0.1 * k), violations=each))
    assert {v.pair: v.worst for v in past.violations.values()} == {"1-2": 0.7, "1-3": 0.1}


def test_every_number_of_a_step_is_plotted_as_what_it_is_live_and_recorded() -> None:
    def status(i: int) -> AgentStatus:
        return AgentStatus(
            u=(i + 0.1, i + 0.2), u_nom=(i + 0.3, i + 0.4), age=i + 0.5, solve_time=i + 0.6,
            certified=i + 0.7, residual=i + 0.8, margin=i + 0.9,
        )  # fmt: skip

    past = LiveHistory(MODEL)
    past.add(msgspec.structs.replace(frame(2.0), agents=tuple(map(status, range(5)))))
    step = Step(
        agent="4", k=0, t=2.0, t_apply=2.0, u=[3.1, 3.2], origin="qp", residual=3.8,
        solve_time=3.6, ages=[("1", 3.5)], fates=[], u_nom=[3.3, 3.4], certified=3.7, margin=3.9,
    )  # fmt: skip
    expected = AgentSeries(
        t=[2.0], empty=[0.0], age=[3.5], solve_time=[3.6], certified=[3.7], residual=[3.8],
        margin=[3.9], u=[[3.1, 3.2]], u_nom=[[3.3, 3.4]],
    )  # fmt: skip
    for series in (past.history.agent(3), AgentSteps([step]).series(inputs=2)):
        for found, numbers in zip(series, expected, strict=True):
            np.testing.assert_array_equal(found, numbers)

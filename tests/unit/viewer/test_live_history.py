"""The past of a live run, from its frames."""

import msgspec
import numpy as np
import pytest
from phalanx_viewer.feeds import live_history
from phalanx_viewer.feeds.live_history import LiveHistory
from phalanx_viewer.scene.legend import Mark, marks_of
from phalanx_viewer.scene.model import scene_model

from phalanx.faults.commands import Condition
from phalanx.guarantee.verdict import Violation
from phalanx.messages.frames import AgentStatus, Frame, LinkEvent
from phalanx.messages.step_report import QUANTITIES, AppliedStep
from phalanx.recording.curves.history import recorded_series
from phalanx.recording.records import Step
from phalanx.scenario.load import load
from phalanx.theory.rows.origin import Origin

MODEL = scene_model(load("unicycles", []))


def frame(t: float, *events: LinkEvent) -> Frame:
    """One at the start's state, with link events."""
    return Frame(
        t=t, x=MODEL.swarm.start().tobytes(), h_tot=-1.0, h=-1.0, worst_h=-1.0, pair=0, turned=(),
        agents=(AgentStatus(),) * 5, link_events=events, steps=0, real_time_factor=1.0,
        assumptions=(), violations=(), log=(), paused=False, speed=1.0, loss=None, delay=None,
    )  # fmt: skip


def test_links_that_were_late_or_lost_are_counted_with_all_that_lead_to_an_agent() -> None:
    past = LiveHistory(MODEL)
    past.add(frame(0.0))
    past.add(frame(0.1, LinkEvent(0, 2, -1.0), LinkEvent(1, 2, 0.01)))
    fates = past.fates
    np.testing.assert_array_equal(fates.t, [0.0] * 5 + [0.1] * 5)
    np.testing.assert_array_equal(fates.receiver, [*range(5)] * 2)
    np.testing.assert_array_equal(fates.total, [2.0, 2.0, 2.0, 0.0, 0.0] * 2)
    np.testing.assert_array_equal(fates.lost, [0.0] * 7 + [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(fates.late, [0.0] * 7 + [1.0, 0.0, 0.0])


def test_the_legend_gets_a_mark_with_the_first_frame_that_has_it_and_keeps_it() -> None:
    past, rare = LiveHistory(MODEL), set(Mark) - marks_of(MODEL)
    assert not past.marks & rare
    dead = AgentStatus(Condition.DEAD, backups=1, lies=1)
    frames = [
        frame(0.0),
        frame(0.1, LinkEvent(0, 2, -1.0)),
        msgspec.structs.replace(frame(0.2), agents=(dead, *(AgentStatus(),) * 4)),
        frame(0.3),
    ]
    marks = []
    for of_run in frames:
        past.add(of_run)
        marks.append(past.marks & rare)
    lost, later = {Mark.LOST}, {Mark.LOST, Mark.LIE, Mark.SILENT, Mark.BACKUP}
    assert marks == [set(), lost, later, later]


def test_frames_to_look_back_at_are_the_last_ones_not_after_a_time() -> None:
    past = LiveHistory(MODEL)
    frames = [frame(0.1 * k) for k in range(5)]
    for of_run in frames:
        past.add(of_run)
    assert past.frame_at(0.25) is frames[2]
    assert past.frame_at(0.25, 1) is frames[3]
    assert past.frame_at(-1.0) is past.frame_at(0.0, -1) is frames[0]
    assert past.frame_at(0.4) is past.frame_at(9.0) is past.frame_at(0.35, 1 + 1) is None
    assert past.frame_at(0.4, -1) is past.frame_at(np.inf, -1) is frames[3], "a pause holds it"
    assert len(past.recent_path(0.25)) == 2, "points 0.2 s from one another"


def test_a_long_past_to_look_back_at_is_thinned_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_history, "_MOST_FRAMES", 8)
    past = LiveHistory(MODEL)
    for k in range(21):
        past.add(frame(float(k)))
    frames_shown = [past.frame_at(t + 0.5) for t in range(20)]
    assert (
        sorted({of_run.t for of_run in frames_shown if of_run})
        == [0.0, 4.0, 8.0, 12.0, 16.0, 20.0][:5]
    )


def test_a_pair_that_was_unsafe_stays_as_last_received_when_frames_name_others():
    past = LiveHistory(MODEL)
    received = [[("1-2", 0.5), ("1-3", 0.1)], [("1-2", 0.7)], []]
    for k, violations in enumerate(received):
        frame_violations = tuple(
            Violation(pair, 0.0, worst, 0.0, 0.1, 1, 0.0, 0.1) for pair, worst in violations
        )
        past.add(msgspec.structs.replace(frame(0.1 * k), violations=frame_violations))
    assert {v.pair: v.worst for v in past.violations.values()} == {"1-2": 0.7, "1-3": 0.1}


def test_the_worst_moment_is_as_bad_as_the_worst_h_so_far_which_may_be_between_two_frames():
    past = LiveHistory(MODEL)
    for t, h, worst_h in ((1.0, -1.0, 0.5), (1.1, -0.9, 0.5), (1.2, -0.8, 0.7), (1.3, -0.7, 0.7)):
        past.add(msgspec.structs.replace(frame(t), h=h, worst_h=worst_h))
    assert past.totals[:, 2].tolist() == [-1.0, -0.9, 0.7, -0.7]


def status(i: int) -> AgentStatus:
    """An agent's, each number of whose step differs."""
    u, u_nom = (i + 0.1, i + 0.2), (i + 0.3, i + 0.4)
    return AgentStatus(step=AppliedStep(origin=Origin.QP, u=u, u_nom=u_nom, **values(i)))


def values(i: int) -> dict[str, float]:
    return {name: i + 0.01 * place for place, name in enumerate(QUANTITIES)}


def test_every_number_of_a_step_is_plotted_as_what_it_is_live_and_recorded() -> None:
    past = LiveHistory(MODEL)
    past.add(msgspec.structs.replace(frame(2.0), agents=tuple(map(status, range(5)))))
    step = Step(
        agent="4", k=0, t=2.0, t_apply=2.0, fates=[], ages=[("1", values(3)["oldest_input"])],
        **msgspec.structs.asdict(status(3).step),
    )  # fmt: skip
    for series in (past.agent(3), recorded_series([step], inputs=2)):
        assert (series.t, series.empty) == ([2.0], [0.0])
        assert series.numbers == values(3)
        np.testing.assert_array_equal(series.u, [[3.1, 3.2]])
        np.testing.assert_array_equal(series.u_nom, [[3.3, 3.4]])


def test_an_empty_k_i_is_plotted_at_the_next_frame_and_no_later() -> None:
    past, backups, without_authority = LiveHistory(MODEL), (0, 1, 1, 2, 3), (0, 0, 0, 2, 2)
    for k, counts in enumerate(zip(backups, without_authority, strict=True)):
        empty = msgspec.structs.replace(status(0), backups=counts[0], without_authority=counts[1])
        agents = (empty, *map(status, range(1, 5)))
        past.add(msgspec.structs.replace(frame(float(k)), agents=agents))
    assert past.agent(0).empty.tolist() == [0.0, 1.0, 0.0, 2.0, 1.0]
    assert not past.agent(1).empty.any()


def test_an_agent_without_a_step_hides_no_other() -> None:
    past = LiveHistory(MODEL)
    agents = AgentStatus(), *map(status, range(1, 5))
    past.add(msgspec.structs.replace(frame(2.0), agents=agents))
    assert len(past.agent(0).t) == 0
    assert past.agent(3).numbers == values(3)
    np.testing.assert_array_equal(past.agent(3).u, [[3.1, 3.2]])


@pytest.mark.slow
def test_a_long_past_is_thinned_evenly_to_its_peaks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_history, "_MOST_ROWS", 256)
    past, peak, last = LiveHistory(MODEL), 300, 1500
    for k in range(last + 1):
        agents = tuple(status(2 if k == peak else 1) for _ in range(5))
        h_tot, lost = -0.5 if k == peak else -1.0, [LinkEvent(0, 2, -1.0)] * (k == peak)
        past.add(msgspec.structs.replace(frame(float(k), *lost), h_tot=h_tot, agents=agents))
    totals, series = past.totals, past.agent(0)
    assert len(totals) == len(series.t) == -(-(last + 1) // 8) <= 256
    assert totals[-1, 0] == series.t[-1] == last
    assert np.diff(totals[:, 0]).max() == 8.0
    assert totals[peak // 8].tolist()[:2] == [peak // 8 * 8 + 7, -0.5]
    assert past.fates.lost.sum() == 1.0
    assert series.numbers["residual"].max() == values(2)["residual"]
    assert series.numbers["certified"].max() == values(1)["certified"], "the least is kept"

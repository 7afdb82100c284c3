"""The text panels of an agent and of the verdict."""

import html
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.panels import CommandPanel, agent_text, verdict_text
from phalanx_viewer.scene.server import SceneServer

from phalanx.guarantee.verdict import Assumption, judge
from phalanx.messages.frames import AgentStatus
from phalanx.messages.step_report import AppliedStep
from phalanx.recording.read import read
from phalanx.theory.rows.origin import Origin
from phalanx.theory.safety.composition import FAR
from tests.unit.report.recordings import drift, record, summary_of, unicycles


def step(residual: float = 0.0) -> AppliedStep:
    return AppliedStep(origin=Origin.QP, residual=residual, solve_time=0.0, u=(1.0,))


@pytest.mark.parametrize(
    ("residual", "text"),
    [(-4.26e-14, "residual 0"), (3e-12, "residual 0"), (2e-9, "residual 2e-09"), (-20.3, "-20.3")],
)
def test_a_residual_of_rounding_alone_is_none(residual: float, text: str) -> None:
    assert f"{text} ·" in agent_text(AgentStatus(step=step(residual)))


def test_steps_with_empty_sets_are_counted_in_words() -> None:
    assert "· 1 backup ·" in agent_text(AgentStatus(step=step(), backups=1))
    text = agent_text(AgentStatus(step=step(), backups=2, without_authority=1))
    assert "· 2 backups, 1 without authority ·" in text


def test_without_an_agent_near_there_is_no_residual() -> None:
    text = agent_text(AgentStatus(step=step(FAR)))
    assert "no agent or obstacle near" in text
    assert "e+09" not in text


@pytest.fixture
def violated(tmp_path: Path) -> Replay:
    scenario = unicycles()
    return Replay(read(record(tmp_path, scenario, drift(scenario), summary_of(scenario))))


@pytest.mark.slow
def test_a_slider_that_a_visitor_moves_stays_there_until_the_run_has_another_loss(
    violated: Replay,
) -> None:
    server = SceneServer("127.0.0.1", 0, "panel")
    try:
        panel = CommandPanel(server.gui, SimpleNamespace(real_time=None), "1")
        for loss, shown in ((0.4, 40), (0.4, 70), (0.1, 10)):
            panel.show(msgspec.structs.replace(violated.frame(0.0), loss=loss))
            assert panel._loss.value == shown
            panel._loss.value = 70
    finally:
        server.stop()


def test_a_violated_recording_says_so_from_its_beginning(violated: Replay) -> None:
    text = verdict_text(violated.frame(0.0), violated.summary, violated.unfinished)
    assert text.index("<b>violated</b>: h &lt;= 0") < text.index("<b>guaranteed until now</b>")


def test_a_guarantee_is_one_sentence_and_the_theorem_another(violated: Replay) -> None:
    assert violated.summary is not None
    outcome, reason = judge([], [], violated.summary.theorem)
    summary = msgspec.structs.replace(violated.summary, outcome=outcome, reason=reason)
    text = verdict_text(violated.frame(violated.end), summary, "")
    assert "<b>guaranteed</b>: every pair was proven safe at every instant</p>" in text
    theorem = "Proven by certificates. The paper's theorem alone would not have sufficed: non-empty"
    assert html.escape(theorem) in text
    assert "Proven by certificates" not in verdict_text(violated.frame(0.0), violated.summary, "")


def test_a_failed_assumption_is_worded_as_a_failure(violated: Replay) -> None:
    certificates = Assumption("certificates", 3, 120, 0.2, "every pair was under one")
    frame = msgspec.structs.replace(violated.frame(0.0), assumptions=(certificates,))
    text = verdict_text(frame, None, "")
    failed = "certificates failed: 3 of 120, first at 0.200 s; expected: every pair was"
    assert failed in text

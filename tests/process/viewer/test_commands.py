"""Commands to a live run: obeyed with the command secret, recorded, and reproducible."""

from pathlib import Path

import psutil
import pytest

import phalanx
from phalanx.faults.commands import CommandKind, CommandPolicy, Condition
from phalanx.guarantee.verdict import Outcome
from phalanx.recording.read import read
from phalanx.scenario.load import load
from tests.process.runs import COMMAND_SECRET, PACED, live_run, wait_for
from tests.process.viewer.pages import Watcher

pytestmark = pytest.mark.swarm

SHORT = load("unicycles", ["duration=3.0"])


def processes() -> set[str]:
    """The living programs that this test started, by name."""
    mine = psutil.Process().children(recursive=True)
    return {p.name() for p in mine if p.status() != psutil.STATUS_ZOMBIE}


def test_a_run_with_live_faults_is_recorded_and_replays_to_the_same_hash(tmp_path: Path) -> None:
    scenario, slow = (
        load("unicycles", ["duration=1.0"]),
        CommandPolicy(secret=COMMAND_SECRET, speed=0.03),
    )
    with live_run(scenario, tmp_path / "live", slow) as run, run.watch() as live:
        watcher = Watcher(live)
        watcher.until(lambda frame: frame.t > 0.01)
        live.command(CommandKind.LOSS, value=0.4)
        live.command(CommandKind.DELAY, value=0.02)
        watcher.until(lambda frame: frame.loss == 0.4 and frame.delay == 0.02)
        live.command(CommandKind.FREEZE, agent="2")
        frozen = watcher.until(lambda frame: frame.agents[1].condition == Condition.FROZEN)
        watcher.until(lambda frame: frame.t > frozen.t + 0.02)
        live.command(CommandKind.THAW, agent="2")
        live.command(CommandKind.TURN, agent="1")
        watcher.until(lambda frame: frame.agents[0].condition == Condition.TURNED)
        assert "phx-agent-5" in processes()
        live.command(CommandKind.KILL, agent="5")
        watcher.until(lambda frame: frame.agents[4].condition == Condition.DEAD)
        wait_for(lambda: "phx-agent-5" not in processes())
        assert "phx-agent-4" in processes()
        assert watcher.frame is not None
        assert watcher.frame.agents[1].condition == Condition.FINE
        live.command(CommandKind.SPEED, value=0.0)
        recorded = run.summary()
    recording = read(tmp_path / "live")
    kinds = [command.kind for command in recording.commands]
    assert kinds == ["loss", "delay", "freeze", "thaw", "turn", "kill", "speed"]
    assert recorded.outcome in (Outcome.SAFE, Outcome.VIOLATED)
    assert "faithful agents" in {a.name for a in recorded.theorem if a.failed}
    steps_of_the_dead = [s.t for s in recording.steps if s.agent == "5"]
    assert max(steps_of_the_dead) <= recording.commands[5].t

    schedule = CommandPolicy(schedule=tuple(recording.commands))
    again = phalanx.run(scenario, engine="in-process", commands=schedule)
    assert again.summary.trajectory == recorded.trajectory
    untouched = phalanx.run(scenario, engine="in-process")
    assert untouched.summary.trajectory != recorded.trajectory


@pytest.mark.nightly
def test_pause_stops_virtual_time_and_step_moves_it_by_what_was_asked(tmp_path: Path) -> None:
    with live_run(SHORT, tmp_path / "live", PACED) as run, run.watch() as live:
        watcher = Watcher(live)
        watcher.until(lambda frame: frame.t > 0.05)
        live.command(CommandKind.PAUSE)
        stopped = watcher.until(lambda frame: frame.paused).t
        for _ in range(5):  # frames go on while virtual time stands still
            live.take()
            assert watcher.until(lambda frame: frame.paused).t == stopped
        live.command(CommandKind.STEP, value=0.5)
        stepped = watcher.until(lambda frame: frame.t > stopped + 0.4)
        watcher.until(lambda frame: frame.t > stopped + 0.45 and frame.paused)
        assert stepped.t <= stopped + 0.5
        live.command(CommandKind.SPEED, value=0.0)
        live.command(CommandKind.RESUME)
        assert run.summary().t == SHORT.duration


@pytest.mark.parametrize(
    "plant", ["with another command secret", pytest.param("without one", marks=pytest.mark.nightly)]
)
def test_a_viewer_without_the_command_secret_changes_nothing(tmp_path: Path, plant: str) -> None:
    secret = COMMAND_SECRET if plant == "with another command secret" else b""
    policy = CommandPolicy(secret=secret, speed=0.3)
    with live_run(SHORT, tmp_path / "live", policy) as run, run.watch(b"guessed") as live:
        watcher = Watcher(live)
        watcher.until(lambda frame: frame.t > 0.05)
        for kind in (CommandKind.PAUSE, CommandKind.LOSS):
            live.command(kind, value=1.0)
        live.command(CommandKind.KILL, agent="1")
        summary = run.summary()
    assert read(tmp_path / "live").commands == []
    assert summary.t == SHORT.duration
    refused = {} if plant == "without one" else {"command: bad seal": 3}
    assert {k: n for k, n in summary.rejected.items() if k.startswith("command")} == refused

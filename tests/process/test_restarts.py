"""kill -9, restart and pause: a process really dies or stands still, and the run goes on."""

import psutil
import pytest

import phalanx
from tests.process.runs import on_both_engines, wait_for

pytestmark = pytest.mark.swarm

KINDS = phalanx.CommandKind
KILLED, RESTARTED, DURATION = 0.2, 0.45, 0.8
VARIANTS = {
    "as printed": {},
    "with latency": pytest.param(
        {"time.latency": 0.004, "safety.information": "in-flight"}, marks=pytest.mark.nightly
    ),
    "one controller": pytest.param({"safety.control": "centralised"}, marks=pytest.mark.nightly),
}


def killed_and_restarted(name: str) -> phalanx.CommandPolicy:
    schedule = (
        phalanx.Command(KILLED, KINDS.KILL, name),
        phalanx.Command(RESTARTED, KINDS.RESTART, name),
    )
    return phalanx.CommandPolicy(schedule=schedule)


@pytest.mark.parametrize("overrides", VARIANTS.values(), ids=VARIANTS)
def test_an_agent_killed_and_restarted_goes_on_equally_on_both_engines(overrides: dict) -> None:
    scenario = phalanx.load("unicycles", {"duration": DURATION, **overrides})
    policy = killed_and_restarted("1")
    run, _ = on_both_engines(scenario, commands=policy)
    times = run.inputs.filter(agent="1")["t"].to_list()
    assert RESTARTED in times, "it samples at once"
    assert not any(KILLED < t < RESTARTED for t in times)
    (gap,) = (a for a in run.summary.assumptions if a.name == "sampling gap")
    assert (gap.failed, gap.first) == (1, RESTARTED)


def test_another_process_takes_the_place_of_the_one_that_died() -> None:
    scenario = phalanx.load("unicycles", {"duration": DURATION})
    run = phalanx.run(scenario, commands=killed_and_restarted("2"))
    assert run.summary.outcome is phalanx.Outcome.SAFE
    log = (run.folder / "logs" / "2.log").read_text()
    assert (log.count("joined run"), log.count("left; ")) == (2, 1), "the first took no leave"
    texts = run.events["text"].to_list()
    assert "agent 2 killed; lost with it: the inputs received of 1, 3" in texts
    assert "agent 2 restarted, with nothing received" in texts


def test_a_paused_agents_process_is_stopped_and_goes_on() -> None:
    stopped: set[str] = set()

    def still() -> set[str]:
        processes = psutil.Process().children(recursive=True)
        return {p.name() for p in processes if p.status() == psutil.STATUS_STOPPED}

    def look(status: phalanx.Status) -> None:
        if status.stopped:  # no process goes on before this has returned
            stopped.update(wait_for(still, 1.5))

    pause = {"kind": "pause", "at": KILLED, "for": RESTARTED - KILLED, "agents": ["2"]}
    scenario = phalanx.load("unicycles", {"duration": DURATION, "faults": [pause]})
    run = phalanx.run(scenario, progress=look)
    assert stopped == {"phx-agent-2"}
    assert run.summary.trajectory == phalanx.run(scenario, engine="in-process").summary.trajectory

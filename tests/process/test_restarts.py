"""kill -9, restart and pause: a process really dies or stands still, and the run goes on."""

import psutil
import pytest

import phalanx
from tests.process.runs import wait_for

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
def test_an_agent_killed_and_restarted_goes_on_alike_on_both_engines(overrides: dict) -> None:
    scenario = phalanx.load("unicycles", {"duration": DURATION, **overrides})
    policy = killed_and_restarted("1")
    runs = [phalanx.run(scenario, engine=e, commands=policy) for e in ("in-process", "processes")]
    first, second = (run.summary for run in runs)
    assert first.trajectory == second.trajectory
    assert (first.assumptions, first.rejected) == (second.assumptions, second.rejected)
    assert runs[0].events.drop("run").equals(runs[1].events.drop("run"))
    times = runs[0].inputs.filter(agent="1")["t"].to_list()
    assert RESTARTED in times, "it samples at once"
    assert not any(KILLED < t < RESTARTED for t in times)
    (gap,) = (a for a in first.assumptions if a.name == "sampling gap")
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


@pytest.mark.nightly
def test_a_run_with_a_restart_by_hand_is_verified() -> None:
    scenario = phalanx.load("unicycles", {"duration": DURATION})
    run = phalanx.run(scenario, engine="in-process", commands=killed_and_restarted("3"))
    assert phalanx.verify(run, engine="processes")


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

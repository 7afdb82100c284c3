"""Theorem 1 as processes: one controller for all normal agents."""

import pytest
from phalanx_agent.centralised import CentralisedController

import phalanx
from phalanx.faults.commands import Command, CommandKind, CommandPolicy
from phalanx.guarantee.verdict import Outcome
from phalanx.recording.read import Recording
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin
from tests.process.swarm.processes import LONG

pytestmark = pytest.mark.swarm

CENTRALISED = ("--set", "safety.control=centralised")
SYNCHRONOUS = ("agents.0.clock.jitter=0.0", "agents.1.clock.jitter=0.0")


def centralised(*overrides: str, schedule: tuple[Command, ...] = (), engine: str) -> Recording:
    scenario = load("unicycles", ["duration=0.5", "safety.control=centralised", *overrides])
    commands = CommandPolicy(schedule=schedule)
    return phalanx.run(scenario, engine=engine, commands=commands).recording


def failed(recording: Recording, assumption: str) -> int:
    assert recording.summary is not None
    return next(a.failed for a in recording.summary.theorem if a.name == assumption)


def test_one_process_controls_all_normal_agents(phalanx):
    run = phalanx("run", "unicycles", *CENTRALISED, *LONG)
    run.wait_until_running(agents=3)
    programs = ["phx-agent-4", "phx-agent-5", "phx-controller", "phx-plant"]
    assert sorted(run.programs()) == programs
    run.programs()["phx-controller"].kill()
    assert "[phx-controller died (killed by SIGKILL)" in run.ends(3)


def test_the_programme_is_solved_once_for_all_who_sample_together():
    swarm = build_swarm(load("unicycles", ["safety.control=centralised"]))
    together, x = CentralisedController(build_rows(swarm)), swarm.start()
    first = together.at(x, 0.0)
    assert together.at(x.copy(), 0.0) is first
    assert together.at(x, 0.01) is not first
    assert together.at(x + 0.1, 0.01)[0].decision.u != pytest.approx(first[0].decision.u)


def test_theorem_1_needs_synchronous_clocks_and_the_run_checks_it():
    for clocks, holds in ((), False), (SYNCHRONOUS, True):
        recording = centralised(*clocks, engine="in-process")
        assert (failed(recording, "synchronous sampling") == 0) == holds


def test_the_controller_outlives_an_agent_and_goes_on_without_one_that_turned():
    schedule = (Command(0.1, CommandKind.KILL, "1", 0.0), Command(0.2, CommandKind.TURN, "2", 0.0))
    recording = centralised(*SYNCHRONOUS, schedule=schedule, engine="processes")
    assert recording.summary.outcome is not Outcome.BROKEN
    last = {step.agent: step for step in recording.steps}
    assert last["1"].t <= 0.1
    assert last["2"].origin == Origin.ATTACK
    assert last["3"].origin == Origin.QP
    assert last["3"].t >= 0.48

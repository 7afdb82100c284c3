"""phalanx test-agent: each mistake that a program makes is named, and its absence too."""

import sys
from pathlib import Path

import msgspec
import pytest
from phalanx_testing.conformance import _gaps, _steps

import phalanx
from phalanx.cli.app import status
from phalanx.guarantee.verdict import Outcome
from phalanx.scenario.agents import Clock
from phalanx.scenario.load import load
from tests.unit.report.recordings import step, swarm_in_space

CARTS = Path(__file__).parents[3] / "examples" / "programs"
LOOP = "import sys, time, os\nfor line in sys.stdin:\n    "
GOOD = "print('{\"u\": [0.5, 0.0]}', flush=True)"
MISTAKES = {
    "late": (f"time.sleep(0.03); {GOOD}", "99 of 99 answers are late, expected within 10 ms, got"),
    "silent": ("pass", "expected to answer within 2 s for agent 1, got nothing"),
    "not JSON": ("print('u: 1', flush=True)", "expected a line of JSON as"),
    "NaN": ("print('{\"u\": [NaN, 0]}', flush=True)", "expected a line of JSON as"),
    "wrong size": (
        "print('{\"u\": [1]}', flush=True)",
        "expected 2 numbers in u for agent 1, got 1",
    ),
    "outside U": (
        GOOD.replace("0.5", "5"),
        "100 of 100 inputs are outside U, the first at t = 0 s",
    ),
    "dies": ("os.abort()", "expected to answer until its input ends for agent 1, got its death by"),
    "two lines": (f"{GOOD}; {GOOD}", "expected one line for each sample for agent 1, got more"),
    "closes": ("os.close(1); time.sleep(60)", "to answer until its input ends for agent 1, got a"),
    "floods": ("print('x' * 10**7, flush=True)", "expected a line of at most 65536 bytes"),
}


@pytest.mark.slow
def test_a_program_that_keeps_the_rules_passes(capsys: pytest.CaptureFixture[str]) -> None:
    slow = ["--set", "agents.0.clock.period=0.2"]  # that of the machine does not matter
    assert status(["test-agent", *slow, sys.executable, "-c", LOOP + GOOD]) == 0
    assert " keeps the rules: 5 answers, the slowest after " in capsys.readouterr().out


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    does, says = MISTAKES[name]
    assert status(["test-agent", sys.executable, "-c", LOOP + does]) == 1
    # On a busy machine an answer may be late too.
    assert any(says in line for line in capsys.readouterr().out.splitlines())


def test_by_the_wall_clock_a_gap_between_samples_says_how_late_an_answer_came():
    """Half a period of 16 ms and 2 ms of jitter are no delay; the other agent does not count."""
    scenario = swarm_in_space(2, 0, {})
    steps = [
        msgspec.structs.replace(step(scenario, ("n0", "n1"), i, 0), t=t)
        for i, t in ((0, 0.0), (1, 0.5), (0, 0.03125), (1, 0.75), (0, 0.125))
    ]
    clock = Clock(period=0.015625, jitter=0.001953125)
    gaps = [gap + 0.009765625 for gap in _gaps(steps, "n0", clock)]
    assert gaps == [0.03125, 0.09375]


def test_all_that_was_refused_is_named_after_what_ended_the_run():
    """A program by Zenoh sent what it may not, and died."""
    result = phalanx.run(load("one-on-one", {"duration": 0.05}), engine="in-process")
    result.summary.outcome, result.summary.reason = Outcome.BROKEN, "agent 1 died"
    result.summary.rejected |= {"bad seal": 2, "not finite": 1}
    _, mistakes = _steps(result, result.recording.scenario.agents[0])
    refused = [
        f"{n} of its messages were refused: {why}"
        for n, why in ((2, "bad seal"), (1, "not finite"))
    ]
    assert mistakes == ["agent 1 died", *refused]


BY_ZENOH = f"""
import os, sys, time
sys.path.append({str(CARTS)!r})
import zenoh_agent as agent
run = agent.Run()
def take(sender, sample):
    if sender != agent.NAME:
        return
    k, t, u = sample[0], sample[1], [0.5, 0.0]
    {{}}
    run.put(f"actuation/{{{{agent.NAME}}}}", [k, t, u])
    for hearer in sample[7]:
        to = f"broadcast/{{{{agent.NAME}}}}/{{{{agent.NAMES[hearer]}}}}"
        run.put(to, [k, t, u, 0.0, [], [], []])
    report = ["controller", None, None, None, [0.0, 0.0], 0.0]
    run.put(f"telemetry/{{{{agent.NAME}}}}", [k, report, [], [], 0, [], [], "", []])
run.join(take)
"""
ON_THE_WIRE = {
    "late": ("time.sleep(0.25)", "answers are late, expected within 100 ms, got "),
    "silent": ("return", "agent 1 did not answer sample 0 within 4 s"),
    "no fields": ("run.put = lambda to, _: agent.Run.put(run, to, [])", "wrong fields"),
    "NaN": ("u = [float('nan'), 0.0]", "not finite"),
    "wrong size": ("u = [0.5]", "wrong size"),
    "outside U": ("u = [5.0, 0.0]", "outside U"),
    "dies": ("os.abort()", "agent 1 died"),
    "twice": ("run.put(f'actuation/{agent.NAME}', [k, t, u])", "out of order"),
    "wrong seal": ("agent.KEYS = dict.fromkeys(agent.KEYS, b'0')", "bad seal"),
}


def by_zenoh(*program: str) -> int:
    """The exit status of the command for a program by Zenoh, which has time on a busy machine."""
    options = ["--protocol", "zenoh", "--set", "agents.0.clock.period=0.1"]
    return status(["test-agent", *options, sys.executable, "-c", *program])


@pytest.mark.swarm
@pytest.mark.nightly
@pytest.mark.parametrize("name", ON_THE_WIRE)
def test_a_mistake_on_the_wire_is_named(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    does, says = ON_THE_WIRE[name]
    assert by_zenoh(BY_ZENOH.format(does)) == 1
    assert any(says in line for line in capsys.readouterr().out.splitlines())


@pytest.mark.swarm
@pytest.mark.nightly
def test_another_scenario_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    other = "import os\nos.environ['PHALANX_DIGEST'] = 'ab'\n"
    assert by_zenoh(other + BY_ZENOH.format("pass")) == 1
    assert "runs another scenario, seed or version" in capsys.readouterr().out


@pytest.mark.swarm
@pytest.mark.nightly
def test_a_program_by_zenoh_that_keeps_the_rules_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert by_zenoh(BY_ZENOH.format("pass")) == 0
    assert " keeps the rules: 11 answers, the slowest after " in capsys.readouterr().out

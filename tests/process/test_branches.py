"""Branches: forked on the way, each with the bits of a run that is seeded again from there."""

import os
import signal
from functools import partial

import pytest
from typer.testing import CliRunner

import phalanx
from phalanx.branches.command import multiples
from phalanx.branches.inevitable import BranchesAt, branch_run, from_when
from phalanx.cli.app import extended
from phalanx.faults.commands import Command, CommandPolicy
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.engine import EngineError
from phalanx.launcher.forks import in_forks
from phalanx.launcher.run import Run
from phalanx.launcher.trunk import trunk_of
from tests.layers import layered

RANDOM = {
    "duration": 0.4,
    "seed": 3,
    "network.loss": {"mean": 0.3, "burst": 3.0},
    "network.delay": {"low": 0.0, "high": 0.05},
}
CASES = {
    "links": {},
    "robots": {
        "time.latency": 0.004,
        "network.sample.loss": {"mean": 0.4, "burst": 8.0},
        "network.actuation": {"loss": 0.1, "delay": {"low": 0.0, "high": 0.015}},
    },
    "lies": {"faults": [{"kind": "lie", "agent": "2", "at": 0.1, "for": 0.4, "equivocate": True}]},
    "an earlier reseed": {"reseed": [{"at": 0.1, "seed": 9}]},
    "faults drawn before the run": {
        "faults": [
            {"kind": "pause", "rate": 20.0, "for": 0.05},
            {"kind": "partition", "shape": "ring", "at": 0.3, "for": 0.1},
        ]
    },
}
KILLED = (Command(0.1, "kill", "2"), Command(0.3, "restart", "2"))


def as_scenario(overrides: dict[str, object], at: float, seed: int) -> Summary:
    """Return the results of the run whose scenario has the branch's seed."""
    reseed = [*overrides.get("reseed", []), {"at": at, "seed": seed}]
    scenario = phalanx.load("unicycles", {**RANDOM, **overrides, "reseed": reseed})
    policy = CommandPolicy(schedule=KILLED)
    return timeless(phalanx.run(scenario, engine="in-process", commands=policy).summary)


def timeless(summary: Summary) -> Summary:
    summary.wall_time = 0.0
    return summary


@pytest.mark.parametrize("case", layered(CASES, ("links",)))
def test_a_branch_has_the_bits_of_a_run_of_the_scenario_with_that_reseed(case):
    trunk = trunk_of(phalanx.load("unicycles", {**RANDOM, **CASES[case]}), KILLED)
    found = []
    for t, seeds in ((0.15, (1, 2)), (0.25, (1,))):
        trunk.advance(t)
        works = [partial(trunk.reseeded, t, seed) for seed in seeds]
        branches = [timeless(summary) for summary in in_forks(works, 2)]
        assert branches == [as_scenario(CASES[case], t, seed) for seed in seeds]
        found += [summary.trajectory for summary in branches]
    assert len(set(found)) == 3
    trunk.close()


def test_results_come_in_order_and_no_more_processes_run_than_are_allowed():
    pids = list(in_forks([os.getpid] * 5, 2))
    assert len({*pids, os.getpid()}) == 6
    assert list(in_forks((partial(divmod, n, 2) for n in range(5)), 3)) == [
        divmod(n, 2) for n in range(5)
    ]


def test_an_error_in_a_branch_is_raised_and_a_dead_one_is_told():
    with pytest.raises(ZeroDivisionError):
        list(in_forks([partial(divmod, 1, 0)], 1))
    with pytest.raises(EngineError, match="a process died before it had a result"):
        list(in_forks([lambda: os.kill(os.getpid(), signal.SIGKILL)], 1))


@pytest.fixture(scope="module")
def violated(tmp_path_factory) -> Run:
    """Return a run in which a pursuer starts in front of a unicycle, and wins."""
    starts = [[8.5, 2.5, -0.5], [12.0, -6.0, 3.1]]
    over = {"duration": 3.2, "network.loss": 0.0, "network.delay": 0.0, "agents.1.start": starts}
    out = tmp_path_factory.mktemp("runs")
    run = phalanx.run(phalanx.load("guaranteed", over), engine="in-process", out=out)
    assert run.verdict is Outcome.VIOLATED
    return run


def test_the_command_shows_when_the_violation_was_inevitable(violated, tmp_path):
    picture = tmp_path / "inevitable.png"
    arguments = ["branch", str(violated.folder), "--at", "2.9", "--every", "2.6", "--branches", "3"]
    shown = CliRunner().invoke(extended(), [*arguments, "--picture", str(picture)])
    assert shown.exit_code == 0, shown.output
    assert "2.600 s" in shown.output
    assert "3 of 3" in shown.output
    assert "all branches violate that leave at" in shown.output
    assert "before 1-4 leaves the safe set" in shown.output
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.nightly
def test_a_report_shows_when_the_violation_was_inevitable(violated):
    arguments = ["branch", str(violated.folder), "--at", "2.9", "--branches", "1"]
    assert CliRunner().invoke(extended(), arguments).exit_code == 0
    page = violated.report().read_text(encoding="utf-8")
    assert "Share of branches that violate, over the time at which they left the run" in page


def test_times_outside_the_run_are_refused(violated):
    for t in (0.0, 3.2):
        with pytest.raises(ValueError, match=r"expected times after 0 s and before the end, 3.2 s"):
            branch_run(violated.recording, [t], 1)
    for words in ([], ["--every", "0.1", "--until", "0"]):
        shown = CliRunner().invoke(extended(), ["branch", str(violated.folder), *words])
        assert shown.exit_code == 2
        assert "expected --at, or --every shorter than the run" in shown.output


def test_branches_leave_a_long_run_up_to_its_end():
    times = multiples(0.01, 20.0)
    assert (len(times), times[0], times[-1]) == (1999, 0.01, 19.99)


def test_a_run_that_does_not_repeat_itself_has_no_branches(violated):
    recording = phalanx.open(violated.folder).recording
    for state in recording.states:
        state.x[0] += 1e-12
    with pytest.raises(EngineError, match="the run arrived elsewhere"):
        branch_run(recording, [0.05], 1)


def test_inevitable_is_what_stays_so_at_all_later_times():
    def at(t: float, violated: int) -> BranchesAt:
        outcomes = [Outcome.VIOLATED] * violated + [Outcome.SAFE] * (4 - violated)
        return BranchesAt(t, tuple(as_outcome(each) for each in outcomes))

    def as_outcome(outcome: Outcome) -> Summary:
        return Summary(outcome, "", 1.0, 0, "", 0.0, 0.0, "", 0, {}, [], [], None, [], {}, 0.0)

    curve = [at(1.0, 4), at(2.0, 1), at(3.0, 2), at(4.0, 4), at(5.0, 4)]
    assert (from_when(curve, 0.5), from_when(curve, 1.0)) == (3.0, 4.0)
    assert from_when(curve[:2], 0.5) is None

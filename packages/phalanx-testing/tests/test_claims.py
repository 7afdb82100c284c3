"""Each assertion of a run is seen to pass, and to fail with its words."""

from functools import cache

import pytest
from phalanx_testing import CheckedRun, ClaimError, kill, lie, partition, start

from phalanx.launcher.run import Run

from .crossing import CROSSING, UNFILTERED, crossed

CUT = partition(["a"], at=0.5, for_=0.5)
LIE = lie("b", says="opposite", at=0.2, for_=1.0)
HEAD_ON = {"agents.0.start": [[-1.5, 0.0], [1.5, 0.0]], "agents.0.goal": [[1.5, 0.0], [-1.5, 0.0]]}
WATCHED = {"safety.information": "split", "safety.watch": True}
RUNS = {
    "plain": {},
    "unfiltered": {"overrides": UNFILTERED},
    "cut": {"loss": 0.9, "faults": [CUT]},
    "late": {"faults": [partition(["a"], at=5.0, for_=1.0)]},
    "seen": {"overrides": {"safety.information": "split"}, "loss": 0.5},
    "watched": {"overrides": WATCHED, "faults": [LIE]},
    "killed": {"faults": [kill("b", at=0.3)]},
    "head-on": {"overrides": HEAD_ON},
    "promised": {"overrides": UNFILTERED | {"safety.keep": "hold"}},
    "promise lost": {"overrides": {"safety.keep": "hold"}, "faults": [kill("b", at=0.3)]},
}


@cache
def of(name: str) -> CheckedRun:
    return crossed(**RUNS[name])


KEPT = [
    ("plain", "guaranteed", {}),
    ("plain", "safe", {}),
    ("plain", "never_closer", {"distance": 1.2}),
    ("plain", "arrives", {"by": 2.9}),
    ("plain", "no_deadlock", {}),
    ("promised", "promise_kept", {}),
    ("cut", "recovers", {"after": "partition", "within": 0.2}),
    ("plain", "never", {"predicate": lambda now: now.h["a-b"] > 0.0}),
    ("plain", "eventually", {"predicate": lambda now: now.states["a"][0] > 1.0, "by": 2.9}),
    ("watched", "detects", {"liar": "b", "within": 0.1}),
    ("plain", "same_bits", {}),
    ("cut", "network_matters", {}),
]
BROKEN = [
    ("unfiltered", "guaranteed", {}, "violated: a-b left the safe set"),
    ("unfiltered", "safe", {}, r"worst h \S+ of a-b at t = \d\.\d+ s"),
    ("plain", "never_closer", {"distance": 1.5}, r"a and b were 1\.\d+ m apart at t = 1\.\d+ s"),
    ("plain", "arrives", {"by": 0.5}, r"\w was there from t = \d\.\d+ s on"),
    ("killed", "arrives", {"by": 2.9}, r"b ended \S+ m from its goal"),
    ("head-on", "no_deadlock", {}, r"\w for \w \(\S+ to \S+ s\), .*: phalanx explain /\S+"),
    ("plain", "promise_kept", {}, "nothing was promised: no agent keeps a fallback"),
    ("promise lost", "promise_kept", {}, r"broken at 0\.\d+ s by b: it fell silent"),
    ("plain", "recovers", {"after": "partition", "within": 0.2}, "no such fault"),
    ("cut", "recovers", {"after": "partition", "within": 2.0}, "it lasts until t = 1 s"),
    ("late", "recovers", {"after": "partition", "within": 0.1}, "it lasts until t = 6 s"),
    ("plain", "never", {"predicate": lambda now: now.t > 1.0}, r"true at t = 1\.0\d+ s"),
    ("plain", "eventually", {"predicate": lambda now: now.t > 2.0, "by": 1.0}, "up to t = 1 s"),
    ("plain", "detects", {"liar": "b"}, "no agent watches another"),
    ("watched", "detects", {"liar": "a"}, "no agent convicted a"),
    ("watched", "detects", {"liar": "b", "within": 0.01}, r"it took 0\.0\d+ s"),
    ("late", "network_matters", {}, r"faults\.0 \(partition\) never had an effect"),
    ("seen", "network_matters", {}, "every input is that of an agent which knows the truth"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "claim", "arguments"), KEPT)
def test_a_claim_that_holds_passes(name, claim, arguments):
    getattr(of(name), f"assert_{claim}")(**arguments)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "claim", "arguments", "words"), BROKEN)
def test_a_claim_that_does_not_hold_says_why(name, claim, arguments, words):
    with pytest.raises(ClaimError, match=words) as caught:
        getattr(of(name), f"assert_{claim}")(**arguments)
    assert caught.value.run is of(name)
    assert str(caught.value).startswith(f"assert_{claim}(")


@pytest.mark.slow
def test_a_claim_of_other_bits_names_the_first_difference():
    with pytest.raises(ClaimError, match=r"agent a, k = \d+, t = \d\.\d+ s"):
        of("plain").assert_same_bits(of("cut"))


@pytest.mark.slow
def test_recovery_fails_where_a_pair_is_unsafe_after_the_fault():
    run = crossed(overrides=UNFILTERED, faults=[partition(["a"], at=0.1, for_=0.1)])
    with pytest.raises(ClaimError, match=r"a pair is unsafe at t = 0\.\d+ s"):
        run.assert_recovers(after="partition", within=0.1)


def test_every_assertion_is_seen_to_pass_and_to_fail():
    claims = {name for name in vars(CheckedRun) if name.startswith("assert_")}
    assert {f"assert_{claim}" for _, claim, _ in KEPT} == claims
    assert {f"assert_{claim}" for _, claim, *_ in BROKEN} == claims - {"assert_same_bits"}


def test_a_run_that_broke_keeps_no_claim(tmp_path):
    (tmp_path / "recording.mcap").write_bytes((of("plain").folder / "recording.mcap").read_bytes())
    with pytest.raises(ClaimError, match="the run broke: "):
        CheckedRun.of(Run(tmp_path, None)).assert_safe()


@pytest.mark.slow
def test_a_run_is_stepped_commanded_and_asserted():
    with start(CROSSING) as live:
        live.until(0.3)
        live.command("kill", "b")
        run = live.finish()
    assert [command.kind for command in run.recording.commands] == ["kill"]
    with pytest.raises(ClaimError, match=r"\w ended \S+ m from its goal"):
        run.assert_arrives(by=2.9)


def test_after_each_of_several_faults_there_is_time_to_recover():
    cuts = [partition(["a"], at=0.5, for_=0.1), partition(["a"], at=1.5, for_=0.5)]
    run = crossed(faults=cuts)
    next(state for state in run.recording.states if state.t > 2.05).h = 0.1
    run.assert_recovers(after="partition", within=0.2)
    with pytest.raises(ClaimError, match=r"a pair is unsafe at t = 2\.0"):
        run.assert_recovers(after="partition", within=0.01)


@pytest.mark.slow
def test_one_who_also_convicts_the_honest_detects_no_liar():
    run = crossed(**RUNS["watched"])
    run.summary.trust.convictions[-1].after = None
    with pytest.raises(ClaimError, match=r"\w convicted b falsely at t = 0\.\d+ s"):
        run.assert_detects("b")

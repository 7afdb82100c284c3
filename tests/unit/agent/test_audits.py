"""Audits by replay: honest steps replay to the bit, and only those who lied are convicted."""

import itertools

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from phalanx_agent.replay import StepReplay

import phalanx
from phalanx.launcher.in_process_engine import DirectRun
from phalanx.network.inbox import Claim
from phalanx.seeded.draws import Draws
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import Broadcaster, build_swarm
from phalanx.wire.audit import PATIENCE, Auditor, _Challenge, convicts
from phalanx.wire.equivocation import NotProvenError, Witness, claim_of
from phalanx.wire.membership import Membership
from phalanx.wire.messages import AuditedBroadcast, AuditedClaim, Reveal
from phalanx.wire.signatures import Signatures, digest_of

AUDIT = {"safety.evidence": True, "safety.audit": True}
INFORMATION = ("paper", "in-flight", "split", "worst-case", "unknown")


def ran(name: str, seed: int = 0, **changes: object) -> DirectRun:
    """Run a scenario with audits to its end, and return all that is left of it."""
    scenario = phalanx.load(name, {"duration": 0.5, **AUDIT, **changes}, seed)
    rows = build_rows(build_swarm(scenario))
    run = DirectRun(rows, None)
    run.rows, run.summary = rows, run.plant.run()
    return run


def audits(run: DirectRun) -> dict[int, Auditor]:
    """Each normal agent's auditor."""
    return {i: s.audits.auditor for i, s in run.agents.steps.items() if s.audits}


def own(run: DirectRun, i: int) -> list[tuple[AuditedClaim, Reveal]]:
    """The last claims and reveals of agent i, as another agent heard the claims."""
    kept = audits(run)[i].kept
    heard = [a.witness._claims[i] for l, a in audits(run).items() if l != i]
    return [(found[k], kept[k]) for found in heard for k in kept.keys() & found.keys()]


def replayed(run: DirectRun, i: int, replay: StepReplay) -> int:
    """Compute the last steps of agent i again, the newest first, and count them."""
    steps = own(run, i)[::-1]
    for claim, reveal in steps:
        assert replay(reveal) == Claim(claim.t_apply, claim.u)
        assert digest_of(reveal) == claim.digest
    return len(steps)


@settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)
@given(
    st.sampled_from(INFORMATION),
    st.booleans(),
    st.floats(0.0, 0.6),
    st.floats(0.0, 0.05),
    st.integers(0, 9),
)
@pytest.mark.slow
def test_honest_steps_replay_to_the_bit_and_convict_nobody(information, prove, loss, delay, seed):
    changes = {
        "safety.information": information, "safety.prove": prove,
        "network.loss": loss, "network.delay": delay,
    }  # fmt: skip
    run = ran("unicycles", seed, duration=0.3, **changes)
    assert run.summary.trust.convictions == []
    assert not any(auditor.refused for auditor in audits(run).values())
    replay = StepReplay(run.rows)
    assert sum(replayed(run, i, replay) for i in audits(run)) or loss > 0.5


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("crossing", {"safety.information": "earned", "network.loss": 0.0, "network.delay": 0.0}),
        ("crossing", {"safety.information": "earned", "safety.prove": True, "duration": 1.0}),
        ("swarm2d", {"safety.prove": True}),
        pytest.param(
            *("formation3d", {"duration": 3.0, "safety.neighbourhood": 60.0}),
            marks=pytest.mark.nightly,
        ),
        pytest.param("guaranteed", {}, marks=pytest.mark.nightly),
    ],
)
@pytest.mark.slow
def test_steps_replay_with_memory_trust_and_waypoints(name, changes):
    run = ran(name, **changes)
    replay = StepReplay(run.rows)
    assert sum(replayed(run, i, replay) for i in audits(run)) > 10
    assert run.summary.trust.convictions == []


@pytest.mark.slow
def test_a_step_is_replayed_with_the_trust_and_the_memory_that_are_revealed():
    run = ran(
        "crossing",
        duration=8.0,
        **{"safety.information": "earned", "network.loss": 0.0, "network.delay": 0.0},
    )
    replay, south = StepReplay(run.rows), run.rows.swarm.names.index("south")
    steps = [reveal for i in audits(run) for _, reveal in own(run, i)]
    trusting = [changed(r, trusted=tuple(sorted({*r.seen} - {r.sender}))) for r in steps]
    assert any(replay(changed(r, trusted=())) != replay(r) for r in trusting)
    # The last of what an agent with waypoints remembers is how many of them it reached.
    none = np.float64(0).tobytes()
    steps = [reveal for _, reveal in own(run, south)]
    assert any(replay(changed(r, memory=r.memory[:-8] + none)) != replay(r) for r in steps)


def test_audits_change_no_trajectory():
    calm = phalanx.load("unicycles", {"duration": 0.5})
    summary = DirectRun(build_rows(build_swarm(calm)), None).plant.run()
    assert ran("unicycles").summary.trajectory == summary.trajectory


LIES = {
    "a constant input": {"kind": "lie", "agent": "2", "says": [3.96, 0.0]},
    "zero": {"kind": "lie", "agent": "2", "says": "zero"},
    "opposite": {"kind": "lie", "agent": "2", "says": "opposite"},
    "an older input": {"kind": "lie", "agent": "2", "replay": 5},
    "a later time": {"kind": "lie", "agent": "2", "apply_time": 0.004},
    "another to each": {"kind": "lie", "agent": "2", "equivocate": True},
    "an attack, announced as it is": {"kind": "turn", "agents": ["2"]},
}


@pytest.mark.parametrize("name", LIES)
@pytest.mark.slow
def test_who_announces_what_its_step_does_not_give_is_convicted_by_all(name):
    fault = {"at": 0.1, **LIES[name]} | ({"for": 9.0} if LIES[name]["kind"] == "lie" else {})
    run = ran("unicycles", duration=0.8, faults=[fault])
    trust = run.summary.trust
    proven = {(each.by, each.of) for each in trust.convictions if each.proof is not None}
    assert proven == {("1", "2"), ("3", "2")}
    assert trust.false == 0
    if "equivocate" not in LIES[name]:
        assert {each.proof for each in trust.convictions} >= {"replay"}
    assert all(each.after > 0.0 for each in trust.convictions)
    for step in run.agents.steps.values():
        assert not step.audits or step.audits._watch.convicted == {LIAR} - {step.i}


def test_a_hijack_whose_announcements_are_its_steps_passes_audits():
    """It does not hold them: that is what the motion check is for."""
    run = ran("unicycles", faults=[{"kind": "hijack", "at": 0.1, "agents": ["2"]}])
    found = run.summary.trust.convictions
    assert {each.of for each in found} == {"2"}
    assert {each.proof for each in found} == {None}


# Forged evidence against an honest agent: its true claim and reveal, and what a liar can make.

NAMES = ("1", "2", "3", "4", "5")
LIAR, HONEST, THIRD = 1, 0, 2
HOME = Membership("in-process", "")


@pytest.fixture(scope="module")
def run() -> DirectRun:
    return ran("unicycles", duration=0.2)


@pytest.fixture(scope="module")
def true(run: DirectRun) -> tuple[AuditedClaim, Reveal]:
    """The newest claim and signed reveal of the honest agent."""
    claim, reveal = max(own(run, HONEST), key=lambda step: step[1].k)
    return claim, Signatures(HOME, NAMES, HONEST).sign_reveal(reveal)


def changed(signed, **fields):
    return msgspec.structs.replace(signed, **fields)


def by_liar(reveal: Reveal) -> Reveal:
    """Sign another agent's reveal with the liar's key."""
    signed = Signatures(HOME, NAMES, LIAR).sign_reveal(changed(reveal, sender=LIAR))
    return changed(reveal, signature=signed.signature)


FORGED = {
    "an altered input": lambda c, r: (changed(c, u=(0.5, 0.5)), r),
    "an altered time": lambda c, r: (changed(c, t_apply=c.t_apply + 1e-9), r),
    "an altered digest": lambda c, r: (changed(c, digest=bytes(32)), r),
    "another number": lambda c, r: (changed(c, k=c.k + 1), changed(r, k=r.k + 1)),
    "a reveal of another number": lambda c, r: (c, changed(r, k=r.k + 1)),
    "a reveal of another number, signed": lambda c, r: (
        c,
        Signatures(HOME, NAMES, HONEST).sign_reveal(changed(r, k=r.k - 1)),
    ),
    "an altered sample": lambda c, r: (c, changed(r, x=bytes(len(r.x)))),
    "an altered time of the sample": lambda c, r: (c, changed(r, t=r.t + 0.001)),
    "nothing seen": lambda c, r: (c, changed(r, seen=(), x=b"")),
    "nothing received": lambda c, r: (c, changed(r, received=())),
    "an altered sample, signed by the liar": lambda c, r: (
        c,
        by_liar(changed(r, x=bytes(len(r.x)))),
    ),
    "the liar's claim as the honest agent's": lambda c, r: (
        changed(Signatures(HOME, NAMES, LIAR).sign(c.k, c.t_apply, (0.0, 0.0), c.digest), sender=0),
        r,
    ),
    "without signatures": lambda c, r: (changed(c, signature=b""), changed(r, signature=b"")),
    "signatures exchanged": lambda c, r: (
        changed(c, signature=r.signature),
        changed(r, signature=c.signature),
    ),
    "of another run": lambda c, r: (
        c,
        Signatures(Membership("other", ""), NAMES, HONEST).sign_reveal(changed(r, trusted=(1,))),
    ),
    "of nobody": lambda c, r: (changed(c, sender=9), changed(r, sender=9)),
    "the truth": lambda c, r: (c, r),
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_evidence_convicts_nobody(name, run, true):
    claim, reveal = FORGED[name](*true)
    third = audits(run)[THIRD]
    refused = third.refused
    carrier = AuditedBroadcast(
        k=1000, t_apply=1.0, u=(0.0, 0.0), signature=b"", relayed=(claim,), digest=b"",
        reveal=reveal,
    )  # fmt: skip
    assert third.hear(0.0, [(LIAR, carrier)]) == []
    assert third.proven == {}
    assert third.refused == refused + 1
    witness = Witness(THIRD, {}, Signatures(HOME, NAMES, THIRD))
    replay = StepReplay(run.rows)
    if name == "the truth":
        assert not convicts(claim, reveal, witness, replay)
        return
    with pytest.raises(NotProvenError):
        convicts(claim, reveal, witness, replay)


def test_a_signed_reveal_that_does_not_match_its_digest_convicts(run, true):
    claim, reveal = true
    # The step's input does not depend on trust, but its digest does.
    other = Signatures(HOME, NAMES, HONEST).sign_reveal(changed(reveal, trusted=(1,)))
    witness, replay = Witness(THIRD, {}, Signatures(HOME, NAMES, THIRD)), StepReplay(run.rows)
    assert replay(other) == replay(reveal)
    assert convicts(claim, other, witness, replay)


@pytest.mark.parametrize("other", [{"u": (0.5, 0.5)}, {"t_apply": 9.0}])
def test_a_signed_broadcast_that_is_not_the_step_revealed_convicts(other, run, true):
    claim, reveal = true
    stated = changed(claim, **other)
    signed = Signatures(HOME, NAMES, HONEST).sign(
        stated.k, stated.t_apply, stated.u, digest_of(reveal)
    )
    witness = Witness(THIRD, {}, Signatures(HOME, NAMES, THIRD))
    assert convicts(signed, reveal, witness, StepReplay(run.rows))


def test_an_agents_trust_follows_its_audits(run):
    for i, step in run.agents.steps.items():
        if step.audits and i != LIAR:
            watch, auditor = step.audits._watch, step.audits.auditor
            auditor.unanswering.add(LIAR)
            watch.checked_until[LIAR] = 1.0
            assert LIAR not in watch.trusted(1.0)
            auditor.unanswering.remove(LIAR)
            assert LIAR in watch.trusted(1.0)


GARBAGE = {
    "states cut short": lambda r: changed(r, x=r.x[:-1]),
    "states that are not finite": lambda r: changed(r, x=np.full(len(r.x) // 8, np.nan).tobytes()),
    "agents out of order": lambda r: changed(r, seen=r.seen[::-1]),
    "an agent that there is not": lambda r: changed(r, seen=(*r.seen, 99)),
    "memory that it has not": lambda r: changed(r, memory=b"12345678"),
    "a broadcast that nobody signed": lambda r: changed(
        r, received=(AuditedClaim(1, 3, 0.1, (1.0, 1.0), b"s" * 64, b"d" * 32),)
    ),
    "an input of another size": lambda r: changed(
        r, received=(Signatures(HOME, NAMES, 1).sign(3, 0.1, (1.0,), b"d" * 32),)
    ),
    "a broadcast of nobody that it hears": lambda r: changed(
        r, received=(Signatures(HOME, NAMES, 4).sign(3, 0.1, (1.0, 1.0), b"d" * 32),)
    ),
}


@pytest.mark.parametrize("name", GARBAGE)
def test_a_reveal_of_no_step_is_no_evidence_though_signed(name, run, true):
    """It is no answer either: its sender stays unanswering."""
    reveal = GARBAGE[name](true[1])
    signatures = Signatures(HOME, NAMES, HONEST)
    claim = signatures.sign(true[0].k, true[0].t_apply, true[0].u, digest_of(reveal))
    witness = Witness(THIRD, {}, Signatures(HOME, NAMES, THIRD))
    with pytest.raises(NotProvenError):
        convicts(claim, signatures.sign_reveal(reveal), witness, StepReplay(run.rows))


def reveal(k: int) -> Reveal:
    return Reveal(HONEST, k, 0.01 * k, (0,), b"", (), (), b"")


def test_who_does_not_answer_is_trusted_no_more_until_it_does():
    """Two auditors ask each other; the other's broadcasts lack the answer at first."""
    asks, answers = (
        Auditor(
            i,
            Witness(i, {other: Broadcaster(other, 1, 10_000)}, Signatures(HOME, NAMES, i)),
            lambda shown: Claim(shown.t, (1.0,)),
            Draws(0, "audit", NAMES[i], width=2),
            {other: PATIENCE * 0.01},
        )
        for i, other in ((THIRD, HONEST), (HONEST, THIRD))
    )
    silent, when = True, dict[bool, int]()
    for k in itertools.count():
        sent = []
        for auditor in (asks, answers):
            auditor.prepare(changed(reveal(k), sender=auditor._i))
            sent.append(auditor.broadcast(k, Claim(0.01 * k, (1.0,))))
        if silent:
            sent[1] = changed(sent[1], reveal=None)
        for auditor, sender, message in ((asks, HONEST, sent[1]), (answers, THIRD, sent[0])):
            auditor.witness._compare(claim_of(sender, message), verified=True)
            assert auditor.hear(0.01 * (k + 1), [(sender, message)]) == []
        found = HONEST in asks.unanswering
        when.setdefault(found, k)
        if found and silent:
            silent = False
        elif not found and not silent:
            break
    assert when[True] >= PATIENCE
    assert asks.proven == answers.proven == {}


def test_a_reveal_of_another_number_answers_no_challenge():
    broadcasters, draws = {HONEST: Broadcaster(HONEST, 1, 100)}, Draws(0, "audit", "3", width=2)
    witness = Witness(THIRD, broadcasters, Signatures(HOME, NAMES, THIRD))
    asks = Auditor(THIRD, witness, lambda shown: Claim(shown.t, (1.0,)), draws, {HONEST: 1.0})
    asks._challenge, own = _Challenge(HONEST, 5, 0, 9.0), Signatures(HOME, NAMES, HONEST)
    for k, answered in ((4, []), (5, [5])):
        shown = own.sign_reveal(reveal(k))
        witness._compare(own.sign(k, shown.t, (1.0,), digest_of(reveal(k))), verified=True)
        carrier = AuditedBroadcast(
            k=9, t_apply=0.1, u=(1.0,), signature=b"", relayed=(), digest=b"", reveal=shown
        )
        assert asks.hear(0.1, [(HONEST, carrier)]) == []
        assert [each.k for each in asks.answered] == answered

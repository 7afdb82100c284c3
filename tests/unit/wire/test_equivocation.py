"""Two signed broadcasts of one number that differ convict their sender; nothing else does."""

import msgspec
import pytest

from phalanx.swarm.swarm import Broadcaster
from phalanx.wire.equivocation import NotProvenError, Witness, equivocator
from phalanx.wire.membership import Membership
from phalanx.wire.messages import SignedBroadcast, SignedClaim
from phalanx.wire.signatures import Signatures

NAMES = ("liar", "honest", "third")
LIAR, HONEST, THIRD = range(3)
RUN = Membership("r1", "", b"the run's secret")


def signatures(i: int, run: Membership = RUN) -> Signatures:
    """Agent i's, as the launcher gives them: with its own private key alone."""
    return Signatures(run.of(NAMES[i], (NAMES[i],), NAMES, signed=True), NAMES, i)


def witness(i: int, *senders: int) -> Witness:
    """Agent i, that hears these senders, each with two inputs and a hundred broadcasts."""
    return Witness(i, {l: Broadcaster(l, 2, 100) for l in senders}, signatures(i))


def signed(i: int, k: int = 7, u: tuple[float, ...] = (1.0, 2.0), run: Membership = RUN):
    return signatures(i, run).sign(k, 0.01 * k, u)


def changed(claim: SignedClaim, **fields: object) -> SignedClaim:
    return msgspec.structs.replace(claim, **fields)


def as_broadcast(claim: SignedClaim, *relayed: SignedClaim) -> SignedBroadcast:
    return SignedBroadcast(
        k=claim.k, t_apply=claim.t_apply, u=claim.u, signature=claim.signature, relayed=relayed
    )


TRUE = signed(HONEST)
OTHER_U = (5.0, 5.0)
BY_LIAR = signed(LIAR, u=OTHER_U)
FORGED = {
    "signed with the liar's key": (
        changed(BY_LIAR, sender=HONEST),
        "bad signature",
    ),
    "an altered input": (changed(TRUE, u=OTHER_U), "bad signature"),
    "an altered time": (changed(TRUE, t_apply=9.0), "bad signature"),
    "of another run with the same secret": (
        signed(HONEST, u=OTHER_U, run=Membership("r2", "", RUN.secret)),
        "bad signature",
    ),
    "of another run with the same name": (
        signed(HONEST, u=OTHER_U, run=Membership("r1", "", b"another secret")),
        "bad signature",
    ),
    "of another number": (signed(HONEST, k=8, u=OTHER_U), "two numbers"),
    "of another number, renumbered": (
        changed(signed(HONEST, k=8, u=OTHER_U), k=7),
        "bad signature",
    ),
    "the same broadcast twice": (TRUE, "the same claim twice"),
    "of another sender": (BY_LIAR, "two senders"),
    "a signature cut short": (
        changed(TRUE, u=OTHER_U, signature=TRUE.signature[:32]),
        "bad signature",
    ),
    "without a signature": (changed(TRUE, u=OTHER_U, signature=b""), "bad signature"),
    "an input cut short": (changed(TRUE, u=TRUE.u[:1]), "bad signature"),
    "of nobody": (changed(TRUE, sender=3, u=OTHER_U), "two senders"),
    "of an index before the first": (changed(TRUE, sender=-2, u=OTHER_U), "two senders"),
}


def other_schema() -> SignedClaim:
    """A claim whose signature is the honest agent's, of the same fields under another head."""
    claim = changed(TRUE, u=OTHER_U)
    own = signatures(HONEST)
    fields = ("phalanx claim 2", "r1", "honest", claim.k, claim.t_apply, claim.u)
    return changed(claim, signature=own._private.sign(msgspec.msgpack.encode(fields)))


FORGED["of another schema"] = (other_schema(), "bad signature")


def test_two_claims_of_one_number_that_differ_convict_their_sender():
    assert equivocator([signed(LIAR), BY_LIAR], signatures(THIRD)) == LIAR


@pytest.mark.parametrize("name", FORGED)
def test_forged_evidence_convicts_nobody(name):
    forged, reason = FORGED[name]
    for evidence in ([TRUE, forged], [forged, TRUE]):
        with pytest.raises(NotProvenError, match=reason):
            equivocator(evidence, signatures(THIRD))


@pytest.mark.parametrize("name", FORGED)
def test_who_hears_forged_evidence_convicts_nobody_and_keeps_the_truth(name):
    heard = witness(THIRD, LIAR, HONEST)
    forged, _ = FORGED[name]
    assert heard.hear([(LIAR, as_broadcast(signed(LIAR, k=6), forged, TRUE))]) == []
    assert heard.hear([(LIAR, as_broadcast(signed(LIAR, k=9), TRUE, forged))]) == []
    assert HONEST not in heard.proven
    # The honest agent's own broadcast still counts, and none of it is evidence.
    assert heard.hear([(HONEST, as_broadcast(TRUE))]) == []
    nobody = forged.sender not in (LIAR, HONEST)
    unsigned = FORGED[name][1] == "bad signature"
    assert heard.refused == (2 if nobody or unsigned else 0)


@pytest.mark.parametrize("sender", [-2, 3])
def test_a_claim_of_no_agent_is_not_genuine_though_signed(sender):
    both = [changed(claim, sender=sender) for claim in (TRUE, signed(HONEST, u=OTHER_U))]
    with pytest.raises(NotProvenError, match="bad signature"):
        equivocator(both, signatures(THIRD))


def test_evidence_of_one_claim_or_three_is_none():
    for count in (0, 1, 3):
        with pytest.raises(NotProvenError, match="expected two claims"):
            equivocator([TRUE] * count, signatures(THIRD))


@pytest.mark.parametrize("early", ["the relay", "the broadcast"])
def test_a_relayed_claim_that_differs_convicts_whichever_comes_first(early):
    heard = witness(THIRD, LIAR, HONEST)
    messages = [
        (HONEST, as_broadcast(signed(HONEST, k=8), signed(LIAR))),
        (LIAR, as_broadcast(BY_LIAR)),
    ]
    first, second = messages if early == "the relay" else messages[::-1]
    assert heard.hear([first]) == []
    (evidence,) = heard.hear([second])
    assert equivocator(evidence, signatures(HONEST)) == LIAR
    assert heard.hear([first, second]) == [], "an agent is convicted once"


def test_a_conviction_spreads_with_its_evidence():
    first, last = witness(HONEST, LIAR), witness(THIRD, LIAR, HONEST)
    first.hear([(LIAR, as_broadcast(signed(LIAR)))])
    (claim,) = first.relay(8)
    assert claim == signed(LIAR), "until then, what it heard"
    first.hear([(LIAR, as_broadcast(BY_LIAR))])
    carrier = as_broadcast(signed(HONEST, k=9), *first.relay(9))
    assert len(carrier.relayed) == 2
    (evidence,) = last.hear([(HONEST, carrier)])
    assert evidence.first.sender == LIAR
    assert {last.relay(k) for k in (8, 9)} == {tuple(evidence), (signed(HONEST, k=9),)}


@pytest.mark.parametrize("fields", [{"u": (0.0,) * 3000}, {"u": ()}, {"k": 100}, {"k": -1}])
def test_claims_that_are_no_broadcast_are_refused_though_signed(fields):
    heard, claim = witness(THIRD, LIAR, HONEST), changed(signed(LIAR), **fields)
    own = signatures(LIAR).sign(claim.k, claim.t_apply, claim.u)
    heard.hear([(HONEST, as_broadcast(TRUE, own))])
    assert heard.refused == 1
    assert heard.relay(0) == heard.relay(1) == (TRUE,), "it would fill what others broadcast"


def test_claims_of_senders_that_are_not_heard_are_refused():
    heard = witness(THIRD, HONEST)
    assert heard.hear([(HONEST, as_broadcast(TRUE, signed(LIAR), BY_LIAR))]) == []
    assert heard.refused == 2


def test_no_program_has_the_private_key_of_another():
    held = RUN.of("liar", ("liar",), NAMES, signed=True)
    assert held.signing_key("liar") == RUN.signing_key("liar")
    with pytest.raises(KeyError):
        held.signing_key("honest")
    assert held.public_key("honest") == RUN.public_key("honest")

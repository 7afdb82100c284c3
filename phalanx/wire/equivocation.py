"""Equivocation: two signed broadcasts of one number by one sender that differ.

An honest agent signs one claim for each number, so that two are evidence against it, which every
agent checks for itself. Each broadcast relays a claim that its sender heard, in turn, so that peers
find pairs. A pair that was found is relayed too, and the conviction spreads with it.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from phalanx.network.inbox import SentInput
from phalanx.swarm.swarm import Broadcaster
from phalanx.wire.messages import AuditedBroadcast, AuditedClaim, SignedBroadcast, SignedClaim
from phalanx.wire.signatures import Signatures

_MOST = 64
"""Claims of one sender that are kept: later numbers replace the least."""


class NotProvenError(ValueError):
    """Two claims are no evidence; the text is the reason."""


class Equivocation(NamedTuple):
    """Two claims that convict their sender."""

    first: SignedClaim
    second: SignedClaim


def equivocator(evidence: Sequence[SignedClaim], signatures: Signatures) -> int:
    """Return the index of the agent that two claims convict. Raises NotProvenError: they do not."""
    if len(evidence) != 2:
        raise NotProvenError(f"expected two claims, got {len(evidence)}")
    first, second = evidence
    if first.sender != second.sender:
        raise NotProvenError("two senders")
    if first.k != second.k:
        raise NotProvenError("two numbers")
    if not (signatures.genuine(first) and signatures.genuine(second)):
        raise NotProvenError("bad signature")
    if signatures.statement(first) == signatures.statement(second):
        raise NotProvenError("the same claim twice")
    return first.sender


def claim_of(sender: int, message: SignedBroadcast) -> SignedClaim:
    """Return the claim of a broadcast."""
    k, t_apply, u, signature = message.k, message.t_apply, message.u, message.signature
    if isinstance(message, AuditedBroadcast):
        return AuditedClaim(sender, k, t_apply, u, signature, message.digest)
    return SignedClaim(sender, k, t_apply, u, signature)


class Witness:
    """The signed claims that one agent has heard, and the convictions that follow."""

    def __init__(self, i: int, senders: Mapping[int, Broadcaster], signatures: Signatures) -> None:
        """Keep for agent i the claims of these senders, by index."""
        self._i, self._senders, self.signatures = i, senders, signatures
        self._claims: dict[int, dict[int, SignedClaim]] = {l: {} for l in senders}
        """The first genuine claim heard, by sender and number."""
        self.proven: dict[int, Equivocation] = {}
        """The evidence against each convicted agent."""
        self.refused = 0
        """Relayed claims dropped so far: malformed, or not signed by their sender."""

    def hear(self, delivered: Iterable[tuple[int, SentInput]]) -> list[Equivocation]:
        """Return the evidence that broadcasts complete, whose own signatures were verified."""
        before = len(self.proven)
        for sender, message in delivered:
            if not isinstance(message, SignedBroadcast):
                continue
            self._compare(claim_of(sender, message), verified=True)
            for claim in message.relayed:
                self._compare(claim, verified=False)
        return list(self.proven.values())[before:]

    def claim(self, l: int, k: int) -> SignedClaim | None:
        """Return agent l's claim k, if it was heard."""
        return self._claims[l].get(k) if l in self._claims else None

    def genuine(self, claim: SignedClaim) -> bool:
        """Return whether its sender signed a claim; one that was heard is not verified again."""
        return claim == self.claim(claim.sender, claim.k) or self.signatures.genuine(claim)

    def relay(self, k: int) -> tuple[SignedClaim, ...]:
        """Return what broadcast k relays: in turn each evidence, and each other's newest claim."""
        others = [c for l, c in self._claims.items() if c and l not in self.proven]
        turns = [*map(tuple, self.proven.values()), *((c[max(c)],) for c in others)]
        return turns[k % len(turns)] if turns else ()

    def _compare(self, claim: SignedClaim, *, verified: bool) -> None:
        """Keep a claim, or convict its sender if it differs from the one that is kept."""
        l, stated = claim.sender, self.signatures.statement
        if l in self.proven or l == self._i:
            return
        if not self._plausible(claim):
            self.refused += 1
            return
        claims = self._claims[l]
        known = claims.get(claim.k)
        if known is not None and stated(known) == stated(claim):
            return
        if not (verified or self.signatures.genuine(claim)):
            self.refused += 1
        elif known is None:
            claims[claim.k] = claim
            if len(claims) > _MOST:
                del claims[min(claims)]
        else:
            evidence = Equivocation(known, claim)
            self.proven[equivocator(evidence, self.signatures)] = evidence

    def _plausible(self, claim: SignedClaim) -> bool:
        """Return whether a claim has the form of a broadcast: any other could fill messages."""
        sender = self._senders.get(claim.sender)
        return sender is not None and len(claim.u) == sender.inputs and 0 <= claim.k < sender.most

"""Audit by replay: a peer computes an agent's control step again, from what that agent reveals.

Each broadcast has a digest of its sender's Reveal: what the agent was shown, had received and
remembered. With the scenario that determines its input to the bit. Now and then an agent asks
another for the Reveal of a broadcast that it heard. If the answer does not match the digest, or
gives another input than was announced, broadcast and Reveal convict their sender: both are signed,
and every peer checks them for itself. Who does not answer in time is trusted no more, until it
answers a later challenge.

The idea is PeerReview's (Haeberlen, Kuznetsov and Druschel, SOSP 2007).
"""

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, TypeGuard

from phalanx.network.inbox import Claim, SentInput
from phalanx.seeded.draws import Draws
from phalanx.wire.equivocation import NotProvenError, Witness
from phalanx.wire.messages import AuditedBroadcast, AuditedClaim, Reveal, SignedClaim
from phalanx.wire.signatures import digest_of

_EVERY, _REPEATED = 16, 4
"""Own broadcasts from one challenge to the next, on average, and until it is repeated."""
_KEPT = 64
"""Reveals of own broadcasts that are kept: later ones replace the oldest."""
PATIENCE = 32.0
"""Longest wait for an answer, in the other's sampling periods; it keeps reveals for longer."""


Replay = Callable[[Reveal], Claim]
"""Computes a step again: what its sender must announce. Raises anything: it is of no step."""


class Misstep(NamedTuple):
    """A broadcast and a reveal that convict their sender."""

    claim: AuditedClaim
    reveal: Reveal


class _Challenge(NamedTuple):
    of: int
    """Index of the agent that is asked."""
    number: int
    """Of its broadcast."""
    begun: int
    """Number of the asker's broadcast that asked first."""
    until: float
    """When it is given up [s]."""


def convicts(claim: AuditedClaim, reveal: Reveal, witness: Witness, replay: Replay) -> bool:
    """Return whether a broadcast is not the step that its sender reveals.

    Raises:
        NotProvenError: they are no evidence: not both of one number and signed by one agent, or
            of no step that can be computed.
    """
    if (claim.sender, claim.k) != (reveal.sender, reveal.k):
        raise NotProvenError("of two broadcasts")
    if not (witness.genuine(claim) and witness.signatures.genuine_reveal(reveal)):
        raise NotProvenError("bad signature")
    if digest_of(reveal) != claim.digest:
        return True
    if not all(witness.genuine(received) for received in reveal.received):
        raise NotProvenError("a received broadcast without a signature")
    try:
        found = replay(reveal)
    except Exception as error:  # of content that no honest agent reveals: it is no answer
        raise NotProvenError(f"no step: {error}") from error
    return found != Claim(claim.t_apply, claim.u)


def _audited(claim: SignedClaim) -> TypeGuard[AuditedClaim]:
    return isinstance(claim, AuditedClaim)


class Auditor:
    """One agent's audits of those that it hears, and its answers to theirs."""

    def __init__(
        self,
        i: int,
        witness: Witness,
        replay: Replay,
        draws: Draws,
        patience: Mapping[int, float],
    ) -> None:
        """Audit as agent i.

        Args:
            i: the agent.
            witness: of the broadcasts that it has heard.
            replay: computes steps of others again.
            draws: at each own broadcast whether to ask, and whom; rows of two.
            patience: by agent, the longest wait for an answer [s].
        """
        self._i, self._replay = i, replay
        self.witness = witness
        """Of the broadcasts that it has heard."""
        self._draws, self._patience = draws, patience
        self.kept: dict[int, Reveal] = {}
        """The reveals of the last own broadcasts, by number."""
        self._heard: dict[int, int] = {}
        """The newest broadcast heard at this sample, by sender."""
        self._asked: dict[int, int] = {}
        """Own number that another asked for, by asker."""
        self._challenge: _Challenge | None = None
        self._attached: tuple[bytes, tuple[int, int] | None, Reveal | None] = b"", None, None
        self._evidence: tuple[AuditedClaim, ...] = ()
        self.proven: dict[int, Misstep] = {}
        """The evidence against each convicted agent."""
        self.unanswering: set[int] = set()
        """Agents whose last challenge was not answered in time."""
        self.answered: list[Reveal] = []
        """Answers at this sample whose step was found right."""
        self.refused = 0
        """Reveals dropped so far: no evidence, and no answer."""

    def hear(self, t: float, delivered: Iterable[tuple[int, SentInput]]) -> list[Misstep]:
        """Return the convictions that broadcasts complete, which were delivered by t [s]."""
        before = len(self.proven)
        self._heard, self.answered = {}, []
        for sender, message in delivered:
            if not isinstance(message, AuditedBroadcast):
                continue
            self._heard[sender] = max(message.k, self._heard.get(sender, 0))
            if message.challenge is not None and message.challenge[0] == self._i:
                self._asked[sender] = message.challenge[1]
            if message.reveal is not None:
                self._examine(sender, message.reveal, message.relayed)
        if self._challenge is not None and t > self._challenge.until:
            self.unanswering.add(self._challenge.of)
            self._challenge = None
        return list(self.proven.values())[before:]

    def prepare(self, reveal: Reveal) -> None:
        """Prepare the broadcast of a step: what it depends on, and what else the broadcast has."""
        k = reveal.k
        self.kept[k] = reveal
        if len(self.kept) > _KEPT:
            del self.kept[min(self.kept)]
        digest, challenge = digest_of(reveal), self._next_challenge(k, reveal.t)
        self._evidence, shown = (), self._answer()
        if shown is None and self.proven and k % _REPEATED == 0:
            evidence = list(self.proven.values())[k // _REPEATED % len(self.proven)]
            self._evidence, shown = (evidence.claim,), evidence.reveal
        self._attached = digest, challenge, shown

    def broadcast(self, k: int, claim: Claim) -> AuditedBroadcast:
        """Return the broadcast of a claim, signed, with all that was prepared."""
        digest, challenge, shown = self._attached
        signed = self.witness.signatures.sign(k, claim.t_apply, claim.u, digest)
        return AuditedBroadcast(
            k=k,
            t_apply=claim.t_apply,
            u=claim.u,
            signature=signed.signature,
            relayed=self._evidence or tuple(filter(_audited, self.witness.relay(k))),
            digest=digest,
            challenge=challenge,
            reveal=shown,
        )

    def _examine(self, sender: int, reveal: Reveal, relayed: tuple[AuditedClaim, ...]) -> None:
        """Check an answer to an own challenge, or evidence against another than its sender."""
        l, open_ = reveal.sender, self._challenge
        if l in self.proven or l == self._i:
            return
        claim: SignedClaim | None
        if l != sender:
            claim = relayed[0] if relayed else None
        elif open_ is not None and (l, reveal.k) == (open_.of, open_.number):
            claim = self.witness.claim(l, reveal.k)
        else:
            return
        if claim is None or not _audited(claim):
            self.refused += 1
            return
        try:
            guilty = convicts(claim, reveal, self.witness, self._replay)
        except NotProvenError:
            self.refused += 1
            return
        if guilty:
            self.proven[l] = Misstep(claim, reveal)
        elif l != sender:
            self.refused += 1
            return
        else:
            self.unanswering.discard(l)
            self.answered.append(reveal)
        if l == sender:
            self._challenge = None

    def _next_challenge(self, k: int, t: float) -> tuple[int, int] | None:
        others = [l for l in sorted(self._heard) if l not in self.proven]
        if self._challenge is None and others:
            now, whom = self._draws[k].tolist()
            if now * _EVERY < 1.0:
                l = others[int(whom * len(others))]
                self._challenge = _Challenge(l, self._heard[l], k, t + self._patience[l])
        open_ = self._challenge
        if open_ is None or (k - open_.begun) % _REPEATED:
            return None
        return open_.of, open_.number

    def _answer(self) -> Reveal | None:
        """Return the reveal that another asked for, signed, if there is one."""
        while self._asked:
            own = self.kept.get(self._asked.pop(min(self._asked)))
            if own is not None:
                return self.witness.signatures.sign_reveal(own)
        return None

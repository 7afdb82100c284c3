"""An agent's audits by replay: what it reveals of its own steps, and what it checks of others'."""

from collections.abc import Mapping

from phalanx.guarantee.verdict import Proof
from phalanx.network.inbox import SentInput
from phalanx.seeded.draws import Draws
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.watch import Conviction, Watch
from phalanx.wire.audit import PATIENCE, Auditor
from phalanx.wire.equivocation import Witness, claim_of
from phalanx.wire.messages import AuditedBroadcast, AuditedClaim, Reveal, Sample
from phalanx_agent.controller import DistributedController
from phalanx_agent.replay import StepReplay


class Audits:
    """Puts an auditor, the replay of steps and the agent's watch together."""

    def __init__(
        self,
        rows: SafetyRows,
        i: int,
        controller: DistributedController,
        watch: Watch,
        witness: Witness,
    ) -> None:
        """Audit as agent i, whose own inputs this controller makes."""
        swarm = rows.swarm
        self._i, self._controller, self._watch = i, controller, watch
        self._replay = StepReplay(rows)
        self.auditor = Auditor(
            i,
            witness,
            self._replay,
            Draws(swarm.seed, "audit", swarm.names[i], width=2),
            {l: PATIENCE * swarm.horizon(l) for l in swarm.heard_by(i)},
        )

    def __call__(
        self,
        sample: Sample,
        delivered: list[tuple[int, SentInput]],
        received: Mapping[int, SentInput],
    ) -> tuple[list[tuple[int, int, Proof]], list[Conviction]]:
        """Hear what was delivered, and prepare the broadcast that will answer a sample.

        Returns the new convictions by replay, and those by a revealed sample that no motion
        explains. Call it before the controller, whose memory it reads.
        """
        watch, auditor = self._watch, self.auditor
        found = auditor.hear(sample.t, delivered)
        contradicted = [
            watch.contradicts(shown.sender, shown.t, self._replay.state(shown))
            for shown in auditor.answered
        ]
        watch.convicted.update(each.claim.sender for each in found)
        watch.unanswering = auditor.unanswering
        trusted = self._controller.trusted(sample.t, sample.seen)
        auditor.prepare(
            Reveal(
                sender=self._i,
                k=sample.k,
                t=sample.t,
                seen=sample.seen,
                x=sample.x,
                received=_claims(received),
                trusted=tuple(sorted(trusted)),
                memory=self._controller.memory,
            )
        )
        proofs: list[tuple[int, int, Proof]] = [
            (each.claim.sender, each.claim.k, "replay") for each in found
        ]
        return proofs, [each for each in contradicted if each is not None]


def _claims(received: Mapping[int, SentInput]) -> tuple[AuditedClaim, ...]:
    """Return the claims of received broadcasts, in their order."""
    return tuple(
        claim
        for l, message in received.items()
        if isinstance(message, AuditedBroadcast)
        and isinstance(claim := claim_of(l, message), AuditedClaim)
    )

"""Another agent's control step, computed again from what that agent reveals of it."""

from collections.abc import Mapping

import numpy as np

from phalanx.network.inbox import Claim
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.watch import conviction_takes
from phalanx.wire.messages import Reveal
from phalanx_agent.controller import DistributedController


class _RevealedTrust:
    """The trust of an agent as it reveals it, in place of its watch."""

    def __init__(self, reserve: Mapping[int, float]) -> None:
        self.conviction_takes = reserve
        self.revealed: frozenset[int] = frozenset()

    def trusted(self, t: float) -> frozenset[int]:
        """Return what was revealed."""
        return self.revealed


class StepReplay:
    """Computes steps of any normal agent; each one's theory is compiled at its first step."""

    def __init__(self, rows: SafetyRows) -> None:
        """rows: of the whole swarm."""
        self._rows, self._codec = rows, StateCodec(rows.swarm)
        self._controllers: dict[int, tuple[DistributedController, _RevealedTrust]] = {}

    def __call__(self, reveal: Reveal) -> Claim:
        """Return what the agent must announce for a step that is as it reveals.

        Raises ValueError: no sample or memory of this agent's; or what its controller raises.
        """
        l, swarm = reveal.sender, self._rows.swarm
        x = self._codec.unpack(reveal.x, reveal.seen)
        received = {claim.sender: claim for claim in reveal.received}
        if l not in reveal.seen or not set(swarm.heard_by(l)).issuperset(received):
            raise ValueError("expected the agent itself and those that it hears")
        if not np.isfinite(np.frombuffer(reveal.x, dtype="<f8")).all():
            raise ValueError("expected finite states")
        if l not in self._controllers:
            trust = _RevealedTrust(conviction_takes(swarm, l))
            self._controllers[l] = DistributedController(self._rows, l, trust), trust
        controller, trust = self._controllers[l]
        controller.memory, trust.revealed = reveal.memory, frozenset(reveal.trusted)
        u = controller(x, reveal.seen, reveal.t, received).decision.u
        return Claim(reveal.t + swarm.time.latency, tuple(u.tolist()))

    def state(self, reveal: Reveal) -> np.ndarray:
        """Return the state of its own that an agent reveals, shape (n_l,)."""
        return self._codec.unpack_one(reveal.sender, reveal.x, reveal.seen)

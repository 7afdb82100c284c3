"""Statements by radio: which ones had reached whom, direct or repeated by another.

That follows from the reports on broadcasts, and from what their senders had heard by then.
"""

from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import NamedTuple

from phalanx.network.inbox import DeliveryReport
from phalanx.swarm.swarm import Swarm

_KEPT = 256
"""Broadcasts of one agent whose relays are kept."""


class OwnStatement(NamedTuple):
    """An agent's statement of itself, as others have it."""

    k: int
    """Number of its sample; -1 at the start."""
    t: float
    """Time of its sample [s]."""
    x: tuple[float, ...]
    t_apply: float
    u: tuple[float, ...]
    true: bool = True
    """Whether x is the state that it had."""

    @property
    def z(self) -> tuple[float, ...]:
        """The state: no report has the reference."""
        return self.x


class StatementLedger:
    """The newest statement that each agent had of each of its peers."""

    def __init__(self, swarm: Swarm) -> None:
        """Begin at x(0)."""
        self._radios = {i: swarm.groups[i].radio for i in swarm.normal if swarm.peers(i)}
        self.known = {i: _starts(swarm, i) for i in self._radios}
        """By agent and peer."""
        self._in_flight = defaultdict[int, list[tuple[float, DeliveryReport]]](list)
        self._sent: dict[tuple[int, int], list[tuple[int, OwnStatement]]] = {}
        """By agent and number of its broadcast: its own statement, then what it repeats."""
        self._convicted = defaultdict[int, set[int]](set)

    def restarted(self, i: int) -> None:
        """Forget what agent i knew, if it has a radio: another process has taken over."""
        if i in self.known:
            for by_agent in (self.known, self._in_flight, self._convicted):
                by_agent[i].clear()

    def sampled(
        self, i: int, t: float, k: int, x: Sequence[float],
        fates: Collection[DeliveryReport], convicted: Collection[int],
    ) -> None:  # fmt: skip
        """Follow agent i's sample k at t [s], at its true state x.

        fates: decided then. convicted: peers that it believes no more from now on.
        """
        self._convicted[i] |= {*convicted}
        self._deliver(i, t, fates)
        radio = self._radios[i]
        if radio is not None and k % radio.every == 0:
            heard = [(l, said) for l, said in self.known[i].items() if said.k >= 0]
            heard.sort(key=lambda item: (-item[1].t, item[0]))
            of_itself = i, OwnStatement(k, t, tuple(x), t, ())
            self._sent[i, k] = [of_itself, *heard[: radio.relays]]
            self._sent.pop((i, k - _KEPT * radio.every), None)

    def _deliver(self, i: int, t: float, fates: Collection[DeliveryReport]) -> None:
        """Add the statements that reach agent i by t [s] to what it knows."""
        in_flight, known = self._in_flight[i], self.known[i]
        in_flight += [(f.claim.t_apply + f.delay, f) for f in fates if f.claim]
        self._in_flight[i] = [(at, fate) for at, fate in in_flight if at > t]
        for fate in (fate for at, fate in in_flight if at <= t):
            claim, sent = fate.claim, self._sent.get((fate.sender, fate.k))
            if sent is None or claim is None:
                continue
            (_, statement), *others = sent
            x = claim.x or statement.x
            true = x == statement.x
            direct = OwnStatement(statement.k, statement.t, x, claim.t_apply, claim.u, true)
            for l, said in [(fate.sender, direct), *others]:
                newest = known[l].k if l in known else -1
                if said.k > newest and l != i and l not in self._convicted[i]:
                    known[l] = said


def _starts(swarm: Swarm, i: int) -> dict[int, OwnStatement]:
    """Return what agent i knows at t = 0: the starts, as a mission's plan has them, or nothing."""
    radio, start = swarm.groups[i].radio, swarm.start()
    peers = swarm.peers(i) if radio and radio.starts_known else ()
    parts, members = swarm.safe_set.parts, swarm.members
    return {
        l: OwnStatement(
            -1, 0.0, tuple(start[parts[l]].tolist()), 0.0, (0.0,) * len(members[l].dynamics.inputs)
        )
        for l in peers
    }

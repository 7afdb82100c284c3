"""Traffic of a run's broadcasts, which follows from its scenario."""

import msgspec

from phalanx.messages.kinds import Broadcast
from phalanx.messages.seal import SEAL_BYTES
from phalanx.network.inbox import Statement
from phalanx.swarm.swarm import Swarm

_ANY = 0.1
"""Each float takes as many bytes as this one."""


def payload_bytes(swarm: Swarm, i: int) -> int:
    """Return the size of normal agent i's sealed broadcast, with all that it may repeat [bytes]."""
    of = swarm.broadcasters[swarm.names[i]]
    u, x = (_ANY,) * of.inputs, (_ANY,) * of.states
    # Peers of other groups may have other sizes: theirs count as its own.
    one = Statement(sender=i, k=of.most, t_apply=_ANY, u=u, t=_ANY, x=x, z=x)
    relays = (one,) * min(of.relays, len(swarm.peers(i)))
    message = Broadcast(k=of.most, t_apply=_ANY, u=u, t=_ANY, x=x, z=x, relays=relays)
    return SEAL_BYTES + len(msgspec.msgpack.encode(message))


def traffic_in_words(swarm: Swarm) -> str:
    """Describe what normal agents broadcast, of most bytes first; empty if none is heard."""
    sizes = set()
    for i in (i for i in swarm.normal if swarm.heard_by(i)):
        every = swarm.broadcasters[swarm.names[i]].every
        sizes.add((payload_bytes(swarm, i), every * swarm.groups[i].clock.period))
    return "; ".join(
        f"{1.0 / period:.3g} a second and agent, of at most {size} bytes: "
        f"{1e-3 * size / period:.3g} kB/s"
        for size, period in sorted(sizes, reverse=True)
    )

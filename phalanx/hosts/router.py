"""The router: a hub that is nobody's but its own, so that it may die and come back in a run.

A run may have several, each near its own agents: what comes in at one goes out at all.
"""

import logging
import signal
from collections.abc import Sequence
from queue import SimpleQueue

from phalanx.identities.access import admission
from phalanx.swarm.swarm import Swarm
from phalanx.wire import liveliness
from phalanx.wire.keys import ROUTER
from phalanx.wire.membership import Membership
from phalanx.wire.session import open_hub

log = logging.getLogger("phalanx.router")


def run(swarm: Swarm, membership: Membership, beyond: Sequence[str] = ()) -> int:
    """Pass on what the programs of a run tell one another, until SIGTERM or Ctrl-C.

    Args:
        swarm: of the scenario, which says who may come in.
        membership: of the run, with its secret or certificates; the router listens on its endpoint.
        beyond: endpoints of the run's other hubs that this one connects to.

    Returns:
        Exit status 0.

    Raises:
        HubError: the endpoint cannot be listened on.
    """
    # No event: a handler that sets one while this thread begins to wait for it never returns.
    told_to_stop: SimpleQueue[int] = SimpleQueue()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: told_to_stop.put(number))
    shown = membership.credentials if beyond else None
    allowed = admission(swarm, membership)
    with open_hub(membership.endpoint, allowed, beyond, shown) as session:
        # Who sees it knows that the hub may come back after it was lost.
        _token = liveliness.announce(
            session, membership.keys.alive(ROUTER, str(session.info.zid()))
        )
        log.info("run %s meets at %s", membership.run, membership.endpoint)
        told_to_stop.get()
    return 0

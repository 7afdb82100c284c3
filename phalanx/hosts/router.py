"""The router: a hub in a process of its own, which may die and be restarted during a run.

A run may have several, each near some of the agents; each forwards messages to the others.
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


def run(swarm: Swarm, membership: Membership, other_hubs: Sequence[str] = ()) -> int:
    """Forward the messages of a run until SIGTERM or Ctrl-C; return exit status 0.

    Args:
        swarm: of the scenario, for the names of the programs to admit.
        membership: of the run, with its secret or identity; the router listens on its endpoint.
        other_hubs: endpoints of the run's other hubs that this one connects to.

    Raises:
        HubError: the endpoint cannot be listened on.
    """
    # No threading.Event: a signal handler that sets one while this thread enters wait() deadlocks.
    stop_signal: SimpleQueue[int] = SimpleQueue()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: stop_signal.put(number))
    credentials = membership.credentials if other_hubs else None
    allowed = admission(swarm, membership)
    with open_hub(membership.endpoint, allowed, other_hubs, credentials) as session:
        # Clients that have seen this token wait for the hub to come back after it was lost.
        _token = liveliness.announce(
            session, membership.keys.alive(ROUTER, str(session.info.zid()))
        )
        log.info("run %s meets at %s", membership.run, membership.endpoint)
        stop_signal.get()
    return 0

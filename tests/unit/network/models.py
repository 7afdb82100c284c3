"""Link models from the fields of a [network] table, without a scenario around them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from phalanx.messages.kinds import Broadcast
from phalanx.network.inbox import BroadcastInbox
from phalanx.network.link import Link, LinkModel, Stage
from phalanx.network.table import LinkTable
from phalanx.theory.arrays import Array

MANY = 40_000
"""So many that four standard errors of a share are a hundredth, where messages are independent."""
SOME = 20_000
"""Where a share alone is asked for, to a hundredth."""


def model(**fields: Any) -> LinkModel:
    """The model of a link with these fields; rules are numbered in their order."""
    rules = LinkTable.model_validate(fields).fields()
    return LinkModel(tuple(Stage(field, rule, i) for i, (field, rule) in enumerate(rules)))


def lost(count: int = MANY, **fields: Any) -> NDArray[np.bool_]:
    """Return for each of so many messages whether it is lost, shape (count,)."""
    link = Link(0, "a", "b", model(**fields))
    return np.array([link.fate(k).delay is None for k in range(count)])


def delays(count: int = MANY, **fields: Any) -> Array:
    """Delays of so many messages [s], shape (count,); none may be lost."""
    link = Link(0, "a", "b", model(**fields))
    return np.array([link.fate(k).delay for k in range(count)], dtype=float)


def broadcast(k: int) -> Broadcast:
    """The broadcast that is sent at k/100 s."""
    return Broadcast(k=k, t_apply=k / 100, u=(float(k), 0.0))


def inbox_of(links: LinkModel, senders: int = 1, count: int = 0) -> BroadcastInbox:
    """An inbox that listens to senders 0, 1, ..., and holds so many broadcasts of the first."""
    inbox = BroadcastInbox(range(senders), lambda s: Link(0, f"s{s}", "me", links))
    for k in range(count):
        inbox.put(0, broadcast(k))
    return inbox

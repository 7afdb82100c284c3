"""Broadcasts by radio that a program by Zenoh has received, by the draws of docs/wire.md.

It is for a constant loss and delay, and partitions.
"""

import hashlib
import json
from collections import defaultdict
from os import environ
from typing import Any

from numpy.random import Generator, Philox
from zenoh_agent import INDEX, NAME, NAMES

LINKS, EVERY = json.loads(environ["PHALANX_LINKS"]), 10  # samples between two broadcasts
CUTS = [fault for fault in LINKS["faults"] if fault["kind"] == "partition"]


def is_lost(sender: str, number: int, t: float) -> bool:
    """Return whether the link loses the broadcast with this number, sent at t."""
    for cut in CUTS:
        sides = [{sender, NAME} & set(group) for group in cut["groups"]]
        if cut["at"] <= t < cut["at"] + cut["for"] and any(len(side) == 1 for side in sides):
            return True
    name = "\x1f".join([environ["PHALANX_SEED"], "link", sender, NAME]).encode()
    key = int.from_bytes(hashlib.blake2b(name, digest_size=16).digest(), "little")
    rows = Generator(Philox(key=key, counter=(number // 256) << 192)).random((256, 2))
    return bool(rows[number % 256, 0] < LINKS["network"]["loss"])


class Inbox:
    """Broadcasts of peers, and the newest statement of each that has been received."""

    def __init__(self) -> None:
        self.arrived, self.heard = dict[tuple[int, int], list[Any]](), dict[int, list[Any]]()
        self._decided, self._on_air = defaultdict[int, int](lambda: -1), list[Any]()

    def receive(self, sample: list[Any]) -> list[Any] | None:
        """Return the fates of broadcasts that a sample counts; None if one has yet to come."""
        t, counted, delay = sample[1], zip(*sample[4:7], strict=True), LINKS["network"]["delay"]
        spans = {j: range(max(self._decided[j] + 1, first), last + 1) for j, first, last in counted}
        new = [(j, k) for j, numbers in spans.items() for k in numbers if k % EVERY == 0]
        if not all(broadcast in self.arrived for broadcast in new):
            return None
        since, fates = dict(zip(*sample[4:6], strict=True)), list[Any]()
        for j, k in new:
            self._decided[j], message = k, self.arrived.pop((j, k))
            _, t_apply, u, _, x, _, _ = message
            if is_lost(NAMES[j], k // EVERY, t_apply):
                fates.append([j, k, -1.0, [], None])
            else:
                fates.append([j, k, delay, [], [t_apply, u, x]])
                self._on_air.append((t_apply + delay, j, since[j], message))
        in_contact = [copy for copy in self._on_air if since.get(copy[1]) == copy[2]]
        for _, j, _, (*statement, relays) in [copy for copy in in_contact if copy[0] <= t]:
            for of, *rest in ([j, *statement], *relays):
                if of != INDEX and rest[0] > self.heard.get(of, [-1])[0]:
                    self.heard[of] = rest
        self._on_air = [copy for copy in in_contact if copy[0] > t]
        return fates

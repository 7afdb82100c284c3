"""What a narrow link does: messages wait for one another, or for the next slot."""

import math
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt

from phalanx.network.rule import DELIVER, DROP, Message, Treatment, delay

Positive = Annotated[float, Gt(0)]

_ROUNDING = 1e-6
"""Of a wait, as a share of the time that a message takes."""


@dataclass(frozen=True)
class Rate:
    """netem's `rate` and `limit`: one message after the other, as fast as the link is.

    The only rule with a memory: of when the message before was through. A receiver decides a
    link's messages in the order of their numbers, so even this depends on nothing else.
    """

    bits_per_second: Positive
    size: Positive = 128.0
    """Of every message, with all that the link adds to it [bytes]."""
    limit: Annotated[int, Ge(1)] = 1000
    """Most messages in the queue, with the one being carried; to a full one nothing is added."""

    def treat(self, message: Message) -> Treatment:
        """Delay until the link has carried it."""
        takes = 8.0 * self.size / self.bits_per_second
        begins = max(message.t, message.previous)
        # One that waits longer finds `limit` before it, the one being carried among them.
        if begins - message.t > (self.limit - 1 + _ROUNDING) * takes:
            return DROP
        return delay(begins + takes - message.t)


@dataclass(frozen=True)
class Slot:
    """netem's `slot`: what has come is delivered at the end of each slot, all at once."""

    every: Positive
    """[s]"""

    def treat(self, message: Message) -> Treatment:
        """Delay to the end of the slot."""
        slots = message.t / self.every
        if not math.isfinite(slots):
            # Who lies about when it sent may name a time that no slot has a number for.
            return DELIVER
        return delay(max(0.0, math.ceil(slots) * self.every - message.t))

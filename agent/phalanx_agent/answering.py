"""Answers each sample in Zenoh's own thread, the shortest way from a sample to its input."""

import logging
import os
import signal
from collections.abc import Callable, Sequence

from phalanx.profile.stopwatch import Stopwatch
from phalanx.swarm.watchdog import Watchdog
from phalanx.wire.keys import kind_and_name
from phalanx.wire.messages import Broadcast, Sample
from phalanx.wire.seal import Malformed, Refusals, Sealer
from phalanx_agent.step import Accepted, Answer, ControlStep

log = logging.getLogger("phalanx.agent")

_SHARE = 0.8
"""Of the plant's patience with an agent: so it hears why before it gives the agent up."""


class SampleAnswering:
    """One agent's answers: a sample is answered once every broadcast that it counts is here.

    What cannot be a message of this run is dropped and counted.
    """

    def __init__(
        self,
        step: ControlStep,
        sealer: Sealer,
        send: Callable[[Answer], None],
        give_up: Callable[[], None],
    ) -> None:
        self.error: Exception | None = None
        """What ended the answering, if a control step did."""
        self.begun = False
        """Whether a sample has come."""
        self._step, self._sealer = step, sealer
        self._send, self._give_up = send, give_up
        self._refusals = Refusals(log)
        self.pending: Accepted | None = None
        """The sample that waits for a broadcast."""

    def time(self, stopwatch: Stopwatch) -> None:
        """Have the stopwatch tell computing from handling messages; what is left is waiting."""
        stopwatch.time(self, "answer", "compute")
        stopwatch.time(self, "on_sample", "message")
        stopwatch.time(self, "on_broadcast", "message")

    def on_sample(self, key: str, payload: bytes) -> None:
        """Take a sample."""
        try:
            accepted = self._step.accept_sample(self._sealer.open(key, payload, Sample))
        except Malformed as reason:
            self._drop(key, reason)
            return
        orders = accepted.sample.orders
        if orders and orders.die:
            # A crash as it would be: no clean-up, no goodbye.
            os.kill(os.getpid(), signal.SIGKILL)
        self.begun = True
        self.pending = accepted
        self._answer_if_complete()

    def on_broadcast(self, key: str, payload: bytes) -> None:
        """Take another agent's broadcast."""
        try:
            message = self._sealer.open(key, payload, Broadcast)
            self._step.accept_broadcast(kind_and_name(key)[1], message)
        except Malformed as reason:
            self._drop(key, reason)
        else:
            self._answer_if_complete()

    def answer(self, accepted: Accepted) -> Answer:
        """What the agent makes of a sample."""
        return self._step(accepted)

    def _answer_if_complete(self) -> None:
        # Broadcasts come from other sessions than samples do: nothing orders the two, so a sample
        # may be here before a broadcast that it counts.
        accepted = self.pending
        if accepted is None or self._step.lacks_broadcasts(accepted):
            return
        self.pending = None
        try:
            self._send(self.answer(accepted))
        except Exception as error:  # a user's law may raise anything, and Zenoh would swallow it
            self.error = error
            self._give_up()

    def give_up_waiting(self, accepted: Accepted) -> None:
        """Have a sample fail that waits for a broadcast; any thread may, once it waits too long."""
        if self.pending is accepted:
            self.pending = None
            self.error = self._step.withheld(accepted)
            log.error("%s", self.error)
            self._give_up()

    def _drop(self, key: str, reason: Malformed) -> None:
        self._step.rejected += 1
        self._refusals.add(key, reason)


def withheld_broadcasts(
    timeout: float, answerings: Sequence[SampleAnswering]
) -> Watchdog[SampleAnswering, Accepted]:
    """Has samples fail that wait for broadcasts too long.

    timeout: of the plant's wait for an agent [s].
    """

    def waiting() -> dict[SampleAnswering, Accepted]:
        return {a: sample for a in answerings if (sample := a.pending) is not None}

    return Watchdog(_SHARE * timeout, waiting, lambda a, sample, _: a.give_up_waiting(sample))

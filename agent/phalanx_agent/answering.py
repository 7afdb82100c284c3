"""Answer samples in Zenoh's own thread, for the least latency."""

import logging
import os
import signal
from collections.abc import Callable, Sequence

from phalanx.messages.keys import kind_and_name
from phalanx.messages.kinds import Broadcast, Sample
from phalanx.messages.seal import Malformed, Refusals, Sealer
from phalanx.swarm.watchdog import Watchdog
from phalanx_agent.step import Accepted, Answer, ControlStep

log = logging.getLogger("phalanx.agent")

_SHARE = 0.8
"""Share of the plant's timeout after which an agent reports that a broadcast is missing."""


class SampleAnswering:
    """Answers each sample of one agent once every broadcast that the sample counts has come.

    Payloads that are not valid messages of the run are dropped and counted.
    """

    def __init__(
        self,
        step: ControlStep,
        sealer: Sealer,
        send: Callable[[Answer], None],
        give_up: Callable[[], None],
    ) -> None:
        self.error: Exception | None = None
        """The error of the control step that ended the answering."""
        self.begun = False
        """Whether a sample has come."""
        self._step, self._sealer = step, sealer
        self._send, self._give_up = send, give_up
        self._refusals = Refusals(log)
        self.pending: Accepted | None = None
        """The sample that waits for broadcasts."""

    def on_sample(self, key: str, payload: bytes) -> None:
        """Handle a sample."""
        try:
            accepted = self._step.accept_sample(self._sealer.open(key, payload, Sample))
        except Malformed as reason:
            self._drop(key, reason)
            return
        commands = accepted.sample.commands
        if commands and commands.die:
            # As in a real crash there is no clean-up.
            os.kill(os.getpid(), signal.SIGKILL)
        self.begun = True
        self.pending = accepted
        self._answer_if_complete()

    def on_broadcast(self, key: str, payload: bytes) -> None:
        """Handle another agent's broadcast."""
        try:
            message = self._sealer.open(key, payload, Broadcast)
            self._step.accept_broadcast(kind_and_name(key)[1], message)
        except Malformed as reason:
            self._drop(key, reason)
        else:
            self._answer_if_complete()

    def _answer_if_complete(self) -> None:
        # Broadcasts come from other sessions than samples, in any order: a sample may come before
        # a broadcast that it counts.
        accepted = self.pending
        if accepted is None or self._step.lacks_broadcasts(accepted):
            return
        self.pending = None
        try:
            self._send(self._step(accepted))
        except Exception as error:  # a user's law may raise any, and Zenoh would drop it
            self.error = error
            self._give_up()

    def give_up_waiting(self, accepted: Accepted) -> None:
        """Fail if a sample is still pending; may be called in any thread."""
        if self.pending is accepted:
            self.pending = None
            self.error = self._step.broadcasts_missing(accepted)
            self._give_up()

    def _drop(self, key: str, reason: Malformed) -> None:
        self._step.rejected += 1
        self._refusals.add(key, reason)


def pending_watchdog(
    timeout: float, answerings: Sequence[SampleAnswering]
) -> Watchdog[SampleAnswering, Accepted]:
    """Make a watchdog that fails samples which wait too long for broadcasts.

    timeout: of the plant's wait for an agent [s].
    """

    def waiting() -> dict[SampleAnswering, Accepted]:
        return {a: sample for a in answerings if (sample := a.pending) is not None}

    return Watchdog(_SHARE * timeout, waiting, lambda a, sample, _: a.give_up_waiting(sample))

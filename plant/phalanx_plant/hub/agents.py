"""The hub of each clock: in lockstep it waits for agents, in real time it never waits."""

import contextlib
import queue
import time

from phalanx.profile.stopwatch import Stopwatch
from phalanx.wire.messages import Actuation, Sample
from phalanx_plant.events.stop import SwarmBrokenError
from phalanx_plant.hub.hub import POLL, Hub


class LockstepHub(Hub):
    """A hub of agents that are all waited for: the run cannot go on without one."""

    may_leave = False

    def time(self, stopwatch: Stopwatch) -> None:
        """Have the stopwatch tell waiting for answers apart, too."""
        super().time(stopwatch)
        stopwatch.time(self, "await_actuation", "wait")

    def await_actuation(self, i: int) -> Actuation:
        """What agent i's actuator gets for its last sample.

        Raises:
            SwarmBrokenError: the agent died, or does not answer in time.
        """
        return self._await(i, lambda: self._mailbox.answers.take_actuation(i), "did not answer")

    def take_actuation(self, i: int) -> Actuation | None:
        """The same, if it has come. Raises SwarmBrokenError if an agent died."""
        self._handle_arrived()
        return self._mailbox.answers.take_actuation(i)

    def pause(self, i: int, t: float) -> None:
        """Once agent i has said all that it had to say. Raises SwarmBrokenError."""
        self._await_report(i)
        super().pause(i, t)

    def kill(self, i: int, order: Sample) -> None:
        """Once agent i has said all that it had to say. Raises SwarmBrokenError."""
        self._await_report(i)
        super().kill(i, order)

    def restart(self, i: int, t: float) -> None:
        """Return when the new process is there.

        Raises SwarmBrokenError: it does not come, or runs another scenario.
        """
        if i not in self._alone:
            return
        name, deadline = self._names[i], time.monotonic() + self._timeout
        self._joining.invite(name)
        while self._joining.has(name):
            self._take_event(deadline, f"agent {name} did not die")
        while not self._joining.has(name):
            super().restart(i, t)
            self._take_event(deadline, f"agent {name} did not join again")
        self.session.wait_until_heard(i, self._timeout)

    def _await_report(self, i: int) -> None:
        self._await(i, lambda: self._mailbox.answers.complete(i) or None, "did not report on")

    def _on_failure(self, words: str) -> None:
        raise SwarmBrokenError(words)


class RealTimeHub(Hub):
    """A hub of agents that come and go while the run goes on."""

    may_leave = True

    @property
    def waiting(self) -> int:
        """How much has come that was not handled yet."""
        return self._arrivals.waiting

    def listen(self, seconds: float) -> None:
        """Handle what comes, for so long [s of wall time], or until something has come."""
        self._check_stop()
        with contextlib.suppress(queue.Empty):
            self._handle(*self._arrivals.get(timeout=min(max(seconds, 0.0), POLL)))
            self._handle_arrived()

    def take_reported(self, i: int) -> Actuation | None:
        """Agent i's input, if it has come, and its report too."""
        return self._mailbox.answers.take_reported(i)

    def take_changes(self) -> list[tuple[int, bool]]:
        """Who is not to be reached any more, and who is back, since last asked: (i, is back)."""
        return self._joining.take_changes()

    def _on_failure(self, words: str) -> None:
        """The run goes on without the agent."""

"""Why a run stops before its end: a signal, or the end of a process that it cannot do without."""

import multiprocessing
import multiprocessing.connection
import signal
import threading


class StoppedError(Exception):
    """The user asked the run to stop."""


class AbandonedError(Exception):
    """The process that launched the run is gone, or says that an agent is."""


class SwarmBrokenError(RuntimeError):
    """An agent is missing, dead or silent; the message names it."""


class StopRequest:
    """Takes signals, and watches the launcher if there is one.

    SIGINT and SIGTERM stop the run. SIGUSR1 is the launcher's word that an agent failed, which the
    plant could not see by itself before the agent joined.
    """

    def __init__(self) -> None:
        self._reason: Exception | None = None
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._set(StoppedError("stopped by the user")))
        failed = AbandonedError("an agent failed")
        signal.signal(signal.SIGUSR1, lambda *_: self._set(failed))
        # Held back by the launcher until now, when they can be answered.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})
        if parent := multiprocessing.parent_process():
            threading.Thread(target=self._watch, args=(parent.sentinel,), daemon=True).start()

    def check(self) -> None:
        """Raise StoppedError or AbandonedError if the run should stop."""
        if self._reason is not None:
            raise self._reason

    def _watch(self, sentinel: int) -> None:
        multiprocessing.connection.wait([sentinel])
        self._set(AbandonedError("the launcher died"))

    def _set(self, reason: Exception) -> None:
        self._reason = self._reason or reason

"""Why a run stops before its end: a signal, or the end of the process that launched it."""

import multiprocessing
import multiprocessing.connection
import signal
import threading


class StoppedError(Exception):
    """The user asked the run to stop."""


class LauncherDiedError(Exception):
    """The process that launched the run is gone."""


class StopRequest:
    """Takes SIGINT and SIGTERM, and watches the launcher if there is one."""

    def __init__(self) -> None:
        self._reason: Exception | None = None
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._set(StoppedError("stopped by the user")))
        if parent := multiprocessing.parent_process():
            threading.Thread(target=self._watch, args=(parent.sentinel,), daemon=True).start()

    def check(self) -> None:
        """Raise StoppedError or LauncherDiedError if the run should stop."""
        if self._reason is not None:
            raise self._reason

    def _watch(self, sentinel: int) -> None:
        multiprocessing.connection.wait([sentinel])
        self._set(LauncherDiedError("the launcher died"))

    def _set(self, reason: Exception) -> None:
        self._reason = self._reason or reason

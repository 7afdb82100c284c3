"""What was refused: counted by reason, and told in the log ever more rarely."""

import logging
import threading
from collections import Counter


class Refusals:
    """Payloads that a program dropped; any thread may add to them."""

    def __init__(self, log: logging.Logger) -> None:
        self.counts: Counter[str] = Counter()
        """By reason."""
        self._log, self._lock = log, threading.Lock()

    def add(self, key: str, reason: object) -> None:
        """A payload that came under a key expression was dropped.

        The log tells of the 1st, 10th, 100th and so on of each reason: whoever sends rubbish must
        not fill the disk with it.
        """
        with self._lock:
            self.counts[str(reason)] += 1
            n = self.counts[str(reason)]
        if n == 10 ** (len(str(n)) - 1):
            self._log.warning("dropped a payload on %s: %s (%d so far)", key, reason, n)

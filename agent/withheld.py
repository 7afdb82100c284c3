"""An end to the wait for a broadcast that does not come: whose it is, is said."""

import threading
from collections.abc import Sequence
from typing import Self

from phalanx.agent.answering import SampleAnswering
from phalanx.agent.step import Accepted

_SHARE = 0.8
"""Of the plant's patience with an agent: so it hears why before it gives the agent up."""
_LOOKS = 20
"""A sample that was there so often in a row waits for what was withheld."""


class WithheldWatch:
    """Has samples fail that wait for broadcasts too long.

    It looks from a thread of its own: a process that stood still is looked at no more often for it.
    """

    def __init__(self, timeout: float, answerings: Sequence[SampleAnswering]) -> None:
        """timeout: of the plant's wait for an agent [s]."""
        self._pause, self._answerings = _SHARE * timeout / _LOOKS, answerings
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        waiting: list[tuple[Accepted | None, int]] = [(None, 0)] * len(self._answerings)
        while not self._over.wait(self._pause):
            for n, answering in enumerate(self._answerings):
                sample, looks = waiting[n]
                looks = looks + 1 if answering.pending is sample else 0
                waiting[n] = answering.pending, looks
                if sample is not None and looks == _LOOKS:
                    answering.give_up_waiting(sample)

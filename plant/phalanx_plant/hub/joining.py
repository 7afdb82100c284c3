"""Membership of a run: agents that have joined or left."""

import time
from collections.abc import Callable

from phalanx.messages.keys import kind_and_name
from phalanx.swarm.swarm import Swarm


class Joining:
    """The agents of one run, as their liveliness tokens come and go."""

    def __init__(
        self, swarm: Swarm, may_leave: bool, now: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin without members.

        Args:
            swarm: of the scenario.
            may_leave: whether agents that joined may leave, and come back.
            now: the wall clock [s].
        """
        self.digest = swarm.digest
        """Of the scenario; an agent that runs another one is rejected."""
        self._names, self._may_leave = swarm.names, may_leave
        self._now = now
        self._joined: set[str] = set()
        self._dismissed: set[str] = set()
        """Agents that were ordered to exit, and are still there."""
        self._begun = False
        self._gone: dict[str, float] = {}
        """Wall time at which an agent that had joined was lost [s]."""
        self._changes: list[tuple[int, bool]] = []

    def begin(self) -> None:
        """Begin the run: unless agents may leave, losing one is now an error."""
        self._begun = True

    def gone_for(self, seconds: float) -> list[str]:
        """Agents that joined, and were lost at least this long ago."""
        now = self._now()
        return [name for name, since in self._gone.items() if now > since + seconds]

    def missing(self) -> tuple[str, ...]:
        """Agents that have not joined yet."""
        return tuple(name for name in self._names if name not in self._joined)

    def has(self, name: str) -> bool:
        """Return whether an agent has joined and is not lost."""
        return name in self._joined

    def dismiss(self, name: str) -> None:
        """Expect that an agent exits, as it was ordered to."""
        self._dismissed.add(name)

    def exits(self, name: str) -> bool:
        """Return whether an agent was ordered to exit, and has not yet."""
        return name in self._dismissed

    def take_changes(self) -> list[tuple[int, bool]]:
        """Return agents that were lost or came back since the last call: (i, is back)."""
        changes, self._changes = self._changes, []
        return changes

    def on_token(self, key: str, alive: bool) -> str | None:
        """Handle a token's appearance or disappearance; return an error message, or None."""
        (_, name), digest = kind_and_name(key), key.rsplit("/", 1)[-1]
        if name not in self._names:
            return None
        if name in self._joined and self._may_leave:
            self._changes += [(self._names.index(name), alive)] if digest == self.digest else []
            return None
        if name in self._joined:
            if alive or digest != self.digest:
                return None
            self._joined.remove(name)
            if name in self._dismissed:
                self._dismissed.remove(name)
                return None
            if self._begun:
                return f"agent {name} died: see its log"
            self._gone[name] = self._now()
            return None
        if alive and digest != self.digest:
            return (
                f"agent {name} runs another scenario, seed or version (digest {digest[:64]!r}, "
                f"here {self.digest}): start it with the plant's --scenario, --seed and --set"
            )
        if alive:
            self._joined.add(name)
            self._gone.pop(name, None)
        return None

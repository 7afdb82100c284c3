"""Membership of a run: agents that have joined or left, and the assignment of free places."""

import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping

from phalanx.swarm.swarm import Swarm
from phalanx.wire.keys import kind_and_name
from phalanx.wire.messages import Place, PlaceRequest

_KEPT = 20.0
"""Time for which an assigned place is reserved until its process joins [s]."""


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
        """Agents that were ordered to exit."""
        self._here: set[str] = set()
        """Agents whose liveliness token exists."""
        self._arrived: Counter[str] = Counter()
        """How many processes of each agent have come."""
        self._places = set(swarm.names)
        """Agents whose places may be assigned if they are free."""
        self._begun = False
        self._gone: dict[str, float] = {}
        """Wall time at which an agent that had joined was lost [s]."""
        self._changes: list[tuple[int, bool]] = []

    def begin(self) -> None:
        """Begin the run: unless agents may leave, losing one is now an error."""
        self._begun = True
        if not self._may_leave:
            self._places.clear()

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
        self._places.discard(name)

    def invite(self, name: str) -> None:
        """Let another process take a dead agent's place."""
        self._places.add(name)

    def vacant(self) -> dict[str, int]:
        """Agents without a process that may be assigned one, and how many each has had.

        Called in any thread.
        """
        free = (n for n in self._names if n in self._places and n not in self._here)
        return {name: self._arrived[name] for name in free}

    def take_changes(self) -> list[tuple[int, bool]]:
        """Return agents that were lost or came back since the last call: (i, is back)."""
        taken, self._changes = self._changes, []
        return taken

    def on_token(self, key: str, alive: bool) -> str | None:
        """Handle a token's appearance or disappearance; return an error message, or None."""
        (_, name), found = kind_and_name(key), key.rsplit("/", 1)[-1]
        if name not in self._names:
            return None
        if found == self.digest:
            self._arrived[name] += alive
            (self._here.add if alive else self._here.discard)(name)
        if name in self._joined and self._may_leave:
            self._changes += [(self._names.index(name), alive)] if found == self.digest else []
            return None
        if name in self._joined:
            if alive or found != self.digest:
                return None
            self._joined.remove(name)
            if name in self._dismissed:
                return None
            if self._begun:
                return f"agent {name} died: see its log"
            self._gone[name] = self._now()
            return None
        if alive and found != self.digest:
            return (
                f"agent {name} runs another scenario, seed or version (digest {found}, here "
                f"{self.digest}): start it with the plant's --scenario, --seed and --set"
            )
        if alive:
            self._joined.add(name)
            self._dismissed.discard(name)
            self._gone.pop(name, None)
        return None


class Places:
    """Assigns free places to claimants, each to one at a time.

    A claimant that asks again receives the same place. One that does not join in time loses it to
    the next, but keeps its certificate: it may still send as that agent, and as no other. One that
    joined and died has had its turn: the place goes to the next at once.
    """

    def __init__(
        self,
        programs: Mapping[str, Collection[str]],
        vacant: Callable[[], Mapping[str, int]],
        digest: str,
        sign: Callable[[str, bytes], bytes],
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin with nothing assigned.

        Args:
            programs: by name, the agents that each program controls.
            vacant: the agents without a process that may be assigned one, and how many processes
                each has had.
            digest: of the scenario; a claimant with another one is refused.
            sign: makes the certificate of a name for a public key; raises ValueError.
            now: the wall clock [s].
        """
        self._programs, self._vacant, self._digest = programs, vacant, digest
        self._sign, self._now = sign, now
        self._assigned: dict[str, tuple[bytes, float, int]] = {}
        """By name: the claimant's public key, the time [s], and how many processes came before."""
        self._lock = threading.Lock()

    def answer(self, request: PlaceRequest) -> Place:
        """Assign a place, or return the reason for a refusal. Called in any thread."""
        if request.digest != self._digest:
            return Place(refusal="start it with the plant's --scenario, --seed and --set")
        with self._lock:
            vacant, now = self._vacant(), self._now()
            name = self._free(request.public_key, vacant, now)
            if not name:
                return Place()
            try:
                certificate = self._sign(name, request.public_key)
            except ValueError as error:
                return Place(refusal=str(error))
            self._assigned[name] = request.public_key, now, self._arrivals(name, vacant)
        return Place(name=name, certificate=certificate)

    def _free(self, public_key: bytes, vacant: Mapping[str, int], now: float) -> str:
        free = [name for name, own in self._programs.items() if vacant.keys() >= set(own)]
        kept = {}
        for name in free:
            key, since, before = self._assigned.get(name, (b"", -math.inf, 0))
            if now < since + _KEPT and self._arrivals(name, vacant) == before:
                kept[name] = key
        own = (name for name in kept if kept[name] == public_key)
        return next(own, next((name for name in free if name not in kept), ""))

    def _arrivals(self, name: str, vacant: Mapping[str, int]) -> int:
        return sum(vacant[agent] for agent in self._programs[name])

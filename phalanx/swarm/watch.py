"""An agent's watch: it holds what others broadcast against where it sees them go."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from phalanx.network.inbox import Conviction, SentInput
from phalanx.swarm.swarm import DEFECT, Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.models.motion_check import MotionCheck
from phalanx.theory.rows.information import ReceivedInput

_MOST = 64
"""Windows and broadcasts of one agent that are kept: later ones replace the oldest."""


class _Seen(NamedTuple):
    """Two samples of an agent, one after the other."""

    begin: float
    end: float
    before: Array
    after: Array


class Watch:
    """One agent's watch over those whose broadcasts it hears; each is convicted once."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        """Compile the motion check of each kind of agent that agent i hears."""
        self._parts = swarm.safe_set.parts
        self._checks = {l: motion_check(swarm, l) for l in swarm.heard_by(i)}
        self._claims: dict[int, dict[int, ReceivedInput]] = {l: {} for l in self._checks}
        self._windows: dict[int, list[_Seen]] = {l: [] for l in self._checks}
        self._last: dict[int, tuple[float, Array]] = {}
        self.convicted: set[int] = set()

    def __call__(
        self, t: float, x: Array, seen: Iterable[int], delivered: Iterable[tuple[int, SentInput]]
    ) -> list[Conviction]:
        """Return the convictions at a sample x, shape (n̄,), at t [s], with what arrived since."""
        for l, message in delivered:
            self._claims[l][message.k] = message
        watched = self._checks.keys() & set(seen)
        for l in sorted(watched):
            state = x[self._parts[l]].copy()
            if l in self._last:
                self._windows[l].append(_Seen(self._last[l][0], t, self._last[l][1], state))
            self._last[l] = t, state
        for l in self._last.keys() - watched:
            del self._last[l]
        convictions = [self._check(l) for l in sorted(self._checks)]
        return [conviction for conviction in convictions if conviction is not None]

    def _check(self, l: int) -> Conviction | None:
        """Check agent l's windows whose broadcasts have all come."""
        claims, waiting, convicted = self._claims[l], list[_Seen](), None
        for window in self._windows[l]:
            parts = covering(claims, window.begin, window.end)
            if parts is None:
                waiting.append(window)
                continue
            excess = self._excess(l, window, parts)
            if excess > 0.0 and l not in self.convicted:
                self.convicted.add(l)
                convicted = Conviction(l, window.begin, window.end, excess)
        self._windows[l] = waiting[-_MOST:]
        for k in sorted(claims)[:-_MOST]:
            del claims[k]
        return convicted

    def _excess(self, l: int, window: _Seen, parts: list[tuple[ReceivedInput, float]]) -> float:
        u = np.array([[claim.u for claim, _ in parts]])
        seconds = np.array([[length for _, length in parts]])
        check = self._checks[l]
        return float(check.excess(window.before[None], window.after[None], u, seconds)[0])


def motion_check(swarm: Swarm, l: int) -> MotionCheck:
    """Return the motion check of agent l, compiled once for its group."""
    key = "motion check", swarm.group_numbers[l]
    bound = swarm.groups[l].disturbance.bound + DEFECT
    return swarm.functions.get(key, lambda: MotionCheck(swarm.members[l].dynamics, bound))


def covering(
    claims: dict[int, ReceivedInput], begin: float, end: float
) -> list[tuple[ReceivedInput, float]] | None:
    """Return the broadcasts in force from begin to end, each with its time in it [s].

    None if one may be missing: they are consecutive, from the last one that was in force at the
    begin to the first that takes effect at the end or later.
    """
    first = max((k for k, claim in claims.items() if claim.t_apply <= begin), default=None)
    if first is None:
        return None
    parts, k = list[tuple[ReceivedInput, float]](), first
    while claims[k].t_apply < end:
        if k + 1 not in claims or claims[k + 1].t_apply <= claims[k].t_apply:
            return None
        until = min(claims[k + 1].t_apply, end)
        parts.append((claims[k], until - max(claims[k].t_apply, begin)))
        k += 1
    return [(claim, length) for claim, length in parts if length > 0.0]

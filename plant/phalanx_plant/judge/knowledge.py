"""Knowledge of peers by radio, against the truth: whether a set contains it, and if not why.

Which statements had reached whom follows from the reports on broadcasts, and what these repeated
from what their senders had by then.
"""

from collections import Counter, defaultdict
from collections.abc import Set
from typing import NamedTuple

import numpy as np

from phalanx.guarantee.verdict import Assumption
from phalanx.knowledge.contradiction import unreached
from phalanx.messages.kinds import Telemetry
from phalanx.network.inbox import DeliveryReport
from phalanx.swarm.points import agent_point
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array

_NOTE = (
    "at every step the true state of each peer by radio was in the set of all that its newest "
    "statement allows for, and it kept the half of a gap that others count on"
)
_KEPT = 256
"""Broadcasts of one agent whose relays are kept."""
_ROUNDING = 1e-9


class _Statement(NamedTuple):
    k: int
    t: float
    """Time of its sample [s]."""
    x: Array
    true: bool


class Knowledge:
    """The statements that each agent had, and the assumption that they left room for the truth."""

    def __init__(self, swarm: Swarm) -> None:
        """Begin at x(0)."""
        self.held = Assumption("knowledge held", note=_NOTE)
        self._swarm, self._start = swarm, swarm.start()
        self._points = {i: agent_point(swarm, i) for i in swarm.normal if swarm.peers(i)}
        self._motions = {i: point.motion for i, point in self._points.items()}
        self._known = {i: self._starts(i) for i in self._points}
        self._in_flight = defaultdict[int, list[tuple[float, DeliveryReport]]](list)
        self._relays: dict[tuple[int, int], list[tuple[int, _Statement]]] = {}
        """By agent and number of its broadcast: its own statement, then what it repeats."""
        self._convicted, self._sampled = defaultdict[int, set[int]](set), dict[int, float]()
        self._late: dict[int, float] = {}
        """By agent, until when its last hold was that was too long [s]."""
        self._broken = Counter[str]()

    def _starts(self, i: int) -> dict[int, _Statement]:
        radio, parts = self._swarm.groups[i].radio, self._swarm.safe_set.parts
        peers = self._swarm.peers(i) if radio and radio.starts_known else ()
        return {l: _Statement(-1, 0.0, self._start[parts[l]], True) for l in peers}

    def restarted(self, i: int) -> None:
        """Forget what agent i knew: another process has taken over."""
        for by_agent in (self._known, self._in_flight, self._convicted):
            by_agent[i].clear()

    def sampled(
        self, i: int, t: float, x: Array, telemetry: Telemetry, late: bool, turned: Set[int]
    ) -> None:
        """Follow agent i's sample at t [s], at the true stacked state x, shape (n̄,), and check it.

        late: whether its input did not reach its actuator in time. turned: who attacks by now.
        """
        if late or t - self._sampled.get(i, 0.0) > self._motions[i].longest + _ROUNDING:
            self._late[i] = t
        self._sampled[i] = t
        self._convicted[i] |= {conviction.of for conviction in telemetry.convictions}
        self._deliver(i, t, telemetry)
        self._send(i, t, telemetry.k, x)
        radio = self._swarm.groups[i].radio
        if radio is not None and radio.belief == "set" and i not in turned:
            self._check(i, t, x, turned, 2.0 * radio.stamp_error)

    def _deliver(self, i: int, t: float, telemetry: Telemetry) -> None:
        """Add the statements that reach agent i by t [s] to what it knows."""
        in_flight, known = self._in_flight[i], self._known[i]
        in_flight += [(f.claim.t_apply + f.delay, f) for f in telemetry.fates if f.claim]
        self._in_flight[i] = [(at, fate) for at, fate in in_flight if at > t]
        for fate in (fate for at, fate in in_flight if at <= t):
            statements = self._relays.get((fate.sender, fate.k))
            if statements is None or fate.claim is None:
                continue
            (_, direct), *others = statements
            x = np.array(fate.claim.x)
            stated = direct._replace(x=x, true=bool((x == direct.x).all()))
            for l, statement in [(fate.sender, stated), *others]:
                newest = known[l].k if l in known else -1
                if statement.k > newest and l != i and l not in self._convicted[i]:
                    known[l] = statement

    def _send(self, i: int, t: float, k: int, x: Array) -> None:
        """Keep what agent i's broadcast k states and repeats."""
        radio, parts = self._swarm.groups[i].radio, self._swarm.safe_set.parts
        if radio is None or k % radio.every:
            return
        heard = [(l, s) for l, s in self._known[i].items() if s.k >= 0]
        heard.sort(key=lambda item: (-item[1].t, item[0]))
        statement = i, _Statement(k, t, x[parts[i]].copy(), True)
        self._relays[i, k] = [statement, *heard[: radio.relays]]
        self._relays.pop((i, k - _KEPT * radio.every), None)

    def _check(self, i: int, t: float, x: Array, turned: Set[int], late: float) -> None:
        """Check what agent i knows at t [s]; late: bound on the error of a statement's time [s]."""
        known, parts, by_motion = self._known[i], self._swarm.safe_set.parts, defaultdict(list)
        for l in known:
            by_motion[self._motions[l]].append(l)
        for motion, peers in by_motion.items():
            older = np.array([self._points[l].of(known[l].x) for l in peers])
            newer = np.array([self._points[l].of(x[parts[l]]) for l in peers])
            ages = np.array([t - known[l].t for l in peers])
            off = unreached(motion, older, newer, ages, late)
            for l, outside in zip(peers, (off > 0.0).tolist(), strict=True):
                cause = self._cause(l, t, known[l], outside, l in turned)
                self.held.check(cause is None, t)
                if cause is not None:
                    self._broken[f"of {self._swarm.names[l]}, {cause}"] += 1
        if self._broken:
            causes = "; ".join(f"{what} ({count} times)" for what, count in self._broken.items())
            self.held.note = f"{_NOTE}; not so {causes}"

    def _cause(
        self, l: int, t: float, known: _Statement, outside: bool, turned: bool
    ) -> str | None:
        """Return why what is known of agent l does not hold; None if it does."""
        if outside and not known.true:
            return "which stated a false place"
        if outside:
            return "which a disturbance, a sensor or a clock moved by more than is declared"
        if turned:
            return "which attacks"
        overdue = t - self._sampled.get(l, 0.0) > self._motions[l].longest + _ROUNDING
        if overdue or self._late.get(l, -1.0) > known.t:
            return "which held an input for too long"
        return None

"""Knowledge of peers by radio, against the truth: whether a set contains it, and if not why.

Reports on broadcasts say which statements had reached whom; see phalanx.swarm.statements.
"""

from collections import Counter, defaultdict
from collections.abc import Set

import numpy as np

from phalanx.guarantee.verdict import Assumption
from phalanx.knowledge.contradiction import unreached
from phalanx.messages.kinds import Telemetry
from phalanx.swarm.points import agent_point
from phalanx.swarm.statements import OwnStatement, StatementLedger
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array

_NOTE = (
    "at every step the true state of each peer by radio was in the set of all that its newest "
    "statement allows for, and it kept the half of a gap that others count on"
)
_ROUNDING = 1e-9


class Knowledge:
    """The assumption that the statements which each agent had left room for the truth."""

    def __init__(self, swarm: Swarm) -> None:
        """Begin at x(0)."""
        self.held = Assumption("knowledge held", note=_NOTE)
        self._swarm, self._ledger = swarm, StatementLedger(swarm)
        self.statements = self._ledger.known
        """By agent and peer, the newest that had come."""
        self._points = {i: agent_point(swarm, i) for i in self._ledger.known}
        self._motions = {i: point.motion for i, point in self._points.items()}
        self._sampled = dict[int, float]()
        self._late: dict[int, float] = {}
        """By agent, until when its last hold was that was too long [s]."""
        self._broken = Counter[str]()

    def restarted(self, i: int) -> None:
        """Forget what agent i knew: another process has taken over."""
        self._ledger.restarted(i)

    def sampled(
        self, i: int, t: float, x: Array, telemetry: Telemetry, late: bool, turned: Set[int]
    ) -> None:
        """Follow agent i's sample at t [s], at the true stacked state x, shape (n̄,), and check it.

        late: whether its input did not reach its actuator in time. turned: who attacks by now.
        """
        if late or t - self._sampled.get(i, 0.0) > self._motions[i].longest + _ROUNDING:
            self._late[i] = t
        self._sampled[i] = t
        of_agent, convicted = x[self._swarm.safe_set.parts[i]], telemetry.convictions
        self._ledger.sampled(
            i, t, telemetry.k, of_agent.tolist(), telemetry.fates, [c.of for c in convicted]
        )
        radio = self._swarm.groups[i].radio
        if radio is not None and radio.belief == "set" and i not in turned:
            self._check(i, t, x, turned, 2.0 * radio.stamp_error)

    def _check(self, i: int, t: float, x: Array, turned: Set[int], late: float) -> None:
        """Check what agent i knows at t [s]; late: bound on the error of a statement's time [s]."""
        known, by_motion = self._ledger.known[i], defaultdict(list)
        parts = self._swarm.safe_set.parts
        for l in known:
            by_motion[self._motions[l]].append(l)
        for motion, peers in by_motion.items():
            older = np.array([self._points[l].of(np.array(known[l].x)) for l in peers])
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
        self, l: int, t: float, known: OwnStatement, outside: bool, turned: bool
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

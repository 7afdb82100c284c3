"""Compare the inputs that agents broadcast with those that their actuators held, and since when."""

import math
from collections import Counter, defaultdict
from typing import NamedTuple

import numpy as np

from phalanx.faults.lies import Past
from phalanx.guarantee.verdict import Assumption
from phalanx.network.inbox import AnnouncedInput
from phalanx.recording.columns import Inputs, Stated, TrueStates
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index, Mask

_NOTE = (
    "every broadcast stated an input that its sender's actuator held, and since when; by radio its "
    "state too"
)


class Finding(NamedTuple):
    """The result of checking one broadcast."""

    false: bool = False
    lies: tuple[int, ...] = ()
    """Numbers of the declared lies that made it false."""


TRUE = Finding()
FalseClaims = defaultdict[int, dict[int, Finding]]
"""By the row of the input that reports them, and their place in its report."""


class _Claim(NamedTuple):
    """A claim that is compared with the truth, or waits for it."""

    number: int
    """Of the event with the report."""
    at: tuple[int, int]
    """Its row and place in Stated."""
    receiver: int
    sender: int
    k: int
    t: float
    """Of the report [s]."""
    t_apply: float
    """[s]"""
    values: Array
    """As in Stated, shape (w,)."""


class Claims:
    """Compares the claims that receivers report with the truth, which the plant knows.

    Senders are not asked. A receiver that reports another claim than it received accuses its
    sender, and this check cannot tell which of the two lied.
    """

    def __init__(self, swarm: Swarm) -> None:
        self.truthful = Assumption("truthful broadcasts", note=_NOTE)
        self.faults: Counter[int] = Counter()
        """Messages and agents on which each declared fault had an effect."""
        self._names, self._latency = swarm.names, swarm.time.latency
        self._lies = [swarm.links.lies(name) for name in swarm.names]
        stated = {b.i: b.states for b in swarm.broadcasters.values()}
        inputs = [len(m.dynamics.inputs) for m in swarm.members]
        self.sizes = [(size, stated.get(i, 0)) for i, size in enumerate(inputs)]
        """How many numbers of its input and of its state each agent states."""
        widest = max(inputs), max(stated.values(), default=0)
        self._widest = widest[0]
        self.fits = np.hstack(
            [np.arange(most) < np.array(sizes)[:, None]
             for most, sizes in zip(widest, zip(*self.sizes, strict=True), strict=True)]
        )  # fmt: skip
        """Which numbers of a row of Stated.values are an agent's, shape (N, w)."""
        begins = np.array([[part.start] for part in swarm.safe_set.parts])
        last = swarm.pairs.states - 1
        self._states: Index = np.minimum(begins + np.arange(widest[1]), last)
        """Indices of the states that each agent may state, shape (N, n)."""
        self._truth = np.full((len(inputs), 64, 3 + sum(widest)), np.nan)
        """By agent and number k: number of the event, when the input took effect and when it was
        planned to [s], input and state; NaN where there is none."""
        self._open = list[_Claim]()
        """Claims whose truth is not known yet."""
        self._false: Counter[str] = Counter()
        self._misleading = dict[tuple[int, int, float], int]()
        """By receiver, sender and claimed time to a nanosecond [s] of false claims, from which
        event on they were known."""
        self.betrayals: dict[str, float] = {}
        """By agent, the time from which it first held another input than it announced [s]."""

    def add(self, inputs: Inputs, x: TrueStates, stated: Stated) -> FalseClaims:
        """Compare claims with the truth: that of these inputs, or of earlier ones.

        Where an input reaches its actuator late, its broadcasts are compared once it does.

        Args:
            inputs: applied, or lost: those took effect never.
            x: the true states at their samples, which agents with a radio had to state.
            stated: what receivers report.

        Returns what was found of false claims that were compared when they were reported, by their
        row and place in `stated`.
        """
        states = x.table[x.sampled[:, None], self._states[inputs.i]]
        states[~self.fits[inputs.i, self._widest :]] = 0.0
        self._put(inputs, np.hstack([inputs.u, states]))
        number, receiver = inputs.number[stated.row], inputs.i[stated.row]
        truth = self._of(stated.sender, stated.k)
        known = truth[:, 0] < number
        true = (truth[:, 1] == stated.t_apply) & (truth[:, 3:] == stated.values).all(axis=1)
        self.truthful.checked += int(np.count_nonzero(known & true))
        for row in np.flatnonzero(~(known & true)).tolist():
            of, place, i, k = (int(column[row]) for column in stated[:4])
            t, t_apply = float(inputs.t_sample[of]), float(stated.t_apply[row])
            ends = int(receiver[row]), i, k
            claim = _Claim(int(number[row]), (of, place), *ends, t, t_apply, stated.values[row])
            self._open.append(claim)
        begun = [self._of(np.array([c.sender]), np.array([c.k]))[0, 0] for c in self._open]
        settled = [
            (max(since, claim.number), since > claim.number, claim)
            for since, claim in zip(begun, self._open, strict=True)
            if since == since  # not NaN
        ]
        self._open = [c for since, c in zip(begun, self._open, strict=True) if since != since]
        false: FalseClaims = defaultdict(dict)
        for since, is_late, claim in sorted(settled, key=lambda item: item[:2]):
            finding = self._compare(claim, int(since))
            if not is_late:
                row, place = claim.at
                false[row][place] = finding
        return false

    def misled(self, receiver: Index, sender: Index, t_apply: Array, number: Index) -> Mask:
        """Return whether false broadcasts to receivers had inputs from t_apply on [s], shape (a,).

        number: of the events by which they have to be known, shape (a,).
        """
        if not self._misleading:
            return np.zeros(len(receiver), dtype=bool)
        columns = (column.tolist() for column in (receiver, sender, t_apply, number))
        return np.array([self._misled(*row) for row in zip(*columns, strict=True)], dtype=bool)

    def _misled(self, receiver: int, sender: int, t_apply: float, number: int) -> bool:
        times = {round(t_apply + off, 9) for off in (-1e-9, 0.0, 1e-9)}
        of = [self._misleading.get((receiver, sender, t), math.inf) for t in times]
        return min(of) <= number

    def _put(self, inputs: Inputs, values: Array) -> None:
        """Record the inputs, and the states that go with them."""
        while len(inputs.k) and inputs.k.max() >= self._truth.shape[1]:
            self._truth = np.hstack([self._truth, np.full_like(self._truth, np.nan)])
        held = np.where(inputs.lost, math.inf, inputs.t_apply)
        columns = inputs.number, held, inputs.t_sample + self._latency
        self._truth[inputs.i, inputs.k] = np.column_stack([*columns, values])

    def _of(self, sender: Index, k: Index) -> Array:
        """Return rows of the truth; NaN where there is none yet."""
        exists = (k >= 0) & (k < self._truth.shape[1])
        rows: Array = self._truth[sender, np.where(exists, k, 0)]
        rows[~exists] = np.nan
        return rows

    def _compare(self, claim: _Claim, since: int) -> Finding:
        i, k = claim.sender, claim.k
        planned = self._planned(i, k)
        assert planned is not None
        held_from = float(self._truth[i, k, 1])
        true = bool(claim.t_apply == held_from and (claim.values == self._truth[i, k, 3:]).all())
        self.truthful.check(true, claim.t)
        if true:
            return TRUE
        name = self._names[i]
        self._false[name] += 1
        heard = claim.receiver, i, round(claim.t_apply, 9)
        self._misleading.setdefault(heard, since)
        begin = min(claim.t_apply, held_from)
        self.betrayals[name] = min(begin, self.betrayals.get(name, math.inf))
        counts = ", ".join(f"{count} by {name}" for name, count in self._false.items())
        self.truthful.note = f"{_NOTE}; false were {counts}"
        sampled = planned.t_apply - self._latency
        liar, past = self._lies[i], self._before(i, k)
        lies = liar.claim(self._names[claim.receiver], k, planned, past, sampled).lies
        self.faults.update(lies)
        return Finding(True, lies)

    def _before(self, i: int, k: int) -> Past:
        return lambda ago: self._planned(i, k - ago) if ago <= k else None

    def _planned(self, i: int, k: int) -> AnnouncedInput | None:
        """Return what agent i's broadcast k had to state, unless it is not known yet."""
        _, _, t_apply, *values = self._truth[i, k].tolist()
        inputs, states = self.sizes[i]
        u, x = values[:inputs], values[self._widest : self._widest + states]
        return None if math.isnan(t_apply) else AnnouncedInput(t_apply, tuple(u), tuple(x))

"""The safety filter that proves its input before it is applied.

With safety.prove the agent evaluates the verdict's certificates of its own pairs in sight, from its
sample. Where one ends before the agent's next sample, the pair gets its whole row too; if that does
not do, the agent takes the input whose least certified time is longest. Only if nothing is
certified does it back up.
"""

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from phalanx.guarantee.certificates import QUIET, Near, SwarmCertificates
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array, Mask
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.decision import decide_pairs
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.pairs import pair_rows
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows
from phalanx.theory.rows.safety_filter import Filtered, FilterInput, SafetyFilter

_INSIDE = 1e-6
"""Distance that inputs to be proven keep from their whole rows: on a row itself, rounding decides
whether anything is proven. Unit of the inputs."""
_ROUNDS = 3
"""Searches for the longest certified time: the later ones around the best input so far."""


class OwnProofs:
    """Certificates of an agent's own pairs, from its samples."""

    def __init__(self, rows: SafetyRows, i: int) -> None:
        swarm = rows.swarm
        self._needed = swarm.horizon(i)
        """Until agent i's next sample at the latest [s]."""
        self.certificates = certificates = SwarmCertificates(swarm).of(i)
        self.others = certificates.others
        self.agents = len(swarm.members)
        self._visible: tuple[int, ...] = ()
        self._in_sight = np.zeros(len(certificates.pairs), dtype=bool)
        """Pairs with what is seen that some input can certify."""
        self._quiet_until = np.full(len(certificates.pairs), -np.inf)
        """Time up to which each pair is proven safe for all inputs of all agents [s]."""
        self._all_quiet_until = -np.inf
        """The same of all pairs in sight [s]."""
        self.unprovable_in_sight = False

    def near(self, now: FilterInput) -> Near | None:
        """Pairs in sight that may become unsafe in the time needed; None without any.

        Most are too far apart for several samples, for all inputs, and are not looked at meanwhile.
        """
        provable, longest = self.certificates.provable, self.certificates.longest
        if now.seen != self._visible:
            self._visible, agents = now.seen, {*now.seen}
            # For few numbers np.isin takes ten times as long.
            listed = [l in agents or l >= self.agents for l in self.others.tolist()]
            in_sight = np.array(listed, dtype=bool)
            self._in_sight = in_sight & provable
            self.unprovable_in_sight = bool((in_sight & ~provable).any())
        elif self._all_quiet_until >= now.t + self._needed:
            return None
        due: Mask = self._in_sight & (self._quiet_until < now.t + self._needed)
        if (near := self.certificates.near(now.x, due)) is None:
            self._quiet_until[due] = now.t + QUIET * longest
        else:
            self._quiet_until[due & ~near.pairs] = now.t + longest
        self._all_quiet_until = float(self._quiet_until[self._in_sight].min(initial=np.inf))
        return near if near is not None and near.pairs.any() else None


class ProvenFilter:
    """A filter whose inputs the agent's own certificates cover until its next sample, if any do."""

    def __init__(self, rows: SafetyRows, i: int, first: SafetyFilter) -> None:
        """Prove inputs of normal agent i's first filter; rows: as that agent knows the swarm."""
        self._i, self._first, self._pairs = i, first, rows.pair_terms(i)
        self._qp = NearestInput(rows.swarm.members[i].dynamics.input_metric())
        self.proofs = OwnProofs(rows, i)
        self._certificates = certificates = self.proofs.certificates
        self._provable = {i, *certificates.others[certificates.provable].tolist()}
        """Itself and the others with whom a pair can be proven: no other's row may exist."""

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply, and for how long it is proven safe."""
        filtered, near = self._first(now), self.proofs.near(now)
        if near is None:
            result = _proven(filtered, self._certificates.longest)
        else:
            result = self._proven_input(now, filtered, near)
        return _proven(result, 0.0) if self.proofs.unprovable_in_sight else result

    def _proven_input(self, now: FilterInput, filtered: Filtered, near: Near) -> Filtered:
        """Prove the first filter's input, or take another, as far as pairs can be proven."""
        if near.unsafe.any():
            return _proven(filtered, 0.0)
        (times,) = self._certificates.times(now.x, [filtered.decision.u], near)
        first, weak = float(times.min()), times < self._certificates.tau
        if not weak.any():
            return _proven(filtered, first)
        whole = self._with_whole_rows(now, filtered, weak)
        again = float(self._certificates.times(now.x, [whole.decision.u], near).min())
        if whole.decision.origin is Origin.PROVEN and again >= self._certificates.tau:
            return _proven(whole, again)
        least = {filtered.decision.u.tobytes(): first, whole.decision.u.tobytes(): again}
        u, longest = self._longest(now, near, [filtered.decision.u, whole.decision.u], least)
        if longest > 0.0 and u is not filtered.decision.u:
            decision = replace(filtered.decision, u=u, origin=Origin.LONGEST, proven=longest)
            return Filtered(decision, [])
        return _proven(filtered, first)

    def _with_whole_rows(self, now: FilterInput, first: Filtered, weak: Mask) -> Filtered:
        """Solve the QP with the first filter's rows and whole rows for these pairs."""
        assert first.rows is not None
        terms = self._pairs(now.x, [l for l in now.seen if l in self._provable])
        counted = set(self.proofs.others[weak].tolist())
        chosen = np.array([l in counted for l in terms.others], dtype=bool)
        every = pair_rows(terms, {})
        a = np.concatenate([np.atleast_2d(first.rows.a), every.a[chosen]])
        inside = every.bound[chosen] - _INSIDE * length(every.a[chosen])
        bound = np.concatenate([np.atleast_1d(first.rows.bound), inside])
        others = tuple([l for l in terms.others if l in counted])
        if isinstance(first.rows, Rows):
            others = first.rows.others + others
        else:  # one row of all pairs
            others = (first.decision.binding or others)[:1] + others
        inputs = now.terms.polytopes[self._i]
        decision = decide_pairs(inputs, Rows(a, bound, others=others), now.u_nom, self._qp)
        origin = Origin.PROVEN if decision.origin is Origin.QP else decision.origin
        return Filtered(replace(decision, origin=origin), first.used)

    def _longest(
        self, now: FilterInput, near: Near, inputs: Sequence[Array], least: dict[bytes, float]
    ) -> tuple[Array, float]:
        """Search for the input with the longest least time: these, corners, and points between.

        least: the least times of some of them, by the input's bytes.
        """
        polytope: Polytope = now.terms.polytopes[self._i]
        tried = [*inputs, *polytope.corners, polytope.corners.mean(axis=0)]
        best, longest = tried[0], -1.0
        for _ in range(_ROUNDS):
            new = [u for u in tried if u.tobytes() not in least]
            if new:
                times = self._certificates.times(now.x, new, near).min(axis=1)
                least |= {u.tobytes(): time for u, time in zip(new, times.tolist(), strict=True)}
            times_tried = [least[u.tobytes()] for u in tried]
            index = int(np.argmax(times_tried))
            if times_tried[index] > longest:
                best, longest = tried[index], times_tried[index]
            tried = [0.5 * (best + u) for u in tried]
        return best, longest


def _proven(filtered: Filtered, time: float) -> Filtered:
    """Add for how long all pairs in sight are proven safe [s]."""
    return replace(filtered, decision=replace(filtered.decision, proven=time))

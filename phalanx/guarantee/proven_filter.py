"""Safety filters that prove their input before it is applied.

With safety.prove the agent evaluates the verdict's certificates of its own pairs in sight, from its
sample. Where one ends before the agent's next sample, the pair gets its whole row too; if that does
not do, the agent takes the input whose least certified time is longest. Only if nothing is
certified does it back up.

With the information model earned, an agent splits a pair only while its certificate, against
everything that the other may do, covers the time until a betrayal would be convicted.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace

from phalanx.arrays import Array, Mask
from phalanx.guarantee.certificates import Held, SwarmCertificates
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.decision import decide_pairs
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.pairs import pair_rows
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows
from phalanx.theory.rows.safety_filter import Filtered, FilterInput, RowFilter

_ROUNDS = 3
"""Searches for the longest certified time: the later ones around the best input so far."""


class OwnProofs:
    """Certificates of an agent's own pairs, from its samples."""

    def __init__(self, rows: SafetyRows, i: int, longest: float) -> None:
        """longest: the longest time for which a proof is needed [s]."""
        swarm = rows.swarm
        self._certificates, self._needed = swarm.once(SwarmCertificates), longest
        self.own = own = self._certificates.of(i)
        ends = self._certificates.ends[list(own.pairs)]
        self.others = np.where(ends[:, 0] == i, ends[:, 1], ends[:, 0])
        """The other member of each pair, or N + k for obstacle k; shape (p,)."""
        self.agents = len(swarm.members)
        self._seen: tuple[int, ...] = ()
        self._in_sight = np.zeros(len(own.pairs), dtype=bool)
        """Pairs with what is seen that some input can certify."""
        self._quiet_until = np.full(len(own.pairs), -np.inf)
        """Time up to which each pair is proven safe for all inputs of all agents [s]."""
        self._all_quiet_until = -np.inf
        """The same of all pairs in sight [s]."""
        self._provable = np.array([pair not in own.refused for pair in own.pairs], dtype=bool)

    @property
    def memory(self) -> Array:
        """Time up to which each pair is safe for all inputs of all agents [s], shape (p,)."""
        return self._quiet_until

    @memory.setter
    def memory(self, quiet_until: Array) -> None:
        self._quiet_until[:], self._seen = quiet_until, ()

    def near(self, now: FilterInput) -> Mask | None:
        """Pairs in sight that may become unsafe in the time needed, shape (p,); None without any.

        Most are too far apart for several samples, for all inputs, and are not looked at meanwhile.
        """
        if now.seen != self._seen:
            self._seen = now.seen
            known = np.isin(self.others, now.seen) | (self.others >= self.agents)
            self._in_sight = known & self._provable
        elif self._all_quiet_until >= now.t + self._needed:
            return None
        due: Mask = self._in_sight & (self._quiet_until < now.t + self._needed)
        if due.any():
            may_meet = self._certificates.may_meet(self.own, now.x, due)
            self._quiet_until[due & ~may_meet] = now.t + self.own.longest
            due = may_meet
        self._all_quiet_until = float(self._quiet_until[self._in_sight].min(initial=np.inf))
        return due if due.any() else None

    def times(self, now: FilterInput, near: Mask, inputs: Sequence[Array]) -> list[Array]:
        """Return for each input the times for which its pairs are proven safe [s]."""
        held = [Held(self.own, now.x, u, near.astype(np.float64)) for u in inputs]
        return self._certificates.proven(held)


class EarnedFilter:
    """A filter that splits pairs with trusted agents only under a reserve."""

    def __init__(
        self, rows: SafetyRows, i: int, first: RowFilter, reserve: Mapping[int, float]
    ) -> None:
        """reserve: by agent, the time until a betrayal would be convicted [s]."""
        self.i, self._first = i, first
        self.proofs = OwnProofs(rows, i, max(reserve.values(), default=0.0))
        others = self.proofs.others.tolist()
        self._reserve = np.array([reserve.get(l, 0.0) for l in others])

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply."""
        return self._with_reserve(now)[0]

    def rows(self, now: FilterInput) -> tuple[Rows, list[int]]:
        """The rows of the input to apply."""
        return self._first.rows(self._with_reserve(now)[1])

    def _with_reserve(self, now: FilterInput) -> tuple[Filtered, FilterInput]:
        """Trust fewer agents until certificates cover the reserve of all that are trusted."""
        filtered = self._first(now)
        if not now.trusted:
            return filtered, now
        near = self.proofs.near(now)
        while now.trusted and near is not None:
            (times,) = self.proofs.times(now, near, [filtered.decision.u])
            short = set(self.proofs.others[near & (times < self._reserve)].tolist()) & now.trusted
            if not short:
                break
            now = replace(now, trusted=now.trusted - short)
            filtered = self._first(now)
        return filtered, now


class ProvenFilter:
    """A filter whose inputs the agent's own certificates cover until its next sample, if any do."""

    def __init__(self, rows: SafetyRows, i: int, first: RowFilter) -> None:
        """Prove inputs of normal agent i's first filter; rows: as that agent knows the swarm."""
        self._first, self._pairs = first, rows.pair_terms(i)
        self._qp = NearestInput(rows.swarm.members[i].dynamics.input_metric())
        self.proofs = OwnProofs(rows, i, rows.swarm.horizon(i))
        self._own = self.proofs.own

    def __call__(self, now: FilterInput) -> Filtered:
        """The input to apply, and for how long it is proven safe."""
        filtered = self._first(now)
        near = self.proofs.near(now)
        if near is None:
            return self._reported(filtered, self._own.longest)
        (times,) = self.proofs.times(now, near, [filtered.decision.u])
        weak = near & (times < self._own.tau)
        if not weak.any():
            return self._reported(filtered, float(times[near].min()))
        whole = self._with_whole_rows(now, weak)
        (again,) = self.proofs.times(now, near, [whole.decision.u])
        if whole.decision.origin is Origin.PROVEN and not (again[near] < self._own.tau).any():
            return self._reported(whole, float(again[near].min()))
        u, longest = self._longest(now, near, [filtered.decision.u, whole.decision.u])
        if longest > 0.0 and u is not filtered.decision.u:
            made = replace(filtered.decision, u=u, origin=Origin.LONGEST, proven=longest)
            return Filtered(made, [])
        return self._reported(filtered, float(times[near].min()))

    def _reported(self, filtered: Filtered, least: float) -> Filtered:
        """Add for how long the pairs near are proven safe [s]."""
        proven = min(least, self._own.longest)
        return Filtered(replace(filtered.decision, proven=proven), filtered.used)

    def _with_whole_rows(self, now: FilterInput, weak: Mask) -> Filtered:
        """Solve the QP with the first filter's rows and whole rows for these pairs."""
        rows, used = self._first.rows(now)
        terms = self._pairs(now.x, now.seen)
        agents, others = self.proofs.agents, self.proofs.others[weak].tolist()
        counted = {l if l < agents else None for l in others}
        chosen = np.array([l in counted for l in terms.others], dtype=bool)
        every = pair_rows(terms, {})
        a, bound = every.a[chosen], every.bound[chosen]
        joined = Rows(np.concatenate([rows.a, a]), np.concatenate([rows.bound, bound]))
        inputs = now.terms.polytopes[self._first.i]
        decision = decide_pairs(inputs, joined, now.u_nom, self._qp)
        origin = Origin.PROVEN if decision.origin is Origin.QP else decision.origin
        return Filtered(replace(decision, origin=origin), used)

    def _longest(
        self, now: FilterInput, near: Mask, inputs: Sequence[Array]
    ) -> tuple[Array, float]:
        """Search for the input with the longest least time: these, corners, and points between."""
        polytope: Polytope = now.terms.polytopes[self._first.i]
        tried = [*inputs, *polytope.corners, polytope.corners.mean(axis=0)]
        best, longest = tried[0], -1.0
        for _ in range(_ROUNDS):
            least = [float(t[near].min()) for t in self.proofs.times(now, near, tried)]
            place = int(np.argmax(least))
            if least[place] > longest:
                best, longest = tried[place], least[place]
            tried = [0.5 * (best + u) for u in tried]
        return best, longest

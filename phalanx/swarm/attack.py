"""The attack of a normal agent that was taken over: the input worst for the others."""

from phalanx.schema.registry import construct
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.laws.law import CheckedInput, Law, View
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.safety_filter import FilterInput


class Attack:
    """Agent i's inputs once it attacks, without a row; an adversary knows everything."""

    def __init__(self, rows: SafetyRows, i: int) -> None:
        swarm = rows.swarm
        self._i, self._members, self._parts = i, swarm.members, swarm.safe_set.parts
        self._worst = CheckedInput(construct(Law, {"type": "worst"}), swarm.members[i])
        self._goal, self._latency = swarm.goal(i), swarm.time.latency
        self._terms, self._unfiltered = rows.terms(i), rows.unfiltered(i)

    def __call__(self, x: Array, visible: tuple[int, ...], t: float) -> tuple[Decision, Array]:
        """Return its decision, and the attack before it was projected onto U_i, shape (m_i,).

        x is the stacked state, shape (n̄,), sampled at t [s]; NaN for agents that are not visible.
        """
        states, terms = {l: x[self._parts[l]] for l in visible}, self._terms(x, visible)
        normal = [l for l in visible if not self._members[l].adversary]
        u = self._worst(View(self._i, states, normal, self._goal(t, states), terms, t))
        now = FilterInput(t + self._latency, x, visible, terms, u, {})
        return self._unfiltered(now).decision, u

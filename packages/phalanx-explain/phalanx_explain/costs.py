"""The cost of each term of an agent's rows: by how much it holds the input back from the wish.

A row a u <= bound that binds keeps the input u from the wish u_nom by a (u_nom - u). That is the
sum of its terms, each in the unit of the row::

    a u_nom - bound = wish + motion + allowance + others at their worst + margin

The wish is the law's input, or the nearest in U_i to it.
"""

from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.guarantee.row_terms import ADVERSARY, ALLOWANCE, MOTION, PairRowTerms
from phalanx.knowledge.sets import Boxes
from phalanx.swarm.radio import RadioFilter
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, inner, length
from phalanx.theory.margins.margin import RowPart
from phalanx.theory.rows.origin import OF_PROOFS
from phalanx_explain.repetition import ControllerSteps

WISH, ANNOUNCED = "the wish", "the other's announced input"
BINDS, OWN_PART_BINDS = 1e-6, 2e-3
"""Slack of a row, relative to it, and of an own part [m/s], below which it binds.

The input is chosen a little inside of own parts.
"""


class RowCost(NamedTuple):
    """A row a u <= bound at one sample, and what each term of it costs."""

    other: str
    """The other agent, obstacle or limit; "all pairs" of h_tot."""
    part: str
    """half, whole, all pairs or own part."""
    terms: Mapping[str, float]
    """Of a u_nom - bound, in the unit of h per second to the q; m/s of an own part."""
    slack: float
    """bound - a u of the applied input: 0 if the row binds, negative if it is violated."""
    per_metre: float | None = None
    """Change of the row by one more metre between the two; None if there is no such distance."""
    a: Array | None = None
    """The row, shape (m_i,); None for an own part, which is no row."""

    @property
    def excess(self) -> float:
        """a u_nom - bound: positive if the wish violates the row."""
        return added(self.terms.values())

    @property
    def bound(self) -> float:
        """The row's bound."""
        return self.terms[WISH] - self.excess

    @property
    def binds(self) -> bool:
        """True if the row keeps the wish from being applied."""
        size = max(1.0, *map(abs, self.terms.values()))
        most = OWN_PART_BINDS if self.a is None else BINDS * size
        # No input satisfies a row that is not a number: its margin is not known.
        return not self.excess <= 0.0 and not self.slack > most

    def in_metres(self) -> dict[str, float]:
        """Return the distance that would make up for each term [m]."""
        if not self.per_metre:
            return {}
        return {name: rate / self.per_metre for name, rate in self.terms.items()}


def row_costs(steps: ControllerSteps) -> list[RowCost]:
    """Return all rows of an agent's last step, the largest excess of the wish first."""
    rows, i = steps.rows.seen_by(steps.i), steps.i
    radio = steps.controller.radio
    if isinstance(radio, RadioFilter) and radio.result is not None:
        seen = [l for l in steps.steps[-1].seen if l not in radio.with_beliefs.peers]
        limits = range(len(rows.swarm.members) + len(rows.swarm.scenario.obstacles), _end(rows))
        whole = [_pair(steps, rows, l, RowPart.WHOLE) for l in [*seen, *limits] if l != i]
        costs = [*_own_parts(steps, radio), *whole]
    elif rows.swarm.safety.pairwise:
        costs = _pairs(steps, rows)
    else:
        costs = [_composed(steps, rows)]
    return sorted(costs, key=lambda cost: -cost.excess)


def _end(rows: SafetyRows) -> int:
    return len(rows.swarm.members) + len(rows.swarm.safe_set.obstacles)


def _known(steps: ControllerSteps) -> tuple[Array, tuple[int, ...]]:
    """The stacked state that the last step was decided on, and the agents in it."""
    now, radio = steps.steps[-1], steps.controller.radio
    return radio.with_beliefs(*now) if radio else (now.x, now.seen)


def _pairs(steps: ControllerSteps, rows: SafetyRows) -> list[RowCost]:
    """The rows of all pairs in sight, and for proven inputs their whole rows too."""
    now, i, swarm = steps.steps[-1], steps.i, rows.swarm
    assert steps.result is not None
    information, t, (_, seen) = swarm.information(), now.t + swarm.time.latency, _known(steps)
    halves = information.sharing(i, now.received, t, seen) if information.shares else []
    if radio := steps.controller.radio:
        halves = [l for l in seen if l in radio.with_beliefs.age]
    others = [l for l in seen if l != i] + list(range(len(swarm.members), _end(rows)))
    parts = [RowPart.HALF if l in halves else RowPart.WHOLE for l in others]
    costs = [_pair(steps, rows, l, part) for l, part in zip(others, parts, strict=True)]
    if steps.result.decision.origin in OF_PROOFS:
        costs += [_pair(steps, rows, l, RowPart.WHOLE) for l in halves if l != i]
    return costs


def _pair(steps: ControllerSteps, rows: SafetyRows, other: int, part: RowPart) -> RowCost:
    """The row of one pair."""
    now, result, swarm = steps.steps[-1], steps.result, rows.swarm
    assert result is not None
    row = PairRowTerms(rows, steps.i, other, part)(_known(steps)[0])
    terms = {WISH: inner(row.a.tolist(), steps.wish.tolist()), **row.terms}
    if part is RowPart.WHOLE and other in result.used:
        del terms[ADVERSARY]
        terms[ANNOUNCED] = inner(row.forces.tolist(), now.received[other].u)
    slack = terms[WISH] - added(terms.values()) - inner(row.a.tolist(), result.decision.u.tolist())
    terms = {name: value for name, value in terms.items() if value != 0.0 or name == WISH}
    label = swarm.safe_set.labels[other]
    return RowCost(label, part.name.lower(), terms, slack, row.per_metre, row.a)


def _composed(steps: ControllerSteps, rows: SafetyRows) -> RowCost:
    """The row of h_tot."""
    (x, visible), i, result, swarm = _known(steps), steps.i, steps.result, rows.swarm
    assert result is not None
    terms, received = rows.terms(i)(x, visible), steps.steps[-1].received
    a, u_nom, u = (v.tolist() for v in (terms.c[i], steps.wish, result.decision.u))
    allowance = float(swarm.safety.class_k[-1].value(ca.SX(terms.psi[-1])))
    costs = {WISH: inner(a, u_nom), MOTION: terms.unforced - allowance, ALLOWANCE: allowance}
    for l, most in terms.most.items():
        if l in result.used:
            costs[f"{ANNOUNCED}: {swarm.names[l]}"] = inner(terms.c[l].tolist(), received[l].u)
        elif l != i:
            costs[f"{ADVERSARY}: {swarm.names[l]}"] = most
    costs["margin η"] = terms.margin
    slack = costs[WISH] - added(costs.values()) - inner(a, u)
    return RowCost("all pairs", "all pairs", costs, slack, a=terms.c[i])


def _own_parts(steps: ControllerSteps, radio: RadioFilter) -> list[RowCost]:
    """The own parts that may bind: in m/s, and by the gap's terms times the share of it."""
    parts, result, swarm = radio.own_parts, radio.result, steps.rows.swarm
    assert result is not None
    if parts.limits is None:
        return []
    wish, applied = parts.spending()
    own_motion = radio.with_beliefs.points[steps.i].motion
    p, v = np.split(parts.reference, 2)
    costs, peers = [], sum(l in result.sets for l in parts.near if l is not None)
    for k, l in enumerate(parts.near):
        allowed, terms = float(parts.limits.most[k]), {WISH: float(wish[k])}
        if l is not None and l in result.sets:
            belief, motion = result.sets[l], radio.with_beliefs.points[l].motion
            low, high = belief.low[None], belief.high[None]
            near = float(Boxes(low, high).distance(p)[0])
            position, speed = np.split(belief.centre, 2)
            centre, fastest = float(length(position - p)), float(Boxes(low, high).speed()[0])
            way = motion.stopping(float(length(speed)))
            in_metres = {
                "distance to where it is believed": -centre,
                "age of what is known": centre - near + motion.stopping(fastest) - way,
                "required distance": parts.radius,
                "own way to stop": own_motion.stopping(float(length(v))),
                "the other's way to stop": way,
                "disturbance": own_motion.tube + motion.tube,
            }
            terms |= {name: parts.share * metres for name, metres in in_metres.items()}
        terms["share of the gap that it keeps"] = wish[k] - allowed - added(terms.values())
        name = f"obstacle {k - peers}" if l is None else swarm.names[l]
        slack = allowed - float(applied[k])
        costs.append(RowCost(name, "own part", terms, slack, parts.share))
    return costs

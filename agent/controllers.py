"""How an agent turns a u_nom input into one to apply: its row or rows, its QP, its backup."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.decision import Decision, decide, decide_pairs
from phalanx.theory.rows.information import Information, ReceivedInput
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.pairs import pair_rows
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import paper_row, split_row
from phalanx.theory.rows.terms import Terms

Array = NDArray[np.float64]


class Moment(NamedTuple):
    """What agent i knows when it decides."""

    t: float
    """When its input takes effect [s]."""
    x: Array
    """Stacked sampled state, shape (n̄,)."""
    terms: Terms
    u_nom: Array
    """What its law would like to apply, shape (m_i,)."""
    heard: Mapping[int, ReceivedInput]


class Controller(Protocol):
    """One agent's decision."""

    def __call__(self, now: Moment) -> tuple[Decision, list[int]]:
        """The input, and the agents whose û_l counted for it."""


def controller(swarm: Swarm, i: int) -> Controller:
    """What the scenario asks of agent i, alone."""
    safety = swarm.scenario.safety
    if swarm.members[i].adversary:
        return Attack(swarm, i)
    return OneRowForEachPair(swarm, i) if safety.composition == "pairs" else OneRow(swarm, i)


class Attack:
    """An adversary's u_nom input, projected onto U_j."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        self._i, self._qp = i, _solver(swarm, i, 1)

    def __call__(self, now: Moment) -> tuple[Decision, list[int]]:
        u = self._qp.solve(now.u_nom, now.terms.polytopes[self._i])
        if u is None:
            raise ArithmeticError(f"projection of {now.u_nom} onto U_i failed at t = {now.t}")
        return Decision(u, Origin.ATTACK, 0.0), []


class OneRow:
    """(psiQPdistributed): one row for h_tot."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        safety = swarm.scenario.safety
        self._i, self._qp, self._trust = i, _solver(swarm, i, 1), swarm.trust()
        self._eta, self._scale = swarm.eta(i), safety.margin_scale
        self._authority = safety.authority
        self._split = safety.information is Information.SPLIT

    def __call__(self, now: Moment) -> tuple[Decision, list[int]]:
        terms, i = now.terms, self._i
        eta = self._scale * (self._eta + terms.margin)
        usable: dict[int, Array] = {}
        if self._split:
            row = split_row(terms, i, self._trust.sharing(i, now.heard, now.t), eta)
        else:
            usable = self._trust.usable(now.heard, now.t)
            row = paper_row(terms, i, usable, eta)
        decision = decide(terms, i, row, now.u_nom, self._qp, self._authority)
        return decision, [l for l in usable if terms.c[l].any()]


class OneRowForEachPair:
    """The same for each pair by itself."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        safety = swarm.scenario.safety
        self._i, self._trust = i, swarm.trust()
        self._pairs, self._terms = swarm.own_pairs(i), swarm.pair_terms(i)
        self._qp = _solver(swarm, i, len(self._pairs))
        self._eta, self._scale = swarm.eta(i), safety.margin_scale
        self._split = safety.information is Information.SPLIT

    def __call__(self, now: Moment) -> tuple[Decision, list[int]]:
        sharing = self._trust.sharing(self._i, now.heard, now.t) if self._split else []
        usable = self._trust.usable(now.heard, now.t)
        terms = self._terms(now.x)
        rows = pair_rows(terms, self._pairs, usable, sharing, self._eta, self._scale)
        inputs = now.terms.polytopes[self._i]
        return decide_pairs(inputs, rows, now.u_nom, self._qp), list(usable)


def _solver(swarm: Swarm, i: int, safety_rows: int) -> NearestInput:
    dynamics, composed = swarm.members[i].dynamics, swarm.chain.set
    rows = dynamics.input_polytope(composed.x[composed.parts[i]])[0].shape[0]
    return NearestInput(dynamics.input_metric(), rows, safety_rows)

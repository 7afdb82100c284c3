"""Attacks: chase a target as in Simulation 2, or raise h_tot as fast as U_j allows."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from annotated_types import Ge

from phalanx.arrays import Array
from phalanx.theory.expressions.exact import dot
from phalanx.theory.laws.law import View
from phalanx.theory.laws.tracking import Gains, OutputDerivatives, output_derivatives
from phalanx.theory.margins.margin import ComposedMargin
from phalanx.theory.models.dynamics import Dynamics, Positive
from phalanx.theory.models.polytope import maximiser
from phalanx.theory.rows.composed import SwarmTerms
from phalanx.theory.rows.decision import decide
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import split_row
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Obstacle, Sphere
from phalanx.theory.safety.pairs import SwarmPairs


@dataclass(frozen=True)
class Guard:
    """An adversary's own CBF-QP, against other adversaries and obstacles, never normal agents."""

    radius: Positive
    """Distance that adversaries keep from each other [m]."""
    obstacle_clearance: Positive
    """Distance that adversaries keep from a sphere's center [m]."""
    alpha: Gains
    """Gains of the linear α_1 ... α_q [1/s]."""
    rho: Positive
    xi: Annotated[float, Ge(0)] = 0.0
    eta: Annotated[float, Ge(0)] = 0.0


@dataclass
class Chase:
    """K (x_target - x): each adversary pursues its own target, with collision avoidance on request.

    While it does not see its target it pursues the nearest normal agent. If it sees none it stays
    in place.
    """

    gains: Gains
    """k_1 ... k_q, as Track has them."""
    targets: Mapping[str, str] = field(default_factory=dict)
    """Target's name by adversary's name; all others pursue the nearest normal agent."""
    guard: Guard | None = None

    def prepare(self, dynamics: Dynamics) -> None:
        self._output = output_derivatives(dynamics, self.gains)
        self._target: int | None = None
        self._team: _Team | None = None
        self._outputs: list[OutputDerivatives] = []

    def join(self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]) -> "Chase":
        """The law of agent i in a swarm.

        Raises ValueError if a target is not a member or its output has another degree.
        """
        names, joined = [m.name for m in members], copy(self)
        joined._outputs = _outputs([m.dynamics for m in members])
        if (target := self.targets.get(names[i])) is not None:
            if target not in names:
                raise ValueError(f"targets: expected one of {names}, got {target!r}")
            joined._target = names.index(target)
        alone = not obstacles and sum(m.adversary for m in members) == 1
        if self.guard is not None and not alone:
            joined._team = _Team(self.guard, i, members, obstacles)
        return joined

    def input(self, view: View) -> Array:
        x, here = view.x[view.i], self._output(view.x[view.i])
        target = self._nearest(view) if self._target not in view.x else self._target
        there = np.zeros_like(here)
        if target is None:
            there[0] = here[0]
        else:
            known = self._outputs[target](view.x[target])[: len(here)]
            there[: len(known)] = known
        u_nom = self._output.input_for(x, dot((there - here).T, np.array(self.gains)))
        return u_nom if self._team is None else self._team.guarded(view.x, u_nom)

    def _nearest(self, view: View) -> int | None:
        here = view.positions[view.i]
        return min(
            view.normal,
            key=lambda n: float(np.sum((view.positions[n] - here) ** 2)),
            default=None,
        )


def _outputs(dynamics: Sequence[Dynamics]) -> list[OutputDerivatives]:
    """OutputDerivatives of each dynamics, compiled once for equal ones."""
    different: list[Dynamics] = []
    for each in dynamics:
        if each not in different:
            different.append(each)
    compiled = [OutputDerivatives(each) for each in different]
    return [compiled[different.index(each)] for each in dynamics]


class _Team:
    """Adversaries that avoid each other and the obstacles, each with a row of its share."""

    def __init__(
        self, guard: Guard, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]
    ) -> None:
        self._team = [j for j, m in enumerate(members) if m.adversary]
        self._self = self._team.index(i)
        team = [Member(members[j].name, members[j].dynamics, False) for j in self._team]
        around = [
            Sphere(o.center, guard.obstacle_clearance) if isinstance(o, Sphere) else o
            for o in obstacles
        ]
        pairs = SwarmPairs(team, around, Separation(guard.radius), len(guard.alpha))
        swarm = SwarmTerms(pairs, guard.rho, [Linear(gain) for gain in guard.alpha], guard.xi)
        self._terms = swarm.of(self._self, None, ComposedMargin(guard.eta))
        self._states = swarm.members.states
        self._qp = NearestInput(members[i].dynamics.input_metric())

    def guarded(self, x: Mapping[int, Array], u_nom: Array) -> Array:
        """The nearest input that keeps the team's safe set, shape (m_i,)."""
        stacked = np.full(self._states[-1].stop, np.nan)
        seen = [place for place, j in enumerate(self._team) if j in x]
        for place in seen:
            stacked[self._states[place]] = x[self._team[place]]
        terms = self._terms(stacked, seen)
        row = split_row(terms, self._self, seen)
        return decide(terms, self._self, row, u_nom, self._qp, _AUTHORITY).u


_AUTHORITY = 0.01
"""Plays the part of safety.authority: with a smaller span the backup could not help."""


@dataclass
class WorstCase:
    """u_j^max of Eq. (adversarialu): the input of U_j with the largest effect on ψ_q."""

    def prepare(self, dynamics: Dynamics) -> None:
        """Do nothing: the attack fits every dynamics."""

    def input(self, view: View) -> Array:
        return maximiser(view.terms.c[view.i], view.terms.polytopes[view.i].corners)

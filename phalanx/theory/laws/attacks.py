"""Attacks: chase a target, raise h_tot at once, or follow a script."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Annotated, ClassVar

import casadi as ca
import numpy as np
from annotated_types import Ge, Le, MinLen

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.cache import FunctionCache, cached_for
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.laws.law import View
from phalanx.theory.laws.tracking import (
    Gains,
    nearest_normal,
    output_chain,
    tracked_chain,
)
from phalanx.theory.models.dynamics import Dynamics, Positive
from phalanx.theory.models.polytope import constant_polytope, maximiser
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

    >>> Chase(gains=(1.0, 2.0), targets={"hunter": "1"}).targets["hunter"]
    '1'
    """

    without_goal: ClassVar[bool] = True

    gains: Gains
    """k_1 ... k_q, as Track has them."""
    targets: Mapping[str, str] = field(default_factory=dict)
    """Target's name by adversary's name; all others pursue the nearest normal agent."""
    guard: Guard | None = None

    def prepare(self, dynamics: Dynamics) -> None:
        self._dynamics, self._chain = dynamics, tracked_chain(dynamics, self.gains)
        self.stay = self._towards([self._chain.derivatives[0]])
        self.target: int | None = None
        self.team: _Team | None = None
        self.pursue: list[CompiledFunction] = []

    def join(self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]) -> "Chase":
        """The law of agent i in a swarm.

        Raises ValueError if a target is not a member or its output has another degree.
        """
        names, joined = [m.name for m in members], copy(self)
        joined.pursue = self._towards_each([m.dynamics for m in members])
        if (target := self.targets.get(names[i])) is not None:
            if target not in names:
                raise ValueError(f"targets: expected one of {names}, got {target!r}")
            joined.target = names.index(target)
        alone = not obstacles and sum(m.adversary for m in members) == 1
        if self.guard is not None and not alone:
            joined.team = _Team(self.guard, i, members, obstacles)
        return joined

    def input(self, view: View) -> Array:
        x = view.x[view.i]
        target = self.target if self.target in view.x else nearest_normal(view)
        (u,) = self.stay(x) if target is None else self.pursue[target](x, view.x[target])
        return u if self.team is None else self.team.guarded(view.x, u)

    def _towards(self, reference: Sequence[ca.SX], *symbols: ca.SX) -> CompiledFunction:
        """Compile the input for p^d and its derivatives, expressions of the state and symbols."""
        u = self._chain.input_for(self._chain.pull(self.gains, reference))
        return CompiledFunction([self._chain.x, *symbols], [u])

    def _towards_each(self, targets: Sequence[Dynamics]) -> list[CompiledFunction]:
        """Compile the input for the state of each target, once for each dynamics."""
        compiled = {
            number: cached_for(
                [self._dynamics, dynamics], ("chase", self.gains), partial(self._to_state, dynamics)
            )
            for number, dynamics in {id(dynamics): dynamics for dynamics in targets}.items()
        }
        return [compiled[id(dynamics)] for dynamics in targets]

    def _to_state(self, target: Dynamics) -> CompiledFunction:
        chain = output_chain(target)
        return self._towards(chain.derivatives[:-1], chain.x)


class _Team:
    """Adversaries that avoid each other and the obstacles, each with a row of its share."""

    def __init__(
        self, guard: Guard, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]
    ) -> None:
        self.agents = [j for j, m in enumerate(members) if m.adversary]
        self.place = self.agents.index(i)
        team = [Member(members[j].name, members[j].dynamics, False) for j in self.agents]
        around = [
            Sphere(o.center, guard.obstacle_clearance) if isinstance(o, Sphere) else o
            for o in obstacles
        ]
        # All agents of the team, and other runs, have the same functions.
        kinds = [o if not isinstance(o, Sphere) else len(o.center) for o in around]
        of = [guard, *[m.dynamics for m in team]]
        functions = cached_for(of, ("team", repr(kinds)), FunctionCache)
        function, gains = Separation(guard.radius), [Linear(gain) for gain in guard.alpha]
        pairs = SwarmPairs(team, around, function, len(gains), functions)
        swarm = SwarmTerms(pairs, guard.rho, gains, guard.xi)
        self.terms = swarm.of(self.place, None, guard.eta)
        self._states = swarm.members.states
        self._unseen = np.full(self._states[-1].stop, np.nan)
        self.terms.compile()
        self._qp = NearestInput(members[i].dynamics.input_metric())

    def guarded(self, x: Mapping[int, Array], u_nom: Array) -> Array:
        """The nearest input that keeps the team's safe set, shape (m_i,)."""
        stacked = self._unseen.copy()
        in_sight = [index for index, j in enumerate(self.agents) if j in x]
        for index in in_sight:
            stacked[self._states[index]] = x[self.agents[index]]
        terms = self.terms(stacked, in_sight)
        row = split_row(terms, self.place, in_sight)
        return decide(terms, self.place, row, u_nom, self._qp).u


@dataclass
class WorstCase:
    """u_j^max of Eq. (adversarialu): the input of U_j with the largest effect on ψ_q.

    >>> isinstance(WorstCase(), Law)
    True
    """

    without_goal: ClassVar[bool] = True

    def prepare(self, dynamics: Dynamics) -> None:
        """Do nothing: the attack fits every dynamics."""

    def input(self, view: View) -> Array:
        return maximiser(view.terms.c[view.i], view.terms.polytopes[view.i].corners)


Instant = Annotated[float, Ge(0), Le(1e9)]
Number = Annotated[float, Ge(-1e9), Le(1e9)]


@dataclass
class Script:
    """u(t) = inputs[k] from at[k] until at[k + 1]: the attack of a search, or of a person.

    An agent changes its input at its first sample at or after the instant. It keeps the last one.

    >>> attack = Script(at=(0.0, 1.0), inputs=((1.0, 0.0), (0.0, 1.0)))
    >>> attack.prepare(SingleIntegrator(speed=1.0))
    >>> goal = Goal(np.ones(2), np.zeros(2), np.zeros(2))
    >>> attack.input(View(0, {0: np.zeros(2)}, (0,), goal, None, t=1.5))
    array([0., 1.])
    """

    without_goal: ClassVar[bool] = True

    at: Annotated[tuple[Instant, ...], MinLen(1)]
    """When each input begins [s]: 0 first, then ascending."""
    inputs: Annotated[tuple[tuple[Number, ...], ...], MinLen(1)]
    """One input of U_j for each instant, in the order of the dynamics' inputs."""

    def __post_init__(self) -> None:
        """Raises ValueError unless each instant has an input, and instants ascend from 0."""
        if len(self.at) != len(self.inputs):
            raise ValueError(
                f"expected an input for each instant of at: {len(self.at)}, got {len(self.inputs)}"
            )
        if self.at[0] != 0.0:
            raise ValueError(f"expected at to begin with 0, got {self.at[0]:g}")
        for earlier, later in pairwise(self.at):
            if later <= earlier:
                raise ValueError(f"expected at to ascend, got {later:g} after {earlier:g}")

    def prepare(self, dynamics: Dynamics) -> None:
        """Take the inputs for a dynamics. Raises ValueError if one is not in its U."""
        size, x = len(dynamics.inputs), ca.SX.sym("x", len(dynamics.states))
        names = ", ".join(dynamics.inputs)
        polytope = constant_polytope(*dynamics.input_polytope(x))
        self._inputs = [np.array(u, dtype=np.float64) for u in self.inputs]
        for k, u in enumerate(self._inputs):
            if len(u) != size:
                raise ValueError(f"inputs.{k}: expected {size} numbers ({names}), got {len(u)}")
            # Where U depends on the state, an input outside is projected onto it.
            if polytope is not None and not polytope.takes(u):
                raise ValueError(
                    f"inputs.{k}: expected ({names}) within U, {_extent(polytope.corners)}, "
                    f"got {list(self.inputs[k])}"
                )

    def input(self, view: View) -> Array:
        return self._inputs[bisect_right(self.at, view.t) - 1]


def _extent(corners: Array) -> str:
    """Bounds of each input in words, from the corners of U, shape (v, m)."""
    bounds = zip(corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), strict=True)
    return " x ".join(f"[{low:g}, {high:g}]" for low, high in bounds)

"""The laws of Simulation 2, for outputs of any degree q: track a goal, chase a target.

Both are u = K (x^d - x) + d^q/dt^q p^d, with K acting on the output and its derivatives; the
signs are those that attract (as printed in the paper they repel).
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt, MinLen
from numpy.typing import NDArray

from phalanx.theory.controller import decide
from phalanx.theory.dynamics import Dynamics
from phalanx.theory.laws import View
from phalanx.theory.obstacles import Obstacle, Sphere
from phalanx.theory.outputs import OutputDerivatives
from phalanx.theory.psi import build_chain
from phalanx.theory.qp import NearestInput
from phalanx.theory.row import split_row
from phalanx.theory.safe_set import Member, Separation, compose
from phalanx.theory.terms import TermsFunction

Array = NDArray[np.float64]
Positive = Annotated[float, Gt(0)]
Gains = Annotated[tuple[Positive, ...], MinLen(1)]


def _prepared(dynamics: Dynamics, gains: Gains) -> OutputDerivatives:
    output = OutputDerivatives(dynamics)
    if len(gains) != output.degree:
        raise ValueError(
            f"gains: {type(dynamics).__name__} needs {output.degree}, one for the output and each "
            f"of its derivatives below the input; got {len(gains)}"
        )
    return output


@dataclass
class Track:
    """K (x^d - x) + the q-th derivative of p^d: the nominal law of Simulation 2."""

    gains: Gains
    """k_1 ... k_q of the position error and its derivatives' [1/s^q ... 1/s]."""

    def prepare(self, dynamics: Dynamics) -> None:
        self._output = _prepared(dynamics, self.gains)

    def input(self, view: View) -> Array:
        x = view.x[view.i]
        q, d = self._output.degree, len(view.goal.position)
        goal = np.zeros((q + 1, d))
        goal[: len(view.goal)] = view.goal[: q + 1]
        error = goal[:q] - self._output(x)
        return self._output.input_for(x, self.gains @ error + goal[q])


@dataclass(frozen=True)
class Guard:
    """An adversary's own CBF-QP, against other adversaries and obstacles, never normal agents."""

    radius: Positive
    """Distance that adversaries keep from each other [m]."""
    obstacle_radius: Positive
    """Distance that they keep from a sphere's center [m]."""
    alpha: Gains
    """Gains of the linear α_1 ... α_q [1/s]."""
    rho: Positive
    xi: Annotated[float, Ge(0)] = 0.0
    eta: Annotated[float, Ge(0)] = 0.0


@dataclass
class Chase:
    """K (x_target - x): each adversary pursues its own target, and may guard itself."""

    gains: Gains
    """k_1 ... k_q, as Track has them."""
    targets: Mapping[str, str] = field(default_factory=dict)
    """Adversary's name to its target's; who has none pursues the nearest normal agent."""
    guard: Guard | None = None

    def prepare(self, dynamics: Dynamics) -> None:
        self._output = _prepared(dynamics, self.gains)
        self._target: int | None = None
        self._team: _Team | None = None
        self._outputs: list[OutputDerivatives] = []

    def join(self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]) -> "Chase":
        """The law of agent i in a swarm.

        Raises ValueError if a target is not a member or its output has another degree.
        """
        names, joined = [m.name for m in members], copy(self)
        joined._outputs = [OutputDerivatives(m.dynamics) for m in members]
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
        target = self._nearest(view) if self._target is None else self._target
        there = np.zeros_like(here)
        known = self._outputs[target](view.x[target])[: len(here)]
        there[: len(known)] = known
        wanted = self._output.input_for(x, self.gains @ (there - here))
        return wanted if self._team is None else self._team.guarded(view.x, wanted)

    def _nearest(self, view: View) -> int:
        here = view.positions[view.i]
        return min(view.normal, key=lambda n: float(np.sum((view.positions[n] - here) ** 2)))


class _Team:
    """Adversaries that avoid each other and the obstacles, each keeping its share."""

    def __init__(
        self, guard: Guard, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]
    ) -> None:
        self._who = [j for j, m in enumerate(members) if m.adversary]
        self._self = self._who.index(i)
        self._eta = guard.eta
        team = [Member(members[j].name, members[j].dynamics, False) for j in self._who]
        around = [
            Sphere(o.center, guard.obstacle_radius) if isinstance(o, Sphere) else o
            for o in obstacles
        ]
        composed = compose(team, around, Separation(guard.radius), guard.rho)
        self._terms = TermsFunction(build_chain(composed, guard.alpha, guard.xi))
        dynamics = members[i].dynamics
        own = composed.x[composed.parts[self._self]]
        rows = dynamics.input_polytope(own)[0].shape[0]
        self._qp = NearestInput(dynamics.input_metric(), rows)

    def guarded(self, x: Sequence[Array], wanted: Array) -> Array:
        """The nearest input that keeps the team's safe set, shape (m_i,)."""
        terms = self._terms(np.concatenate([x[j] for j in self._who]))
        row = split_row(terms, self._self, range(len(self._who)), self._eta)
        return decide(terms, self._self, row, wanted, self._qp, _FUTILE).u


_FUTILE = 0.01
"""As safety.authority: below this span the backup could not help."""

"""Nominal laws of normal agents and attacks of adversaries: what each would like to apply.

Both return an input before it is made safe or projected onto U_i.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple, Protocol, runtime_checkable

from annotated_types import Gt

from phalanx.arrays import Array
from phalanx.theory.laws.formation import Goal
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.rows.terms import Terms
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.obstacles import Obstacle

Gain = Annotated[float, Gt(0)]


class View(NamedTuple):
    """What a law may look at, at one sampling instant of agent i: itself, and whom it sees."""

    i: int
    x: Mapping[int, Array]
    """States by agent's index, agent i's among them."""
    normal: Sequence[int]
    """Indices of the normal agents that it sees, itself included if it is one."""
    goal: Goal
    terms: Terms

    @property
    def positions(self) -> Mapping[int, Array]:
        """Output positions by agent's index [m]."""
        return self.terms.positions


@runtime_checkable
class Law(Protocol):
    """A nominal law or an attack; a scenario names it ``package.module:Name``."""

    def prepare(self, dynamics: Dynamics) -> None:
        """Called once in the agent's process, before the first input.

        Raises ValueError if the law does not fit the dynamics.
        """

    def input(self, view: View) -> Array:
        """What the agent would like to apply, shape (m_i,)."""


@runtime_checkable
class TeamLaw(Protocol):
    """A law that must know the swarm before its first input."""

    def join(self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]) -> Law:
        """The law of agent i. Called once, after prepare. Raises ValueError if it does not fit."""

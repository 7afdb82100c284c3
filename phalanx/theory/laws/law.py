"""Nominal laws of normal agents and attacks of adversaries: what each would like to apply.

Both return an input before it is made safe or projected onto U_i.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, NamedTuple, Protocol, runtime_checkable

import numpy as np
from annotated_types import Gt

from phalanx.arrays import Array
from phalanx.theory.expressions.asked import MistakenMethodError, ask, in_short
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.laws.formation import Goal
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.rows.row import Terms
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


_FLOAT = np.dtype(np.float64)


class NominalInput:
    """One agent's law, asked for what it would like to apply; checked, for it may be a user's."""

    def __init__(self, law: Law, member: Member) -> None:
        """member: the agent."""
        self._law, self._agent = law, member.name
        self._shape = (len(member.dynamics.inputs),)
        self._expected = f"an array of {self._shape[0]} finite numbers"
        # Those built in return, and raise nothing that is theirs to say.
        built_in = type(law).__module__.startswith("phalanx.")
        self._input = law.input if built_in else self._ask

    def __call__(self, view: View) -> Array:
        """The nominal input, shape (m_i,).

        Raises:
            MistakenMethodError: a user's law returned something else, raised, or does not return.
        """
        u = self._input(view)
        # What a law nearly always returns, for a fraction of a microsecond.
        usual = type(u) is np.ndarray and u.dtype is _FLOAT and u.shape == self._shape
        if usual and sum(map(abs, u.tolist())) <= LARGEST:
            return u
        if not isinstance(u, np.ndarray):
            got = repr(u)
        elif u.shape != self._shape or u.dtype.kind not in "fi":
            got = f"shape {u.shape} of {u.dtype}"
        elif not (np.abs(u) <= LARGEST).all():
            got = in_short(u)
        else:
            return u
        raise MistakenMethodError(self._law, "input", self._expected, got, agent=self._agent)

    def _ask(self, view: View) -> Array:
        found: Array = ask(self._law, "input", self._expected, view, agent=self._agent)
        return found

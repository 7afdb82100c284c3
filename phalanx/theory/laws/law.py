"""Nominal laws of normal agents and attacks of adversaries.

Both compute an input before it is made safe or projected onto U_i.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.expressions.user_methods import MistakenMethodError, call_user, first_numbers
from phalanx.theory.laws.goals import Goal
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.rows.row import Terms
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.obstacles import Obstacle


class View(NamedTuple):
    """A law's arguments at one sampling instant of agent i: its own state and those it sees."""

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
        """Prepare for a dynamics; called once, before the first input.

        Raises ValueError if the law does not fit the dynamics.
        """

    def input(self, view: View) -> Array:
        """The nominal input, shape (m_i,)."""


@runtime_checkable
class TeamLaw(Protocol):
    """A law that needs the swarm before its first input."""

    def join(self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]) -> Law:
        """The law of agent i. Called once, after prepare. Raises ValueError if it does not fit."""


_FLOAT = np.dtype(np.float64)


class NominalInput:
    """One agent's nominal input, checked, since the law may be a user's own."""

    def __init__(self, law: Law, member: Member) -> None:
        """member: the agent."""
        self._law, self._agent = law, member.name
        self._shape = (len(member.dynamics.inputs),)
        self._expected = f"a numpy array of {self._shape[0]} finite numbers"
        # A built-in law needs neither the watch for endless loops nor a message with its place.
        built_in = type(law).__module__.startswith("phalanx.")
        self._input = law.input if built_in else self._call_user

    def __call__(self, view: View) -> Array:
        """The nominal input, shape (m_i,).

        Raises:
            MistakenMethodError: a user's law returned something else, raised, or does not return.
        """
        u = self._input(view)
        # The usual case, decided in a fraction of a microsecond.
        usual = type(u) is np.ndarray and u.dtype is _FLOAT and u.shape == self._shape
        if usual and sum(map(abs, u.tolist())) <= LARGEST:
            return u
        if not isinstance(u, np.ndarray):
            got = repr(u)
        elif u.shape != self._shape or u.dtype.kind not in "fi":
            got = f"shape {u.shape} of {u.dtype}"
        elif not (np.abs(u) <= LARGEST).all():
            got = first_numbers(u)
        else:
            return u
        raise MistakenMethodError(self._law, "input", self._expected, got, agent=self._agent)

    def _call_user(self, view: View) -> Array:
        found: Array = call_user(self._law, "input", self._expected, view, agent=self._agent)
        return found

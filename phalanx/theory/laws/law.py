"""Nominal laws of normal agents and attacks of adversaries.

Both compute an input before it is made safe or projected onto U_i.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

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
    t: float
    """Time of the sample [s]."""

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
        self._size = len(member.dynamics.inputs)
        # A built-in law needs neither the watch for endless loops nor a message with its place.
        built_in = type(law).__module__.startswith("phalanx.")
        self._input = law.input if built_in else self._call_user

    def __call__(self, view: View) -> Array:
        """The nominal input, shape (m_i,).

        Raises:
            MistakenMethodError: a user's law returned something else, raised, or does not return.
        """
        return checked_input(self._law, self._input(view), self._size, self._agent)

    def _call_user(self, view: View) -> Any:
        return call_user(self._law, "input", expected_input(self._size), view, agent=self._agent)


def expected_input(size: int) -> str:
    """An input of m_i numbers in words."""
    return f"a numpy array of {size} finite numbers"


def checked_input(of: object, u: Any, size: int, agent: str) -> Array:
    """Return what the method `input` of a law or controller returned, if it is an input.

    Raises MistakenMethodError if it is anything else.
    """
    # The usual case, decided in a fraction of a microsecond.
    usual = type(u) is np.ndarray and u.dtype is _FLOAT and u.shape == (size,)
    if usual and sum(map(abs, u.tolist())) <= LARGEST:
        found: Array = u
        return found
    if not isinstance(u, np.ndarray):
        got = repr(u)
    elif u.shape != (size,) or u.dtype.kind not in "fi":
        got = f"shape {u.shape} of {u.dtype}"
    elif not (np.abs(u) <= LARGEST).all():
        got = first_numbers(u)
    else:
        return u
    raise MistakenMethodError(of, "input", expected_input(size), got, agent=agent)

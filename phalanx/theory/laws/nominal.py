"""A law's nominal input, checked: a law may be a user's."""

import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.asked import MistakenMethodError, ask, in_short
from phalanx.theory.expressions.magnitude import LARGEST
from phalanx.theory.laws.law import Law, View
from phalanx.theory.safety.composition import Member

_FLOAT = np.dtype(np.float64)


class NominalInput:
    """One agent's law, asked for what it would like to apply."""

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

"""A swarm in which some agents take the inputs that a program outside of the run holds for them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from phalanx.arrays import Array
from phalanx.swarm.swarm import Swarm
from phalanx.theory.laws.law import Law, View
from phalanx.theory.models.dynamics import Dynamics


@dataclass(frozen=True)
class ActedSwarm(Swarm):
    """A swarm whose acting agents have no law of the scenario's.

    An adversary's action is projected onto U_i. A normal agent's is its nominal input: its filter
    or controller makes it safe, or none does if the scenario says `controller = "none"`.
    """

    actions: Mapping[int, Array] = field(default_factory=dict)
    """The action that each acting agent holds, by index, shape (m_i,); it may change."""

    def law(self, i: int) -> Law:
        """Return the law of agent i, which holds its action if it acts."""
        return Held(self.actions, i) if i in self.actions else super().law(i)


@dataclass(frozen=True)
class Held:
    """The action of one agent, whatever it sees."""

    actions: Mapping[int, Array]
    i: int

    def prepare(self, dynamics: Dynamics) -> None:
        """Do nothing: an action fits every dynamics."""

    def input(self, view: View) -> Array:
        return self.actions[self.i]

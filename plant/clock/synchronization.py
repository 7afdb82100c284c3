"""Synchronization of the plant with its agents: decides whose answers virtual time waits for."""

from collections.abc import Sequence
from typing import Protocol

from phalanx.arrays import Array
from phalanx.plant.world.world import World
from phalanx.swarm.swarm import Swarm


class Synchronization(Protocol):
    """Takes the state on while inputs are awaited, and the world after it."""

    sequential: bool
    """Whether all that was handed out is answered before virtual time goes on."""

    @property
    def open(self) -> list[int]:
        """Agents whose states are not known, since their inputs are awaited."""

    def begin_awaiting(self, i: int) -> None:
        """From now on agent i holds an input that is not known yet."""

    def end_awaiting(self, i: int, u: Array | None) -> None:
        """Agent i's awaited input is u, shape (m_i,).

        None: it was lost, and the actuator holds what it did.
        """

    def in_question(self, who: Sequence[int]) -> list[int]:
        """Whose inputs have to be known before those in `who` can be told what they see."""

    def advance(self, until: float) -> None:
        """Integrate to `until` [s]. Raises DivergedError."""

    def reach(self, until: float) -> None:
        """Bring the world to `until` [s]. Raises DivergedError."""


class Sequential:
    """Everybody is waited for: an input is known as soon as it takes effect."""

    sequential = True

    def __init__(self, swarm: Swarm, world: World) -> None:
        self._world = world
        self.open: list[int] = []

    def begin_awaiting(self, i: int) -> None:
        """The world stands still until the input is there."""

    def end_awaiting(self, i: int, u: Array | None) -> None:
        """Let the input take effect."""
        if u is not None:
            self._world.apply(i, u)

    def in_question(self, who: Sequence[int]) -> list[int]:
        """Nobody's: all have answered."""
        return []

    def advance(self, until: float) -> None:
        """Bring the world there. Raises DivergedError."""
        self._world.advance(until)

    reach = advance

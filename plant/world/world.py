"""The true continuous dynamics, integrated between events."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from phalanx.plant.world.integration import Integration, Passage, Piece
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.expressions.magnitude import LARGEST

Array = NDArray[np.float64]


class DivergedError(ArithmeticError):
    """The true dynamics, or h along them, left the finite numbers."""

    def __init__(self, what: str, t: float) -> None:
        """what: which number it was. t: when, at the latest [s]."""
        super().__init__(
            f"{what} is no longer finite at t = {t:.3f} s: check dynamics and laws for divisions "
            "by zero and unbounded growth"
        )


class World:
    """State of all agents and the inputs they hold, Eq. (generalsystem)."""

    def __init__(self, rows: SafetyRows) -> None:
        """Start at the scenario's x(0), with every actuator at zero."""
        self.integration = Integration(rows)
        """Of this world; whoever goes ahead with it lets the world follow."""
        self.t, self.x, self.p = 0.0, self.integration.x, self.integration.p
        self._way = self.integration.start()

    def take_way(self) -> list[Piece]:
        """What the world went through since this was last called, in order."""
        way, self._way = self._way, []
        return way

    def apply(self, i: int, u: Array) -> None:
        """Agent i's actuator holds u, shape (m_i,), from now on."""
        self.integration.hold(i, u)

    def advance(self, until: float) -> None:
        """Integrate to `until` [s]. Raises DivergedError."""
        self.follow(self.integration.to(until))

    def follow(self, way: Iterable[Piece]) -> None:
        """Go this way on from here. Raises DivergedError."""
        for piece in way:
            if isinstance(piece, Passage):
                if not (np.abs(piece.x) <= LARGEST).all():
                    raise DivergedError("the state", piece.stretch.end)
                self.t, self.x, self.p = piece.stretch.end, piece.x[-1], piece.p[-1]
            self._way.append(piece)

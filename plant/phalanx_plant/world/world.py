"""The true continuous dynamics, integrated between events."""

from collections.abc import Iterable

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.expressions.asked import place_of
from phalanx.theory.expressions.exact import LARGEST
from phalanx_plant.world.integration import Integration, Passage, Piece


class DivergedError(ArithmeticError):
    """The true dynamics, or h along them, left the finite numbers."""

    def __init__(self, what: str, t: float, check: str = "dynamics and laws") -> None:
        """what: which number it was. t: when, at the latest [s]. check: whose it may be."""
        super().__init__(
            f"{what} is no longer finite at t = {t:.3f} s: check {check} for divisions by zero "
            "and unbounded growth"
        )


class World:
    """State of all agents and the inputs they hold, Eq. (generalsystem)."""

    def __init__(self, rows: SafetyRows) -> None:
        """Start at the scenario's x(0), with every actuator at zero."""
        self.swarm = rows.swarm
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
                if not ((np.abs(piece.x) <= LARGEST).all() and np.isfinite(piece.p).all()):
                    raise self._diverged(piece)
                self.t, self.x, self.p = piece.stretch.end, piece.x[-1], piece.p[-1]
            self._way.append(piece)

    def _diverged(self, passage: Passage) -> DivergedError:
        """Whose state or output point is no longer finite, and the methods that led there."""
        members, end = self.swarm.members, passage.stretch.end
        finite = np.abs(passage.x) <= LARGEST
        for member, part in zip(members, self.swarm.safe_set.parts, strict=True):
            if not finite[:, part].all():
                methods = [place_of(member.dynamics, method) for method in ("drift", "actuation")]
                return DivergedError(
                    f"the state of agent {member.name}", end, " and ".join(methods)
                )
        member = members[int(np.argmin(np.isfinite(passage.p).all(axis=(0, 2))))]
        position = place_of(member.dynamics, "position")
        return DivergedError(f"the output point of agent {member.name}", end, position)

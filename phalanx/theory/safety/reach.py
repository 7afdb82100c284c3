"""How far a safe-set function reaches, where that is proven, so that distant pairs are left out."""

import math
from typing import Protocol

from phalanx.theory.safety.distances import Distance, HeadingAware
from phalanx.theory.safety.function import SafeSetFunction, Separation
from phalanx.theory.safety.limits import Boundary
from phalanx.theory.safety.obstacles import Obstacle
from phalanx.theory.safety.static import Static

_PROVEN = (Separation, Distance, HeadingAware)
_METHODS = ("between", "to_obstacle", "reach")


class Reaching(Protocol):
    """A safe-set function whose h falls below any level, far enough away."""

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        """Distance beyond which h is below a level <= 0 [m].

        Of the output points of any two agents; or of an agent's from an obstacle, as the obstacle
        measures it.
        """


def proven_reach(function: SafeSetFunction) -> Reaching | None:
    """The function, if its h and its reach are those of a class above; of a user's none is proven.

    A reach that is too short would leave an unsafe pair out of the truth and of certificates.
    """
    for known in _PROVEN:
        own = (getattr(type(function), name, None) is getattr(known, name) for name in _METHODS)
        if isinstance(function, known) and all(own):
            return function
    return None


def static_reach(function: Reaching, level: float, static: Static) -> float:
    """Distance from it beyond which h is below a level <= 0 [m]: a limit's is without end."""
    return math.inf if isinstance(static, Boundary) else function.reach(level, static)

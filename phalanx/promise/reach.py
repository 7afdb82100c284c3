"""A: everything that another member can reach, with any input in its bounds."""

from math import sqrt
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.held import held
from phalanx.promise.capsules import Capsules, balls
from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import Bounded
from phalanx.theory.models.integrators import DoubleIntegrator


class Reach(NamedTuple):
    """One member's reach.

    >>> from phalanx.theory.models.integrators import SingleIntegrator
    >>> robot = Reach(SingleIntegrator(speed=1.0), disturbance=0.0)
    >>> robot.within(np.zeros(2), np.zeros(2), 2.0).radius.round(2)
    array([2.83])
    """

    dynamics: Bounded
    disturbance: float
    """Bound on the norm of φ."""

    def within(self, x: Array, p: Array, time: float) -> Capsules:
        """Return one capsule of its output points, from p at the state x, within a time [s]."""
        if isinstance(self.dynamics, DoubleIntegrator):
            return self._from_speed(x, p, time)
        radius = self.dynamics.travel(x, time, self.disturbance)
        return balls(p[None], np.array([radius]))

    def _from_speed(self, x: Array, p: Array, time: float) -> Capsules:
        """Return the way straight on, and around it what inputs and φ change."""
        assert isinstance(self.dynamics, DoubleIntegrator)
        factors = held(np.array(self.dynamics.drag), np.array(time))
        push = sqrt(self.dynamics.dimension) * self.dynamics.acceleration
        radius = push * factors.reach + self.disturbance * (time + factors.reach)
        end = p + factors.speed * x[self.dynamics.dimension :]
        return Capsules(p[None], end[None], np.array([float(radius)]))

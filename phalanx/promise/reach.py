"""A: everything that another member can reach, with any input in its bounds."""

from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.held import held
from phalanx.promise.capsules import Capsules, balls
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.dynamics import Bounded
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.wheeled import DifferentialDrive, Unicycle


class Reach(NamedTuple):
    """The reach of members.

    >>> from phalanx.theory.models.integrators import SingleIntegrator
    >>> robot = Reach(SingleIntegrator(speed=1.0), disturbance=0.0)
    >>> robot.within(np.zeros((1, 2)), np.zeros((1, 2)), 2.0).radius.round(2)
    array([2.83])
    """

    dynamics: Bounded
    disturbance: float
    """Bound on the norm of φ."""

    def within(self, x: Array, p: Array, time: float) -> Capsules:
        """Return all output points within a time [s], of n members with these dynamics.

        From p, shape (n, axes), at the states x, shape (n, states); one capsule each.
        """
        if isinstance(self.dynamics, DoubleIntegrator):
            return self._from_speed(x, p, time)
        travels = [self.dynamics.travel(each, time, self.disturbance) for each in x]
        return balls(p, np.array(travels))

    def for_ever(self, x: Array) -> tuple[float, float]:
        """Return bounds on its way from p at the state x: an offset [m], and a speed [m/s].

        With drag a faster one comes down to U / β; without it, speeds have no bound, nor are those
        of other dynamics whose inputs are no velocities known.
        """
        if isinstance(self.dynamics, DoubleIntegrator):
            return self._with_drag(x)
        if not isinstance(self.dynamics, SingleIntegrator | Unicycle | DifferentialDrive):
            return 0.0, inf
        return 0.0, self.dynamics.travel(x, 1.0, self.disturbance)

    def _with_drag(self, x: Array) -> tuple[float, float]:
        assert isinstance(self.dynamics, DoubleIntegrator)
        drag, axes = self.dynamics.drag, self.dynamics.dimension
        if drag == 0.0:
            return 0.0, inf
        steady = (sqrt(axes) * self.dynamics.acceleration + self.disturbance) / drag
        more = max(0.0, float(length(x[axes:])) - steady) / drag
        return more, steady + self.disturbance

    def _from_speed(self, x: Array, p: Array, time: float) -> Capsules:
        """Return the ways straight on, and around each what inputs and φ change."""
        assert isinstance(self.dynamics, DoubleIntegrator)
        factors = held(np.array(self.dynamics.drag), np.array(time))
        push = sqrt(self.dynamics.dimension) * self.dynamics.acceleration
        radius = push * factors.reach + self.disturbance * (time + factors.reach)
        end = p + factors.speed * x[:, self.dynamics.dimension :]
        return Capsules(p, end, np.full(len(p), radius))

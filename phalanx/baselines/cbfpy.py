"""`cbfpy`: a barrier for each pair, as in continuous time, by the library cbfpy in JAX.

As a user of cbfpy would write it: others go on with the velocity that is seen, none is assumed to
attack or to help, and nothing is known of sampling. JAX does not give the same bits on every CPU.
"""

import warnings
from dataclasses import dataclass, field
from importlib import import_module

import numpy as np

from phalanx.arrays import Array
from phalanx.theory.laws.law import ControlledAgent, ControllerView
from phalanx.theory.safety.obstacles import Sphere

_FAR = 1e3
"""Coordinate of agents that are not seen [m]."""


@dataclass
class CbfPy:
    """cbfpy's safety filter, with slack: without a solution it violates least."""

    _before: dict[int, Array] = field(default_factory=dict, init=False)
    """Positions at the last sample [m]."""
    _t: float = field(default=0.0, init=False)

    def prepare(self, agent: ControlledAgent) -> None:
        """Compile the filter. Raises ValueError if cbfpy is lacking or the agent does not fit."""
        with warnings.catch_warnings(action="ignore"):  # of settings, and of h at a trial state
            try:
                jax = import_module("phalanx.baselines.cbfpy_pairs")
            except ImportError as error:
                raise ValueError("cbfpy is not here: pip install 'phalanx-swarm[cbfpy]'") from error
            pairs = jax.pairs_of(agent)
            self._filter, self._axes = jax.compiled(pairs), pairs.axes
        self._second = pairs.second
        self._others = [l for l in range(len(agent.members)) if l != agent.i]
        self._static = [each.center for each in agent.static if isinstance(each, Sphere)]

    def input(self, view: ControllerView) -> Array:
        """Return the input of cbfpy's QP."""
        points = np.full((len(self._others) + len(self._static), self._axes), _FAR)
        points[len(self._others) :] = self._static or points[:0]
        speeds = np.zeros_like(points)
        for k, l in enumerate(self._others):
            if l in view.x:
                points[k], speeds[k] = view.positions[l], self._velocity(view, l)
        self._before, self._t = dict(view.positions), view.t
        z = np.concatenate([view.x[view.i], points.ravel(), speeds.ravel()])
        return np.array(self._filter(z, view.nearest(view.u_nom)))

    def _velocity(self, view: ControllerView, l: int) -> Array:
        """Another's velocity, sampled, or from its last two positions [m/s]."""
        if self._second:
            return view.x[l][self._axes :]
        elapsed, here = view.t - self._t, view.positions[l]
        return (here - self._before.get(l, here)) / elapsed if elapsed > 0.0 else 0.0 * here

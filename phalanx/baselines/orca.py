"""`orca`: optimal reciprocal collision avoidance in the plane, by the library RVO2 (pyrvo).

van den Berg, Guy, Lin and Manocha, *Reciprocal n-Body Collision Avoidance* (2011). Every agent in
sight is taken to avoid collisions too. Velocities are those between an agent's last two samples.
"""

import math
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot, length, solve
from phalanx.theory.laws.law import ControlledAgent, ControllerView
from phalanx.theory.laws.tracking import output_chain
from phalanx.theory.safety.obstacles import Sphere

_CORNERS = 16
"""Of the polygon around a round obstacle."""


@dataclass
class Orca:
    """The velocity that RVO2 finds, as an input."""

    horizon: float = 2.0
    """Time for which collisions are avoided [s]."""
    _before: dict[int, Array] = field(default_factory=dict, init=False)
    """Positions at the last sample [m]."""
    _t: float = field(default=0.0, init=False)

    def prepare(self, agent: ControlledAgent) -> None:
        """Compile the velocity of the position. Raises ValueError if the agent does not fit."""
        try:
            self._rvo = import_module("pyrvo")
        except ImportError as error:
            raise ValueError("orca is not here: pip install 'phalanx-swarm[orca]'") from error
        x, (_, drift, *more), gain = output_chain(agent.dynamics)
        if more or gain.shape != (2, 2):
            raise ValueError("orca needs a planar agent whose two inputs set its velocity")
        self._motion = CompiledFunction([x], [drift, ca.densify(gain)])
        apart = getattr(agent.function, "radius", None)
        if apart is None or not all(isinstance(each, Sphere) for each in agent.static):
            raise ValueError("orca needs safety.function 'separation' and round obstacles")
        self._radius, self._period = 0.5 * float(apart), agent.period
        self._around = [_polygon(each, self._radius) for each in agent.static]

    def input(self, view: ControllerView) -> Array:
        """Return the input with the velocity that RVO2 finds for the nominal one."""
        points, elapsed = dict(view.positions), view.t - self._t
        drift, gain = (value.reshape(2, -1) for value in self._motion(view.x[view.i]))
        fastest = float(length(dot(view.inputs.corners[:, None], gain)).max())
        scene = self._scene(fastest)
        for l in (view.i, *[l for l in view.x if l != view.i]):
            moved = points[l] - self._before.get(l, points[l])
            velocity = moved / elapsed if elapsed > 0.0 else 0.0 * moved
            scene.set_agent_velocity(scene.add_agent(points[l].tolist()), velocity.tolist())
        wanted = drift[:, 0] + dot(gain, view.u_nom)
        scene.set_agent_pref_velocity(0, wanted.tolist())
        scene.do_step()
        self._before, self._t = points, view.t
        found = scene.get_agent_velocity(0)
        inputs, _ = solve(gain[None], np.array([[found.x, found.y]]) - drift[:, 0])
        return inputs.reshape(2)

    def _scene(self, fastest: float) -> Any:
        """A simulator with the obstacles alone; fastest: largest speed [m/s]."""
        near, most = 1e3, 1000
        horizons = self.horizon, self.horizon
        rvo = self._rvo.RVOSimulator(self._period, near, most, *horizons, self._radius, fastest)
        for polygon in self._around:
            rvo.add_obstacle(polygon)
        rvo.process_obstacles()
        return rvo


def _polygon(sphere: Any, radius: float) -> list[list[float]]:
    """Corners around a round obstacle, less the agent's radius, counterclockwise [m]."""
    size = max(sphere.clearance - radius, 1e-3) / math.cos(math.pi / _CORNERS)
    angles = [2.0 * math.pi * k / _CORNERS for k in range(_CORNERS)]
    x, y = sphere.center
    return [[x + size * math.cos(a), y + size * math.sin(a)] for a in angles]

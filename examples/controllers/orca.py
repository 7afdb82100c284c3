"""A controller: optimal reciprocal collision avoidance in the plane, by the library RVO2.

pip install pyrvo; in this folder:
phalanx run unicycles --set agents.0.controller.type=orca:Orca

van den Berg, Guy, Lin and Manocha, *Reciprocal n-Body Collision Avoidance* (2011). Every agent in
sight is taken to avoid collisions too. Velocities are those between an agent's last two samples.
"""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from pyrvo import RVOSimulator

from phalanx.extend import CompiledFunction, Sphere

CORNERS = 16
"""Of the polygon around a round obstacle."""


@dataclass
class Orca:
    """The velocity that RVO2 finds, as an input."""

    horizon: float = 2.0
    """Time for which collisions are avoided [s]."""

    def prepare(self, agent):
        """Compile the velocity of the position. Raises ValueError if the agent does not fit."""
        x, dynamics = ca.SX.sym("x", len(agent.dynamics.states)), agent.dynamics
        jacobian = ca.jacobian(dynamics.position(x), x)
        gain = ca.sparsify(ca.simplify(jacobian @ dynamics.actuation(x)))
        if gain.shape != (2, 2) or ca.sprank(gain) < 2:
            raise ValueError("orca needs a planar agent whose two inputs set its velocity")
        self.motion = CompiledFunction([x], [jacobian @ dynamics.drift(x), ca.densify(gain)])
        distance = getattr(agent.function, "radius", None)
        if distance is None or not all(isinstance(each, Sphere) for each in agent.static):
            raise ValueError("orca needs safety.function 'separation' and round obstacles")
        self.radius, self.period = 0.5 * distance, agent.period
        self.around = [polygon(each, self.radius) for each in agent.static]
        self.before, self.t = {}, 0.0

    def input(self, view):
        """Return the input with the velocity that RVO2 finds for the nominal one."""
        points, elapsed = dict(view.positions), view.t - self.t
        drift, gain = (value.reshape(2, -1) for value in self.motion(view.x[view.i]))
        scene = self.scene(fastest=np.linalg.norm(gain @ view.inputs.corners.T, axis=0).max())
        for l in (view.i, *[l for l in view.x if l != view.i]):
            moved = points[l] - self.before.get(l, points[l])
            velocity = moved / elapsed if elapsed > 0.0 else 0.0 * moved
            scene.set_agent_velocity(scene.add_agent(points[l].tolist()), velocity.tolist())
        scene.set_agent_pref_velocity(0, (drift[:, 0] + gain @ view.u_nom).tolist())
        scene.do_step()
        self.before, self.t = points, view.t
        choice = scene.get_agent_velocity(0)
        return np.linalg.solve(gain, np.array([choice.x, choice.y]) - drift[:, 0])

    def scene(self, fastest):
        """Return a simulator with the obstacles alone; fastest: largest speed [m/s]."""
        near, most = 1e3, 1000
        scene = RVOSimulator(
            self.period, near, most, self.horizon, self.horizon, self.radius, float(fastest)
        )
        for obstacle in self.around:
            scene.add_obstacle(obstacle)
        scene.process_obstacles()
        return scene


def polygon(sphere, radius):
    """Return corners around a round obstacle, less the agent's radius, counterclockwise [m]."""
    size = max(sphere.clearance - radius, 1e-3) / math.cos(math.pi / CORNERS)
    angles = 2.0 * math.pi * np.arange(CORNERS) / CORNERS
    return (
        np.array(sphere.center) + size * np.column_stack([np.cos(angles), np.sin(angles)])
    ).tolist()

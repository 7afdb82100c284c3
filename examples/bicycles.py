"""Use dynamics of your own: two bicycles pass each other while a third chases them.

python examples/bicycles.py
"""

from dataclasses import dataclass

import casadi as ca

import phalanx
from phalanx.extend import box_polytope


@dataclass(frozen=True)
class Bicycle:
    """(x, y) the rear axle, x' = v cos θ, y' = v sin θ, θ' = v s / wheelbase, v' = a.

    The inputs are a and s, the tangent of the steering angle, in which the dynamics are affine.
    Both act on the axle's acceleration, so q = 2; at standstill steering has no effect.
    """

    acceleration: float = 2.0  # bound on a [m/s²]
    steering: float = 0.7  # bound on s
    wheelbase: float = 0.5  # m
    states = ("x", "y", "theta", "v")
    inputs = ("a", "s")
    state_units = ("m", "m", "rad", "m/s")

    def drift(self, x):
        return ca.vertcat(x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), 0, 0)

    def actuation(self, x):
        g = ca.SX(4, 2)
        g[2, 1], g[3, 0] = x[3] / self.wheelbase, 1
        return g

    def position(self, x):
        return x[:2]

    def input_polytope(self, x):
        return box_polytope((self.acceleration, self.steering))

    def input_metric(self):
        return (1.0, 1.0)  # weights of both inputs in ‖u - u_nom‖²


if __name__ == "__main__":  # this file is imported for its dynamics, and must not run again then
    common = {"dynamics": {"type": "bicycles:Bicycle"}, "clock": {"period": 0.02}}
    normal = {**common, "role": "normal", "law": {"type": "track", "gains": [1.0, 2.0]}}
    chase = {"role": "adversary", "law": {"type": "chase", "gains": [1.0, 2.0]}}
    separation = {"type": "separation", "radius": 1.0}
    agents = [
        {**normal, "names": ["east"], "start": [[-4.0, 0.2, 0.0, 1.0]], "goal": [[4.0, 0.2]]},
        {**normal, "names": ["west"], "start": [[4.0, -0.2, 3.1, 1.0]], "goal": [[-4.0, -0.2]]},
        {**common, **chase, "names": ["rider"], "start": [[0.0, -6.0, 1.6, 1.0]]},
    ]
    safety = {"function": separation, "rho": 5.0, "alpha": [2.0, 4.0], "margin": "integrated"}
    run = phalanx.run({"name": "bicycles", "duration": 5.0, "safety": safety, "agents": agents})
    print(run.verdict, f"- largest h {run.summary.worst_h:.3f}, safe is at most 0")

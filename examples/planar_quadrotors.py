"""Use dynamics of your own with q = 3: two quadrotors in a vertical plane swap heights.

python examples/planar_quadrotors.py
"""

from dataclasses import dataclass

import casadi as ca

import phalanx
from phalanx.extend import box_polytope

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class PlanarQuadrotor:
    """x horizontal, z up; the specific thrust g + c points to the pitch θ; zero inputs hover.

    An autopilot follows the inputs, a thrust and a pitch, with lags of first order: hence q = 3.
    """

    thrust: float = 4.0  # bound on the commanded c [m/s²]
    tilt: float = 0.5  # bound on the commanded θ [rad]
    thrust_lag: float = 0.1  # s
    tilt_lag: float = 0.15  # s
    states = ("x", "z", "vx", "vz", "c", "theta")
    inputs = ("c", "theta")
    state_units = ("m", "m", "m/s", "m/s", "m/s²", "rad")

    def drift(self, x):
        c, theta = x[4], x[5]
        lift = (GRAVITY + c) * ca.vertcat(ca.sin(theta), ca.cos(theta)) - ca.vertcat(0, GRAVITY)
        return ca.vertcat(x[2:4], lift, -c / self.thrust_lag, -theta / self.tilt_lag)

    def actuation(self, x):
        return ca.vertcat(ca.SX(4, 2), ca.diag(ca.SX([1 / self.thrust_lag, 1 / self.tilt_lag])))

    def position(self, x):
        return x[:2]

    def input_polytope(self, x):
        return box_polytope((self.thrust, self.tilt))

    def input_metric(self):
        return (1.0, GRAVITY**2)  # near hover a pitch of θ accelerates by g θ


if __name__ == "__main__":  # this file is imported for its dynamics, and must not run again then
    common = {"role": "normal", "dynamics": {"type": "planar_quadrotors:PlanarQuadrotor"}}
    common |= {"law": {"type": "track", "gains": [4.0, 6.0, 2.0]}, "clock": {"period": 0.02}}
    agents = [
        {**common, "names": ["low"], "start": [[0.0] * 6], "goal": [[0.0, 4.0]]},
        {**common, "names": ["high"], "start": [[0.3, 4.0, *[0.0] * 4]], "goal": [[0.3, 0.0]]},
    ]
    safety = {"function": {"type": "separation", "radius": 1.0}, "rho": 5.0}
    safety |= {"alpha": [3.0, 6.0, 15.0], "margin": "integrated"}
    run = phalanx.run({"name": "swap", "duration": 3.0, "safety": safety, "agents": agents})
    print(run.verdict, f"- largest h {run.summary.worst_h:.3f}, safe is at most 0")

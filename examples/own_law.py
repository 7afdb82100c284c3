"""Use a nominal law of your own: two agents circle a point at different speeds, kept apart.

python examples/own_law.py
"""

from dataclasses import dataclass

import numpy as np

import phalanx


@dataclass
class Circle:
    """Fly around the origin at a given speed, without regard to collisions."""

    speed: float = 1.0
    """[m/s]"""

    def prepare(self, dynamics):
        """Check the dynamics before the first input. Raises ValueError if the law does not fit."""
        if len(dynamics.inputs) != 2:
            raise ValueError("Circle: expected an agent in the plane, with two inputs")

    def input(self, view):
        """Return the nominal velocity [m/s]."""
        x, y = view.positions[view.i]
        return self.speed * np.array([-y, x]) / max(np.hypot(x, y), 1e-9)


def agent(name, start, speed):
    """One agent's table; its law is named as module:Class, so that every process finds it."""
    return {
        "names": [name],
        "role": "normal",
        "start": [start],
        "dynamics": {"type": "single-integrator", "speed": 2.0},
        "law": {"type": "own_law:Circle", "speed": speed},
        "clock": {"period": 0.01},
    }


if __name__ == "__main__":  # this file is imported for its law, and must not run again then
    separation = {"type": "separation", "radius": 1.0}
    safety = {"function": separation, "rho": 5.0, "alpha": [5.0], "eta": 0.5}
    scenario = phalanx.load(
        {
            "name": "roundabout",
            "duration": 8.0,
            "safety": safety,
            "agents": [agent("slow", [3.0, 0.0], 0.5), agent("fast", [0.0, -3.0], 1.5)],
        }
    )
    run = phalanx.run(scenario)
    print(run.verdict, f"- largest h {run.h['slow-fast'].max():.3f}, safe is at most 0")

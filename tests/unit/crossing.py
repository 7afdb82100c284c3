"""Two agents that pass each other: a swarm whose run takes a tenth of a second."""

from typing import Any

from phalanx_testing import CheckedRun, run

CROSSING: dict[str, Any] = {
    "name": "crossing-pair",
    "duration": 3.0,
    "safety": {
        "function": {"type": "separation", "radius": 1.0},
        "rho": 5.0,
        "alpha": [3.0],
        "margin": "integrated",
        "information": "paper",
    },
    "agents": [
        {
            "names": ["a", "b"],
            "role": "normal",
            "dynamics": {"type": "single-integrator", "speed": 2.0},
            "law": {"type": "track-velocity", "gain": 2.0},
            "clock": {"period": 0.02},
            "start": [[-1.5, 0.1], [1.5, -0.1]],
            "goal": [[1.5, 0.1], [-1.5, -0.1]],
        }
    ],
}
UNFILTERED = {"agents.0.controller": {"type": "none"}}
"""They do not avoid each other."""


def crossed(**conditions: Any) -> CheckedRun:
    return run(CROSSING, **conditions)

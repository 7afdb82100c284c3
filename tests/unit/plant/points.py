"""Points in the plane that keep a metre apart: small scenarios of the plant's tests."""

from typing import Any

POINTS: dict[str, Any] = {
    "name": "points",
    "duration": 1.0,
    "safety": {
        "function": {"type": "separation", "radius": 1.0},
        "rho": 5.0,
        "alpha": [1.0],
        "eta": 0.0,
    },
}


def group(
    names: str, role: str, starts: list[list[float]], law: str, speed: float = 2.0
) -> dict[str, Any]:
    """Return a group of points that can move in all directions."""
    return {
        "names": names.split(),
        "role": role,
        "dynamics": {"type": "single-integrator", "speed": speed},
        "law": {"type": law},
        "clock": {"period": 0.01},
        "start": starts,
    }

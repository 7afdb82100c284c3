"""A robot's own program that knows its peers by radio: to the goal, keeping right of others.

phalanx run radio --set 'agents.0.program=["python", "examples/programs/robot.py"]' \
    --set agents.0.filter=true
"""

import json
import math
import sys
from typing import Any

NEAR, GAIN, DAMPING, SPEED, PUSH = 4.0, 1.0, 4.0, 3.0, 2.0  # m, 1/s, 1/s, m/s, m/s


def acceleration(sample: dict[str, Any]) -> list[float]:
    """Return the acceleration that brings the robot to its goal and right of those near [m/s²]."""
    (px, py, vx, vy), (gx, gy) = sample["x"], sample["goal"]["position"]
    wx, wy = GAIN * (gx - px), GAIN * (gy - py)
    share = SPEED / max(math.sqrt(wx * wx + wy * wy), SPEED)
    wx, wy = wx * share, wy * share
    for peer in sample["peers"].values():
        dx, dy = peer["x"][0] - px, peer["x"][1] - py
        distance = math.sqrt(dx * dx + dy * dy)
        if 0.0 < distance < NEAR:
            push = PUSH * (1.0 - distance / NEAR) / distance
            wx, wy = wx + push * (dy - dx), wy - push * (dx + dy)
    return [DAMPING * (wx - vx), DAMPING * (wy - vy)]


def main() -> None:
    """Answer until there are no more samples."""
    for line in sys.stdin:
        print(json.dumps({"u": acceleration(json.loads(line))}), flush=True)


if __name__ == "__main__":
    main()

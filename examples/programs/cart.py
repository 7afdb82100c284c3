"""A cart's own program: a line of JSON for each sample comes in, a line with the input goes out.

phalanx run warehouse --set 'agents.0.program=["python", "examples/programs/cart.py"]' \
    --set agents.0.filter=true
"""

import json
import math
import sys

RADIUS, TRACK, OFFSET = 0.1, 0.5, 0.25  # of the wheels, between them, of the point ahead [m]


def wheels(x: list[float], goal: dict[str, list[float]]) -> list[float]:
    """Return the rates of both wheels [rad/s] that bring the point ahead to its goal."""
    ahead, aside = math.cos(x[2]), math.sin(x[2])
    point = x[0] + OFFSET * ahead, x[1] + OFFSET * aside
    towards = goal["position"][0] - point[0], goal["position"][1] - point[1]
    velocity = goal["velocity"][0] + towards[0], goal["velocity"][1] + towards[1]
    forward = ahead * velocity[0] + aside * velocity[1]
    turn = (ahead * velocity[1] - aside * velocity[0]) / OFFSET
    return [(forward - turn * TRACK / 2) / RADIUS, (forward + turn * TRACK / 2) / RADIUS]


def main() -> None:
    """Answer until there are no more samples."""
    for line in sys.stdin:
        sample = json.loads(line)
        print(json.dumps({"u": wheels(sample["x"], sample["goal"])}), flush=True)


if __name__ == "__main__":
    main()

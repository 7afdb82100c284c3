"""The moving picture of the README: a swarm that loses three of ten broadcasts.

python evidence/network/moving_picture.py
"""

from pathlib import Path

import phalanx

PICTURE = Path("docs/images/swarm.webp")
CHANGES = {
    "agents.0.count": 28,
    "agents.1.count": 4,
    "flows.room": 40.0,
    "network.loss": 0.3,
    "duration": 20.0,
}


def main() -> None:
    """Run, draw, and print the verdict and the picture's size."""
    run = phalanx.run(phalanx.load("swarm2d", CHANGES), engine="in-process")
    run.animate(PICTURE, speed=2.0, per_second=10)
    print(run.verdict, f"{PICTURE.stat().st_size / 2**20:.2f} MiB")


if __name__ == "__main__":
    main()

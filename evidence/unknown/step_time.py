"""CPU time of a control step without roles, and with a proof of its input, next to `split`.

python evidence/unknown/step_time.py
"""

import time
from collections.abc import Mapping

import numpy as np
from phalanx_agent.controller import DistributedController

import phalanx
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array

VARIANTS: Mapping[str, Mapping[str, object]] = {
    "split": {"safety.information": "split"},
    "unknown": {"safety.information": "unknown"},
    "split, prove": {"safety.information": "split", "safety.prove": True},
    "unknown, prove": {"safety.information": "unknown", "safety.prove": True},
}
ROUNDS = 5


def main() -> None:
    """Print the median time and the median ratio of rounds taken in turns."""
    print("| scenario | " + " | ".join(f"{name} [µs]" for name in VARIANTS) + " |")
    print("|---" * (1 + len(VARIANTS)) + "|")
    for scenario in ("guaranteed", "formation3d-distance", "swarm2d"):
        run = phalanx.run(phalanx.load(scenario, {"duration": 3.0}), engine="in-process")
        states = run.states.drop("run", "scenario", "seed", "t").to_numpy()
        states = states[:, : build_swarm(run.scenario).pairs.states]
        rounds: Array = np.array(turns(scenario, states[:: max(1, len(states) // 200)][:200]))
        ratios = np.median(rounds / rounds[:, :1], axis=0)
        cells = zip(np.median(rounds, axis=0), ratios, strict=True)
        print(f"| {scenario} | " + " | ".join(f"{t:.0f} ({r:.2f})" for t, r in cells) + " |")


def turns(scenario: str, states: Array) -> list[list[float]]:
    """Return the mean time of a step of agent 1 in each round, by variant [µs]."""
    built = [build_rows(build_swarm(phalanx.load(scenario, v))) for v in VARIANTS.values()]
    rounds = []
    for _ in range(ROUNDS + 1):
        row = []
        for rows in built:
            swarm, controller = rows.swarm, DistributedController(rows, 0)
            neighbours = [swarm.seen(0, x) for x in states]
            controller(states[0], neighbours[0], 0.0, {})
            begun = time.process_time()
            for k, x in enumerate(states):
                controller(x, neighbours[k], swarm.groups[0].clock.period * k, {})
            row.append(1e6 * (time.process_time() - begun) / len(states))
        rounds.append(row)
    return rounds[1:]


if __name__ == "__main__":
    main()

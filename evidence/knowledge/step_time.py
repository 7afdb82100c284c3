"""CPU time of a control step by radio, next to that of agents who see as many peers.

    python -m evidence.knowledge.step_time

Eight agents are those of `radio`; 64 stand in a square, 4 m apart, and want to its opposite side.
"""

import time
from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

import phalanx
from phalanx.launcher.simulation import Simulation
from phalanx.messages.kinds import Sample
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array

PLACES = [[4.0 * x - 14.0, 4.0 * y - 14.0] for x, y in product(range(8), repeat=2)]
SWARMS: Mapping[int, Mapping[str, Any]] = {
    8: {"duration": 6.0},
    64: {
        "duration": 1.0,
        "agents.0.count": len(PLACES),
        "agents.0.start": [[*place, 0.0, 0.0] for place in PLACES],
        "agents.0.goal": [[-x, -y] for x, y in PLACES],
    },
}
RADIO = {"every": 10, "relays": 7}
KINDS: Mapping[str, Mapping[str, Any] | None] = {
    "own sensors, halves": None,
    "radio, carried on, halves": {**RADIO, "belief": "carried-on", "rows": "halves"},
    "radio, sets, own parts": RADIO,
}
ROUNDS = 2


def main() -> None:
    """Print the median time of a step, and its ratio to that with own sensors."""
    print("| agents | " + " | ".join(f"{kind} [ms]" for kind in KINDS) + " |")
    print("|---" * (1 + len(KINDS)) + "|")
    for size, settings in SWARMS.items():
        rounds = [[step_time(settings, radio) for radio in KINDS.values()] for _ in range(ROUNDS)]
        times: Array = np.min(rounds, axis=0)
        cells = (f"{time:.2f} ({time / times[0]:.1f})" for time in times)
        print(f"| {size} | {' | '.join(cells)} |", flush=True)


def step_time(settings: Mapping[str, Any], radio: Mapping[str, Any] | None) -> float:
    """Return the median CPU time of a control step in a run without partition [ms]."""
    scenario = phalanx.load("radio", {**settings, "faults": [], "agents.0.radio": radio})
    run, times = Simulation(require_runnable(build_swarm(scenario))), list[float]()
    answer = run.agents.send_sample

    def timed(i: int, sample: Sample) -> None:
        begun = time.thread_time()
        answer(i, sample)
        times.append(1e3 * (time.thread_time() - begun))

    run.agents.send_sample = timed  # type: ignore[method-assign]
    run.run()
    return float(np.median(times))


if __name__ == "__main__":
    main()

"""Train an attacker for some minutes, and compare it to attacks that ship.

pip install pettingzoo cmaes; python examples/pettingzoo_env/train_attacker.py [GENERATIONS]
"""

import sys
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from cmaes import CMA
from swarm_env import SwarmEnv

import phalanx

FAST = {"type": "unicycle", "speed": 4.0, "turn_rate": 2.0, "offset": 0.25}
STEER = {"type": "track-velocity", "gain": 1.0}
NORMAL = {"names": ["1"], "role": "normal", "dynamics": FAST, "law": STEER, "slots": [0]}
SLOW = {**FAST, "speed": 2.0, "turn_rate": 1.0}
ATTACKER = {"names": ["2"], "role": "adversary", "dynamics": SLOW, "start": [[8.5, 2.5, -0.5]]}
BOTH = {"clock": {"period": 0.02}, "disturbance": {"bound": 0.5}, "spread": [0.2, 0.2, 0.3]}
CHASE, WORST = {"type": "chase", "gains": [5.0]}, {"type": "worst"}


def settings(attack):
    agents = [{**NORMAL, **BOTH}, {**ATTACKER, **BOTH, "law": attack}]
    return {"agents": agents, "safety.eta": 0.0, "duration": 3.0}


def action(weights, seen):
    """Return a linear function of where the target is and heads, seen from the attacker."""
    (x, y, heading), (own_x, own_y, own) = seen[:3], seen[3:]
    apart = (x - own_x + 1j * (y - own_y)) * np.exp(-1j * own) / 5.0
    features = [apart.real, apart.imag, np.cos(heading - own), np.sin(heading - own), 1.0]
    return np.clip(weights.reshape(2, 5) @ features, [-2.0, -1.0], [2.0, 1.0])


def trained(weights, seeds=range(2)):
    """Return the largest h of an episode for each seed; above 0 is unsafe."""
    env, largest = SwarmEnv("unicycles", overrides=settings(WORST)), []
    for seed in seeds:
        observations, infos = env.reset(seed=seed)
        while env.agents:
            observations, *_, infos = env.step({"2": action(weights, observations["2"])})
        largest.append(infos["2"]["peak"])
    return largest


if __name__ == "__main__":
    ahead = np.array([0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 5.0, 0.0, 0.0, 0.0])  # towards the target
    search, fresh = CMA(mean=ahead, sigma=1.0, seed=1, population_size=8), range(100, 110)
    with ProcessPoolExecutor() as pool:
        for _ in range(int(sys.argv[1]) if sys.argv[1:] else 16):
            xs = [search.ask() for _ in range(search.population_size)]
            search.tell([(x, -np.mean(h)) for x, h in zip(xs, pool.map(trained, xs), strict=True)])
    largest_of = {"trained": trained(search.mean, fresh)}
    for name, law in (("chase", CHASE), ("worst", WORST)):
        scenarios = (phalanx.load("unicycles", settings(law), seed) for seed in fresh)
        runs = (phalanx.run(scenario, engine="in-process") for scenario in scenarios)
        largest_of[name] = [run.h["1-2"].max() for run in runs]
    print(
        *(f"{n}: largest h {np.mean(h):.2f} in the mean" for n, h in largest_of.items()), sep="\n"
    )

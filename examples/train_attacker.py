"""Train an attacker for about a minute, and compare it to attacks that ship.

pip install 'phalanx-swarm[pettingzoo]' cmaes; python examples/train_attacker.py [GENERATIONS]
"""

import sys
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from cmaes import CMA

import phalanx

FAST = {"type": "unicycle", "speed": 4.0, "turn_rate": 2.0, "offset": 0.25}
STEER = {"type": "track-velocity", "gain": 1.0}
NORMAL = {"names": ["1"], "role": "normal", "dynamics": FAST, "law": STEER, "slots": [0]}
SLOW = {**FAST, "speed": 2.0, "turn_rate": 1.0}
ATTACKER = {"names": ["2"], "role": "adversary", "dynamics": SLOW, "start": [[8.5, 2.5, -0.5]]}
BOTH = {"clock": {"period": 0.02}, "disturbance": {"bound": 0.5}, "spread": [0.2, 0.2, 0.3]}
CHASE, WORST = {"type": "chase", "gains": [5.0]}, {"type": "worst"}


def scenario(attack, seed=0):
    agents = [{**NORMAL, **BOTH}, {**ATTACKER, **BOTH, "law": attack}]
    return phalanx.load("unicycles", {"agents": agents, "safety.eta": 0.0, "duration": 3.0}, seed)


def action(weights, seen):
    """Return a linear function of where the target is and heads, seen from the attacker."""
    (x, y, heading), (own_x, own_y, own) = seen[:3], seen[3:6]
    apart = (x - own_x + 1j * (y - own_y)) * np.exp(-1j * own) / 5.0
    features = [apart.real, apart.imag, np.cos(heading - own), np.sin(heading - own), 1.0]
    return np.clip(weights.reshape(2, 5) @ features, [-2.0, -1.0], [2.0, 1.0])


def trained(weights, seeds=range(2)):
    """Return the largest h of an episode for each seed; above 0 is unsafe."""
    env, largest = phalanx.parallel_env(scenario(WORST), every=0.1), []
    for seed in seeds:
        (seen, infos), rewards = env.reset(seed=seed), [0.0]
        while env.agents:
            seen, reward, *_ = env.step({"2": action(weights, seen["2"])})
            rewards.append(reward["2"])
        largest.append(infos["2"]["h"] + sum(rewards))
    return largest


if __name__ == "__main__":
    ahead = np.array([0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 5.0, 0.0, 0.0, 0.0])  # towards the target
    search, fresh = CMA(mean=ahead, sigma=1.0, seed=1, population_size=8), range(100, 110)
    with ProcessPoolExecutor() as pool:
        for _ in range(int(sys.argv[1]) if sys.argv[1:] else 16):
            xs = [search.ask() for _ in range(search.population_size)]
            search.tell([(x, -np.mean(h)) for x, h in zip(xs, pool.map(trained, xs), strict=True)])
    found = {"trained": trained(search.mean, fresh)}
    for name, law in (("chase", CHASE), ("worst", WORST)):
        runs = (phalanx.run(scenario(law, seed), engine="in-process") for seed in fresh)
        found[name] = [run.h["1-2"].max() for run in runs]
    print(*(f"{n}: largest h {np.mean(h):.2f} in the mean" for n, h in found.items()), sep="\n")

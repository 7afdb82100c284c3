"""Explain inputs at random samples of shipped scenarios, and try what is advised.

    python -m evidence.explanation.states [STATES]

Samples are drawn among those of normal agents that a row keeps from the wish. Counted are rows
whose terms do not add up to what lies between wish and input to 1e-9 of their largest term, and
changes, of all fields, that do not free the agent, or do so with 5 % less of the change. Then
CONFLICTS programs that no input keeps: how often the least conflict is not that which trying every
subset finds.
"""

import argparse
from collections.abc import Iterator
from itertools import chain, combinations

import numpy as np
from phalanx_agent.step import ControlStep
from phalanx_explain.advice import FIELDS, changes, frees, least_change
from phalanx_explain.conflict import least_conflict
from phalanx_explain.costs import RowCost, row_costs
from phalanx_explain.repetition import ControllerSteps
from rich.progress import track

from phalanx.launcher.simulation import Simulation
from phalanx.network.draws import Draws
from phalanx.scenario.load import load
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.polytope import polytope
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows

SCENARIOS = {
    "crossing": 8.0, "swarm2d": 12.0, "unknown": 4.0, "fence": 12.0, "radio": 8.0,
    "evidence/explanation/swap.toml": 5.0, "evidence/explanation/drives.toml": 10.0,
    "evidence/explanation/lagged.toml": 6.0,
}  # fmt: skip
"""Scenarios, some in which robots wait, and until when samples are drawn [s]."""
MOST_DRAWN = 2000
"""Samples drawn until enough are found that a row holds back."""
CONFLICTS = 1000


def main() -> None:
    """Print both tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("states", type=int, nargs="?", default=200)
    states = arguments.parse_args().states
    share = -(-states // len(SCENARIOS))
    print("| scenario | samples | rows | wrong sums | changes | do not free | too large |")
    print("|---|---|---|---|---|---|---|")
    for name, until in SCENARIOS.items():
        counts = np.zeros(5, dtype=int)
        for steps in track(held_back(name, until, share), description=name, total=share):
            counts += of_sample(steps)
        print(f"| `{name}` | {share} | {' | '.join(map(str, counts))} |", flush=True)
    print(f"\nleast conflicts: {wrong_conflicts()} of {CONFLICTS} differ from trying every subset")


def held_back(name: str, until: float, count: int) -> Iterator[ControllerSteps]:
    """Yield random control steps whose wish some row keeps from being applied."""
    scenario = load(name, {"duration": until})
    rows = require_runnable(build_swarm(scenario))
    run, agents = Simulation(rows), [ControllerSteps(rows, i) for i in rows.swarm.normal]
    for agent in agents:
        run.agents.steps[agent.i] = ControlStep(rows, agent.i, agent)
    run.run()
    draws = Draws(scenario.seed, "explained", scenario.name, width=2)
    for number in range(MOST_DRAWN):
        of_agent, of_step = draws[number]
        agent = agents[int(of_agent * len(agents))]
        alone = ControllerSteps(rows, agent.i)
        alone(*agent.steps[int(of_step * len(agent.steps))])
        assert alone.result is not None
        held = not np.array_equal(alone.result.decision.u, alone.wish)
        if held and any(row.binds for row in row_costs(alone)):
            yield alone
            count -= 1
        if not count:
            return


def of_sample(steps: ControllerSteps) -> np.ndarray:
    """Return counts: rows, those that do not add up, changes, that do not free, are too large."""
    # The last term of an own part is what the others leave: its sum is no check.
    rows = [row for row in row_costs(steps) if row.a is not None]
    assert steps.result is not None
    difference = steps.wish - steps.result.decision.u
    wrong = sum(not adds_up(row, difference) for row in rows)
    scenario = steps.rows.swarm.scenario
    advised = [(field, change) for field in FIELDS if (change := least_change(steps, field))]
    idle = sum(not frees(steps, change.overrides) for _, change in advised)
    # A whole number of samples between two broadcasts has no 5 % less.
    parts = [(f, c) for f, c in advised if not f.path.endswith("every")]
    large = sum(frees(steps, changes(scenario, f, 0.95 * c.share)) for f, c in parts)
    return np.array([len(rows), wrong, len(advised), idle, large])


def adds_up(row: RowCost, difference: np.ndarray) -> bool:
    """True if a row's terms and what the input leaves of it are a (wish - input)."""
    assert row.a is not None
    scale = max(1.0, *map(abs, row.terms.values()))
    return abs(sum(row.terms.values()) + row.slack - float(row.a @ difference)) <= 1e-9 * scale


def wrong_conflicts() -> int:
    """Count programs whose least conflict is not the one that trying every subset finds."""
    rng, wrong, tried = np.random.default_rng(0), 0, 0
    while tried < CONFLICTS:
        axes, count = int(rng.integers(1, 4)), int(rng.integers(2, 8))
        inputs = polytope(np.vstack([np.eye(axes), -np.eye(axes)]), np.ones(2 * axes))
        rows = Rows(rng.normal(size=(count, axes)), rng.uniform(-1.5, 0.5, count))
        solver = NearestInput((1.0,) * axes)
        subsets = chain.from_iterable(combinations(range(count), k) for k in range(1, count + 1))
        first = next(
            (
                s
                for s in subsets
                if solver.solve(np.zeros(axes), inputs, Rows(rows.a[list(s)], rows.bound[list(s)]))
                is None
            ),
            None,
        )
        if first is not None:
            tried, wrong = tried + 1, wrong + (least_conflict(inputs, rows) != first)
    return wrong


if __name__ == "__main__":
    main()

"""kill -9 and restart of each agent of `unicycles`, at many instants: what the run makes of it.

python evidence/network/restarts.py
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

import phalanx
from phalanx.launcher.engine import DEFAULT_ENGINE, ENGINES
from phalanx.recording.records import Step

AGENTS = ("1", "2", "3", "4", "5")
DOWN = 0.3
"""How long an agent is dead each time [s]."""
INFORMATION = "in-flight"


class Line(NamedTuple):
    """One run, in which one agent is killed again and again."""

    agent: str
    kills: int
    joined: int
    """How often it samples as soon as it was started again."""
    relied: int
    """Steps of others that counted on an input of the dead when a newer one might be in force."""
    at_worst: int
    """Steps of others, meanwhile, that counted it at its worst."""
    worst: float
    """Largest h_tot."""
    verdict: str


def main() -> None:
    """Run, and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--instants", type=int, default=20)
    arguments.add_argument("--agents", nargs="*", default=AGENTS)
    arguments.add_argument("--engine", choices=ENGINES, default=DEFAULT_ENGINE)
    options = arguments.parse_args()
    print("| agent | killed | joined again | on its input | at its worst | worst h_tot | verdict |")
    print("|---|---|---|---|---|---|---|")
    for agent in options.agents:
        result = line(agent, options.instants, options.engine)
        cells = (f"{cell:.3f}" if isinstance(cell, float) else str(cell) for cell in result)
        print(f"| {' | '.join(cells)} |", flush=True)


def line(agent: str, instants: int, engine: str) -> Line:
    """Kill one agent at so many instants of the whole run, each time for a while."""
    duration = phalanx.load("unicycles").duration
    # Not in step with any clock: everywhere between two samples.
    times = (np.arange(instants) + 0.5 / np.sqrt(2.0)) * (duration / instants)
    kills = [{"kind": "restart", "at": t, "for": DOWN, "agents": [agent]} for t in times.tolist()]
    overrides = {"safety.information": INFORMATION, "faults": kills}
    run = phalanx.run(phalanx.load("unicycles", overrides), engine=engine)
    summary = run.summary
    assert summary is not None
    steps = run.recording.steps
    step_times = {step.t for step in steps if step.agent == agent}
    meanwhile = [s for s in others(run, agent) if any(t < s.t < t + DOWN for t in times)]
    failed = {a.name: a.failed for a in (*summary.assumptions, *summary.theorem) if a.failed}
    assumptions = ("sampling gap", "certificates", "faithful agents")
    clock = run.scenario.agents[0].clock
    return Line(
        agent,
        sum(fault.count for fault in summary.faults),
        sum(fault["at"] + DOWN in step_times for fault in kills),
        sum(old(step, agent, clock.period - clock.jitter) for step in meanwhile),
        sum(agent not in dict(step.ages) for step in meanwhile),
        summary.largest_h_tot,
        f"{summary.outcome}: " + ", ".join(f"{n} {failed[n]}" for n in assumptions if n in failed),
    )


def others(run: phalanx.Run, agent: str) -> Sequence[Step]:
    """The steps of the other normal agents."""
    normal = [n for n, group, _ in run.scenario.roster() if group.role == "normal" and n != agent]
    return [step for step in run.recording.steps if step.agent in normal]


def old(step: Step, agent: str, unchanged: float) -> bool:
    """Return whether a step used an input of this agent that may have been replaced."""
    return dict(step.ages).get(agent, 0.0) > unchanged


if __name__ == "__main__":
    main()

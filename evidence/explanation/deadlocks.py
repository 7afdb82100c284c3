"""Find deadlocks, and cure them.

    python -m evidence.explanation.deadlocks [RUNS] [SEEDS]

First table: RUNS of 2 to 8 robots with random starts and goals in a small square, each labelled by
a rule that knows nothing of inputs: some robot is away from its goal and moves less than 5 cm in
the last 4 s. The metric is right where it sees a deadlock that lasts to the end.

Second table: rings of robots that change sides, and shipped scenarios, with their own law, with a
detour to a random place in place of that by priority, and with `unstick`.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from msgspec.structs import replace
from rich.progress import track

import phalanx
from phalanx.extend import Dynamics, Law, View
from phalanx.launcher.run import Run
from phalanx.network.draws import Draws
from phalanx.recording.read import swarm_of
from phalanx.theory.arrays import Array
from phalanx.theory.laws.goals import hold

MOVES, AT_GOAL, LAST = 0.05, 0.5, 4.0
RADIUS = 0.8
SHIPPED = ("crossing", "radio")
"""Scenarios whose first group gets the law; robots of both have goals at which they rest."""


@dataclass
class RandomDetour:
    """The law of a ring with another goal at random, every `every` seconds, for half of them."""

    of: Law
    every: float = 4.0

    def prepare(self, dynamics: Dynamics) -> None:
        self.of.prepare(dynamics)

    def input(self, view: View) -> Array:
        number = int(view.t / self.every)
        p = view.positions[view.i]
        width = len(p)
        waypoint = Draws(0, "detour", str(view.i), width=width + 1)[number]
        if waypoint[-1] < 0.5 and number:
            view = replace(view, goal=hold(p + 4.0 * (np.array(waypoint[:-1]) - 0.5)))
        return self.of.input(view)


def scenario(starts: Array, goals: Array, duration: float) -> dict[str, Any]:
    """Return the table of robots between these places."""
    return {
        "name": "robots",
        "duration": duration,
        "safety": {
            "function": {"type": "distance", "radius": RADIUS}, "rho": 20.0, "alpha": [3.0],
            "composition": "pairs", "margin": "integrated", "information": "split",
        },
        "agents": [
            {
                "count": len(starts),
                "role": "normal",
                "dynamics": {"type": "single-integrator", "speed": 2.0},
                "law": {"type": "track-velocity", "gain": 1.0},
                "clock": {"period": 0.05, "jitter": 0.01},
                "start": starts.tolist(),
                "goal": goals.tolist(),
            }
        ],
    }  # fmt: skip


def crowd(seed: int) -> dict[str, Any]:
    """Return robots with random places, none within twice the radius of another's."""
    draws = Draws(seed, "crowd", "places", width=2)
    count = 2 + int(draws[0][0] * 7)
    points: list[Array] = []
    number = 1
    while len(points) < 2 * count:
        point = 8.0 * (np.array(draws[number]) - 0.5)
        others = points[len(points) // count * count :]
        if all(np.linalg.norm(point - other) > 2.0 * RADIUS for other in others):
            points.append(point)
        number += 1
        if number > 400:  # too full: start again with one robot less
            count, points, number = count - 1, [], number - 400
    return scenario(np.array(points[:count]), np.array(points[count:]), 20.0)


def ring(count: int) -> dict[str, Any]:
    angles = 2.0 * np.pi * np.arange(count) / count
    starts = count / 3.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    return scenario(starts + 0.01 * np.arange(count)[:, None], -starts, 60.0)


def stuck_by_places(run: Run) -> bool:
    """The label: some robot is away from its goal and has not moved of late."""
    recording, swarm = run.recording, swarm_of(run.recording)
    t, x = recording.times, recording.x
    late = x[t >= t[-1] - LAST].reshape(-1, len(swarm.names), 2)
    moved = np.ptp(late, axis=0).max(axis=1)
    goals = [swarm.goal(i)(float(t[-1]), {i: late[-1, i]}).position for i in swarm.normal]
    away = np.linalg.norm(late[-1] - np.array(goals), axis=1)
    return bool(((moved < MOVES) & (away > AT_GOAL)).any())


def stuck_by_metric(run: Run) -> bool:
    summary = run.summary
    assert summary is not None
    return any(wait.end > summary.t - 0.5 for wait in summary.deadlocks or ())


def laws(law: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the scenario's law, and two around it, by name."""
    random = {"type": "evidence.explanation.deadlocks:RandomDetour", "of": dict(law)}
    return {"own": dict(law), "random": random, "unstick": {"type": "unstick", "of": dict(law)}}


def main() -> None:
    """Print both tables."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("runs", type=int, nargs="?", default=100)
    arguments.add_argument("seeds", type=int, nargs="?", default=3)
    chosen = arguments.parse_args()
    counts = {(label, seen): 0 for label in (True, False) for seen in (True, False)}
    for seed in track(range(chosen.runs), description="crowds"):
        run = phalanx.run(phalanx.load(crowd(seed)), engine="in-process")
        counts[stuck_by_places(run), stuck_by_metric(run)] += 1
    print("| runs | with a deadlock | found | missed | called one wrongly |\n|---|---|---|---|---|")
    right, missed, wrong = (counts[k] for k in ((True, True), (True, False), (False, True)))
    print(f"| {chosen.runs} | {right + missed} | {right} | {missed} | {wrong} |\n")
    print(
        "| scenario | law | arrived | all in | in deadlock | verdicts |"
        + "\n|---|---|---|---|---|---|"
    )
    sources: dict[str, Any] = {"ring of 8": ring(8), "ring of 16": ring(16)}
    for name in [*sources, *SHIPPED]:
        source = sources.get(name, name)
        law_table = phalanx.load(source).agents[0].law
        for law, table in laws(law_table).items():
            seeds = range(chosen.seeds if name in SHIPPED else 1)
            print(f"| {name} | {law} | {row(source, table, seeds)} |", flush=True)


def row(source: Any, law: Mapping[str, Any], seeds: Sequence[int]) -> str:
    arrived = normal = deadlocked = 0
    last, verdicts = [], list[str]()
    for seed in track(seeds, description=str(law["type"])):
        loaded = phalanx.load(source, {"agents.0.law": dict(law)}, seed)
        run = phalanx.run(loaded, engine="in-process")
        rows = run.metrics.filter(run.metrics["role"] == "normal").to_dicts()
        arrived, normal = arrived + sum(bool(r["arrived"]) for r in rows), normal + len(rows)
        deadlocked += sum(bool(r["deadlock_time"]) for r in rows)
        last += [max(r["arrival_time"] for r in rows)] if all(r["arrived"] for r in rows) else []
        verdicts.append(str(run.verdict))
    mean = f"{np.mean(last):.1f} s in {len(last)} of {len(seeds)}" if last else "–"
    counted = ", ".join(f"{verdicts.count(v)} {v}" for v in sorted(set(verdicts)))
    return f"{arrived} of {normal} | {mean} | {deadlocked} | {counted}"


if __name__ == "__main__":
    main()

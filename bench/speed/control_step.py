"""Compare one agent's control step, row and QP, with cbfpy's at the states of a real run.

    pip install -e '.[bench]' && python bench/speed/control_step.py

All get the same sampled states, nominal inputs and û_l, alternately in one process, and must
return the same input. Only states with a non-empty K_i count, since cbfpy has no backup. "Ratio"
is the median, over all states, of the time in units of ours.
"""

import os

# As cbfpy recommends for its speed on a CPU; they count only before JAX is imported.
os.environ |= {
    "JAX_ENABLE_X64": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    "OPENBLAS_NUM_THREADS": "1",
}

import argparse
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from cbfpy_peer import Peer, push

import phalanx
from phalanx.network.inbox import AnnouncedInput
from phalanx.recording.read import Recording
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.information import ReceivedInput
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.safety_filter import FilterInput

SIMULATIONS = {"unicycles": "Simulation 1", "formation3d": "Simulation 2"}
IN_TURN, WARM_UP = 50, 10


class Sampled(NamedTuple):
    """The data of one agent's step of the run."""

    t: float
    x: Array
    visible: tuple[int, ...]
    u_nom: Array
    received: dict[int, ReceivedInput]
    applied: Array
    binding: bool
    """Whether the row changed the nominal input."""


def main() -> None:
    """Measure both simulations and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--steps", type=int, default=2000, help="most states")
    arguments.add_argument("--backends", default="qpax,elastiqp", help="of cbfpy")
    options = arguments.parse_args()
    print("| | states | all: p50, p99 [µs] | row binds: p50, p99 [µs] | ratio | largest Δu |")
    print("|---|---|---|---|---|---|")
    for name, title in SIMULATIONS.items():
        rows, steps = prepared(phalanx.run(name, engine="in-process").recording, options.steps)
        i = rows.swarm.normal[0]
        controllers = {title: our_step(rows, i)}
        for backend in options.backends.split(","):
            controllers[f"{title}, cbfpy with {backend}"] = cbfpy_step(rows, i, steps, backend)
        report(steps, measured(steps, controllers))


def prepared(recording: Recording, most: int) -> tuple[SafetyRows, list[Sampled]]:
    """Return the rows, and evenly chosen steps of the first normal agent that had a solution."""
    rows = build_rows(build_swarm(recording.scenario))
    steps = list(sampled(recording, rows.swarm, rows.swarm.normal[0]))
    return rows, steps[:: -(-len(steps) // most)]


def sampled(recording: Recording, swarm: Swarm, i: int) -> Iterator[Sampled]:
    """Yield agent i's steps with a non-empty K_i, with its received inputs."""
    states = {state.t: np.array(state.x) for state in recording.states}
    steps = sorted(recording.steps, key=lambda step: step.t)
    newest: dict[int, list[ReceivedInput]] = {l: [] for l in swarm.normal if l != i}
    for step in steps:
        l = swarm.names.index(step.agent)
        if l == i and step.origin == Origin.QP:
            received = {
                k: next(h for h in reversed(past) if h.t_apply < step.t)
                for k, past in newest.items()
                if past and past[0].t_apply < step.t
            }
            u, u_nom = np.array(step.u), np.array(step.u_nom)
            binding = step.residual is not None and step.residual > -1e-3
            x = states[step.t]
            visible = swarm.seen(i, x)
            yield Sampled(step.t, x, visible, u_nom, received, u, binding)
        elif l in newest:
            newest[l].append(AnnouncedInput(step.t_apply, tuple(step.u)))


def our_step(rows: SafetyRows, i: int) -> Callable[[Sampled], Array]:
    """Make a function for terms, row and QP as in agent i's process."""
    terms, decide = rows.terms(i), rows.filter(i)

    def step(now: Sampled) -> Array:
        found = terms(now.x, now.visible)
        arguments = FilterInput(now.t, now.x, now.visible, found, now.u_nom, now.received)
        return decide(arguments).decision.u

    return step


def cbfpy_step(
    rows: SafetyRows, i: int, steps: list[Sampled], backend: str
) -> Callable[[Sampled], Array]:
    """Make the same function with cbfpy; the others' inputs are computed before, and not timed."""
    swarm, peer, terms = rows.swarm, Peer(rows, i, backend), rows.terms(i)
    arguments = {
        now.t: (
            push(
                swarm,
                i,
                terms(now.x, now.visible),
                {l: np.array(h.u) for l, h in now.received.items()},
                now.x,
            ),
            in_sight(rows, i, now),
        )
        for now in steps
    }
    return lambda now: peer(now.x, now.u_nom, *arguments[now.t])


def in_sight(rows: SafetyRows, i: int, now: Sampled) -> Array:
    """Return 1 for each pair of which agent i sees both sides, else 0, shape (p,)."""
    swarm = rows.swarm
    members = np.isin(np.arange(len(swarm.members)), now.visible)
    near = rows.composed.obstacles_within(i, swarm.sensing(i))
    obstacles = np.ones(len(swarm.pairs.obstacles))
    if near is not None:
        (obstacles,) = near(now.x[swarm.safe_set.parts[i]], swarm.pairs.parameters)
    sides = np.concatenate([members, obstacles.ravel()])
    active: Array = sides[swarm.pairs.every].prod(axis=1)
    return active


class Measured(NamedTuple):
    """Results of one controller, by state."""

    times: Array
    """[s]"""
    differences: Array
    """From the input that the agent applied."""


def measured(
    steps: list[Sampled], controllers: dict[str, Callable[[Sampled], Array]]
) -> dict[str, Measured]:
    """Run every controller at every state, alternating after a few states.

    So all have the same load of the machine, and warm caches.
    """
    results = {name: Measured(*np.empty((2, len(steps)))) for name in controllers}
    for first in range(0, len(steps), IN_TURN):
        turn = range(first, min(first + IN_TURN, len(steps)))
        for name, step in controllers.items():
            for k in turn[:WARM_UP]:
                step(steps[k])
            for k in turn:
                began = time.perf_counter()
                u = step(steps[k])
                results[name].times[k] = time.perf_counter() - began
                results[name].differences[k] = np.abs(u - steps[k].applied).max()
    return results


def report(steps: list[Sampled], results: dict[str, Measured]) -> None:
    """Print one line for each controller; the first is ours."""
    binding = np.array([now.binding for now in steps])
    ours, *_ = results.values()
    for name, (times, differences) in results.items():
        ratio = f"{np.median(times / ours.times):.1f}"
        columns = [name, str(len(steps)), _quantiles(times), _quantiles(times[binding]), ratio]
        print("|", " | ".join([*columns, f"{differences.max():.1e}"]), "|", flush=True)


def _quantiles(times: Array) -> str:
    if not len(times):
        return "-"
    p50, p99 = np.percentile(times, [50, 99]) * 1e6
    return f"{p50:.0f}, {p99:.0f}"


if __name__ == "__main__":
    main()

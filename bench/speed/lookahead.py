"""Measure the gain of lookahead: one sample after another, or as many at once as allowed.

    python bench/speed/lookahead.py --agents 64

A real hub and a process for each agent; the plant integrates and hashes the trajectory, but judges
and records nothing. Both ways alternate; their hashes must agree.
"""

import argparse
import multiprocessing
import statistics
import time
from collections.abc import Sequence
from multiprocessing.queues import SimpleQueue as Answers

from phalanx_agent import main as agent
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.clock.lookahead import look_ahead
from phalanx_plant.hub.hub import LockstepHub
from phalanx_plant.judge.event_queue import EventQueue
from phalanx_plant.judge.judge import Judged
from phalanx_plant.observers.recorder import TrajectoryHash
from phalanx_plant.sampling.sampling import Sampling
from phalanx_plant.world.events import Event, InputApplied, Instant
from phalanx_plant.world.world import World

import phalanx
from phalanx.faults.commands import NO_COMMANDS
from phalanx.messages.keys import PLANT
from phalanx.messages.membership import Membership
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.session import free_endpoint

# Rows that are built quickly: the exchange is to be measured, with some computation in it.
SIMPLE = {
    "safety.composition": "lse",
    "safety.margin": "paper",
    "safety.eta": 1.0,
    "safety.xi": 0.5,
    "safety.information": "in-flight",
    "time.timeout": 120.0,
}


class Keeper:
    """Hashes the trajectory, and counts inputs."""

    def __init__(self) -> None:
        self.trajectory, self.steps = TrajectoryHash(), 0
        self.began = time.perf_counter()

    def prepare(self, events: Sequence[Event]) -> None:
        """Do nothing."""

    def judge(self, instant: Instant, judged: list[Judged]) -> None:
        """Take the next instant."""
        self.trajectory.add([*map(Judged, instant)])
        for event in instant:
            if isinstance(event, InputApplied):
                self.steps += 1
                if event.t_sample == 0.0:  # the first samples compile what is compiled at first use
                    self.began = time.perf_counter()


def main() -> None:
    """Run both ways alternately, and print times and their ratio."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--agents", type=int, default=64)
    arguments.add_argument("--duration", type=float, default=0.5, help="virtual time [s]")
    arguments.add_argument("--rounds", type=int, default=3)
    options = arguments.parse_args()
    count = {
        "agents.0.count": options.agents - options.agents // 8,
        "agents.1.count": options.agents // 8,
        "duration": options.duration,
    }
    rows = {
        lookahead: build_rows(
            build_swarm(phalanx.load("swarm", {**count, **SIMPLE, "time.lookahead": lookahead}))
        )
        for lookahead in (False, True)
    }
    times: dict[bool, list[float]] = {False: [], True: []}
    hashes = set()
    for _ in range(options.rounds):
        for lookahead in (False, True):
            seconds, trajectory = measured(rows[lookahead])
            times[lookahead].append(seconds)
            hashes.add(trajectory)
    off, on = (statistics.median(times[lookahead]) for lookahead in (False, True))
    gains = [a / b for a, b in zip(times[False], times[True], strict=True)]
    print(f"{options.agents} agents: {off * 1e6:.0f} µs a step one after another, "
          f"{on * 1e6:.0f} µs with lookahead: {statistics.median(gains):.2f} times as fast "
          f"({min(gains):.2f} to {max(gains):.2f}); "
          f"{'one trajectory' if len(hashes) == 1 else 'DIFFERENT TRAJECTORIES'}")  # fmt: skip


def measured(rows: SafetyRows) -> tuple[float, str]:
    """Run once; return the wall time of a step [s] and the trajectory's hash."""
    context = multiprocessing.get_context("fork")
    membership = Membership("bench", free_endpoint(), b"bench")
    answers = context.SimpleQueue()
    programs = [context.Process(target=plant, args=(rows, membership.of(PLANT), answers))]
    for name in rows.swarm.names:
        member = membership.of(name, (name,), rows.swarm.names)
        programs.append(context.Process(target=agent.run, args=(rows, member)))
    for program in programs:
        program.start()
    answer: tuple[float, str] = answers.get()
    for program in programs:
        program.join()
    return answer


def plant(rows: SafetyRows, membership: Membership, answers: "Answers[tuple[float, str]]") -> None:
    """Run world, schedule and hub; time counts once every agent has answered once."""
    swarm, keeper = rows.swarm, Keeper()
    with LockstepHub(swarm, membership, lambda: None) as hub:
        world, commands = World(rows), CommandQueue(NO_COMMANDS, swarm.names)
        events = EventQueue(keeper, hub.await_telemetry, ())
        lockstep = Lockstep(world, Sampling(swarm), hub, events, commands, look_ahead)
        hub.wait_for_agents(lambda _: None)
        lockstep.run(swarm.scenario.duration)
        seconds = (time.perf_counter() - keeper.began) / (keeper.steps - len(swarm.members))
        answers.put((seconds, keeper.trajectory.hexadecimal))


if __name__ == "__main__":
    main()

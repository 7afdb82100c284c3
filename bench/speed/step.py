"""Measure the wall time of one agent step of both simulations, and of its parts.

    python bench/speed/step.py

step      a real run: plant, hub and agents, each a process
exchange  the same processes, hub, subscriptions and message sizes, but nothing computed
compute   the same run by the in-process engine: nothing sealed or sent
colder    what a control step takes longer in a process of its own: between two of its steps the
          caches hold other programs

The ratio step / (exchange + compute) is the overhead of the design, and the one with colder added
what is left of it. Each figure is the median of rounds, and a ratio is the median of the rounds'
own ratios, with the least and the largest.

Below it are the wake-ups of a step in the real run, by program and thread: how often a thread of
the plant or of an agent gave up its core to wait, and how often it was taken from it.
"""

import argparse
import contextlib
import multiprocessing
import statistics
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import bare
import psutil
from bare import KEYS
from phalanx_agent.step import ControlStep

import phalanx
from phalanx.messages.kinds import Message, Sample, Status
from phalanx.messages.seal import Sealer
from phalanx.swarm.rows import build_rows
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import build_swarm
from phalanx.wire import pubsub
from phalanx.wire.session import free_endpoint


class Sizes(NamedTuple):
    """Lengths of sealed payloads [bytes]."""

    sample: int
    actuation: int
    broadcast: int
    telemetry: int


SIMULATIONS = {"unicycles": ("Simulation 1", 4.0), "formation3d": ("Simulation 2", 12.0)}
"""Title, and virtual time of a round [s]."""


Wakeups = dict[str, tuple[float, ...]]
"""By program and thread: voluntary and forced context switches of a step."""


class Round(NamedTuple):
    """Wall times of one agent step [s]."""

    step: float
    exchange: float
    compute: float
    colder: float

    @property
    def overhead(self) -> float:
        """Overhead of the design, as a factor."""
        return self.step / (self.exchange + self.compute)

    @property
    def rest(self) -> float:
        """Overhead without that of caches."""
        return self.step / (self.exchange + self.compute + self.colder)


def main() -> None:
    """Measure each part alternately, several times, and print a table of medians."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--only", choices=list(SIMULATIONS), help="one simulation")
    arguments.add_argument("--rounds", type=int, default=10)
    options = arguments.parse_args()
    print("| | step [µs] | exchange | compute | colder | step / (exchange + compute) | + colder |")
    print("|---|---|---|---|---|---|---|")
    woken: dict[str, Wakeups] = {}
    for name, (title, duration) in SIMULATIONS.items():
        if options.only in (None, name):
            scenario = phalanx.load(name, {"duration": duration})
            sizes = payload_sizes(scenario)
            rounds = [measured(scenario, sizes) for _ in range(options.rounds)]
            woken[title] = wakeups(scenario)
            times = [f"{statistics.median(part) * 1e6:.0f}" for part in zip(*rounds, strict=True)]
            ratios = [spread([each.overhead for each in rounds]), spread([r.rest for r in rounds])]
            print("|", " | ".join([title, *times, *ratios]), "|", flush=True)
    print()
    print("| | program: thread | waits of a step | taken from its core |")
    print("|---|---|---|---|")
    for title, counts in woken.items():
        for thread, (waits, preemptions) in sorted(counts.items(), key=lambda item: -item[1][0]):
            print(f"| {title} | {thread} | {waits:.2f} | {preemptions:.2f} |")


def spread(ratios: list[float]) -> str:
    """Return the median of ratios, with the least and the largest."""
    return f"{statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})"


def measured(scenario: phalanx.Scenario, sizes: Sizes) -> Round:
    """Measure one round."""
    real, direct = phalanx.run(scenario), phalanx.run(scenario, engine="in-process")
    (step, steps), (compute, _) = per_step(real), per_step(direct)
    exchange = measure_exchange(scenario, steps, sizes)
    return Round(step, exchange, compute, control_step(real) - control_step(direct))


def control_step(run: phalanx.Run) -> float:
    """Return the median time from a sample to its input, without the wire [s]."""
    return statistics.median(step.solve_time for step in run.recording.steps)


def wakeups(scenario: phalanx.Scenario) -> Wakeups:
    """Count the context switches of a run, from its first half second to its last look."""
    looks: list[tuple[int, Counter[tuple[str, int]]]] = []

    def look(status: Status) -> None:
        if not status.waiting_for and status.steps:
            looks.append((status.steps, switches()))

    phalanx.run(scenario, progress=look)
    (first, before), (last, after) = looks[0], looks[-1]
    return {
        name: tuple((after[name, kind] - before[name, kind]) / (last - first) for kind in (0, 1))
        for name in {name for name, _ in after}
    }


def switches() -> Counter[tuple[str, int]]:
    """Return the context switches of all programs so far, by thread: voluntary 0, forced 1."""
    counts: Counter[tuple[str, int]] = Counter()
    for process in psutil.Process().children(recursive=True):
        with contextlib.suppress(OSError, psutil.NoSuchProcess):
            program = "plant" if process.name() == "phx-plant" else "agents"
            if not process.name().startswith(("phx-plant", "phx-agent")):
                continue
            for task in Path(f"/proc/{process.pid}/task").iterdir():
                lines = (task / "status").read_text().splitlines()
                name = (task / "comm").read_text().strip().rstrip("-0123456789")
                thread = "its own" if name.startswith("phx") else name
                for kind, line in enumerate(lines[-2:]):
                    counts[f"{program}: {thread}", kind] += int(line.split()[1])
    return counts


def per_step(run: phalanx.Run) -> tuple[float, int]:
    """Return the wall time of a step in a run [s], and the number of steps."""
    assert run.summary is not None
    return run.summary.wall_time / run.summary.steps, run.summary.steps


def payload_sizes(scenario: phalanx.Scenario) -> Sizes:
    """Compute the sizes of the messages in the first step of the first normal agent."""
    swarm = build_swarm(scenario)
    step = ControlStep(build_rows(swarm), swarm.normal[0])
    everyone = tuple(range(len(swarm.members)))
    x = StateCodec(swarm).pack(swarm.start(), everyone)
    hearers = swarm.heard_by(step.i)
    sample = Sample(k=0, t=0.0, seen=everyone, x=x, hearers=hearers)
    answer = step(step.accept_sample(sample))
    broadcast = answer.broadcasts[hearers[0]]
    messages = (sample, answer.actuation, broadcast, answer.telemetry)
    return Sizes(*map(_sealed, messages))


def _sealed(message: Message) -> int:
    return len(Sealer(b"bench").seal(KEYS.status, message))


def measure_exchange(scenario: phalanx.Scenario, steps: int, sizes: Sizes) -> float:
    """Measure the time from a payload of a sample's size to its answer, through the hub [s]."""
    swarm, endpoint = build_swarm(scenario), free_endpoint()
    context = multiprocessing.get_context("forkserver")
    answer = context.SimpleQueue()
    hub = context.Process(target=exchange, args=(endpoint, swarm.names, steps, sizes, answer))
    hub.start()
    normal = [swarm.names[i] for i in swarm.normal]
    echoes = [
        context.Process(
            target=echo,
            args=(
                endpoint,
                name,
                [n for n in normal if name in normal and n != name],
                sizes,
            ),
        )
        for name in swarm.names
    ]
    for process in echoes:
        process.start()
    seconds: float = answer.get()
    for process in [hub, *echoes]:
        process.join()
    return seconds


def exchange(
    endpoint: str,
    names: tuple[str, ...],
    steps: int,
    sizes: Sizes,
    answer: "multiprocessing.queues.SimpleQueue[float]",
) -> None:
    """Run the hub of a bare exchange: agent after agent, as in lockstep without latency."""
    with bare.hub(endpoint, names) as hub:
        answer.put(bare.exchange(hub, bytes(sizes.sample), steps))


def echo(endpoint: str, name: str, peers: list[str], sizes: Sizes) -> None:
    """Run an agent of a bare exchange: answer every payload, with an agent's subscriptions."""
    with bare.member(endpoint, name) as session:
        actuation = pubsub.publisher(session, KEYS.actuation(name))
        telemetry = pubsub.publisher(session, KEYS.telemetry(name))
        addressed = pubsub.Addressed(session)
        broadcasts = [KEYS.broadcast(name, peer) for peer in peers]

        def reply(_key: str, _payload: bytes) -> None:
            actuation.put(bytes(sizes.actuation))
            for key in broadcasts:
                addressed.put(key, bytes(sizes.broadcast))
            telemetry.put(bytes(sizes.telemetry))

        pubsub.subscribe(session, KEYS.broadcast("*", name), lambda _key, _payload: None)
        pubsub.subscribe(session, KEYS.sample(name), reply)
        pubsub.wait_for_listener(actuation, bare.PATIENCE)


if __name__ == "__main__":
    main()

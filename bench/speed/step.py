"""Wall time of one agent step of `unicycles`, beside its parts, measured in one go.

    python bench/step.py

step      a real run: plant, hub and five agents, each a process
exchange  the same processes, hub, subscriptions and message sizes, but nothing computed
compute   the same run in one process: plant and agents without a wire (messages still sealed)

The ratio step / (exchange + compute) is what the design adds.
"""

import argparse
import multiprocessing
import statistics
import tempfile
import threading
import time
from pathlib import Path
from queue import SimpleQueue
from typing import TypeVar

from phalanx.agent.step import ControlStep
from phalanx.launcher.launch import launch, new_folder
from phalanx.plant.judge import Judge
from phalanx.plant.lockstep import Lockstep
from phalanx.recording.write import RecordingWriter
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.wire import session as wire
from phalanx.wire.keys import PLANT, Keys, sender
from phalanx.wire.messages import Input, Message, Sample, Sealer, Status

KEYS, SEALER = Keys("bench"), Sealer(b"bench")
M = TypeVar("M", bound=Message)


def main() -> None:
    """Measure each part in turn, several times, and print the medians."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--duration", type=float, default=12.0, help="virtual time [s]")
    arguments.add_argument("--rounds", type=int, default=3)
    options = arguments.parse_args()
    scenario = load("unicycles", [f"duration={options.duration}"])
    times: dict[str, list[float]] = {"step": [], "exchange": [], "compute": []}
    for _ in range(options.rounds):
        step, steps = measure_step(scenario)
        compute, sizes = measure_compute(scenario)
        times["step"].append(step)
        times["compute"].append(compute)
        times["exchange"].append(measure_exchange(scenario, steps, sizes))
    report({name: statistics.median(values) for name, values in times.items()}, scenario)


def report(median: dict[str, float], scenario: Scenario) -> None:
    """Print the medians, their ratio and the real-time factor."""
    for name, seconds in median.items():
        print(f"{name:9} {seconds * 1e6:7.1f} µs per agent step")
    print(f"step / (exchange + compute) = {ratio(median):.2f}")
    rate = sum(1 / group.clock.period for _, group, _ in scenario.roster())
    print(f"real-time factor {1 / (rate * median['step']):.1f}")


def ratio(median: dict[str, float]) -> float:
    """What the design adds to its parts."""
    return median["step"] / (median["exchange"] + median["compute"])


def measure_step(scenario: Scenario) -> tuple[float, int]:
    """Wall time of a step in a real run [s], and the number of steps."""
    with tempfile.TemporaryDirectory(prefix="phalanx-") as parent:
        folder = new_folder(Path(parent), scenario.name)
        summary = launch(scenario, folder, wire.free_endpoint(), lambda _: None)
    return summary.wall_time / summary.steps, summary.steps


class InProcess:
    """Agents that answer by a function call; every message is still sealed and opened."""

    def __init__(self, swarm: Swarm) -> None:
        self._steps = [ControlStep(swarm, i) for i in range(len(swarm.members))]
        self._names = swarm.names
        self._answers: dict[int, Input] = {}
        self.bytes: dict[type, int] = {}

    def send_sample(self, i: int, sample: Sample) -> None:
        """Compute the answer at once and hand it to whoever listens."""
        step = self._steps[i]
        answer = step(self._through_the_seal(KEYS.sample(self._names[i]), sample))
        self._answers[i] = self._through_the_seal(KEYS.input(self._names[i]), answer)
        for other in self._steps:
            if self._names[i] in other.listens_to:
                heard = self._through_the_seal(KEYS.input(self._names[i]), answer)
                other.accept_broadcast(self._names[i], heard)

    def await_input(self, i: int) -> Input:
        """The answer."""
        return self._answers.pop(i)

    def publish_status(self, message: Status) -> None:
        """Nobody watches."""

    def _through_the_seal(self, key: str, message: M) -> M:
        payload = SEALER.seal(key, message)
        self.bytes[type(message)] = len(payload)
        return SEALER.open(key, payload, type(message))


def measure_compute(scenario: Scenario) -> tuple[float, dict[type, int]]:
    """Time of a step without a wire [s], and the sizes of the messages."""
    swarm = build_swarm(scenario)
    agents, judge = InProcess(swarm), Judge(swarm)
    with (
        tempfile.TemporaryDirectory(prefix="phalanx-") as folder,
        RecordingWriter(Path(folder) / "bench.mcap", scenario, "bench") as recording,
    ):
        lockstep = Lockstep(swarm, agents, judge, recording)
        began = time.perf_counter()
        lockstep.run()
        return (time.perf_counter() - began) / judge.steps, agents.bytes


def measure_exchange(scenario: Scenario, steps: int, sizes: dict[type, int]) -> float:
    """Time from a sample-sized payload out to an input-sized payload back, through the hub [s]."""
    swarm, endpoint = build_swarm(scenario), wire.free_endpoint()
    context = multiprocessing.get_context("forkserver")
    answer = context.SimpleQueue()
    hub = context.Process(target=exchange, args=(endpoint, swarm.names, steps, sizes, answer))
    hub.start()
    echoes = [
        context.Process(
            target=echo, args=(endpoint, name, ControlStep(swarm, i).listens_to, sizes[Input])
        )
        for i, name in enumerate(swarm.names)
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
    sizes: dict[type, int],
    answer: "multiprocessing.queues.SimpleQueue[float]",
) -> None:
    """The hub of a bare exchange: one agent after the other, as in lockstep without latency."""
    joined: SimpleQueue[str] = SimpleQueue()
    inputs: SimpleQueue[bytes] = SimpleQueue()
    with wire.open_hub(endpoint) as session:
        publishers = [wire.publisher(session, KEYS.sample(name)) for name in names]
        wire.subscribe(session, KEYS.input("*"), lambda _, payload: inputs.put(payload))
        wire.watch(session, KEYS.alive("*"), lambda key, _: joined.put(sender(key)))
        _token = wire.announce(session, KEYS.alive(PLANT, "bench"))
        missing = {*names, PLANT}
        while missing:
            missing.discard(joined.get())
        began = time.perf_counter()
        for step in range(steps):
            publishers[step % len(names)].put(bytes(sizes[Sample]))
            inputs.get()
        answer.put((time.perf_counter() - began) / steps)


def echo(endpoint: str, name: str, listens_to: list[str], size: int) -> None:
    """An agent of a bare exchange: it answers every payload, and hears what it would hear."""
    with wire.open_client(endpoint, timeout=20) as session:
        reply = wire.publisher(session, KEYS.input(name))
        for other in listens_to:
            wire.subscribe(session, KEYS.input(other), lambda _key, _payload: None)
        wire.subscribe(session, KEYS.sample(name), lambda _key, _payload: reply.put(bytes(size)))
        over = threading.Event()
        wire.watch(session, KEYS.alive(PLANT), lambda _, alive: None if alive else over.set())
        wire.wait_for_listener(reply, timeout=20)
        _token = wire.announce(session, KEYS.alive(name, "bench"))
        over.wait()


if __name__ == "__main__":
    main()

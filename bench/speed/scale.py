"""Measure time and memory of a swarm by its size, compared with as many bare processes.

    python bench/speed/scale.py [swarm2d] [--agents 8,16,32] [--steps 4000]

build      compile the theory that all agents inherit, and one agent's controller, in a new process
start-up   from the call until all agents have joined; bare: processes that only open a session and
           announce themselves
memory     PSS of an agent, and of the plant: private memory, and its share of shared memory
step       wall time of one agent step of a real run; exchange: the bare processes answer a payload
           one after the other, and receive messages from as many peers as an agent
RTF        real-time factor

A run lasts until all agents together have made --steps steps, and from 2 to 20 s of virtual time.
A size that fails has its error in the table, and the next one is measured.
"""

import argparse
import multiprocessing
import statistics
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from queue import SimpleQueue
from typing import NamedTuple, TypeVar

import bare
import numpy as np
import psutil
from bare import KEYS
from phalanx_agent.step import control_steps
from rich.console import Console
from rich.progress import Progress

import phalanx
from phalanx.guarantee.verdict import Outcome
from phalanx.messages.kinds import Status
from phalanx.scenario.load import from_json
from phalanx.scenario.model import to_json
from phalanx.swarm.rows import build_rows
from phalanx.swarm.runnable import compile_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.wire import pubsub
from phalanx.wire.session import free_endpoint

T = TypeVar("T")
SIZES = "8,16,32,64,128,256"
PAYLOAD = 400
"""Bytes of a message of the bare exchange."""
EXCHANGES = 2000
SHORTEST, LONGEST = 2.0, 20.0
"""Virtual time of a run [s]."""
LOOKED_AT = 16
"""Number of agents whose memory is read: reading it delays an agent."""

COLUMNS = (
    "N | build [s] | start-up [s] | bare [s] | ratio | agent [MB] | plant [MB] | step [µs] | "
    "exchange [µs] | steps/s | RTF | in-process: step [µs] | RTF | trajectory"
)


class Started(NamedTuple):
    """Measurements during a run."""

    seconds: float
    agent: float
    """PSS, median [MB]."""
    plant: float
    """PSS [MB]."""


def main() -> None:
    """Measure every size and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("scenario", nargs="?", default="swarm")
    arguments.add_argument("--agents", default=SIZES, help=f"sizes, by default {SIZES}")
    arguments.add_argument("--steps", type=int, default=4000, help="of all agents in a run")
    options = arguments.parse_args()
    sizes = [int(size) for size in options.agents.split(",")]
    print(f"| {COLUMNS} |")
    print("|---" * (COLUMNS.count("|") + 1) + "|", flush=True)
    with Progress(console=Console(stderr=True), transient=True) as bar:
        for size in bar.track(sizes):
            print(f"| {size} | {measured(options.scenario, size, options.steps)} |", flush=True)


def measured(name: str, agents: int, steps: int) -> str:
    """Make the cells of one line of the table, or the error."""
    try:
        return cells(sized(name, agents, steps))
    except Exception as error:  # the other sizes count too
        return f"{type(error).__name__}: {error}"


def sized(name: str, agents: int, steps: int) -> phalanx.Scenario:
    """Load a swarm of this size, an eighth adversaries, with `steps` steps of all agents."""
    adversaries = max(1, agents // 8)
    counts = {"agents.0.count": agents - adversaries, "agents.1.count": adversaries}
    period = phalanx.load(name).agents[0].clock.period
    duration = min(max(steps * period / agents, SHORTEST), LONGEST)
    return phalanx.load(name, {"duration": duration, "time.timeout": 600.0, **counts})


def cells(scenario: phalanx.Scenario) -> str:
    """Make one line of the table, without its size."""
    size = sum(group.size for group in scenario.agents)
    build = in_new_process(build_time, to_json(scenario))
    alone, exchange = in_new_process(bare_processes, size, peers(scenario))
    started, run = observed(scenario)
    inside = phalanx.run(scenario, engine="in-process").summary
    assert inside is not None
    same = "same" if inside.trajectory == run.trajectory else "DIFFERENT"
    step, direct = run.wall_time / run.steps, inside.wall_time / inside.steps
    columns = [
        f"{build:.2f} | {started.seconds:.2f} | {alone:.2f} | {started.seconds / alone:.1f}",
        f"{started.agent:.1f} | {started.plant:.1f} | {step * 1e6:.0f} | {exchange * 1e6:.0f}",
        f"{1 / step:.0f} | {run.real_time_factor:.2f}",
        f"{direct * 1e6:.0f} | {inside.real_time_factor:.2f} | {same}",
    ]
    return " | ".join(columns)


def in_new_process(function: Callable[..., T], *arguments: object) -> T:
    """Call a function in a new process, and return its result."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        return pool.submit(function, *arguments).result()


def build_time(scenario_json: str) -> float:
    """Measure the time to build the theory and one agent's controller [s]."""
    scenario = from_json(scenario_json)
    began = time.perf_counter()
    rows = build_rows(build_swarm(scenario))
    compile_rows(rows)
    control_steps(rows, next(iter(scenario.programs())))
    return time.perf_counter() - began


def peers(scenario: phalanx.Scenario) -> int:
    """Count the other agents in an agent's neighbourhood at the start, on average."""
    p = np.array([g.start[place][: g.axes] for _, g, place in scenario.roster()])
    distances = np.linalg.norm(p[:, None] - p[None], axis=2)
    radius = scenario.safety.sensing(None) or np.inf
    return round(float((distances <= radius).sum() / len(p) - 1.0))


def observed(scenario: phalanx.Scenario) -> tuple[Started, phalanx.Summary]:
    """Run a scenario with real processes, and measure them once all have joined.

    Raises RuntimeError if the run breaks.
    """
    joined: SimpleQueue[float] = SimpleQueue()

    def on_status(status: Status) -> None:
        if not status.waiting_for:
            joined.put(time.perf_counter())

    began = time.perf_counter()
    measurements: list[Started] = []

    def look() -> None:
        seconds = joined.get() - began
        named: dict[str, list[psutil.Process]] = {}
        for process in psutil.Process().children(recursive=True):
            named.setdefault(process.name()[: len("phx-agent")], []).append(process)
        agents = [megabytes(process) for process in named["phx-agent"][:LOOKED_AT]]
        measurements.append(
            Started(seconds, statistics.median(agents), megabytes(*named["phx-plant"]))
        )

    watcher = threading.Thread(target=look, daemon=True)
    watcher.start()
    summary = phalanx.run(scenario, progress=on_status).summary
    assert summary is not None
    if summary.outcome is Outcome.BROKEN:
        raise RuntimeError(summary.reason)
    watcher.join()
    return measurements[0], summary


def megabytes(process: psutil.Process) -> float:
    """PSS [MB]."""
    return float(process.memory_full_info().pss / 1e6)


def bare_processes(count: int, peers: int) -> tuple[float, float]:
    """Measure the time for `count` processes to start and join, and that of an exchange [s].

    Call it in a process without a session: they are forked from it.
    """
    context = multiprocessing.get_context("fork")
    names, endpoint = [str(k) for k in range(count)], free_endpoint()
    began = time.perf_counter()
    processes = [
        context.Process(
            target=echo,
            args=(endpoint, name, [names[(k + 1 + n) % count] for n in range(peers)]),
        )
        for k, name in enumerate(names)
    ]
    for process in processes:
        process.start()
    try:
        with bare.hub(endpoint, names) as hub:
            startup = time.perf_counter() - began
            exchange = bare.exchange(hub, bytes(PAYLOAD), EXCHANGES)
        for process in processes:
            process.join(bare.PATIENCE)
    finally:
        for process in processes:
            process.kill()
    return startup, exchange


def echo(endpoint: str, name: str, peers: list[str]) -> None:
    """Answer every payload until the hub is gone, and send to as many peers as an agent does."""
    with bare.member(endpoint, name) as session:
        publishers = [pubsub.publisher(session, KEYS.actuation(name))]
        publishers += [pubsub.publisher(session, f"bench/to/{peer}/{name}") for peer in peers]

        def reply(_key: str, _payload: bytes) -> None:
            for publisher in publishers:
                publisher.put(bytes(PAYLOAD))

        pubsub.subscribe(session, f"bench/to/{name}/*", lambda _key, _payload: None)
        pubsub.subscribe(session, KEYS.sample(name), reply)
        pubsub.wait_for_listener(publishers[0], bare.PATIENCE)


if __name__ == "__main__":
    main()

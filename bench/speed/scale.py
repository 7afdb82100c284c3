"""What a swarm costs by its size, beside as many bare processes, measured in one go.

    python bench/speed/scale.py [swarm2d] [--agents 8,16,32] [--duration 2]

build      the theory of the scenario and one agent's controller, in a process that did neither yet
start-up   from the call until all agents have joined; bare: processes that only open a session and
           announce themselves
memory     PSS of an agent, and of the plant: what it has alone, and its part of what is shared
step       wall time of one agent step of a real run; exchange: the bare processes answer a payload
           one after the other, and hear from as many peers as an agent does
RTF        real-time factor
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

import numpy as np
import psutil
from rich.console import Console
from rich.progress import Progress

import phalanx
from phalanx.agent.step import control_steps
from phalanx.scenario.load import from_json, to_json
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.wire import session as wire
from phalanx.wire.keys import PLANT, Keys, kind_and_name
from phalanx.wire.messages import Status

KEYS = Keys("bench")
T = TypeVar("T")
SIZES = "8,16,32,64,128,256"
PAYLOAD = 400
"""Bytes of a message of the bare exchange."""
EXCHANGES = 2000

COLUMNS = (
    "N | build [s] | start-up [s] | bare [s] | ratio | agent [MB] | plant [MB] | step [µs] | "
    "exchange [µs] | steps/s | RTF | in-process: step [µs] | RTF | trajectory"
)


class Started(NamedTuple):
    """What was seen of a run while it went on."""

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
    arguments.add_argument("--duration", type=float, default=2.0, help="virtual time [s]")
    options = arguments.parse_args()
    sizes = [int(size) for size in options.agents.split(",")]
    print(f"| {COLUMNS} |")
    print("|---" * (COLUMNS.count("|") + 1) + "|", flush=True)
    with Progress(console=Console(stderr=True), transient=True) as bar:
        for size in bar.track(sizes):
            print(line(sized(options.scenario, size, options.duration)), flush=True)


def sized(name: str, agents: int, duration: float) -> phalanx.Scenario:
    """A swarm of this size, one in eight an adversary."""
    adversaries = max(1, agents // 8)
    counts = {"agents.0.count": agents - adversaries, "agents.1.count": adversaries}
    return phalanx.load(name, {"duration": duration, "time.timeout": 600.0, **counts})


def line(scenario: phalanx.Scenario) -> str:
    """One line of the table."""
    size = sum(group.size for group in scenario.agents)
    build = apart(build_time, to_json(scenario))
    bare, exchange = apart(bare_processes, size, peers(scenario))
    started, run = observed(scenario)
    inside = phalanx.run(scenario, engine="in-process").summary
    assert inside is not None
    same = "same" if inside.trajectory == run.trajectory else "DIFFERENT"
    step, alone = run.wall_time / run.steps, inside.wall_time / inside.steps
    cells = [
        f"{size} | {build:.2f} | {started.seconds:.2f} | {bare:.2f} | {started.seconds / bare:.1f}",
        f"{started.agent:.1f} | {started.plant:.1f} | {step * 1e6:.0f} | {exchange * 1e6:.0f}",
        f"{1 / step:.0f} | {run.real_time_factor:.2f}",
        f"{alone * 1e6:.0f} | {inside.real_time_factor:.2f} | {same}",
    ]
    return f"| {' | '.join(cells)} |"


def apart(function: Callable[..., T], *arguments: object) -> T:
    """What a function returns in a process of its own."""
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=spawn) as pool:
        return pool.submit(function, *arguments).result()


def build_time(scenario_json: str) -> float:
    """How long theory and one agent's controller take [s]."""
    scenario = from_json(scenario_json)
    began = time.perf_counter()
    control_steps(build_rows(build_swarm(scenario)), next(iter(scenario.programs())))
    return time.perf_counter() - began


def peers(scenario: phalanx.Scenario) -> int:
    """How many others an agent has within its neighbourhood at the start, on average."""
    p = np.array([g.start[place][: g.axes] for _, g, place in scenario.roster()])
    apart = np.linalg.norm(p[:, None] - p[None], axis=2)
    radius = scenario.safety.neighbourhood or np.inf
    return round(float((apart <= radius).sum() / len(p) - 1.0))


def observed(scenario: phalanx.Scenario) -> tuple[Started, phalanx.Summary]:
    """Run a scenario with real processes, and look at them once all have joined."""
    joined: SimpleQueue[float] = SimpleQueue()

    def on_status(status: Status) -> None:
        if not status.waiting_for:
            joined.put(time.perf_counter())

    began = time.perf_counter()
    seen: list[Started] = []

    def look() -> None:
        seconds = joined.get() - began
        mine = psutil.Process().children(recursive=True)
        memory = {process.name(): process.memory_full_info().pss / 1e6 for process in mine}
        agents = [mb for name, mb in memory.items() if name.startswith("phx-agent")]
        seen.append(Started(seconds, statistics.median(agents), memory["phx-plant"]))

    watcher = threading.Thread(target=look)
    watcher.start()
    summary = phalanx.run(scenario, progress=on_status).summary
    watcher.join()
    assert summary is not None
    return seen[0], summary


def bare_processes(count: int, peers: int) -> tuple[float, float]:
    """How long `count` processes take to start and join [s], and an exchange with one of them.

    To be called in a process that has no session: they are forked from it.
    """
    context = multiprocessing.get_context("fork")
    names, endpoint = [str(k) for k in range(count)], wire.free_endpoint()
    joined: SimpleQueue[str] = SimpleQueue()
    answers: SimpleQueue[bytes] = SimpleQueue()
    began = time.perf_counter()
    processes = [
        context.Process(
            target=bare,
            args=(endpoint, name, [names[(k + 1 + n) % count] for n in range(peers)]),
        )
        for k, name in enumerate(names)
    ]
    for process in processes:
        process.start()
    with wire.open_hub(endpoint) as session:
        publishers = [wire.publisher(session, KEYS.sample(name)) for name in names]
        wire.subscribe(session, KEYS.actuation("*"), lambda _, payload: answers.put(payload))
        wire.watch(session, KEYS.alive("*"), lambda key, _: joined.put(kind_and_name(key)[1]))
        _token = wire.announce(session, KEYS.alive(PLANT, "bench"))
        missing = {*names, PLANT}
        while missing:
            missing.discard(joined.get(timeout=120.0))
        startup = time.perf_counter() - began
        began = time.perf_counter()
        for step in range(EXCHANGES):
            publishers[step % count].put(bytes(PAYLOAD))
            answers.get()
        exchange = (time.perf_counter() - began) / EXCHANGES
    for process in processes:
        process.join()
    return startup, exchange


def bare(endpoint: str, name: str, peers: list[str]) -> None:
    """Open a session, announce oneself, and answer every payload until the hub is gone."""
    with wire.open_member(endpoint, KEYS.alive(PLANT), timeout=60) as session:
        actuation = wire.publisher(session, KEYS.actuation(name))
        others = [wire.publisher(session, f"bench/to/{peer}/{name}") for peer in peers]

        def reply(_key: str, _payload: bytes) -> None:
            for publisher in (actuation, *others):
                publisher.put(bytes(PAYLOAD))

        wire.subscribe(session, f"bench/to/{name}/*", lambda _key, _payload: None)
        wire.subscribe(session, KEYS.sample(name), reply)
        over = threading.Event()
        wire.watch(session, KEYS.alive(PLANT), lambda _, alive: None if alive else over.set())
        wire.wait_for_listener(actuation, timeout=60)
        _token = wire.announce(session, KEYS.alive(name, "bench"))
        over.wait()


if __name__ == "__main__":
    main()

"""Measure two ways to reach the peers in sight: one message to subscribers, or one to each peer.

    python bench/speed/broadcasts.py --neighbours 12

subscribed  an agent puts once, on a key that its neighbours subscribe to
addressed   it puts once for each neighbour, on a key of that neighbour's, as Phalanx does
change      one subscription declared and undeclared: the cost of a neighbour that comes and goes,
            if messages are subscribed to

A round is a sample and an actuation for one agent after the other, as in lockstep without latency,
every message sealed and opened. The two ways alternate with the same hub and agents.
"""

import argparse
import multiprocessing
import statistics
import time
from multiprocessing.queues import SimpleQueue as Answers

import bare
from bare import KEYS

from phalanx.messages.kinds import Actuation, Broadcast
from phalanx.messages.seal import Sealer
from phalanx.wire import pubsub
from phalanx.wire.session import Session, free_endpoint

SEALER = Sealer(b"bench")
TO_ALL = "all"
"""The peer's name on the key that neighbours subscribe to."""
WAYS = ("subscribed", "addressed")


def main() -> None:
    """Measure both ways alternately, and print the medians."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--neighbours", type=int, default=12)
    arguments.add_argument("--rounds", type=int, default=20)
    options = arguments.parse_args()
    names = [str(n) for n in range(options.neighbours + 1)]
    endpoint, context = free_endpoint(), multiprocessing.get_context("forkserver")
    answers = context.SimpleQueue()
    hub = context.Process(target=plant, args=(endpoint, names, options.rounds, answers))
    agents = [context.Process(target=agent, args=(endpoint, n, names, answers)) for n in names]
    for process in [hub, *agents]:
        process.start()
    times: dict[str, list[float]] = {}
    for _ in range(2 * options.rounds + len(names)):
        what, seconds = answers.get()
        times.setdefault(what, []).append(seconds)
    for process in [hub, *agents]:
        process.join()
    for what, values in sorted(times.items()):
        print(f"{what:10} {statistics.median(values) * 1e6:7.1f} µs")


def plant(
    endpoint: str, names: list[str], rounds: int, answers: "Answers[tuple[str, float]]"
) -> None:
    """Run the hub: alternate rounds of both ways, each of ten samples for every agent."""
    with bare.hub(endpoint, names) as hub:
        for turn in range(2 * rounds):
            way = WAYS[turn % 2]
            answers.put((way, bare.exchange(hub, way.encode(), 10 * len(names))))


def agent(
    endpoint: str, name: str, names: list[str], answers: "Answers[tuple[str, float]]"
) -> None:
    """Run an agent: answer each sample, and broadcast in the way that the sample names."""
    peers = [other for other in names if other != name]
    with bare.member(endpoint, name) as session:
        actuation = pubsub.publisher(session, KEYS.actuation(name))
        addressed = pubsub.Addressed(session)
        to_all = pubsub.publisher(session, KEYS.broadcast(name, TO_ALL))
        receivers = {
            "subscribed": [KEYS.broadcast(name, TO_ALL)],
            "addressed": [KEYS.broadcast(name, peer) for peer in peers],
        }

        def reply(_key: str, payload: bytes) -> None:
            done = Actuation(k=0, t_apply=0.0, u=(0.1, 0.2, 0.3))
            actuation.put(SEALER.seal(KEYS.actuation(name), done))
            broadcast = Broadcast(k=0, t_apply=0.0, u=(0.1, 0.2, 0.3))
            for key in receivers[payload.decode()]:
                if payload == b"subscribed":
                    to_all.put(SEALER.seal(key, broadcast))
                else:
                    addressed.put(key, SEALER.seal(key, broadcast))

        def hear(key: str, payload: bytes) -> None:
            SEALER.open(key, payload, Broadcast)

        for peer in peers:
            pubsub.subscribe(session, KEYS.broadcast(peer, TO_ALL), hear)
        pubsub.subscribe(session, KEYS.broadcast("*", name), hear)
        pubsub.subscribe(session, KEYS.sample(name), reply)
        for publisher in (actuation, to_all):
            pubsub.wait_for_listener(publisher, bare.PATIENCE)
        answers.put(("change", _seconds_of_a_change(session)))


def _seconds_of_a_change(session: Session) -> float:
    began = time.perf_counter()
    for k in range(50):
        key = KEYS.broadcast(f"neighbour-{k}", TO_ALL)
        session.declare_subscriber(key, lambda _: None).undeclare()  # type: ignore[no-untyped-call]
    return (time.perf_counter() - began) / 50


if __name__ == "__main__":
    main()

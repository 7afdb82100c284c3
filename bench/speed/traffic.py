"""Count the messages that one agent receives in a step, in swarms of one density and two sizes.

    python bench/speed/traffic.py --agents 32,256

Counted in each agent's process: all messages that Zenoh delivers, with their lengths. They depend
on how many agents it sees, which is printed too.
"""

import argparse
import multiprocessing
import statistics
from collections import Counter
from multiprocessing.queues import SimpleQueue as Answers

from lookahead import SIMPLE, plant
from phalanx_agent import main as agent

import phalanx
from phalanx.messages.keys import PLANT, kind_and_name
from phalanx.messages.kinds import Sample
from phalanx.messages.membership import Membership
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.wire import pubsub
from phalanx.wire.session import Session, free_endpoint


def main() -> None:
    """Run each size, and print a row of a table for each."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--agents", default="32,256", help="sizes, with commas between")
    arguments.add_argument("--duration", type=float, default=0.5, help="virtual time [s]")
    options = arguments.parse_args()
    print("| agents | seen | messages a step | bytes a step |\n|---|---|---|---|")
    for size in map(int, options.agents.split(",")):
        count = {"agents.0.count": size - size // 8, "agents.1.count": size // 8}
        scenario = phalanx.load("swarm", {**count, **SIMPLE, "duration": options.duration})
        rows = build_rows(build_swarm(scenario))
        agents = [counted for counted in received(rows) if counted["samples"] > 1]
        means = [
            statistics.mean(counted[what] / counted["samples"] for counted in agents)
            for what in ("seen", "messages", "bytes")
        ]
        print(f"| {size} | " + " | ".join(f"{mean:.1f}" for mean in means) + " |", flush=True)


def received(rows: SafetyRows) -> list[Counter[str]]:
    """Count, for each normal agent, samples, agents in them, all messages and their bytes."""
    context = multiprocessing.get_context("fork")
    membership = Membership("bench", free_endpoint(), b"bench", timeout=120.0)
    times, counts = context.SimpleQueue(), context.SimpleQueue()
    programs = [context.Process(target=plant, args=(rows, membership.of(PLANT), times))]
    for name in rows.swarm.names:
        member = membership.of(name, (name,), rows.swarm.names)
        programs.append(context.Process(target=counted_agent, args=(rows, member, counts)))
    for program in programs:
        program.start()
    times.get()
    counters = dict(counts.get() for _ in rows.swarm.names)
    for program in programs:
        program.join()
    return [counters[rows.swarm.names[i]] for i in rows.swarm.normal]


def counted_agent(
    rows: SafetyRows, membership: Membership, counts: "Answers[tuple[str, Counter[str]]]"
) -> None:
    """Run the agent, and count what its subscriptions deliver."""
    counted, sealer, subscribe = Counter[str](), membership.sealer, pubsub.subscribe

    def subscribe_and_count(session: Session, key: str, deliver: pubsub.Deliver) -> None:
        def count(at: str, payload: bytes) -> None:
            counted["messages"] += 1
            counted["bytes"] += len(payload)
            if kind_and_name(at)[0] == "sample":
                counted["samples"] += 1
                counted["seen"] += len(sealer.open(at, payload, Sample).seen)
            deliver(at, payload)

        subscribe(session, key, count)

    pubsub.subscribe = subscribe_and_count
    agent.run(rows, membership)
    counts.put((membership.identity, counted))


if __name__ == "__main__":
    main()

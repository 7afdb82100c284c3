"""Compare a run with the same run over HELICS: the bare exchange, and Simulation 1 whole.

    pip install -e '.[bench]' && python bench/peers/helics_peer.py [--rounds 3] [--core zmq_ss]

In both each agent and the plant is a process of its own. Over HELICS each is a federate with an
endpoint; the plant sends a sample and asks for the next time, which HELICS grants when an answer
has come. Controllers, plant, messages and their seals are the same code, and the kinds alternate.

exchange     from a payload of a sample's size to its answer, with an agent's other messages;
             nothing is computed
Simulation 1 wall time of one agent step of a whole run; a run must have the bits of the others
"""

import argparse
import contextlib
import importlib
import multiprocessing
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from phalanx_agent.answering import SampleAnswering
from phalanx_agent.step import Answer, ControlStep
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.run import PlantRun

import phalanx
from phalanx.faults.commands import NO_COMMANDS
from phalanx.launcher.engine import silent
from phalanx.launcher.simulation import DirectAgents, RecordsInMemory
from phalanx.messages.keys import PLANT
from phalanx.messages.kinds import Actuation, Sample, Telemetry
from phalanx.messages.membership import Membership
from phalanx.scenario.load import from_json
from phalanx.scenario.model import to_json
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array

sys.path.append(str(Path(__file__).parents[1] / "speed"))
from scale import in_new_process
from step import Sizes, measure_exchange, payload_sizes

h: Any = importlib.import_module("helics")
"""Loaded after CasADi, whose names it would replace by its own."""
_SAMPLE, _BROADCAST, _ACTUATION, _TELEMETRY, _OVER = (bytes([kind]) for kind in b"SBATO")
_FIRST = 1e-9
"""Least difference of two granted times [s]: HELICS counts exchanges, not virtual time."""
_END = 1e3
"""A time that no exchange reaches [s]."""


def main() -> None:
    """Measure in turns, and print a table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--rounds", type=int, default=3)
    arguments.add_argument("--duration", type=float, default=4.0, help="virtual time [s]")
    arguments.add_argument("--core", default="zmq_ss", help="of HELICS: zmq, zmq_ss, tcp_ss, ipc")
    options = arguments.parse_args()
    scenario = phalanx.load("unicycles", {"duration": options.duration})
    sizes, rounds, hashes = payload_sizes(scenario), [], set[str]()
    for _ in range(options.rounds):
        ours = phalanx.run(scenario).summary
        assert ours is not None
        theirs = in_new_process(whole, to_json(scenario), options.core)
        hashes |= {ours.trajectory, theirs.trajectory}
        rounds.append(
            (
                measure_exchange(scenario, ours.steps, sizes),
                in_new_process(exchange, to_json(scenario), options.core, sizes, ours.steps),
                ours.wall_time / ours.steps,
                theirs.wall_time / theirs.steps,
            )
        )
    print("| | Phalanx [µs] | HELICS [µs] | ratio of each round |")
    print("|---|---|---|---|")
    columns = list(zip(*rounds, strict=True))
    for name, a, b in (("exchange", *columns[:2]), ("Simulation 1", *columns[2:])):
        middle = [f"{statistics.median(own) * 1e6:.0f}" for own in (a, b)]
        ratios = ", ".join(f"{theirs / ours:.2f}" for ours, theirs in zip(a, b, strict=True))
        print(f"| {name} | {middle[0]} | {middle[1]} | {ratios} |")
    print("trajectories:", "the same bits" if len(hashes) == 1 else "DIFFERENT")


class Federate:
    """One program, with an endpoint of its name."""

    def __init__(self, name: str, core: str) -> None:
        info = h.helicsCreateFederateInfo()
        h.helicsFederateInfoSetCoreTypeFromString(info, core)
        h.helicsFederateInfoSetCoreInitString(info, "--federates=1")
        h.helicsFederateInfoSetTimeProperty(info, h.HELICS_PROPERTY_TIME_DELTA, _FIRST)
        self._federate = h.helicsCreateMessageFederate(name, info)
        self._endpoint = h.helicsFederateRegisterGlobalEndpoint(self._federate, name, "")
        h.helicsFederateEnterExecutingMode(self._federate)

    def send(self, to: str, payload: bytes) -> None:
        """Send a payload at the granted time."""
        h.helicsEndpointSendBytesTo(self._endpoint, payload, to)

    def received(self) -> Iterator[tuple[str, bytes]]:
        """Ask for the time of the next message; yield those that came, with their senders."""
        h.helicsFederateRequestTime(self._federate, _END)
        while h.helicsEndpointHasMessage(self._endpoint):
            message = h.helicsEndpointGetMessage(self._endpoint)
            yield h.helicsMessageGetSource(message), h.helicsMessageGetBytes(message)

    def close(self) -> None:
        """Leave the federation."""
        h.helicsFederateDisconnect(self._federate)
        h.helicsFederateFree(self._federate)


@contextlib.contextmanager
def federation(
    names: Sequence[str], core: str, agent: Callable[..., None], *arguments: object
) -> Iterator[Federate]:
    """Fork an agent's program for each name; yield the plant's federate, which ends them all."""
    context = multiprocessing.get_context("fork")
    count = len(names) + 1
    broker = context.Process(target=_serve, args=(core, count))
    agents = [context.Process(target=agent, args=(core, name, *arguments)) for name in names]
    for process in (broker, *agents):
        process.start()
    plant = Federate(PLANT, core)
    try:
        yield plant
    finally:
        for name in names:
            plant.send(name, _OVER)
        plant.close()
        for process in (*agents, broker):
            process.join()


def _serve(core: str, count: int) -> None:
    broker = h.helicsCreateBroker(core, "", f"--federates={count}")
    h.helicsBrokerWaitForDisconnect(broker, -1)
    h.helicsCloseLibrary()


def exchange(scenario: str, core: str, sizes: Sizes, steps: int) -> float:
    """Measure the time from a payload of a sample's size to its answer [s]."""
    swarm = build_swarm(from_json(scenario))
    normal = [swarm.names[i] for i in swarm.normal]
    with federation(swarm.names, core, _echo, normal, sizes) as plant:
        began = time.perf_counter()
        for k in range(steps):
            plant.send(swarm.names[k % len(swarm.names)], _SAMPLE + bytes(sizes.sample))
            answered = False
            while not answered:
                answered = _ACTUATION in [payload[:1] for _, payload in plant.received()]
        return (time.perf_counter() - began) / steps


def _echo(core: str, name: str, normal: list[str], sizes: Sizes) -> None:
    federate, over = Federate(name, core), False
    while not over:
        for _, payload in federate.received():
            over |= payload[:1] == _OVER
            if payload[:1] == _SAMPLE:
                federate.send(PLANT, _ACTUATION + bytes(sizes.actuation))
                for peer in normal:
                    if peer != name:
                        federate.send(peer, _BROADCAST + bytes(sizes.broadcast))
                federate.send(PLANT, _TELEMETRY + bytes(sizes.telemetry))
    federate.close()


class Ended(NamedTuple):
    """A finished run."""

    trajectory: str
    steps: int
    wall_time: float


def whole(scenario: str, core: str) -> Ended:
    """Run a scenario over HELICS."""
    rows = require_runnable(build_swarm(from_json(scenario)))
    compile_rows(rows)
    membership = Membership("helics", endpoint="", secret=b"bench")
    with federation(rows.swarm.names, core, _answer, rows, membership) as federate:
        agents = FederateAgents(rows, federate, membership)
        commands = CommandQueue(NO_COMMANDS, rows.swarm.names)
        summary = PlantRun(rows, agents, RecordsInMemory(), commands, Lockstep).run()
    return Ended(summary.trajectory, summary.steps, summary.wall_time)


def _answer(core: str, name: str, rows: SafetyRows, membership: Membership) -> None:
    """Run an agent: its control step is that of every engine."""
    swarm = rows.swarm
    member = membership.of(name, swarm.programs.get(name, ()), swarm.names)
    keys, sealer = member.keys, member.sealer
    federate = Federate(name, core)

    def send(answer: Answer) -> None:
        key = keys.actuation(name)
        federate.send(PLANT, _ACTUATION + sealer.seal(key, answer.actuation))
        for l, broadcast in answer.broadcasts.items():
            peer = swarm.names[l]
            sealed = sealer.seal(keys.broadcast(name, peer), broadcast)
            federate.send(peer, _BROADCAST + sealed)
        federate.send(PLANT, _TELEMETRY + sealer.seal(keys.telemetry(name), answer.telemetry))

    step = ControlStep(rows, swarm.names.index(name), membership=member)
    answering, over = SampleAnswering(step, sealer, send, lambda: None), False
    while not over and answering.error is None:
        for sender, payload in federate.received():
            over |= payload[:1] == _OVER
            if payload[:1] == _SAMPLE:
                answering.on_sample(keys.sample(name), payload[1:])
            elif payload[:1] == _BROADCAST:
                answering.on_broadcast(keys.broadcast(sender, name), payload[1:])
    federate.close()
    if answering.error is not None:
        raise answering.error


class FederateAgents(DirectAgents):
    """The agents of one run, each a federate."""

    def __init__(self, rows: SafetyRows, federate: Federate, membership: Membership) -> None:
        super().__init__(rows, silent)
        self._federate = federate
        self._key_of, self._sealer = membership.keys, membership.sealer
        self._index = {name: i for i, name in enumerate(rows.swarm.names)}

    def send_sample(self, i: int, sample: Sample) -> None:
        """Send agent i its sample."""
        name = self._names[i]
        sealed = self._sealer.seal(self._key_of.sample(name), sample)
        self._federate.send(name, _SAMPLE + sealed)

    def await_input(self, i: int) -> Array:
        """Wait for agent i's input for its last sample."""
        while i not in self._inputs:
            self._receive()
        return self._inputs.pop(i)

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """Wait for agent i's report on sample k."""
        while (i, k) not in self._telemetry:
            self._receive()
        return self._telemetry.pop((i, k))

    def _receive(self) -> None:
        for name, payload in self._federate.received():
            i = self._index[name]
            if payload[:1] == _ACTUATION:
                key = self._key_of.actuation(name)
                self._inputs[i] = np.array(self._sealer.open(key, payload[1:], Actuation).u)
            else:
                key = self._key_of.telemetry(name)
                report = self._sealer.open(key, payload[1:], Telemetry)
                self._telemetry[i, report.k] = report


if __name__ == "__main__":
    main()

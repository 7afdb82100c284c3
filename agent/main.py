"""The agent's shell: a Zenoh client that answers samples until the hub is gone."""

import gc
import logging
import os
import signal
import threading
from collections.abc import Callable

from agent.step import ControlStep
from phalanx.scenario.load import digest
from phalanx.scenario.model import Scenario
from phalanx.scenario.swarm import build_swarm
from phalanx.wire import session as wire
from phalanx.wire.keys import PLANT, Keys, sender
from phalanx.wire.messages import Input, Malformed, Sample, Sealer

log = logging.getLogger("phalanx.agent")


def run(
    scenario: Scenario, name: str, *, run_id: str, endpoint: str, secret: bytes, timeout: float
) -> int:
    """Run one agent until the plant leaves.

    Args:
        scenario: resolved; its digest must be the plant's.
        name: which of the scenario's agents to be.
        run_id: the run to join.
        endpoint: the hub's Zenoh endpoint.
        secret: the run's secret, for the seal.
        timeout: how long to try to reach the hub [s of wall time].

    Returns:
        Exit status 0.

    Raises:
        HubError: the hub cannot be reached. Exception: whatever a control step raised.
    """
    swarm = build_swarm(scenario)
    step = ControlStep(swarm, swarm.names.index(name))
    keys, sealer = Keys(run_id), Sealer(secret)
    over = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: over.set())
    with wire.open_client(endpoint, timeout) as session:
        publisher = wire.publisher(session, keys.input(name))
        answering = Answering(
            step, sealer, lambda i: publisher.put(sealer.seal(keys.input(name), i)), over.set
        )
        for other in step.listens_to:
            wire.subscribe(session, keys.input(other), answering.on_broadcast)
        wire.subscribe(session, keys.sample(name), answering.on_sample)
        wire.watch(session, keys.alive(PLANT), lambda _, alive: None if alive else over.set())
        wire.wait_for_listener(publisher, timeout)
        gc.freeze()
        _token = wire.announce(session, keys.alive(name, digest(scenario)))
        log.info("joined run %s at %s", run_id, endpoint)
        over.wait()
    log.info("left; %d payloads were rejected", step.rejected)
    if answering.error is not None:
        raise answering.error
    return 0


class Answering:
    """Answers each sample in Zenoh's own thread, the shortest way from a sample to its input.

    A sample is answered once every broadcast that it counts is here. What cannot be a message of
    this run is dropped and counted.
    """

    def __init__(
        self,
        step: ControlStep,
        sealer: Sealer,
        broadcast: Callable[[Input], None],
        give_up: Callable[[], None],
    ) -> None:
        self.error: Exception | None = None
        """What ended the answering, if a control step did."""
        self._step, self._sealer = step, sealer
        self._broadcast, self._give_up = broadcast, give_up
        self._pending: Sample | None = None

    def on_sample(self, key: str, payload: bytes) -> None:
        """Take a sample."""
        try:
            sample = self._step.accept_sample(self._sealer.open(key, payload, Sample))
        except Malformed as reason:
            self._drop(key, reason)
        else:
            if sample.orders and sample.orders.die:
                os.kill(os.getpid(), signal.SIGKILL)
            self._pending = sample
            self._answer_if_complete()

    def on_broadcast(self, key: str, payload: bytes) -> None:
        """Take another agent's broadcast."""
        try:
            message = self._sealer.open(key, payload, Input)
            self._step.accept_broadcast(sender(key), message)
        except Malformed as reason:
            self._drop(key, reason)
        else:
            self._answer_if_complete()

    def _answer_if_complete(self) -> None:
        sample = self._pending
        if sample is None or self._step.inbox.missing(sample.latest):
            return
        self._pending = None
        try:
            self._broadcast(self._step(sample))
        except Exception as error:  # a user's law may raise anything, and Zenoh would swallow it
            self.error = error
            self._give_up()

    def _drop(self, key: str, reason: Malformed) -> None:
        self._step.rejected += 1
        log.warning("dropped a payload on %s: %s", key, reason)

"""The agent's shell: a Zenoh client that answers samples until the hub is gone."""

import gc
import logging
import os
import signal
import threading
from collections.abc import Callable

from phalanx.agent.step import ControlStep, control_steps
from phalanx.scenario.load import digest
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import build_swarm
from phalanx.wire import session as wire
from phalanx.wire.keys import PLANT, Keys, sender
from phalanx.wire.messages import Input, Malformed, Sample, Sealer

log = logging.getLogger("phalanx.agent")


def run(
    scenario: Scenario, name: str, *, run_id: str, endpoint: str, secret: bytes, timeout: float
) -> int:
    """Run one agent, or the controller of several, until the plant leaves.

    Args:
        scenario: resolved; its digest must be the plant's.
        name: which of the scenario's programs to be.
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
    steps = control_steps(swarm, name)
    keys, sealer = Keys(run_id), Sealer(secret)
    over = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: over.set())
    with wire.open_client(endpoint, timeout) as session:
        publishers = [wire.publisher(session, keys.input(step.name)) for step in steps]
        answerings = [
            Answering(step, sealer, _broadcast(publisher, sealer), over.set, alone=len(steps) == 1)
            for step, publisher in zip(steps, publishers, strict=True)
        ]
        for step, answering in zip(steps, answerings, strict=True):
            for other in step.listens_to:
                wire.subscribe(session, keys.input(other), answering.on_broadcast)
            wire.subscribe(session, keys.sample(step.name), answering.on_sample)
        wire.watch(session, keys.alive(PLANT), lambda _, alive: None if alive else over.set())
        for publisher in publishers:
            wire.wait_for_listener(publisher, timeout)
        gc.freeze()
        known = digest(scenario)
        _tokens = [wire.announce(session, keys.alive(step.name, known)) for step in steps]
        log.info("joined run %s at %s", run_id, endpoint)
        over.wait()
    log.info("left; %d payloads were rejected", sum(step.rejected for step in steps))
    for answering in answerings:
        if answering.error is not None:
            raise answering.error
    return 0


def _broadcast(publisher: wire.Publisher, sealer: Sealer) -> Callable[[Input], None]:
    key = str(publisher.key_expr)
    return lambda message: publisher.put(sealer.seal(key, message))


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
        alone: bool = True,
    ) -> None:
        """alone: whether this process is the agent, and dies with it when ordered to."""
        self.error: Exception | None = None
        """What ended the answering, if a control step did."""
        self._step, self._sealer = step, sealer
        self._broadcast, self._give_up = broadcast, give_up
        self._alone = alone
        self._pending: Sample | None = None

    def on_sample(self, key: str, payload: bytes) -> None:
        """Take a sample."""
        try:
            sample = self._step.accept_sample(self._sealer.open(key, payload, Sample))
        except Malformed as reason:
            self._drop(key, reason)
        else:
            if not (sample.orders and sample.orders.die):
                self._pending = sample
                self._answer_if_complete()
            elif self._alone:
                os.kill(os.getpid(), signal.SIGKILL)

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

"""The plant's side of the wire: the hub all programs meet in, samples out, inputs in."""

import logging
import queue
import time
from collections import Counter
from collections.abc import Callable
from typing import Self

from phalanx.plant.actuators import Actuators
from phalanx.scenario.load import digest, to_json
from phalanx.swarm.swarm import Swarm
from phalanx.wire import session as wire
from phalanx.wire.frames import Setup
from phalanx.wire.keys import PLANT, Keys, sender
from phalanx.wire.messages import VERSION, Input, Malformed, Message, Sample, Sealer

log = logging.getLogger("phalanx.plant")

_POLL = 0.2
"""How often a wait looks up to see whether the run was stopped [s]."""


class SwarmBrokenError(RuntimeError):
    """An agent is missing, dead or silent; the message names it."""


class Hub:
    """Samples to agents and inputs from them, each checked against what may come next."""

    def __init__(
        self,
        swarm: Swarm,
        run_id: str,
        endpoint: str,
        secret: bytes,
        check_stop: Callable[[], None],
    ) -> None:
        """Listen on the endpoint.

        check_stop is called at every wait and may raise to end the run. Raises HubError.
        """
        self._admissible = Actuators(swarm).admissible
        self.rejected: Counter[str] = Counter()
        self._timeout = swarm.scenario.time.timeout
        self._check_stop = check_stop
        self._keys, self._sealer = Keys(run_id), Sealer(secret)
        self._names = swarm.names
        self._scenario = swarm.scenario
        self._digest = digest(swarm.scenario)
        self._sizes = [len(m.dynamics.inputs) for m in swarm.members]
        self._latency = swarm.scenario.time.latency
        self._events: queue.SimpleQueue[tuple[str, bytes | bool]] = queue.SimpleQueue()
        self._joined: set[str] = set()
        self._expected: dict[int, Sample] = {}
        self._answers: dict[int, Input] = {}
        self._heard: set[int] = set()
        self._dismissed: set[str] = set()
        self._session = wire.open_hub(endpoint)
        self._samples = [
            wire.publisher(self._session, self._keys.sample(name)) for name in self._names
        ]
        self._status = wire.publisher(self._session, self._keys.status)
        self._verdict = wire.publisher(self._session, self._keys.verdict)
        wire.subscribe(self._session, self._keys.input("*"), lambda *m: self._events.put(m))
        wire.watch(self._session, self._keys.alive("*"), lambda *m: self._events.put(m))
        self._token = wire.announce(self._session, self._keys.alive(PLANT, self._digest))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def wait_for_agents(self, waiting_for: Callable[[tuple[str, ...]], None]) -> None:
        """Return when every agent has joined with this very scenario.

        Args:
            waiting_for: told who is missing, whenever that changes.

        Raises:
            SwarmBrokenError: an agent does not come, leaves, or runs another scenario.
        """
        deadline = time.monotonic() + self._timeout
        while missing := tuple(n for n in self._names if n not in self._joined):
            waiting_for(missing)
            self._take_event(deadline, f"agent {', '.join(missing)} did not join")
        waiting_for(())

    def send_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample; one that is to die is not missed."""
        self._expected[i] = sample
        if sample.orders and sample.orders.die:
            self._dismissed.add(self._names[i])
        self._put(self._samples[i], sample)

    def await_input(self, i: int) -> Input:
        """Agent i's answer to its sample.

        Raises:
            SwarmBrokenError: the agent died, or does not answer in time.
        """
        deadline = time.monotonic() + self._timeout
        while i not in self._answers:
            k = self._expected[i].k
            self._take_event(deadline, f"agent {self._names[i]} did not answer sample {k}")
        return self._answers.pop(i)

    def open_view(self, commandable: bool) -> "Viewers":
        """Answer viewers that ask for the scenario, and be ready to show them frames."""
        setup = Setup(VERSION, to_json(self._scenario).encode(), commandable)
        key = self._keys.scenario
        wire.answer(self._session, key, self._sealer.seal(key, setup))
        return Viewers(wire.view_publisher(self._session, self._keys.view), self._sealer)

    def listen_for_commands(self, deliver: wire.Deliver) -> None:
        """Deliver commands in a thread of Zenoh's."""
        wire.subscribe(self._session, self._keys.control, deliver)

    def publish_status(self, message: Message) -> None:
        """Tell whoever watches how far the run is."""
        self._put(self._status, message)

    def publish_verdict(self, message: Message) -> None:
        """Tell whoever watches how the run ended."""
        self._put(self._verdict, message)

    def _put(self, publisher: wire.Publisher, message: Message) -> None:
        publisher.put(self._sealer.seal(str(publisher.key_expr), message))

    def _take_event(self, deadline: float, complaint: str) -> None:
        self._check_stop()
        if time.monotonic() > deadline:
            dropped = ", ".join(f"{n} {reason}" for reason, n in self.rejected.items())
            because = f" (dropped payloads: {dropped})" if dropped else ""
            raise SwarmBrokenError(f"{complaint} within {self._timeout:g} s{because}")
        try:
            key, content = self._events.get(timeout=_POLL)
        except queue.Empty:
            return
        if isinstance(content, bool):
            self._on_token(key, content)
            return
        try:
            self._on_input(sender(key), self._sealer.open(key, content, Input))
        except Malformed as reason:
            self.rejected[str(reason)] += 1
            log.warning("dropped a payload on %s: %s", key, reason)

    def _on_token(self, key: str, alive: bool) -> None:
        name, found = sender(key), key.rsplit("/", 1)[1]
        if name not in self._names:
            return
        if name in self._joined:
            if not alive and found == self._digest and name not in self._dismissed:
                raise SwarmBrokenError(f"agent {name} died")
        elif alive and found != self._digest:
            raise SwarmBrokenError(
                f"agent {name} runs another scenario: expected digest {self._digest}, got {found}"
            )
        elif alive:
            self._joined.add(name)

    def _on_input(self, name: str, message: Input) -> None:
        if name not in self._names:
            raise Malformed("unknown sender")
        i = self._names.index(name)
        if len(message.u) != self._sizes[i] or len(message.ages) != len(self._names):
            raise Malformed("wrong size")
        if any(age is not None and l not in self._heard for l, age in enumerate(message.ages)):
            raise Malformed("unknown sender")
        if any(not 0 <= fate.sender < len(self._names) for fate in message.fates):
            raise Malformed("unknown sender")
        sample = self._expected.get(i)
        if sample is None or message.k != sample.k or i in self._answers:
            raise Malformed("out of order")
        if message.t != sample.t or message.t_apply != sample.t + self._latency:
            raise Malformed("wrong time")
        if not self._admissible(i, sample, message):
            raise Malformed("outside U")
        self._answers[i] = message
        self._heard.add(i)


class Viewers:
    """Everybody who subscribed to the run's frames."""

    def __init__(self, publisher: wire.Publisher, sealer: Sealer) -> None:
        self._publisher, self._sealer = publisher, sealer

    @property
    def present(self) -> bool:
        """Whether there is anybody."""
        matching: bool = self._publisher.matching_status.matching  # type: ignore[attr-defined]
        return matching

    def show(self, frame: Message) -> None:
        """Put a frame; lost on viewers that are slow."""
        self._publisher.put(self._sealer.seal(str(self._publisher.key_expr), frame))

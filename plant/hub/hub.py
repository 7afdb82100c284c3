"""The plant's side of the wire: the hub all programs meet in, samples out, answers in."""

import contextlib
import logging
import queue
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar, Self, TypeVar

import msgspec

from phalanx.plant.events.stop import SwarmBrokenError
from phalanx.plant.hub.answers import Answers
from phalanx.plant.hub.arrivals import Arrivals
from phalanx.plant.hub.joining import Joining
from phalanx.plant.hub.places import Places, signer
from phalanx.profile.stopwatch import Stopwatch
from phalanx.scenario.load import to_json
from phalanx.swarm.swarm import Swarm
from phalanx.wire import liveliness, pubsub, queries
from phalanx.wire.admission import admission
from phalanx.wire.copies import Copies
from phalanx.wire.frames import Setup
from phalanx.wire.keys import PLANT, ROUTER
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Actuation, Message, PlaceRequest, Sample, Status, Telemetry
from phalanx.wire.refusals import Refusals
from phalanx.wire.seal import Malformed, Sealer
from phalanx.wire.session import Session, open_hub, open_member

log = logging.getLogger("phalanx.plant")

_AWAY = 4.0
"""How long an agent may lose the hub before the run begins [s]."""
POLL = 0.2
"""How often a wait looks up to see whether the run was stopped [s]."""

T = TypeVar("T")


class Hub(ABC):
    """Samples to agents and answers from them, each checked against what may come next."""

    may_leave: ClassVar[bool]
    """Whether agents that joined may go, and come back."""

    def __init__(
        self,
        swarm: Swarm,
        membership: Membership,
        check_stop: Callable[[], None],
        at_router: bool = False,
    ) -> None:
        """Listen on the membership's endpoint, or meet the others at the router that does.

        check_stop is called at every wait and may raise to end the run. Raises HubError.
        """
        self.refusals = Refusals(log)
        """Payloads dropped."""
        self._timeout = swarm.scenario.time.timeout
        self._check_stop = check_stop
        self._keys, self._sealer = membership.keys, membership.sealer
        self._names, self._scenario = swarm.names, swarm.scenario
        self._joining, self._answers = Joining(swarm, self.may_leave), Answers(swarm)
        programs = swarm.programs.values()
        self._alone = {swarm.names.index(who[0]) for who in programs if len(who) == 1}
        """The agents that have a process of their own."""
        self._stopped: set[str] = set()
        self._told = Status()
        """The last status."""
        keys = self._keys
        self._from: dict[str, tuple[int, type[Actuation | Telemetry]]] = {}
        for i, name in enumerate(self._names):
            self._from[keys.actuation(name)] = i, Actuation
            self._from[keys.telemetry(name)] = i, Telemetry
        """By key expression, which agent sends what there."""
        self._arrivals = Arrivals(self._from, self.refusals, self._require_awaited)
        self._session = _open(swarm, membership, at_router)
        self._sample_keys = [keys.sample(name) for name in self._names]
        self._samples = [pubsub.urgent_publisher(self._session, key) for key in self._sample_keys]
        self._copies = Copies(self._session, keys, keys.sample("*"))
        self._status = pubsub.notice_publisher(self._session, keys.status)
        self._verdict = pubsub.notice_publisher(self._session, keys.verdict)
        for every in (keys.actuation("*"), keys.telemetry("*")):
            pubsub.subscribe(self._session, every, self._arrivals.put_payload)
        liveliness.watch(self._session, keys.alive("*"), self._arrivals.put_token)
        self._give_places(membership, swarm)
        self._token = liveliness.announce(self._session, keys.alive(PLANT, self._joining.digest))

    def _give_places(self, membership: Membership, swarm: Swarm) -> None:
        key, joining, sign = self._keys.place, self._joining, signer(membership.certificates)
        places = Places(swarm.programs, joining.vacant, joining.digest, sign)

        def answer(question: bytes) -> bytes | None:
            try:
                request = self._sealer.open(key, question, PlaceRequest)
            except Malformed as reason:
                self.refusals.add(key, reason)
                return None
            return self._sealer.seal(key, places.answer(request))

        queries.answer_each(self._session, key, answer)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def time(self, stopwatch: Stopwatch) -> None:
        """Have the stopwatch tell sending, opening answers, and waiting for reports apart."""
        stopwatch.time(self, "send_sample", "send")
        stopwatch.time(self, "_on_message", "receive")
        stopwatch.time(self, "await_telemetry", "wait")

    def wait_for_agents(self, waiting_for: Callable[[tuple[str, ...]], None]) -> None:
        """Return when every agent has joined with this very scenario.

        Args:
            waiting_for: told who is missing, whenever that changes.

        Raises:
            SwarmBrokenError: an agent does not come, leaves, or runs another scenario.
        """
        deadline = time.monotonic() + self._timeout
        while missing := self._not_there():
            waiting_for(missing)
            self._take_event(deadline, f"agent {', '.join(missing)} did not join")
            for name in self._joining.gone_for(_AWAY):
                raise SwarmBrokenError(f"agent {name} died: see its log")
        self._joining.begin()
        waiting_for(())

    def _not_there(self) -> tuple[str, ...]:
        """Who has not joined, or does not hear yet: at a router that may be known later."""
        if missing := self._joining.missing():
            return missing
        samples = zip(self._names, self._samples, strict=True)
        return tuple(name for name, publisher in samples if not pubsub.has_listener(publisher))

    def send_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample."""
        self._answers.expect(i, sample)
        self._put_sample(i, sample)

    def pause(self, i: int, t: float) -> None:
        """Ask for agent i's process to be stopped; one that decides for others too goes on."""
        if i in self._alone:
            self._stopped.add(self._names[i])
            self.publish_status(msgspec.structs.replace(self._told, t=t))

    def resume(self, i: int, t: float) -> None:
        """Ask for agent i's process to go on."""
        self._stopped.discard(self._names[i])
        self.publish_status(msgspec.structs.replace(self._told, t=t))

    def kill(self, i: int, order: Sample) -> None:
        """Have agent i's process die of this order; one that decides for others too lives on."""
        if self._names[i] in self._stopped:
            self.resume(i, order.t)
        if i in self._alone:
            self._joining.dismiss(self._names[i])
            self._put_sample(i, order)

    def restart(self, i: int, t: float) -> None:
        """Ask for another process in the dead agent i's place at t [s]."""
        if i in self._alone:
            self._joining.invite(self._names[i])
            wanted = (self._names[i],)
            self.publish_status(Status(t=t, waiting_for=wanted, restart=True))

    def await_telemetry(self, i: int, k: int) -> Telemetry:
        """How agent i made its input for sample k.

        Raises SwarmBrokenError: the agent died, or does not report in time.
        """
        return self._await(i, lambda: self._answers.take_telemetry(i, k), "did not report on")

    def open_view(self, commandable: bool) -> "Viewers":
        """Answer viewers that ask for the scenario, and be ready to show them frames."""
        setup = Setup(scenario=to_json(self._scenario).encode(), commandable=commandable)
        key = self._keys.scenario
        queries.answer(self._session, key, self._sealer.seal(key, setup))
        return Viewers(pubsub.view_publisher(self._session, self._keys.frames), self._sealer)

    def listen_for_commands(self, deliver: pubsub.Deliver) -> None:
        """Deliver commands in a thread of Zenoh's."""
        pubsub.subscribe(self._session, self._keys.command, deliver)

    def publish_status(self, message: Status) -> None:
        """Tell whoever watches how far the run is."""
        self._told = msgspec.structs.replace(message, stopped=tuple(sorted(self._stopped)))
        self._put(self._status, self._told)

    def publish_verdict(self, message: Message) -> None:
        """Tell whoever watches how the run ended."""
        self._put(self._verdict, message)

    def _put_sample(self, i: int, sample: Sample) -> None:
        key = self._sample_keys[i]
        payload = self._sealer.seal(key, sample)
        self._samples[i].put(payload)
        self._copies.put(key, payload)

    def _put(self, publisher: pubsub.Publisher, message: Message) -> None:
        publisher.put(self._sealer.seal(str(publisher.key_expr), message))

    def _await(self, i: int, take: Callable[[], T | None], failed_to: str) -> T:
        deadline = time.monotonic() + self._timeout
        while (found := take()) is None:
            k = self._answers.expected(i)
            self._take_event(deadline, f"agent {self._names[i]} {failed_to} sample {k}")
        return found

    def _take_event(self, deadline: float, complaint: str) -> None:
        self._check_stop()
        if time.monotonic() > deadline:
            dropped = ", ".join(f"{n} {reason}" for reason, n in self.refusals.counts.items())
            because = f" (dropped payloads: {dropped})" if dropped else ""
            hint = "see its log, or raise time.timeout"
            raise SwarmBrokenError(f"{complaint} within {self._timeout:g} s{because}: {hint}")
        with contextlib.suppress(queue.Empty):
            self._handle(*self._arrivals.get(timeout=POLL))

    def _handle_arrived(self) -> None:
        # Those that are there now: more may come faster than they are handled.
        for _ in range(self._arrivals.waiting):
            self._handle(*self._arrivals.get(timeout=0.0))

    def _handle(self, key: str, content: bytes | bool) -> None:
        if isinstance(content, bool):
            if broken := self._joining.on_token(key, content):
                raise SwarmBrokenError(broken)
            return
        try:
            self._on_message(key, content)
        except Malformed as reason:
            self.refusals.add(key, reason)

    def _opened(self, key: str, payload: bytes) -> tuple[int, Actuation | Telemetry]:
        i, kind = self._from[key]
        return i, self._sealer.open(key, payload, kind)

    def _require_awaited(self, key: str, payload: bytes) -> None:
        self._answers.require_awaited(*self._opened(key, payload))

    def _on_message(self, key: str, payload: bytes) -> None:
        i, answer = self._opened(key, payload)
        if isinstance(answer, Actuation):
            self._answers.on_actuation(i, answer)
            return
        self._answers.on_telemetry(i, answer)
        if answer.failed:
            self._on_failure(i, _as_said_by(self._names[i], answer.failed))

    @abstractmethod
    def _on_failure(self, i: int, words: str) -> None:
        """Agent i says, in these words, that it answers no more."""


def _as_said_by(name: str, failure: str) -> str:
    """An agent's words, which are of itself, as text that a terminal can show."""
    shown = "".join(c if c.isprintable() else " " for c in failure)
    return shown if f"agent {name} " in shown else f"agent {name}: {shown}"


def _open(swarm: Swarm, membership: Membership, at_router: bool) -> Session:
    if not at_router:
        return open_hub(membership.endpoint, admission(swarm, membership))
    router = membership.keys.alive(ROUTER)
    return open_member(membership.endpoint, router, membership.timeout, membership.credentials)


class Viewers:
    """Everybody who subscribed to the run's frames."""

    def __init__(self, publisher: pubsub.Publisher, sealer: Sealer) -> None:
        self._publisher, self._sealer = publisher, sealer

    @property
    def present(self) -> bool:
        """Whether there is anybody."""
        matching: bool = self._publisher.matching_status.matching  # type: ignore[attr-defined]
        return matching

    def show(self, frame: Message) -> None:
        """Put a frame; lost on viewers that are slow."""
        self._publisher.put(self._sealer.seal(str(self._publisher.key_expr), frame))

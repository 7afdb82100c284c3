"""Malformed messages under a valid seal, for every receiver of a run.

A receiver takes a message, or drops and counts it; anything else is a fault.
"""

import contextlib
import random
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import msgspec
from phalanx_agent.answering import SampleAnswering
from phalanx_agent.step import Answer, ControlStep
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.hub.answers import Answers
from phalanx_viewer.feeds.live import check_frame
from phalanx_viewer.feeds.live_history import LiveHistory
from phalanx_viewer.scene.model import scene_model

from phalanx.faults.commands import ActiveCommands, Command, CommandKind, CommandPolicy
from phalanx.guarantee.verdict import CertificateSummary, Outcome, Summary, read_summary
from phalanx.messages.frames import AgentStatus, CommandMessage, Frame, LinkEvent, LogLine
from phalanx.messages.keys import Keys
from phalanx.messages.kinds import Actuation, Broadcast, Ended, Message, Sample, Status, Telemetry
from phalanx.messages.seal import Malformed, Sealer
from phalanx.messages.step_report import AppliedStep, StepReport
from phalanx.network.inbox import AnnouncedInput, DeliveryReport
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.rows.origin import Origin
from tests.hostile.mutation import of_bytes, of_tree

KEYS = Keys("run")
SEALER = Sealer(b"the run's secret")
SCENARIO = load("unicycles", ["duration=1000.0"])
ME, PEER = 0, 1
SUMMARY = Summary(
    outcome=Outcome.SAFE, reason="", t=1.0, seed=0, trajectory="", worst_h=-1.0, worst_at=0.5,
    worst_pair="1-2", largest_h_tot=-0.9, largest_h_tot_at=0.5,
    steps=100, origins={"qp": 100}, assumptions=[], theorem=[],
    certificates=CertificateSummary(), violations=[], rejected={}, wall_time=1.0,
)  # fmt: skip


class Receiver(NamedTuple):
    """One way in."""

    key: str
    good: Callable[[int], Message]
    """The n-th message as it would be right."""
    take: Callable[[str, bytes], bool]
    """Whether a payload was taken; False: dropped and counted. Raises what the program would."""


@cache
def _swarm() -> Any:
    return build_swarm(SCENARIO)


def _state() -> bytes:
    state: bytes = _swarm().start().astype("<f8").tobytes()
    return state


def _sample(k: int) -> Sample:
    everybody = tuple(range(len(_swarm().names)))
    return Sample(
        k=k, t=0.01 * k, seen=everybody, x=_state(), hearers=(1, 2),
        commands=ActiveCommands(loss=0.1, delay=0.01) if k % 2 else None,
    )  # fmt: skip


def _telemetry(k: int) -> Telemetry:
    report = StepReport(origin=Origin.QP, residual=-0.5, u_nom=(0.5, 0.1), solve_time=1e-4)
    return Telemetry(
        k=k, report=report, ages=((1, 0.01), (2, 0.02)), rejected=3,
        fates=(DeliveryReport(PEER, k, 0.01, claim=AnnouncedInput(0.01 * k, (0.1, 0.1))),),
    )  # fmt: skip


def _frame(k: int) -> Frame:
    step = AppliedStep(
        origin=Origin.QP, residual=0.0, u_nom=(0.1, 0.2), solve_time=0.0, u=(0.1, 0.2),
        oldest_input=0.1,
    )  # fmt: skip
    agents = tuple(AgentStatus(step=step) for _ in _swarm().names)
    return Frame(
        t=0.01 * k, x=_state(), h_tot=-1.0, h=-1.1, worst_h=-0.5, pair=2, turned=(1,),
        agents=agents,
        link_events=(LinkEvent(0, 1, 0.1),), steps=k, real_time_factor=1.0, assumptions=(),
        violations=(), log=(LogLine(0.0, "begun"),), paused=False, speed=0.0, loss=None, delay=None,
    )  # fmt: skip


def _plant() -> list[Receiver]:
    """The plant's: two kinds of answers, and commands."""
    answers = Answers(_swarm(), KEYS, SEALER)
    commands = CommandQueue(CommandPolicy(secret=b"c"), _swarm().names)

    def actuation(k: int) -> Actuation:
        answers.expect(ME, _sample(k))
        return Actuation(k=k, t_apply=0.01 * k, u=(0.1, 0.1))

    def telemetry(k: int) -> Telemetry:
        for agent in (ME, PEER):
            answers.expect(agent, _sample(k))
        return _telemetry(k)

    def on_actuation(key: str, payload: bytes) -> bool:
        answers.accept(key, payload)
        return answers.take_input(ME) is not None

    def on_telemetry(key: str, payload: bytes) -> bool:
        answers.accept(key, payload)
        return answers.take_telemetry(ME, SEALER.open(key, payload, Telemetry).k) is not None

    def command(k: int) -> CommandMessage:
        return CommandMessage(number=k + 1, command=Command(0.0, CommandKind.LOSS, "1", 0.5))

    def on_command(key: str, payload: bytes) -> bool:
        # It counts refusals itself. The queue has a seal of its own.
        before = commands.refusals.counts.total()
        body = payload[16:]
        commands.on_command(key, Sealer(b"c")._mac(key, body) + body)
        return commands.refusals.counts.total() == before

    return [
        Receiver(KEYS.actuation("1"), actuation, on_actuation),
        Receiver(KEYS.telemetry("1"), telemetry, on_telemetry),
        Receiver(KEYS.command, command, on_command),
    ]


def _agent() -> list[Receiver]:
    """An agent's: samples, which it answers, and broadcasts."""
    step = ControlStep(build_rows(_swarm()), ME)
    answers: list[Answer] = []
    answering = SampleAnswering(step, SEALER, answers.append, lambda: None)

    def take(on_payload: Callable[[str, bytes], None]) -> Callable[[str, bytes], bool]:
        def receive(key: str, payload: bytes) -> bool:
            before = step.rejected
            on_payload(key, payload)
            answers.clear()
            if answering.error is not None:
                error, answering.error = answering.error, None
                raise error
            return step.rejected == before

        return receive

    def on_sample(key: str, payload: bytes) -> None:
        with contextlib.suppress(Malformed):
            commands = SEALER.open(key, payload, Sample).commands
            if commands and commands.die:
                return  # it would
        answering.on_sample(key, payload)

    def sample(_: int) -> Sample:
        return _sample(step._next or 0)

    def broadcast(k: int) -> Broadcast:
        return Broadcast(k=k % 10_000, t_apply=0.01 * k, u=(0.1, 0.1))

    answering.on_sample(key := KEYS.sample("1"), SEALER.seal(key, _sample(0)))
    return [
        Receiver(KEYS.sample("1"), sample, take(on_sample)),
        Receiver(KEYS.broadcast("2", "1"), broadcast, take(answering.on_broadcast)),
    ]


def _lookers_on() -> list[Receiver]:
    """The viewer's and the launcher's."""
    model, summary = scene_model(SCENARIO), msgspec.json.encode(SUMMARY)
    past = LiveHistory(model)

    def on_frame(key: str, payload: bytes) -> bool:
        frame = SEALER.open(key, payload, Frame)
        check_frame(frame, model)
        past.add(frame)
        return True

    def on_status(key: str, payload: bytes) -> bool:
        return SEALER.open(key, payload, Status) is not None

    def on_verdict(key: str, payload: bytes) -> bool:
        try:
            read_summary(SEALER.open(key, payload, Ended).summary)
        except ValueError as error:
            raise Malformed("wrong fields") from error
        return True

    return [
        Receiver(KEYS.frames, _frame, on_frame),
        Receiver(KEYS.status, lambda k: Status(t=0.1 * k, waiting_for=("1",)), on_status),
        Receiver(KEYS.verdict, lambda _: Ended(summary=summary), on_verdict),
    ]


def receivers() -> list[Receiver]:
    """Return all receivers of messages."""
    return [*_plant(), *_agent(), *_lookers_on()]


def spoilt(receiver: Receiver, n: int, draw: random.Random) -> bytes:
    """A payload that is not quite right."""
    body = msgspec.msgpack.encode(receiver.good(n))
    if draw.random() < 0.3:
        body = of_bytes(body, draw)
    else:
        tree = of_tree(msgspec.msgpack.decode(body), draw, draw.choice((1, 1, 1, 2, 5)))
        body = msgspec.msgpack.encode(tree)
    return SEALER._mac(receiver.key, body) + body


def put(receiver: Receiver, payload: bytes) -> str:
    """Deliver a payload; return "taken", or why it was dropped. Raises as the receiver does."""
    try:
        return "taken" if receiver.take(receiver.key, payload) else "dropped"
    except Malformed as reason:
        return str(reason)


def spoilt_token(draw: random.Random) -> str:
    """A key on which a token is not quite right."""
    key = KEYS.alive("1", "0123456789abcdef")
    return of_bytes(key.encode(), draw).decode(errors="replace")

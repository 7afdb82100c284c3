"""The agent's program: a Zenoh client that answers samples until the plant leaves."""

import contextlib
import gc
import logging
import signal
from collections.abc import Callable
from functools import cache
from queue import SimpleQueue

from phalanx.messages.keys import PLANT, Keys
from phalanx.messages.kinds import LONGEST_FAILURE, StepFailedError, Telemetry
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Sealer
from phalanx.messages.step_report import StepReport
from phalanx.schema.registry import part_of_agent
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.watchdog import endless_loops
from phalanx.theory.rows.origin import Origin
from phalanx.wire import liveliness, pubsub
from phalanx.wire.liveliness import PlantPresence
from phalanx.wire.session import Session, open_member
from phalanx_agent.answering import SampleAnswering, pending_watchdog
from phalanx_agent.clock import clock_of
from phalanx_agent.step import Answer, ControlStep, control_steps

log = logging.getLogger("phalanx.agent")

_LONGEST_SILENCE = 16.0
"""Twice the longest step [s]: Zenoh closes a connection that was not read for 10 s."""


def run(rows: SafetyRows, membership: Membership) -> int:
    """Run one agent, or the controller of several, until the plant leaves.

    An agent whose own program speaks Zenoh is that program from then on.

    Args:
        rows: of the scenario, whose digest must be the plant's.
        membership: of the run; its identity is the program's name.

    Returns:
        Exit status 0.

    Raises:
        HubError: the hub cannot be reached. Exception: that of a control step.
    """
    keys, sealer = membership.keys, membership.sealer
    hub = membership.endpoint, keys.alive(PLANT), membership.timeout, membership.credentials
    if membership.identity in rows.swarm.scenario.programs_by_zenoh():
        # It need not try again until the hub is there.
        open_member(*hub).close()  # type: ignore[no-untyped-call]
        part_of_agent("agents.protocol")(rows.swarm, membership)
    steps = control_steps(rows, membership.identity, membership)
    swarm = steps[0].swarm
    # No threading.Event: a signal handler that sets one while this thread enters wait() deadlocks.
    leaving: SimpleQueue[str] = SimpleQueue()
    signal.signal(signal.SIGTERM, lambda *_: leaving.put("SIGTERM"))
    timeout = swarm.time.timeout
    with (
        endless_loops(min(timeout, _LONGEST_SILENCE)),
        open_member(*hub) as session,
        contextlib.ExitStack() as while_open,
    ):
        senders = [_Sender(session, keys, sealer, step) for step in steps]

        def give_up() -> None:
            """Report the failure to the plant, which then ends the run; else leave."""
            failed = [(s, a.error) for s, a in zip(senders, answerings, strict=True) if a.error]
            waits = False
            for sender, error in failed:
                if isinstance(error, StepFailedError):
                    sender.report_failure(error)
                    waits = clock_of(error.sample).waits
            if not waits:
                leaving.put("a control step failed")

        answerings = [
            SampleAnswering(step, sealer, sender, give_up)
            for step, sender in zip(steps, senders, strict=True)
        ]
        while_open.enter_context(pending_watchdog(timeout, answerings))
        for step, answering in zip(steps, answerings, strict=True):
            pubsub.subscribe(session, keys.broadcast("*", step.name), answering.on_broadcast)
            pubsub.subscribe(session, keys.sample(step.name), answering.on_sample)

        def begun() -> bool:
            return any(answering.begun for answering in answerings)

        PlantPresence(membership.timeout, leaving.put, begun).watch(session, keys)
        for sender in senders:
            sender.wait_for_listeners(membership.timeout, lambda: not leaving.empty())
        # The theory lives as long as the process: the collector must not scan it during a step.
        gc.freeze()
        _tokens = [
            liveliness.announce(session, keys.alive(step.name, swarm.digest)) for step in steps
        ]
        log.info("joined run %s at %s", membership.run, membership.endpoint)
        log.info("leaving: %s", leaving.get())
    log.info("left; %d payloads were rejected", sum(step.rejected for step in steps))
    for answering in answerings:
        if answering.error is not None:
            raise answering.error
    return 0


class _Sender:
    """Sends one agent's answers, the most urgent message first."""

    def __init__(self, session: Session, keys: Keys, sealer: Sealer, step: ControlStep) -> None:
        self._sealer = sealer
        # In real time a peer that does not read must not block the others.
        self._broadcasts = {
            True: pubsub.Addressed(session),
            False: pubsub.Addressed(session, pubsub.Delivery.NOTICE),
        }
        self._inputs = len(step.swarm.members[step.i].dynamics.inputs)
        self._actuation, self._telemetry = (
            pubsub.SealedPublisher(session, sealer, key)
            for key in (keys.actuation(step.name), keys.telemetry(step.name))
        )
        self._broadcast_key = cache(lambda l: keys.broadcast(step.name, step.swarm.names[l]))

    def __call__(self, answer: Answer) -> None:
        self._actuation.put(answer.actuation)
        broadcasts = self._broadcasts[answer.waits]
        for hearer, broadcast in answer.broadcasts.items():
            key = self._broadcast_key(hearer)
            broadcasts.put(key, self._sealer.seal(key, broadcast))
        self._telemetry.put(answer.telemetry)

    def report_failure(self, error: StepFailedError) -> None:
        """Report to the plant why a sample is not answered."""
        zero = (0.0,) * self._inputs
        report = StepReport(origin=Origin.BACKUP, residual=None, u_nom=zero, solve_time=0.0)
        failed = str(error)[:LONGEST_FAILURE]
        telemetry = Telemetry(k=error.sample.k, report=report, ages=(), failed=failed)
        self._telemetry.put(telemetry)

    def wait_for_listeners(self, timeout: float, over: Callable[[], bool]) -> None:
        """Wait until the plant has subscribed: messages put earlier are lost. Raises HubError."""
        self._actuation.wait_until_heard(timeout, over)
        self._telemetry.wait_until_heard(timeout, over)

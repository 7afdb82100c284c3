"""The plant's program: open the hub, wait for the agents, run, and write the summary."""

import contextlib
import gc
import logging
import signal
import threading
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Summary, exit_status
from phalanx.messages.kinds import Ended, Status
from phalanx.messages.membership import Membership
from phalanx.recording.records import RECORDING, SUMMARY
from phalanx.recording.write import RecordingError, RecordingWriter, write_summary
from phalanx.swarm.attack import Attack
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.models.world import WorldError
from phalanx.wire.session import HubError
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.clock.lookahead import look_ahead
from phalanx_plant.clock.real_time import RealTime
from phalanx_plant.hub.hub import Hub, LockstepHub, RealTimeHub
from phalanx_plant.run import ClockFactory, PlantRun
from phalanx_plant.world.events import AbandonedError, StoppedError

log = logging.getLogger("phalanx.plant")

_POLL = 0.2
"""While waiting, period of checking whether the run was stopped [s]."""


class StopRequest:
    """A stop requested by a signal, or by the launcher.

    SIGINT and SIGTERM stop the run. With SIGUSR1 the launcher reports that an agent failed, which
    the plant cannot detect before the agent has joined.
    """

    def __init__(self) -> None:
        self._reason: Exception | None = None
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._set(StoppedError("stopped by the user")))
        failed = AbandonedError("an agent failed")
        signal.signal(signal.SIGUSR1, lambda *_: self._set(failed))
        # The launcher blocks these until now, when there are handlers.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})

    def ignore_failures(self) -> None:
        """Go on without the agents that fail from now on."""
        # No SIG_IGN: Python reports a signal that comes just before it as an error.
        signal.signal(signal.SIGUSR1, lambda *_: None)

    def check(self) -> None:
        """Raise StoppedError or AbandonedError if the run should stop."""
        if self._reason is not None:
            raise self._reason

    def await_start(self, launcher: Connection) -> None:
        """Wait until the launcher starts the agents; from then on obey it."""
        while not launcher.poll(_POLL):
            self.check()
        if reason := launcher.recv():
            raise AbandonedError(reason)
        threading.Thread(target=self._obey, args=(launcher,), daemon=True).start()

    def _obey(self, launcher: Connection) -> None:
        self._set(AbandonedError(launcher.recv()))

    def _set(self, reason: Exception) -> None:
        self._reason = self._reason or reason


def run(
    rows: SafetyRows,
    membership: Membership,
    *,
    folder: Path,
    policy: CommandPolicy = NO_COMMANDS,
    at_router: bool = False,
    real_time: float | None = None,
    launcher: Connection | None = None,
) -> int:
    """Run the plant to the end of the scenario.

    Args:
        rows: of the scenario.
        membership: of the run; the plant listens on its endpoint, unless a router does.
        folder: where the recording and the summary go.
        policy: the secret of live commands, and the scheduled commands.
        at_router: True if a router listens there.
        real_time: seconds of virtual time per second; None: lockstep.
        launcher: sends None once it starts the agents (until then none is late), or why the run
            must end. It receives the summary, or the error in its place: it may not be connected
            to the hub yet, and the disk may be full.

    Returns:
        The exit status of the verdict.

    Raises:
        HubError: the endpoint cannot be listened on, or no router is there.
        RecordingError: the recording cannot be begun.
        WorldError: the scenario's world cannot start.
    """
    rows.swarm.scenario.require_clock(real_time)
    stop = StopRequest()
    hub_class, clock, policy = _clock_for(policy, real_time)
    scenario, names = rows.swarm.scenario, rows.swarm.names
    # A program that does the wire by itself need not know how to attack.
    attacks = {i: Attack(rows, i) for i in map(names.index, scenario.programs_by_zenoh())}
    try:
        recording = RecordingWriter(folder / RECORDING, scenario, membership.run)
    except RecordingError as error:
        _send_result(launcher, str(error))
        raise
    try:
        hub = hub_class(rows.swarm, membership, stop.check, at_router, attacks)
    except HubError:
        recording.close()
        (folder / RECORDING).unlink()  # there was no run: the next attempt needs the name
        raise
    with recording, hub:
        commands = CommandQueue(policy, names, stop.check)
        if policy.secret:
            hub.session.listen_for_commands(commands.on_command)
        hub.session.answer_viewers(commandable=bool(policy.secret), real_time=policy.real_time)
        try:
            plant = PlantRun(rows, hub, recording, commands, clock, hub.session.frames)
        except WorldError as error:
            _send_result(launcher, str(error))
            raise

        def join() -> None:
            if launcher:
                stop.await_start(launcher)
            hub.wait_for_agents(lambda missing: hub.publish_status(Status(waiting_for=missing)))
            if hub.may_leave:
                stop.ignore_failures()
            gc.freeze()

        summary = plant.run(prepare=join, rejected=lambda: hub.refusals.counts)
        write_summary(summary, folder / SUMMARY, recording)
        hub.session.verdict.put(Ended(summary=msgspec.json.encode(summary)))
        _send_result(launcher, summary)
    log.info("%s: %s", summary.outcome, summary.reason)
    return exit_status(summary.outcome)


def _clock_for(
    policy: CommandPolicy, real_time: float | None
) -> tuple[type[Hub], ClockFactory, CommandPolicy]:
    """Return the hub and the clock of a run, and the policy with its speed."""
    if real_time is None:
        return LockstepHub, partial(Lockstep, synchronization=look_ahead), policy
    return RealTimeHub, RealTime, replace(policy, speed=real_time, real_time=True)


def _send_result(launcher: Connection | None, result: Summary | str) -> None:
    if launcher:
        with contextlib.suppress(ConnectionError):  # the launcher died
            launcher.send(result)

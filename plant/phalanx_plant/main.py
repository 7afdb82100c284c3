"""The plant's shell: open the hub, wait for the swarm, run, judge, write it all down."""

import contextlib
import gc
import logging
import multiprocessing
import multiprocessing.connection
import signal
import threading
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Summary, exit_status
from phalanx.profile.stopwatch import Stopwatch
from phalanx.recording.records import RECORDING, SUMMARY
from phalanx.recording.write import RecordingError, RecordingWriter, write_down
from phalanx.swarm.rows import SafetyRows
from phalanx.wire.keys import PLANT
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Ended, Status
from phalanx.wire.session import HubError
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lockstep import Lockstep
from phalanx_plant.clock.lookahead import look_ahead
from phalanx_plant.clock.real_time import RealTime
from phalanx_plant.hub.hub import Hub, LockstepHub, RealTimeHub
from phalanx_plant.run import ClockFactory, PlantRun
from phalanx_plant.world.events import AbandonedError, StoppedError

log = logging.getLogger("phalanx.plant")

_GLANCE = 0.2
"""How often a wait looks up to see whether the run was stopped [s]."""


class StopRequest:
    """Takes signals, and watches the launcher if there is one.

    SIGINT and SIGTERM stop the run. SIGUSR1 is the launcher's word that an agent failed, which the
    plant could not see by itself before the agent joined.
    """

    def __init__(self) -> None:
        self._reason: Exception | None = None
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: self._set(StoppedError("stopped by the user")))
        failed = AbandonedError("an agent failed")
        signal.signal(signal.SIGUSR1, lambda *_: self._set(failed))
        # Held back by the launcher until now, when they can be answered.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})
        if parent := multiprocessing.parent_process():
            threading.Thread(target=self._watch, args=(parent.sentinel,), daemon=True).start()

    def check(self) -> None:
        """Raise StoppedError or AbandonedError if the run should stop."""
        if self._reason is not None:
            raise self._reason

    def _watch(self, sentinel: int) -> None:
        multiprocessing.connection.wait([sentinel])
        self._set(AbandonedError("the launcher died"))

    def _set(self, reason: Exception) -> None:
        self._reason = self._reason or reason


def run(
    rows: SafetyRows,
    membership: Membership,
    *,
    folder: Path,
    policy: CommandPolicy = NO_COMMANDS,
    profile: Path | None = None,
    at_router: bool = False,
    real_time: float | None = None,
    last_words: Connection | None = None,
    agents_start: Connection | None = None,
) -> int:
    """Run the plant to the end of the scenario.

    Args:
        rows: of the scenario.
        membership: of the run; the plant listens on its endpoint, unless a router does.
        folder: where the recording and the summary go.
        policy: who may command the run, and which commands are scheduled.
        profile: folder in which to leave how the time was spent.
        at_router: whether a router listens there.
        real_time: seconds of virtual time per second, where the wall clock decides.
        last_words: takes the summary, or why there is none: whoever started the plant need not
            listen on the hub yet, and the disk may be full.
        agents_start: has something to read once the agents are being started, if they are
            started later, or ends with whoever was to start them: until then none is late.

    Returns:
        The exit status of the verdict.

    Raises:
        HubError: the endpoint cannot be listened on, or no router is there.
        RecordingError: the recording cannot be begun.
    """
    stop = StopRequest()
    hub_class, clock, policy = _clock_for(policy, real_time)
    scenario = rows.swarm.scenario
    stopwatch = Stopwatch() if profile else None
    try:
        recording = RecordingWriter(folder / RECORDING, scenario, membership.run)
    except RecordingError as error:
        _say(last_words, str(error))
        raise
    try:
        hub = hub_class(rows.swarm, membership, stop.check, at_router)
    except HubError:
        recording.close()
        (folder / RECORDING).unlink()  # nobody ran: the next attempt is to find no recording
        raise
    with recording, hub:
        commands = CommandQueue(policy, rows.swarm.names, stop.check)
        if policy.secret:
            hub.session.listen_for_commands(commands.on_command)
        hub.session.answer_viewers(commandable=bool(policy.secret))
        if stopwatch:
            hub.time(stopwatch)  # the judge keeps one of the hub's calls
        plant = PlantRun(rows, hub, recording, commands, clock, hub.session.frames)
        if stopwatch:
            plant.time(stopwatch)

        def join() -> None:
            while agents_start and not agents_start.poll(_GLANCE):
                stop.check()
            hub.wait_for_agents(lambda missing: hub.publish_status(Status(waiting_for=missing)))
            gc.freeze()

        summary = plant.run(prepare=join, rejected=lambda: hub.refusals.counts)
        if stopwatch and profile:
            stopwatch.write(profile, PLANT)
        write_down(summary, folder / SUMMARY, recording)
        hub.session.verdict.put(Ended(summary=msgspec.json.encode(summary)))
        _say(last_words, summary)
    log.info("%s: %s", summary.outcome, summary.reason)
    return exit_status(summary.outcome)


def _clock_for(
    policy: CommandPolicy, real_time: float | None
) -> tuple[type[Hub], ClockFactory, CommandPolicy]:
    """The hub and the clock of a run, and the policy with its speed."""
    if real_time is None:
        return LockstepHub, partial(Lockstep, synchronization=look_ahead), policy
    return RealTimeHub, RealTime, replace(policy, speed=real_time)


def _say(last_words: Connection | None, said: Summary | str) -> None:
    if last_words:
        with contextlib.suppress(BrokenPipeError):  # the launcher died
            last_words.send(said)

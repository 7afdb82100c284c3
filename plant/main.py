"""The plant's shell: open the hub, wait for the swarm, run, judge, write it all down."""

import gc
import logging
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Outcome, Summary, exit_status, judge
from phalanx.plant.commands import CommandQueue
from phalanx.plant.hub import Hub, SwarmBrokenError
from phalanx.plant.judge import Judge
from phalanx.plant.lockstep import Lockstep, waiting_status
from phalanx.plant.stop import AbandonedError, StoppedError, StopRequest
from phalanx.plant.world import DivergedError
from phalanx.recording.records import RECORDING, SUMMARY
from phalanx.recording.write import RecordingError, RecordingWriter
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.wire.messages import VERSION, Ended

log = logging.getLogger("phalanx.plant")


def run(
    scenario: Scenario,
    *,
    run_id: str,
    endpoint: str,
    secret: bytes,
    folder: Path,
    policy: CommandPolicy = NO_COMMANDS,
) -> int:
    """Run the plant to the end of the scenario.

    Args:
        scenario: resolved.
        run_id: part of every key expression.
        endpoint: Zenoh endpoint to listen on.
        secret: the run's secret, for the seal.
        folder: where the recording and the summary go.
        policy: who may interfere from outside the scenario, and what is to happen anyway.

    Returns:
        The exit status of the verdict.

    Raises:
        HubError: the endpoint cannot be listened on.
        RecordingError: the recording cannot be begun.
    """
    stop = StopRequest()
    swarm = build_swarm(scenario)
    with (
        RecordingWriter(folder / RECORDING, scenario, run_id) as recording,
        Hub(swarm, run_id, endpoint, secret, stop.check) as hub,
    ):
        summary = _run(swarm, hub, recording, policy, stop.check)
        hub.publish_verdict(Ended(VERSION, msgspec.json.encode(summary)))
        try:
            recording.finish(summary)
            (folder / SUMMARY).write_bytes(msgspec.json.encode(summary))
        except OSError as error:
            log.error("the summary could not be written: %s", error)
    log.info("%s: %s", summary.outcome, summary.reason)
    return exit_status(summary.outcome)


def _run(
    swarm: Swarm,
    hub: Hub,
    recording: RecordingWriter,
    policy: CommandPolicy,
    check_stop: Callable[[], None],
) -> Summary:
    verdict = Judge(swarm)
    commands = CommandQueue(policy, swarm.names, check_stop)
    if policy.secret:
        hub.listen_for_commands(commands.on_command)
    viewers = hub.open_view(commandable=bool(policy.secret))
    lockstep = Lockstep(swarm, hub, verdict, recording, commands, viewers)
    began = time.monotonic()
    try:
        hub.wait_for_agents(waiting_status(hub))
        gc.freeze()
        began = time.monotonic()
        lockstep.run()
        outcome, reason = judge(verdict.truth.violations(), verdict.assumptions)
    except StoppedError as error:
        outcome, reason = Outcome.STOPPED, str(error)
    except (SwarmBrokenError, AbandonedError, RecordingError, DivergedError) as error:
        outcome, reason = Outcome.BROKEN, str(error)
    log.info("%s at t = %.3f s: %s", outcome, lockstep.world.t, reason)
    return _summary(lockstep, verdict, hub, outcome, reason, time.monotonic() - began)


def _summary(
    lockstep: Lockstep, verdict: Judge, hub: Hub, outcome: Outcome, reason: str, wall: float
) -> Summary:
    truth = verdict.truth
    return Summary(
        outcome=outcome,
        reason=reason,
        t=lockstep.world.t,
        seed=lockstep.seed,
        trajectory=verdict.trajectory,
        worst_h_tot=truth.worst_h_tot,
        worst_at=truth.worst_at,
        worst_pair=truth.worst_pair,
        steps=verdict.steps,
        origins=verdict.origins,
        assumptions=verdict.assumptions,
        violations=truth.violations(),
        rejected={**hub.rejected, **lockstep.rejected_commands(), **lockstep.rejected_by_agents()},
        wall_time=wall,
    )

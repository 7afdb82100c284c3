"""The processes engine: the plant and every agent, each a process of its own, over Zenoh.

The launcher only starts and watches them. Programs communicate over Zenoh alone, and each stops
by itself: agents when the hub is gone, the plant when it is done, on SIGTERM, or when the
launcher dies.
"""

import contextlib
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path

from phalanx.faults.commands import EFFECTS
from phalanx.faults.fault import AgentFault, Fault
from phalanx.guarantee.verdict import Outcome, Summary, read_summary
from phalanx.launcher.engine import EngineError, Progress, RunOptions
from phalanx.launcher.live import announced
from phalanx.launcher.processes import Processes
from phalanx.launcher.programs import Program
from phalanx.messages.keys import PLANT
from phalanx.messages.kinds import SAYS, Status
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Malformed
from phalanx.recording.records import PROFILE, SUMMARY
from phalanx.scenario.model import Scenario
from phalanx.schema.user_code import of_session
from phalanx.wire.pubsub import subscribe
from phalanx.wire.session import HubError, open_client, reserved_endpoint


def run_processes(
    scenario: Scenario, make_folder: Callable[[], Path], options: RunOptions
) -> Summary:
    """Run a scenario to its verdict, as an Engine; progress is called in a thread of Zenoh's."""
    for name in of_session(scenario.model_dump(mode="json")):
        raise EngineError(
            f"{name} is of this script or notebook, which other processes cannot import: write it "
            "into a file of its own, or take engine 'in-process'"
        )
    if options.agents_per_process > 1:
        _require_alone(scenario)
    with Processes(scenario) as processes, reserved_endpoint() as endpoint:
        processes.require_runnable()
        folder = make_folder()
        membership = Membership(
            run=folder.name,
            endpoint=options.listen or endpoint,
            secret=options.secret or secrets.token_bytes(16),
        )
        return _run(processes, scenario, folder, membership, options)


def _run(
    processes: Processes,
    scenario: Scenario,
    folder: Path,
    membership: Membership,
    options: RunOptions,
) -> Summary:
    programs, may_lose_agents = _programs(scenario, folder, options), _may_lose(scenario, options)
    try:
        processes.start(membership, programs, folder / "logs")
    except OSError as error:
        raise EngineError(f"no program could be started: {error}") from error
    try:
        with (
            announced(folder, membership),
            _status_handled(scenario, membership, processes, options.progress),
        ):
            options.announce(folder)
            processes.wait_for_plant(may_lose_agents)
    finally:
        processes.end()
    summary = _verdict(folder, processes)
    failure = processes.first_failure(may_lose_agents)
    if summary is None:
        raise EngineError(
            failure or f"the plant ended without a verdict: see {folder / 'logs' / 'plant.log'}"
        )
    explained = SAYS in summary.reason or summary.reason in failure
    if summary.outcome is Outcome.BROKEN and failure and not explained:
        summary.reason = f"{summary.reason} [{failure}]"
    return summary


def _programs(scenario: Scenario, folder: Path, options: RunOptions) -> list[Program]:
    timed = {"profile": folder / PROFILE} if options.profile else {}
    plant = {"folder": folder, "policy": options.commands, "real_time": options.real_time}
    names, many = list(scenario.programs()), options.agents_per_process
    together = [names[k : k + many] for k in range(0, len(names), many)]
    agents = [Program(first, timed, tuple(others)) for first, *others in together]
    return [Program(PLANT, {**plant, **timed}), *agents]


def _require_alone(scenario: Scenario) -> None:
    """Raise EngineError if a fault is of the process of one agent."""
    for n, fault in enumerate(scenario.faults):
        if _is_of_process(fault):
            raise EngineError(
                f"faults.{n}: expected one agent a process, to {fault.kind} one: leave "
                "--agents-per-process out"
            )


def _may_lose(scenario: Scenario, options: RunOptions) -> bool:
    """Return whether an agent's process may be killed without ending the run."""
    commanded = bool(options.commands.secret or options.commands.schedule)
    in_real_time = options.real_time is not None
    return commanded or in_real_time or any(map(_is_of_process, scenario.faults))


def _is_of_process(fault: Fault) -> bool:
    """Return whether a fault kills, starts or stops an agent's process."""
    begins = fault.begins_with if isinstance(fault, AgentFault) else None
    return bool(begins and EFFECTS[begins].process)


def _verdict(folder: Path, processes: Processes) -> Summary | None:
    """Return the plant's summary from its file, or from its pipe if the disk is full."""
    with contextlib.suppress(OSError, ValueError):
        return read_summary((folder / SUMMARY).read_bytes())
    return processes.result if isinstance(processes.result, Summary) else None


@contextlib.contextmanager
def _status_handled(
    scenario: Scenario,
    membership: Membership,
    processes: Processes,
    progress: Progress,
) -> Iterator[None]:
    """During the block report progress, and restart, suspend and resume as the status requests."""
    keys, sealer = membership.keys, membership.sealer
    program_of = {name: p for p, names in scenario.programs().items() for name in names}

    def on_status(key: str, payload: bytes) -> None:
        with contextlib.suppress(Malformed):
            status = sealer.open(key, payload, Status)
            processes.suspend({program_of[name] for name in status.stopped})
            for name in status.waiting_for if status.restart else ():
                processes.restart(program_of[name])
            progress(status)

    session = None
    while session is None and processes.plant_runs:
        with contextlib.suppress(HubError):
            session = open_client(membership.endpoint, 0.5, membership.credentials)
    if session is None:
        yield
        return
    with session:
        subscribe(session, keys.status, on_status)
        yield

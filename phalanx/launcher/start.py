"""phalanx.run: run a scenario."""

import tempfile
from pathlib import Path

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy, require_valid
from phalanx.launcher.engine import (
    DEFAULT_ENGINE,
    Announce,
    Progress,
    RunOptions,
    execute,
    silent,
)
from phalanx.launcher.run import Run
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario


def run(
    scenario: Scenario | str | Path,
    *,
    engine: str = DEFAULT_ENGINE,
    out: str | Path | None = None,
    progress: Progress = silent,
    commands: CommandPolicy = NO_COMMANDS,
    listen: str | None = None,
    secret: bytes = b"",
    announce: Announce = silent,
    profile: bool = False,
    real_time: float | None = None,
    agents_per_process: int = 1,
) -> Run:
    """Run a scenario to its verdict.

    Args:
        scenario: as load returns it, or a file or name that load takes.
        engine: "processes", every program a process of its own over Zenoh, or "in-process", the
            same control steps called directly; both give the same trajectory to the last bit.
        out: folder in which the run gets a folder of its own. By default a temporary one, removed
            with the returned object; pickling the object copies its files.
        progress: called a few times a second with the run's status, perhaps in another thread.
        commands: the secret of those who may command the run, its speed, and scheduled commands.
        listen: Zenoh endpoint of the hub; by default a free port on 127.0.0.1.
        secret: seals the run's messages; by default random.
        announce: called with the run's folder when viewers can connect.
        profile: measure where every program's wall time goes; see Run.profile.
        real_time: seconds of virtual time per second of wall time; the plant then waits for no
            agent, and Summary.punctuality counts what was missed or late. By default lockstep.
        agents_per_process: agents that share a process of engine "processes". Each keeps its own
            session, keys and inbox; it takes less memory, and start-up less time.

    Returns:
        The finished run, also if it was stopped by Ctrl-C or broke on the way: see its verdict.

    Raises:
        ScenarioError: the scenario cannot be run.
        EngineError: the run could not begin, or ended without a verdict.
        ValueError: there is no such engine, it does not support an option, a callback cannot be
            called, or a scheduled command is invalid.
        OSError: no folder can be made.
    """
    options = RunOptions(
        engine,
        progress=progress,
        commands=commands,
        listen=listen,
        secret=secret,
        announce=announce,
        profile=profile,
        real_time=real_time,
        agents_per_process=agents_per_process,
    )
    if not isinstance(scenario, Scenario):
        scenario = load(scenario)
    require_valid(
        commands.schedule, tuple(name for group in scenario.named() for name in group.names)
    )
    temporary = tempfile.TemporaryDirectory(prefix="phalanx-") if out is None else None
    parent, name = Path(temporary.name if temporary else out or ""), scenario.name
    folders: list[Path] = []

    def make_folder() -> Path:
        folders.append(new_folder(parent, name))
        return folders[0]

    summary = execute(scenario, make_folder, options)
    return Run(folders[0], summary, temporary)


def new_folder(parent: Path, name: str) -> Path:
    """Create the next free folder <parent>/<name>-<n>. Raises OSError."""
    parent.mkdir(parents=True, exist_ok=True)
    n = 1
    while True:
        try:
            (folder := parent / f"{name}-{n}").mkdir()
            return folder
        except FileExistsError:
            n += 1

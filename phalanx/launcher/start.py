"""Run a scenario, and hand back the finished run."""

import tempfile
from pathlib import Path

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
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
) -> Run:
    """Run a scenario to its verdict.

    Args:
        scenario: as load gives it, or what load takes.
        engine: "processes", every program a process of its own over Zenoh, or "in-process", the
            same control steps called directly; both give the same trajectory to the last bit.
        out: folder in which the run gets a folder of its own; by default one that goes away with
            the returned object; to another process that takes its files along.
        progress: called a few times a second with how far the run is, perhaps in another thread.
        commands: who may command the run while it goes on, and what is scheduled.
        listen: Zenoh endpoint of the hub; by default a free port on 127.0.0.1.
        secret: seals the run's messages; drawn at random unless given.
        announce: called with the run's folder when it can be met there, as `phalanx view` does.
        profile: measure where every program's wall time goes; see Run.profile.
        real_time: the wall clock decides, and nobody waits: so many seconds of virtual time per
            second. Summary.punctuality has what was missed and late.

    Returns:
        The finished run, also if it was stopped by Ctrl-C or broke on the way: see its verdict.

    Raises:
        ScenarioError: the scenario cannot be run.
        EngineError: the run could not begin, or ended without a verdict.
        ValueError: there is no such engine, an option that it does not take, or no function where
            one is to be called.
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
    )
    if not isinstance(scenario, Scenario):
        scenario = load(scenario)
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

"""Engines by name, the options of a run, and how a scenario is executed with them.

To add an engine, write its function in a file of its own and enter it in ENGINES. Nothing here
takes long to import: an engine brings its libraries when it is used.
"""

import pkgutil
from collections.abc import Callable, Iterable
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, Protocol

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.launcher.streams import open_closed_streams

if TYPE_CHECKING:
    from phalanx.guarantee.verdict import Summary
    from phalanx.messages.kinds import Status
    from phalanx.scenario.model import Scenario

Progress = Callable[["Status"], None]
"""Called a few times a second while a run goes on, perhaps in another thread."""

Announce = Callable[[Path], object]
"""Called once with a run's folder, once viewers can connect."""

FASTEST = 1e3
"""Seconds of virtual time per second, at most, in real time."""


class Engine(Protocol):
    """Runs a scenario to its summary."""

    def __call__(
        self, scenario: "Scenario", make_folder: Callable[[], Path], options: "RunOptions"
    ) -> "Summary":
        """Run, and write the recording and the summary into the run's folder.

        Args:
            scenario: resolved.
            make_folder: makes the folder; called once the scenario is known to be runnable.
            options: those that this engine does not support are at their defaults.

        Raises:
            ScenarioError: the scenario cannot be run.
            EngineError: the run could not begin, or ended without a verdict.
        """


class EngineEntry(NamedTuple):
    """An engine, as it is registered."""

    function: str
    """The Engine, as module:name."""
    description: str
    """For users, in the help of a command."""
    hub: bool = False
    """Whether its programs meet at a hub: such runs can be watched, commanded, or in real time."""
    prepare: str = ""
    """The function that begins to load its libraries, as module:name; may be empty."""


ENGINES = {
    "processes": EngineEntry(
        "phalanx.launcher.processes:run_processes",
        "every program a process of its own, over Zenoh",
        hub=True,
        prepare="phalanx.launcher.libraries:start_loading",
    ),
    "in-process": EngineEntry(
        "phalanx.launcher.simulation:run_in_process",
        "the same control steps called directly, faster; the trajectory is the same to the last "
        "bit",
    ),
    "native": EngineEntry(
        "phalanx.native.loop.engine:run_native",
        "the same steps in C, many times faster and with the same bits, where the scenario and a "
        "compiler allow; else in-process, and the log says why",
    ),
    "auto": EngineEntry(
        "phalanx.native.loop.fastest:run_fastest",
        "native where all is compiled, or runs in this process have taken longer than a compiler; "
        "else in-process",
    ),
}
"""The engines by name, the default first."""
DEFAULT_ENGINE = next(iter(ENGINES))


class EngineError(RuntimeError):
    """A run could not begin, or ended without a verdict; the message says which program and why."""


def silent(_: object) -> None:
    """Do nothing: the default callback."""


@dataclass(frozen=True)
class RunOptions:
    """The options of a run; phalanx.run takes them as keywords.

    Args:
        engine: "processes", every program a process of its own over Zenoh; "in-process", the same
            control steps called directly; "native", the same in C where that is possible; or
            "auto", the faster of these two. All give the same trajectory to the last bit.
        out: of phalanx.run: folder in which the run gets a folder of its own. By default a
            temporary one, removed with the returned object.
        progress: called a few times a second with the run's status, perhaps in another thread.
        commands: the secret of those who may command the run, its speed, and scheduled commands.
        listen: Zenoh endpoint of the hub; by default a free port on 127.0.0.1.
        secret: seals the run's messages; by default random.
        announce: called with the run's folder when viewers can connect.
        real_time: seconds of virtual time per second of wall time; the plant then waits for no
            agent, and Summary.punctuality counts what was missed or late. By default lockstep.

    Raises ValueError: there is no such engine, it does not support one of the other options, or
    a callback cannot be called.
    """

    engine: str = DEFAULT_ENGINE
    _: KW_ONLY
    out: str | Path | None = None
    progress: Progress = silent
    commands: CommandPolicy = NO_COMMANDS
    listen: str | None = None
    secret: bytes = field(default=b"", repr=False)
    announce: Announce = silent
    real_time: float | None = None

    def __post_init__(self) -> None:
        hub = require_engine(self.engine).hub
        require_functions(progress=self.progress, announce=self.announce)
        needs_hub = (
            self.listen or self.secret or self.announce is not silent or self.commands.secret
        )
        if needs_hub and not hub:
            raise ValueError(
                f"engine {self.engine!r} has no hub to listen on, to watch or to command"
            )
        if self.real_time is not None and not (hub and 0.0 < self.real_time <= FASTEST):
            able = _either(name for name, entry in ENGINES.items() if entry.hub)
            raise ValueError(
                f"real_time: expected a factor above 0 and at most {FASTEST:g}, and engine {able}"
            )


def execute(
    scenario: "Scenario", folder: Path | Callable[[], Path], options: RunOptions
) -> "Summary":
    """Run a scenario to its summary. Raises as an Engine.

    folder: of the run, or a function that makes it, called once the scenario is runnable.
    """
    open_closed_streams()
    try:
        scenario.require_clock(options.real_time)
    except ValueError as error:
        raise EngineError(str(error)) from error
    run: Engine = pkgutil.resolve_name(ENGINES[options.engine].function)
    return run(scenario, (lambda: folder) if isinstance(folder, Path) else folder, options)


def prepare(engine: str) -> None:
    """Begin to load an engine's libraries in the background, if it has any. Raises OSError."""
    if function := require_engine(engine).prepare:
        pkgutil.resolve_name(function)()


def require_engine(engine: str) -> EngineEntry:
    """Return the entry of the engine of this name. Raises ValueError if there is none."""
    if engine not in ENGINES:
        raise ValueError(f"engine: expected {_either(ENGINES)}, got {engine!r}")
    return ENGINES[engine]


def require_functions(**options: object) -> None:
    """Raise ValueError unless each option, given by name, is callable."""
    for name, option in options.items():
        if not callable(option):
            raise ValueError(f"{name}: expected a function to call, got {option!r}")


def _either(names: Iterable[str]) -> str:
    return " or ".join(map(repr, names))

"""phalanx.run, and the run that it returns: verdict, tables, report and page."""

import inspect
import tempfile
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from functools import cached_property, update_wrapper
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, Protocol

from phalanx.faults.commands import require_valid
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.engine import RunOptions, execute, require_functions, silent
from phalanx.recording.read import Recording, read, swarm_of
from phalanx.scenario.load import load
from phalanx.scenario.model import Scenario
from phalanx.schema.extensions import extension
from phalanx.swarm.swarm import Swarm

if TYPE_CHECKING:
    import polars as pl

P = ParamSpec("P")
Source = Scenario | str | Path
"""A scenario as load returns it, or a file or name that load takes."""


class Page(AbstractContextManager["Page"], Protocol):
    """A page that is served until it is closed, or its `with` block is left."""

    url: str

    def close(self) -> None:
        """Stop the server."""


class Explanation(Protocol):
    """The reasons of one input of an agent."""

    def sentences(self) -> list[str]: ...

    def table(self) -> list[tuple[str, ...]]: ...

    def as_json(self) -> dict[str, Any]: ...


class Run:
    """A finished run; its recording is read, and its tables are made, when they are first used."""

    def __init__(
        self,
        folder: Path,
        summary: Summary | None,
        temporary: "tempfile.TemporaryDirectory[str] | None" = None,
        recording: Recording | None = None,
    ) -> None:
        """temporary: removes the folder with this object. recording: if it was read already."""
        self.folder = folder
        """The folder of the recording, the summary, the logs and the report."""
        self.summary = summary
        """The plant's key figures; None if its recording is damaged, or ends without them."""
        self._temporary = temporary
        self._recording = recording
        self._opened = recording.path if recording else folder
        """The path to read again: an opened file may have another name than recording.mcap."""

    @property
    def verdict(self) -> Outcome | None:
        """guaranteed, safe, violated, broken or stopped; None without a summary."""
        return self.summary.outcome if self.summary else None

    @property
    def recording(self) -> Recording:
        """The recording. Raises UnreadableRecordingError."""
        if self._recording is None:
            self._recording = read(self._opened)
        return self._recording

    @property
    def scenario(self) -> Scenario:
        """The resolved scenario, with every default spelled out."""
        return self.recording.scenario

    @cached_property
    def states(self) -> "pl.DataFrame":
        """Every agent's states at every event, and h_tot; t in seconds."""
        from phalanx.recording.tables import states_table

        return states_table(self.recording, self._swarm)

    @cached_property
    def h(self) -> "pl.DataFrame":
        """Every pair's h at every event; safe is h <= 0."""
        from phalanx.recording.tables import h_table

        return h_table(self.recording, self._swarm)

    @cached_property
    def inputs(self) -> "pl.DataFrame":
        """Every control step: the input applied, the nominal one, and how it was made."""
        from phalanx.recording.tables import inputs_table

        return inputs_table(self.recording, self._swarm)

    @cached_property
    def links(self) -> "pl.DataFrame":
        """The fate of every broadcast."""
        from phalanx.recording.tables import links_table

        return links_table(self.recording)

    @cached_property
    def events(self) -> "pl.DataFrame":
        """The event log."""
        from phalanx.recording.tables import events_table

        return events_table(self.recording)

    @cached_property
    def metrics(self) -> "pl.DataFrame":
        """Metrics of the task, of each agent and the swarm: `phalanx.metrics.of(run)`."""
        from phalanx.recording.metrics.table import of

        return of(self)

    @cached_property
    def network_effect(self) -> "pl.DataFrame":
        """Difference of each input from that of an agent which knows the truth: agent, t, effect.

        The effect is a share of the inputs' largest distance. The run is repeated for it, without
        commands. Raises ValueError where one controller decides for all.
        """
        import polars as pl

        from phalanx.launcher.network_effect import network_effect

        return pl.DataFrame(network_effect(self.scenario), orient="row")

    def explain(self, agent: str, t: float, changes: bool = True) -> Explanation:
        """Explain an agent's last control step at or before t [s]: rows, costs, what frees it.

        changes: whether to look for changes that free it, which takes seconds for each field. The
        run is repeated for it. Raises EngineError: it cannot be, or no row made that input.
        """
        explanation: Explanation = extension("explain")(self.recording, agent, t, changes)
        return explanation

    def report(self, progress: Callable[[str], None] | None = None) -> Path:
        """Write report.html and its figures into the run's folder; return the path of report.html.

        progress: called with the name of each figure before it is drawn.
        """
        require_functions(progress=progress or silent)
        written: Path = extension("report")(self._opened, progress)
        return written

    def plot(self, *panels: str, axes: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Draw the run on matplotlib axes, and return them by panel.

        Args:
            panels: some of "paths" (seen from above), "h", "inputs" (the share of their bounds),
                "certified"; by default those of `axes`, or all.
            axes: those to draw on, by panel; by default a new figure's, which pyplot shows.

        Raises ValueError: there is no such panel, or the recording holds no state.
        """
        axes_by_panel: dict[str, Any] = extension("plot")(self.recording, panels, axes)
        return axes_by_panel

    def animate(self, path: str | Path, *, speed: float = 1.0, per_second: int = 15) -> Path:
        """Write the run as a moving picture: agents, broadcasts, h_tot, and the verdict at its end.

        Args:
            path: a name that ends in .gif or .webp.
            speed: virtual seconds in a second.
            per_second: frames.

        Returns the path.

        Raises:
            ValueError: there is no such format, or no state to draw.
            OSError: it cannot be written.
        """
        written: Path = extension("animate")(self.recording, Path(path), speed, per_second)
        return written

    def view(self, port: int | None = None) -> Page:
        """Replay the run on a page; port: by default 8080 or the next free one."""
        page: Page = extension("page")(self._opened, port)
        return page

    def judge_again(self) -> Summary:
        """Judge the recorded inputs again, without the agents that decided them.

        The summary equals the recorded one but for wall time and dropped payloads. Raises
        UnreadableRecordingError: there is no verdict, the run was in real time, or its inputs give
        another trajectory.
        """
        from phalanx_plant.rejudgement import judge_again

        return judge_again(self.recording)

    @cached_property
    def _swarm(self) -> Swarm:
        return swarm_of(self.recording)

    def __repr__(self) -> str:
        verdict = self.verdict or f"none: {self.recording.unfinished}"
        return f"Run({str(self.folder)!r}, verdict={str(verdict)!r})"

    def _repr_html_(self) -> str:
        """Return the key figures for a notebook."""
        if self.summary is None:
            why = escape(self.recording.unfinished)
            return f"<p>{escape(str(self.folder))}: no verdict, {why}</p>"
        return self.summary._repr_html_()


def open_run(folder: str | Path, *, trust: bool = False) -> Run:
    """Open a run from its folder or its recording file, whole or cut short.

    Args:
        folder: of the run, or its recording.
        trust: allow importing, and so running, the code that its scenario names.

    Raises:
        UnreadableRecordingError: there is no recording, or none that can be read.
    """
    recording = read(Path(folder), trust)
    return Run(recording.path.parent, recording.summary, recording=recording)


def _with_keywords(
    options: Callable[P, RunOptions],
) -> Callable[[Callable[[Source, RunOptions], Run]], Callable[Concatenate[Source, P], Run]]:
    """Let a function of a scenario and options take the options' fields as keywords."""

    def decorated(
        function: Callable[[Source, RunOptions], Run],
    ) -> Callable[Concatenate[Source, P], Run]:
        def with_keywords(scenario: Source, *engine: P.args, **keywords: P.kwargs) -> Run:
            return function(scenario, options(*engine, **keywords))

        scenario, _ = inspect.signature(function).parameters.values()
        keywords = inspect.signature(options).parameters.values()
        signature = inspect.Signature([scenario, *keywords], return_annotation=Run)
        vars(with_keywords)["__signature__"] = signature
        update_wrapper(with_keywords, function)
        return with_keywords  # type: ignore[return-value]  # scenario may be a keyword

    return decorated


@_with_keywords(RunOptions)
def run(scenario: Source, options: RunOptions) -> Run:
    """Run a scenario to its verdict.

    Args:
        scenario: as load returns it, or a file or name that load takes.
        options: as keywords, such as engine="in-process": RunOptions describes them.

    Returns:
        The finished run, also if it was stopped by Ctrl-C or broke on the way: see its verdict.

    Raises:
        ScenarioError: the scenario cannot be run.
        EngineError: the run could not begin, or ended without a verdict.
        ValueError: RunOptions refuses an option, or a scheduled command is invalid.
        OSError: no folder can be made.
    """
    if not isinstance(scenario, Scenario):
        scenario = load(scenario)
    names = tuple(name for group in scenario.named() for name in group.names)
    require_valid(options.commands.schedule, names)
    temporary, parent = folder_for_runs(options.out)
    name, folders = scenario.name, list[Path]()

    def make_folder() -> Path:
        folders.append(new_folder(parent, name))
        return folders[0]

    summary = execute(scenario, make_folder, options)
    return Run(folders[0], summary, temporary)


def folder_for_runs(
    out: str | Path | None,
) -> "tuple[tempfile.TemporaryDirectory[str] | None, Path]":
    """Return the parent of a run's folder: a new temporary one, removed with its object, or out."""
    if out is not None:
        return None, Path(out)
    temporary = tempfile.TemporaryDirectory(prefix="phalanx-")
    return temporary, Path(temporary.name)


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

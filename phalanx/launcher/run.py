"""A finished run: its verdict, tables, report and page, and how to repeat it."""

import tempfile
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.engine import DEFAULT_ENGINE, Progress, require_functions, silent
from phalanx.messages.profile import read_profile
from phalanx.recording.read import Recording, read, swarm_of
from phalanx.recording.records import PROFILE
from phalanx.scenario.model import Scenario
from phalanx.schema.extensions import extension
from phalanx.swarm.swarm import Swarm

if TYPE_CHECKING:
    import polars as pl

    from phalanx.launcher.verify import Verification


class Page(AbstractContextManager["Page"], Protocol):
    """A page that is served until it is closed, or its `with` block is left."""

    url: str

    def close(self) -> None:
        """Stop the server."""


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
        self._made_here = recording is None
        """Whether this program or its worker made the run, and so chose its code."""
        self._trust = False

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for another process, with all files of a temporary folder."""
        paths = self.folder.rglob("*") if self._temporary else ()
        files = {p.relative_to(self.folder): p.read_bytes() for p in paths if p.is_file()}
        fields = ("folder", "summary", "_opened", "_made_here")
        return {"files": files, **{name: getattr(self, name) for name in fields}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        files = state.pop("files")
        vars(self).update(state, _recording=None, _temporary=None, _trust=state["_made_here"])
        if files:
            self._temporary = tempfile.TemporaryDirectory(prefix="phalanx-")
            self.folder = self._opened = Path(self._temporary.name) / self.folder.name
        for path, content in files.items():
            file = self.folder / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)

    @property
    def verdict(self) -> Outcome | None:
        """guaranteed, safe, violated, broken or stopped; None without a summary."""
        return self.summary.outcome if self.summary else None

    @property
    def recording(self) -> Recording:
        """The recording. Raises UnreadableRecordingError."""
        if self._recording is None:
            self._recording = read(self._opened, self._trust)
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
    def profile(self) -> "pl.DataFrame":
        """Shares of every program's wall time, if the run was made with profile=True; else empty.

        One row for each program and phase: seconds, share of the program's wall time, and
        per_step [s]. An agent's steps are its own, the plant's are those of all agents.
        """
        from phalanx.recording.tables import profile_table

        return profile_table(read_profile(self.folder / PROFILE), self.summary)

    def report(
        self, progress: Callable[[str], None] | None = None, *, style: str = "screen"
    ) -> Path:
        """Write report.html and its figures into the run's folder; return the path of report.html.

        Args:
            progress: called with the name of each figure before it is drawn.
            style: "screen", or "paper": figures as wide as a paper's column, also as PDF.

        Raises ValueError: there is no such style.
        """
        require_functions(progress=progress or silent)
        written: Path = extension("report")(self._opened, progress, style)
        return written

    def plot(
        self, *panels: str, axes: Mapping[str, Any] | None = None, style: str = "screen"
    ) -> dict[str, Any]:
        """Draw the run on matplotlib axes, and return them by panel.

        Args:
            panels: some of "paths" (seen from above), "h", "inputs" (the share of their bounds),
                "certified"; by default those of `axes`, or all.
            axes: those to draw on, by panel; by default a new figure's, which pyplot shows.
            style: "screen", or "paper": as wide as a paper's column.

        Raises ValueError: there is no such panel or style, or the recording holds no state.
        """
        axes_by_panel: dict[str, Any] = extension("plot")(self.recording, panels, axes, style)
        return axes_by_panel

    def animate(self, path: str | Path, *, speed: float = 1.0, per_second: int = 15) -> Path:
        """Write the run as a moving picture: agents, broadcasts, h_tot, and the verdict at its end.

        Args:
            path: a name that ends in .gif, .webp or, with the program ffmpeg, .mp4.
            speed: virtual seconds in a second.
            per_second: frames.

        Returns the path.

        Raises:
            ValueError: there is no such format, or ffmpeg or a state to draw is missing.
            OSError: it cannot be written.
        """
        written: Path = extension("animate")(self.recording, Path(path), speed, per_second)
        return written

    def view(self, port: int | None = None) -> Page:
        """Replay the run on a page; port: by default 8080 or the next free one."""
        page: Page = extension("page")(self._opened, port)
        return page

    def verify(
        self,
        *,
        engine: str = DEFAULT_ENGINE,
        seed: int | None = None,
        progress: Progress = silent,
    ) -> "Verification":
        """Run it again and compare the trajectories bit by bit.

        Args:
            engine: the engine to run it on.
            seed: another seed, to see where the trajectories depart.
            progress: as run takes it.

        Raises:
            EngineError: it cannot be run again.
            ValueError: there is no such engine.
        """
        from phalanx.launcher.verify import verify

        return verify(self.recording, engine=engine, seed=seed, progress=progress)

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


def verify_run(
    run: Run | str | Path,
    *,
    engine: str = DEFAULT_ENGINE,
    progress: Progress = silent,
    trust: bool = False,
) -> "Verification":
    """Run a recording's scenario again and compare the trajectories bit by bit.

    Args:
        run: a finished run, or its folder.
        engine: the engine to run it on.
        progress: as run takes it.
        trust: as open takes it.

    Raises:
        UnreadableRecordingError: there is no recording, or none that can be read.
        EngineError: it cannot be run again.
        ValueError: there is no such engine.
    """
    finished = run if isinstance(run, Run) else open_run(run, trust=trust)
    return finished.verify(engine=engine, progress=progress)

"""One visitor's page: scene, texts and plots, of the agent and view that the visitor chose."""

import json
import time

import msgspec
import viser

from phalanx.messages.frames import Frame
from phalanx_viewer.feeds.feed import Feed
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.panels import CommandPanel, Panels
from phalanx_viewer.plots.plots import content, values_at
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.scene import Scene, add_display
from phalanx_viewer.scene.server import SceneServer

_PATH_PERIOD = 0.2
"""Wall time between two updates of recent paths [s]: each sends all of their points."""
_PLOT_PERIOD = 1.0
"""Least wall time between two updates of a live run's plots [s]: each sends all of them."""
_PLOT_SHARE = 0.01
"""Largest share of the time spent on plots: with many agents they are updated less often."""


class Visitor:
    """One visitor's choices and page; the run's time alone is the same for all visitors."""

    def __init__(
        self, server: SceneServer, client: viser.ClientHandle, feed: Feed, script: str
    ) -> None:
        """Fill a browser's page. script: JavaScript that adds `phalanx` to its window."""
        self._server, self.client, self._model = server, client, feed.model
        self.selected = 0
        """The chosen agent."""
        self._commands: CommandPanel | None = None
        server.run_script("script", script, client)
        self.scene = Scene(client, feed.model, self.select)
        self._panels = Panels(client.gui, feed.model, self.select)
        add_display(client.gui, self.scene)
        self._paths_due, self._pair = 0.0, 0
        self.follow(feed)

    def follow(self, feed: Feed) -> None:
        """Show a feed from now on: of a live run, or of its recording."""
        if isinstance(feed, Replay):
            self.scene.expect(feed.history.trajectory)
            if self._commands:
                self._commands.folder.remove()
                self._commands = None
        self._feed, self._plotted, self._plots_due = feed, (-1, -1, -1), 0.0
        self.stale = True
        """True until the page shows the last frame and choice."""

    def admit(self, live: Live) -> None:
        """Let the visitor command a live run."""
        chosen = self._model.names[self.selected]
        self._commands = self._commands or CommandPanel(self.client.gui, live, chosen)
        self.stale = True  # the panel has to show what is in force, even in a pause

    def select(self, i: int) -> None:
        """Make agent i the chosen one."""
        self.selected = i
        self._panels.show_selected(i)
        if self._commands:
            self._commands.show_selected(self._model.names[i])
        self.stale, self._plots_due = True, 0.0

    def tick(self) -> bool:
        """Send the plots if there is more to plot; return whether there may be more to show."""
        self._plot()
        self.scene.camera.request_shape()
        return self.stale or self.scene.stale

    def show(self, frame: Frame, picture: Picture) -> None:
        """Send all that shows a frame in one message, so that the page shows one instant."""
        if paths_due := (now := time.monotonic()) >= self._paths_due:
            # Before anything is shown: a selection made meanwhile shows at the next tick.
            self.stale, self._paths_due = False, now + _PATH_PERIOD
        with self.client.atomic():
            self.scene.show(picture, self.selected)
            self._panels.show(frame, self.selected, self._feed)
            values = values_at(self._feed, frame, self.selected, self._pair)
            clock = {"t": frame.t, "playing": not frame.paused, "speed": frame.speed}
            self._call("at", clock | {"values": values})
            if self._commands:
                self._commands.show(frame)
            if paths_due:
                self.scene.lines.show_recent_paths(self._feed.recent_paths(frame.t))

    def _plot(self) -> None:
        now, rows = time.monotonic(), self._feed.history.totals
        state = self.selected, len(rows), len(self._feed.log)
        if state == self._plotted or now < self._plots_due:
            return
        began, names = time.thread_time(), self._model.names
        others = [] if self._model.crowded else range(len(names))
        curves_of = [self.selected, *(i for i in others if i != self.selected)]
        seekable = isinstance(self._feed, Replay)
        data = content(self._feed, curves_of, seekable, inputs_of=[self.selected])
        self._call("show", data)
        self._pair, self.stale = data.pair, True
        duration = time.thread_time() - began
        self._plotted, self._plots_due = state, now + max(_PLOT_PERIOD, duration / _PLOT_SHARE)

    def _call(self, function: str, argument: object) -> None:
        """Call a function of the script with an argument as JSON."""
        quoted = json.dumps(msgspec.json.encode(argument).decode())  # parsed faster than a literal
        call = f"window.phalanx.{function}(JSON.parse({quoted}))"
        self._server.run_script(function, call, self.client)

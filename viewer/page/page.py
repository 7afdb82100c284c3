"""The page of one run: what is new in its feed goes to the scene, the texts and the plots."""

import time

import viser

from phalanx.viewer.feeds.feed import Feed
from phalanx.viewer.feeds.live import Live
from phalanx.viewer.feeds.replay import Replay
from phalanx.viewer.page.commands import CommandPanel
from phalanx.viewer.page.panels import Panels
from phalanx.viewer.page.plots import Plots
from phalanx.viewer.page.server import open_page
from phalanx.viewer.page.timeline import Timeline
from phalanx.viewer.scene.display import add_display
from phalanx.viewer.scene.picture import picture
from phalanx.viewer.scene.scene import Scene
from phalanx.wire.frames import Frame

_TEXT_PERIOD = 0.2
"""Wall time between two updates of texts and plots [s]: they cost more than the scene."""


class Page:
    """Everything on the page, for one feed.

    tick() is called in one thread, select() and what the panels do in threads of viser's.
    """

    def __init__(
        self,
        host: str,
        port: int | None,
        origins: tuple[str, ...],
        feed: Feed,
        live: Live | None = None,
        replay: Replay | None = None,
    ) -> None:
        """Serve it.

        Args:
            host: address to listen on.
            port: to listen on; None takes 8080 or the next free one.
            origins: further origins whose pages may connect.
            feed: what to show.
            live: the feed, if it is a live run: it gets a command panel if the plant obeys.
            replay: the feed, if it is a recording: it gets a timeline.

        Raises:
            ValueError, PortTakenError: the page cannot be served there.
        """
        model = feed.model
        self._feed = feed
        self.selected = 0
        self.server = open_page(host, port, f"Phalanx: {model.scenario.name}", origins)
        self._scene = Scene(self.server, model, self.select)
        if replay:
            self._scene.expect(replay.trajectory)
        self._panels = Panels(self.server, model, self.select)
        self._timeline = Timeline(self.server, replay) if replay else None
        self._commands = None
        if live and live.commandable:
            self._commands = CommandPanel(self.server, live, lambda: model.names[self.selected])
        add_display(self.server.gui, self._scene)
        self._plots = self._add_plots()
        self._frame: Frame | None = None
        self._standing = feed.summary, feed.over
        self._stale, self._texts_due = True, 0.0

    def select(self, i: int) -> None:
        """Make agent i the selected one."""
        self.selected = i
        self._panels.show_selected(i)
        self._stale = True

    def tick(self) -> None:
        """Show what is new."""
        frame = self._feed.take()
        if frame == self._frame:  # a paused plant repeats its frame
            frame = None
        standing = self._feed.summary, self._feed.over
        # The verdict and the plant's end come after the last frame: the texts have to be told once
        # more though no frame will ever come again.
        if frame is not None or standing != self._standing:
            self._standing, self._stale = standing, True
        self._frame = frame or self._frame
        if self._frame is None or not (self._stale or self._scene.stale):
            return
        now = time.monotonic()
        if texts_due := now >= self._texts_due:
            # Before anything is shown: what is selected meanwhile shows at the next tick.
            self._stale, self._texts_due = False, now + _TEXT_PERIOD
        self._scene.show(picture(self._feed.model, self._frame), self.selected)
        if texts_due:
            self._tell(self._frame)

    def _tell(self, frame: Frame) -> None:
        """Texts and plots, in one message to every page."""
        with self.server.atomic():
            self._panels.show(frame, self.selected, self._feed.summary, self._feed.over)
            self._scene.lines.show_recent_paths(self._feed.recent_paths(frame.t))
            self._plots.show(self._feed.history, frame.t, self.selected)
            if self._timeline:
                self._timeline.show()
            if self._commands:
                self._commands.show(frame)

    def _add_plots(self) -> Plots:
        """Plots dock to the right of the scene, everything else to its left."""
        gui = self.server.gui
        right = gui.add_panel()
        with right.add_tab("Plots", viser.Icon.CHART_LINE):
            plots = Plots(self.server, self._feed.model)
        right.dock_right()
        right.set_width(380)
        gui.main_panel.dock_left()
        gui.main_panel.set_width(360)
        return plots

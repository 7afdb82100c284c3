"""The viewer's shell: a feed, live or recorded, shown on a page until it is told to stop."""

import logging
import signal
import threading
import time
from pathlib import Path

import viser

from phalanx.scenario.model import Scenario
from phalanx.viewer.feeds.live import Feed, Live
from phalanx.viewer.feeds.replay import Replay, open_replay
from phalanx.viewer.page.commands import Controls
from phalanx.viewer.page.panels import Panels
from phalanx.viewer.page.plots import Plots
from phalanx.viewer.page.server import choose_port, open_page
from phalanx.viewer.page.timeline import Timeline
from phalanx.viewer.scene.picture import picture
from phalanx.viewer.scene.scene import Scene
from phalanx.wire.frames import Frame

log = logging.getLogger("phalanx.viewer")

_FRAME = 1.0 / 30.0
_TEXT = 0.2
"""Wall time between two updates of texts and plots [s]."""


def run(
    scenario: Scenario | None = None,
    *,
    recording: Path | None = None,
    run_id: str = "",
    endpoint: str = "",
    secret: bytes = b"",
    control: bytes = b"",
    host: str = "127.0.0.1",
    port: int | None = None,
    origins: tuple[str, ...] = (),
    timeout: float = 60.0,
) -> int:
    """Show a run until SIGINT or SIGTERM.

    Args:
        scenario: as every program of a run gets it; a live viewer asks the plant instead.
        recording: a run folder or recording file to replay; without one, the run is live.
        run_id: of the live run.
        endpoint: the hub's Zenoh endpoint.
        secret: the run's secret, for the seal.
        control: the run's control secret, for a viewer that may command; empty: read-only.
        host: address to serve the page on.
        port: to serve the page on; None takes 8080 or the next free one, and says which.
        origins: further origins whose pages may connect; needed behind a proxy only.
        timeout: how long to try to reach the hub [s of wall time].

    Returns:
        Exit status 0.

    Raises:
        HubError, NoRunError: there is no such live run.
        UnreadableRecordingError, ValueError: nothing to replay.
        PortTakenError: the page cannot be served there.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    at = choose_port(host, port)
    if recording is not None:
        replay = open_replay(recording)
        _show(Page(host, at, origins, replay, timeline=replay), stop)
        return 0
    with Live(endpoint, run_id, secret, control, timeout) as live:
        if control and not live.commandable:
            log.warning("the plant obeys no commands: it was started without a control secret")
        _show(Page(host, at, origins, live, live=live), stop)
    return 0


class Page:
    """Everything on the page, for one feed."""

    def __init__(
        self,
        host: str,
        port: int,
        origins: tuple[str, ...],
        feed: Feed,
        live: Live | None = None,
        timeline: Replay | None = None,
    ) -> None:
        cast = feed.cast
        self._feed = feed
        self.selected = 0
        self.server = open_page(host, port, f"Phalanx: {cast.scenario.name}", origins)
        self._scene = Scene(self.server, cast, self.select)
        self._panels = Panels(self.server, cast, self.select)
        self._timeline = Timeline(self.server, timeline) if timeline else None
        self._controls = None
        if live and live.commandable:
            self._controls = Controls(self.server, live, lambda: cast.names[self.selected])
        self._add_display()
        panel = self.server.gui.add_panel()
        with panel.add_tab("Plots", viser.Icon.CHART_LINE):
            self._plots = Plots(self.server, cast)
        panel.dock_right()
        panel.set_width(380)
        self.server.gui.main_panel.dock_left()
        self.server.gui.main_panel.set_width(360)
        self._frame: Frame | None = None
        self._told = -1.0
        self._standing = feed.summary, feed.over
        self._changed = True

    def select(self, i: int) -> None:
        """Make agent i the chosen one."""
        self.selected = i
        self._panels.choose(i)
        self._changed = True

    def tick(self) -> None:
        """Show what is new."""
        frame = self._feed.take()
        if frame == self._frame:  # virtual time stands still
            frame = None
        if frame is not None or (self._changed and self._frame):
            self._frame = frame or self._frame
            assert self._frame is not None
            self._scene.show(picture(self._feed.cast, self._frame), self.selected)
        now, standing = time.monotonic(), (self._feed.summary, self._feed.over)
        if frame is not None or standing != self._standing:  # a run ends after its last frame
            self._standing, self._changed = standing, True
        if self._frame and self._changed and now - self._told > _TEXT:
            self._told, self._changed = now, False
            self._tell()

    def _tell(self) -> None:
        """Texts and plots, less often than the scene."""
        frame = self._frame
        assert frame is not None
        with self.server.atomic():
            self._panels.show(frame, self.selected, self._feed.summary, self._feed.over)
            self._scene.show_past(self._feed.past(frame.t))
            self._plots.show(self._feed.history, frame.t, self.selected)
            if self._timeline:
                self._timeline.show()
            if self._controls:
                self._controls.show(frame)

    def _add_display(self) -> None:
        gui, scene = self.server.gui, self._scene
        with gui.add_folder("Display", expand_by_default=False, order=80):
            follow = gui.add_checkbox("Follow the agent", False)
            arrows = gui.add_checkbox("Inputs", True)
            trails = gui.add_checkbox("Trails", True)
            links = gui.add_checkbox("Late and lost links", True)
        follow.on_update(lambda _: setattr(scene, "follow", follow.value))
        arrows.on_update(lambda _: scene.show_arrows(arrows.value))
        trails.on_update(lambda _: scene.show_trails(trails.value))
        links.on_update(lambda _: scene.show_links(links.value))


def _show(page: Page, stop: threading.Event) -> None:
    where = f"http://{page.server.get_host()}:{page.server.get_port()}"
    print(f"viewer: {where}", flush=True)
    log.info("showing the run at %s", where)
    while not stop.wait(_FRAME):
        page.tick()
    page.server.stop()

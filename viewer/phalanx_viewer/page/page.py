"""The page of one run: scene, texts and plots, updated from its feed."""

import json
import logging
import time

import msgspec

from phalanx.wire.messages import Frame
from phalanx_viewer.feeds.feed import Feed
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.panels import Commands, Panels
from phalanx_viewer.plots.content import script
from phalanx_viewer.plots.plots import content, values_at
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.scene import Scene, add_display
from phalanx_viewer.scene.server import open_page

log = logging.getLogger("phalanx.viewer")

_TEXT_PERIOD = 0.2
"""Wall time between two updates of texts [s]: they are slower than the scene."""
_PLOT_PERIOD = 1.0
"""Least wall time between two updates of a live run's plots [s]: each sends all of them."""
_PLOT_SHARE = 0.01
"""Largest share of the time spent on plots: with many agents they are updated less often."""
_CONNECT = """
if (!window.phalanx.connected) (() => {
  let socket = null, unsent = null;
  // A visitor who may command has the token in the address; the server asks for it under a name.
  const answer = () => {
    const token = new URLSearchParams(location.search).get("token");
    const visitor = window.phalanxVisitor;
    if (!token || !visitor || socket.readyState !== WebSocket.OPEN) return;
    window.phalanxVisitor = null;
    socket.send(JSON.stringify({ visitor, token }));
  };
  const connect = () => {
    socket = new WebSocket(location.origin.replace("http", "ws") + "/actions");
    socket.onopen = () => {
      answer();
      if (unsent) socket.send(unsent);
      unsent = "";
    };
    socket.onclose = () => setTimeout(connect, 1000);
  };
  addEventListener("phalanx-visitor", answer);
  connect();
  window.phalanx.connected = true;
  window.phalanx.act = action => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(action));
    // An action for a server that is gone is not for the one that comes after it.
    else if (unsent !== "") unsent = JSON.stringify(action);
  };
})();
"""


class Action(msgspec.Struct, frozen=True):
    """An action of a visitor; null leaves something as it is."""

    seek: float | None = None
    """[s]"""
    step: int | None = None
    """Number of recorded states to move by."""
    play: bool | None = None
    speed: float | None = None
    """Speed of a replay, in multiples of real time."""
    visitor: str = ""
    """Name under which the server asked for the token, if the visitor has one."""
    token: str = ""


class Page:
    """Everything on the page, for one feed.

    tick() and replay() are called in one thread, everything else in the server's.
    """

    def __init__(
        self, host: str, port: int | None, origins: tuple[str, ...], feed: Feed, token: str = ""
    ) -> None:
        """Serve the page at an address, as open_page() does.

        token: secret of visitors that may command a live run; empty: none may.
        """
        model = feed.model
        self._feed = feed
        self.selected = 0
        self.server = open_page(host, port, f"Phalanx: {model.scenario.name}", origins)
        self._scene = Scene(self.server, model, self.select)
        if isinstance(feed, Replay):
            self._scene.expect(feed.history.trajectory)
        self._panels = Panels(self.server, model, self.select)
        self.server.on_action = self._on_action
        self.server.run_script("script", script() + _CONNECT)
        self._plotted: tuple[int, int, int] | None = None
        self._plots_due = 0.0
        self._pair = 0
        self._commands = None
        if isinstance(feed, Live) and feed.commandable and token:
            self._commands = Commands(self.server, feed, token, lambda: model.names[self.selected])
        add_display(self.server.gui, self._scene)
        self.server.gui.main_panel.dock_left()
        self.server.gui.main_panel.set_width(360)
        self._frame: Frame | None = None
        self._outcome = feed.summary, feed.over
        self._stale, self._texts_due = True, 0.0
        self.server.admit()

    def select(self, i: int) -> None:
        """Make agent i the selected one."""
        self.selected = i
        self._panels.show_selected(i)
        self._stale, self._plots_due = True, 0.0

    def replay(self, replay: Replay) -> None:
        """Continue with the recording of the run that was shown live, at its end."""
        replay.seek(replay.end)
        self.server.run(lambda: self._show_instead(replay))

    def tick(self) -> None:
        self.server.run(self._tick)

    def _show_instead(self, replay: Replay) -> None:
        self._scene.expect(replay.history.trajectory)
        self._feed, self._frame, self._plotted, self._plots_due = replay, None, None, 0.0
        if self._commands:
            self._commands.remove()
            self._commands = None
        self._stale = True

    def _tick(self) -> None:
        frame = self._feed.take()
        self._plot()
        self._scene.cameras.request_shapes()
        if frame == self._frame:  # a paused plant repeats its frame
            frame = None
        outcome = self._feed.summary, self._feed.over
        # The verdict and the plant's end come after the last frame, but change the texts.
        if frame is not None or outcome != self._outcome:
            self._outcome, self._stale = outcome, True
        self._frame = frame or self._frame
        if self._frame is None or not (self._stale or self._scene.stale):
            return
        if not self.server.get_clients():  # drawn when a visitor comes
            return
        now = time.monotonic()
        if texts_due := now >= self._texts_due:
            # Before anything is shown: a selection made meanwhile shows at the next tick.
            self._stale, self._texts_due = False, now + _TEXT_PERIOD
        self._scene.show(Picture(self._feed.model, self._frame), self.selected)
        if texts_due or isinstance(self._feed, Replay):
            self._call("at", self._clock(self._frame))
        if texts_due:
            self._show_texts(self._frame)

    def _clock(self, frame: Frame) -> dict[str, object]:
        values = values_at(self._feed, frame, self.selected, self._pair)
        return {"t": frame.t, "playing": not frame.paused, "speed": frame.speed, "values": values}

    def _show_texts(self, frame: Frame) -> None:
        """Send texts and recent paths, in one message to every page."""
        with self.server.atomic():
            self._panels.show(frame, self.selected, self._feed)
            self._scene.lines.show_recent_paths(self._feed.recent_paths(frame.t))
            if self._commands:
                self._commands.show(frame)

    def _plot(self) -> None:
        """Send the plots if there is more to plot, and a visitor to see it."""
        now, rows = time.monotonic(), self._feed.history.totals
        shown = self.selected, len(rows), len(self._feed.log)
        if shown == self._plotted or now < self._plots_due or not self.server.get_clients():
            return
        began, names = time.thread_time(), self._feed.model.names
        others = [] if self._feed.model.crowded else range(len(names))
        curves_of = [self.selected, *(i for i in others if i != self.selected)]
        seekable = isinstance(self._feed, Replay)
        drawn = content(self._feed, curves_of, seekable, inputs_of=[self.selected])
        self._call("show", drawn)
        self._pair, self._stale = drawn.pair, True
        taken = time.thread_time() - began
        self._plotted, self._plots_due = shown, now + max(_PLOT_PERIOD, taken / _PLOT_SHARE)

    def _call(self, function: str, argument: object) -> None:
        """Call a function of the script with an argument as JSON, on every page, now or later."""
        quoted = json.dumps(msgspec.json.encode(argument).decode())  # parsed faster than a literal
        self.server.run_script(function, f"window.phalanx.{function}(JSON.parse({quoted}))")

    def _on_action(self, text: str | bytes) -> None:
        try:
            action = msgspec.json.decode(text, type=Action)
        except msgspec.DecodeError as error:
            log.warning("not an action: %s", error)
            return
        if self._commands and action.visitor:
            self._commands.answer(action.visitor, action.token)
        replay = self._feed
        if not isinstance(replay, Replay):
            return
        if action.seek is not None:
            replay.seek(action.seek)
        if action.step is not None:
            replay.step(action.step)
        if action.play is not None:
            replay.play(action.play)
        if action.speed is not None:
            replay.set_speed(action.speed)

"""The page of one run, updated from its feed, and each visitor's scene, texts and plots."""

import hmac
import json
import logging
import secrets
import time
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import viser

from phalanx.messages.frames import Frame
from phalanx.schema.extensions import MissingExtensionError, extension
from phalanx_viewer.feeds import Feed
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.panels import CommandPanel, Panels
from phalanx_viewer.plots.plots import content, script, values_at
from phalanx_viewer.scene.picture import Picture
from phalanx_viewer.scene.scene import Scene, add_display, begin_with
from phalanx_viewer.scene.server import SceneServer, in_loop, open_page

log = logging.getLogger("phalanx.viewer")

_PATH_PERIOD = 0.2
"""Wall time between two updates of recent paths [s]: each sends all of their points."""
_PLOT_PERIOD = 1.0
"""Least wall time between two updates of a live run's plots [s]: each sends all of them."""
_PLOT_SHARE = 0.01
"""Largest share of the time spent on plots: with many agents they are updated less often."""

_PANEL = 252
"""Width of viser's panel [pixels]: with the plots it leaves the scene 60 % of a page of 1280."""

_CONNECT = """
if (!window.phalanx.connect) (() => {
  let socket = null, unsent = null, visitor = "";
  // A visitor who may command has the token in the address.
  const token = new URLSearchParams(location.search).get("token");
  const answer = () => {
    if (token && socket.readyState === WebSocket.OPEN)
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
  connect();
  window.phalanx.connect = name => { visitor = name; answer(); };
  window.phalanx.act = action => {
    const text = JSON.stringify({ ...action, visitor });
    if (socket.readyState === WebSocket.OPEN) socket.send(text);
    // An action for a server that is gone is not for the one that comes after it.
    else if (unsent !== "") unsent = text;
  };
})();
window.phalanx.connect("NAME");
"""


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
        self.explanation: Any = None
        """The panel of the package that explains, if there is one and the run is recorded."""
        server.run_script("script", script, client)
        self.scene = Scene(client, feed.model, self.select)
        self._panels = Panels(client.gui, feed.model, self.select)
        add_display(client.gui, self.scene, feed.model)
        self._paths_due, self._pair = 0.0, 0
        self.follow(feed)

    def leave(self) -> None:
        """Stop what was begun for this visitor alone."""
        if self.explanation:
            self.explanation.leave()

    def follow(self, feed: Feed) -> None:
        """Show a feed from now on: of a live run, or of its recording."""
        if isinstance(feed, Replay):
            self.scene.expect(feed.history.trajectory)
            with suppress(MissingExtensionError):
                panel = extension("explanation-panel")
                self.explanation = panel(self._server, self.client.gui, partial(self._shown, feed))
            if self._commands:
                self._commands.folder.remove()
                self._commands = None
        self._feed, self._plots_due = feed, 0.0
        self.past: Frame | None = None
        """The frame of a live run that the visitor looks back at."""
        self._plotted: object = None
        self.stale = True
        """True until the page shows the last frame and choice."""

    def _shown(self, replay: Replay) -> tuple[Path, str, float]:
        return replay.path, self._model.names[self.selected], replay.t

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

    def look_back(self, live: Live, action: "Action") -> None:
        """Show a frame of a live run's past, or the present again."""
        t = action.seek if action.seek is not None else self.past.t if self.past else np.inf
        if action.seek is not None or action.step:
            self.past = live.history.frame_at(t, action.step or 0)
            self.stale, self._paths_due = True, 0.0

    def tick(self) -> bool:
        """Send the plots if there is more to plot; return whether there may be more to show."""
        self._plot()
        self.scene.camera.request_shape()
        return self.stale or self.scene.stale

    def show(self, newest: Frame, picture: Picture) -> None:
        """Send all that shows a frame in one message, so that the page shows one instant.

        Of a live run that can be one of its past, of which `picture` is not.
        """
        frame = self.past or newest
        picture = Picture(self._model, frame) if self.past else picture
        if paths_due := (now := time.monotonic()) >= self._paths_due:
            # Before anything is shown: a selection made meanwhile shows at the next tick. And only
            # with the paths: a page that was fresh without them would never get its last ones.
            self.stale, self._paths_due = False, now + _PATH_PERIOD
        with self.client.atomic():
            radio = self._feed.radio
            self.scene.show(
                picture, self.selected, radio.at(self.selected, frame.t) if radio else ()
            )
            self._panels.show(frame, self.selected, self._feed, past=self.past is not None)
            values = values_at(self._feed, frame, self.selected, self._pair)
            live = not isinstance(self._feed, Replay)
            playing = self.past is None if live else not frame.paused
            clock = {"t": frame.t, "playing": playing, "speed": frame.speed, "now": newest.t}
            self._call("at", clock | {"values": values})
            if self._commands:
                self._commands.show(newest)
            if paths_due:
                self.scene.lines.show_recent_paths(self._feed.recent_paths(frame.t))

    def _plot(self) -> None:
        now, rows = time.monotonic(), self._feed.history.totals
        state = self.selected, len(rows), len(self._feed.log), frozenset(self.scene.hidden)
        if state == self._plotted or now < self._plots_due:
            return
        began, names = time.thread_time(), self._model.names
        others = [] if self._model.crowded else range(len(names))
        curves_of = [self.selected, *(i for i in others if i != self.selected)]
        seekable = isinstance(self._feed, Replay)
        data = content(self._feed, curves_of, seekable, [self.selected], self.scene.hidden)
        self._call("show", data)
        self._pair, self.stale = data.pair, True
        duration = time.thread_time() - began
        self._plotted, self._plots_due = state, now + max(_PLOT_PERIOD, duration / _PLOT_SHARE)

    def _call(self, function: str, argument: object) -> None:
        """Call a function of the script with an argument as JSON."""
        quoted = json.dumps(msgspec.json.encode(argument).decode())  # parsed faster than a literal
        call = f"window.phalanx.{function}(JSON.parse({quoted}))"
        self._server.run_script(function, call, self.client)


class Action(msgspec.Struct, frozen=True):
    """An action of a visitor; null leaves something as it is."""

    seek: float | None = None
    """[s]"""
    step: int | None = None
    """Number of recorded states to move by."""
    play: bool | None = None
    speed: float | None = None
    """Speed of a replay, in multiples of real time."""
    agent: str | None = None
    """The agent that the visitor chooses, by name."""
    visitor: str = ""
    """Name that the server gave the visitor."""
    token: str = ""
    """Of the visitor's address."""


class Page:
    """The page of one feed: all visitors see one time, and each chooses all else.

    tick() and replay() are called in one thread, everything else in the server's.
    """

    def __init__(
        self, host: str, port: int | None, origins: tuple[str, ...], feed: Feed, token: str = ""
    ) -> None:
        """Serve the page at an address, as open_page() does.

        token: secret of visitors that may command a live run; empty: none may.
        """
        self._feed, self._token = feed, token
        self.visitors = dict[str, Visitor]()
        self.server = open_page(host, port, f"Phalanx: {feed.model.scenario.name}", origins)
        self._begin_with(feed)
        self.server.gui.main_panel.dock_left()
        self.server.gui.main_panel.set_width(_PANEL)
        self._frame: Frame | None = None
        self._outcome = feed.summary, feed.over
        self.server.on_action = self._on_action
        self.server.on_client_connect(in_loop(self._on_visitor))
        self.server.on_client_disconnect(in_loop(self._on_leave))
        self.server.admit()

    def replay(self, replay: Replay) -> None:
        """Continue with the recording of the run that was shown live, at its end.

        Its only visitor may go on looking back at a time.
        """
        self.server.run(lambda: self._show_instead(replay))

    def tick(self) -> None:
        self.server.run(self._tick)

    def stop(self) -> None:
        """Stop serving, and what was begun for visitors."""
        for visitor in self.visitors.values():
            visitor.leave()
        self.server.stop()

    def _begin_with(self, feed: Feed) -> None:
        run = feed.history.trajectory if isinstance(feed, Replay) else feed.model.corners
        begin_with(self.server, feed.model, run.reshape(-1, 3))

    def _on_visitor(self, client: viser.ClientHandle) -> None:
        # The token comes by another connection: under a name that cannot be guessed.
        name = secrets.token_urlsafe(16)
        connect = script() + _CONNECT.replace("NAME", name)
        self.visitors[name] = Visitor(self.server, client, self._feed, connect)

    def _on_leave(self, client: viser.ClientHandle) -> None:
        for visitor in self.visitors.values():
            if visitor.client is client:
                visitor.leave()
        self.visitors = {k: v for k, v in self.visitors.items() if v.client is not client}

    def _show_instead(self, replay: Replay) -> None:
        past = [visitor.past.t for visitor in self.visitors.values() if visitor.past]
        replay.seek(past[0] if len(past) == len(self.visitors) == 1 else replay.end)
        self._feed, self._frame = replay, None
        self._begin_with(replay)
        for visitor in self.visitors.values():
            visitor.follow(replay)

    def _tick(self) -> None:
        frame = self._feed.take()
        if frame == self._frame:  # a paused plant repeats its frame
            frame = None
        outcome = self._feed.summary, self._feed.over
        # The verdict and the plant's end come after the last frame, but change the texts.
        if frame is not None or outcome != self._outcome:
            self._outcome = outcome
            for visitor in self.visitors.values():
                visitor.stale = True
        self._frame = frame or self._frame
        due = [visitor for visitor in self.visitors.values() if visitor.tick()]
        if self._frame is None or not due:
            return
        picture = Picture(self._feed.model, self._frame)
        for visitor in due:
            visitor.show(self._frame, picture)

    def _on_action(self, text: str | bytes) -> None:
        try:
            action = msgspec.json.decode(text, type=Action)
        except msgspec.DecodeError as error:
            log.warning("not an action: %s", error)
            return
        visitor, names = self.visitors.get(action.visitor), self._feed.model.names
        if visitor and action.token:
            self._admit(visitor, action.token)
        if visitor and action.agent in names:
            visitor.select(names.index(action.agent))
        replay = self._feed
        if not isinstance(replay, Replay):
            if visitor:
                visitor.look_back(replay, action)
            return
        if action.seek is not None:
            replay.seek(action.seek)
        if action.step is not None:
            replay.step(action.step)
        if action.play is not None:
            replay.play(action.play)
        if action.speed is not None:
            replay.set_speed(action.speed)

    def _admit(self, visitor: Visitor, token: str) -> None:
        """Let a visitor command the run, if it sent the token of the address."""
        live = self._feed
        if not (isinstance(live, Live) and live.commandable and self._token):
            return
        if hmac.compare_digest(token.encode(), self._token.encode()):
            visitor.admit(live)
        else:
            log.warning("a visitor with a wrong token may look, but not command")

"""The command panels: pause and pace, faults of the network and of the selected agent."""

import hmac
import logging
import secrets
from collections.abc import Callable

import viser

from phalanx.faults.commands import EFFECTS, CommandKind
from phalanx.wire.messages import Frame
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.scene.server import Callback, SceneServer, in_loop

log = logging.getLogger("phalanx.viewer")

_SPEEDS = {"as fast as possible": 0.0, **{f"{s:g} ×": s for s in (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)}}

_ON_AGENT = tuple(kind.title() for kind in EFFECTS)


class Commands:
    """Command panels of the visitors whose address had the token; other pages have none."""

    def __init__(
        self, server: SceneServer, live: Live, token: str, selected: Callable[[], str]
    ) -> None:
        """Ask every visitor for the token.

        selected: returns the name of the agent that receives commands to an agent.
        """
        self._server, self._live, self._token, self._selected = server, live, token, selected
        self._asked: dict[str, viser.ClientHandle] = {}
        self._panels: dict[int, CommandPanel] = {}
        server.on_client_connect(in_loop(self._ask))
        server.on_client_disconnect(in_loop(self._forget))

    def answer(self, visitor: str, token: str) -> None:
        """Give a visitor who sent the right token a panel; `visitor` is the name from _ask."""
        client = self._asked.pop(visitor, None)
        if client is None:
            return
        if hmac.compare_digest(token.encode(), self._token.encode()):
            self._panels[client.client_id] = CommandPanel(client.gui, self._live, self._selected)
        else:
            log.warning("a visitor with a wrong token may look, but not command")

    def show(self, frame: Frame) -> None:
        """Set every panel's sliders to the plant's loss and delay."""
        for panel in self._panels.values():
            panel.show(frame)

    def remove(self) -> None:
        """Remove the panels: the run is over."""
        self._asked.clear()
        for panel in self._panels.values():
            panel.folder.remove()
        self._panels.clear()

    def _ask(self, client: viser.ClientHandle) -> None:
        # The answer comes by another connection: a name that cannot be guessed, and is used once.
        visitor = secrets.token_urlsafe(16)
        self._asked[visitor] = client
        ask = f'window.phalanxVisitor = "{visitor}"; dispatchEvent(new Event("phalanx-visitor"));'
        self._server.run_script("visitor", ask, client)

    def _forget(self, client: viser.ClientHandle) -> None:
        self._asked = {name: asked for name, asked in self._asked.items() if asked is not client}
        self._panels.pop(client.client_id, None)


class CommandPanel:
    """One visitor's command panel."""

    def __init__(self, gui: viser.GuiApi, live: Live, selected: Callable[[], str]) -> None:
        self._live = live
        self.folder = gui.add_folder("Command", order=10)
        with self.folder:
            self._pause = gui.add_button_group("Run", ("Pause", "Resume", "Step"))
            self._step = gui.add_number("Step [s]", 0.01, min=0.001, max=10.0, step=0.001)
            self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS))
            self._loss = gui.add_slider("Loss [%]", min=0, max=100, step=1, initial_value=0)
            self._delay = gui.add_slider("Delay [ms]", min=0, max=500, step=1, initial_value=0)
            self._agent = gui.add_button_group("Agent", _ON_AGENT)
        self._shown: tuple[float | None, float | None] = None, None
        """Loss and delay in the last frame."""

        def command(kind: CommandKind, value: Callable[[], float]) -> Callback:
            # Only for visitors: viser also calls back when show() sets a value.
            return in_loop(lambda e: live.command(kind, value=value()) if e.client else None)

        def command_agent(_: object) -> None:
            live.command(CommandKind(self._agent.value.lower()), agent=selected())

        self._pause.on_click(in_loop(lambda _: self._command_pace()))
        self._agent.on_click(in_loop(command_agent))
        self._speed.on_update(command(CommandKind.SPEED, lambda: _SPEEDS[self._speed.value]))
        self._loss.on_update(command(CommandKind.LOSS, lambda: self._loss.value / 100.0))
        self._delay.on_update(command(CommandKind.DELAY, lambda: self._delay.value / 1000.0))

    def show(self, frame: Frame) -> None:
        """Set the sliders to the plant's loss and delay."""
        # Only what changed: otherwise a slider that a visitor has just moved would jump back before
        # the command is sent, and the command would carry the old value.
        loss, delay = self._shown
        if frame.loss is not None and frame.loss != loss:
            self._loss.value = round(100.0 * frame.loss)  # type: ignore[misc]
        if frame.delay is not None and frame.delay != delay:
            self._delay.value = round(1000.0 * frame.delay)  # type: ignore[misc]
        self._shown = frame.loss, frame.delay

    def _command_pace(self) -> None:
        kind = CommandKind(self._pause.value.lower())
        self._live.command(kind, value=self._step.value if kind == CommandKind.STEP else 0.0)

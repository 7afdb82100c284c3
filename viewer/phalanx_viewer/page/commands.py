"""The command panels: pause and pace, the network, and what becomes of the selected agent."""

import hmac
import logging
import secrets
from collections.abc import Callable, Coroutine
from typing import Any

import viser

from phalanx.faults.commands import EFFECTS, CommandKind
from phalanx.wire.messages import Frame
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.scene.server import SceneServer, in_loop

log = logging.getLogger("phalanx.viewer")

_SPEEDS = {"as fast as possible": 0.0, **{f"{s:g} ×": s for s in (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)}}

_ON_AGENT = tuple(kind.title() for kind in EFFECTS)


class Commands:
    """The panels of those visitors whose address had the token; nobody else's page has one."""

    def __init__(
        self, server: SceneServer, live: Live, token: str, selected: Callable[[], str]
    ) -> None:
        """Ask every visitor for the token.

        Args:
            server: of the page.
            live: the run, which obeys.
            token: what its visitors must show.
            selected: tells the name of the agent that commands to an agent are meant for.
        """
        self._server, self._live, self._token, self._selected = server, live, token, selected
        self._asked: dict[str, viser.ClientHandle] = {}
        self._panels: dict[int, CommandPanel] = {}
        server.on_client_connect(in_loop(self._ask))
        server.on_client_disconnect(in_loop(self._forget))

    def answer(self, visitor: str, token: str) -> None:
        """Give a visitor, by the name that he was asked by, a panel for the right token."""
        client = self._asked.pop(visitor, None)
        if client is None:
            return
        if hmac.compare_digest(token.encode(), self._token.encode()):
            self._panels[client.client_id] = CommandPanel(client.gui, self._live, self._selected)
        else:
            log.warning("a visitor with a wrong token may look, but not command")

    def show(self, frame: Frame) -> None:
        """Let the sliders say what the plant does, whoever asked for it."""
        for panel in self._panels.values():
            panel.show(frame)

    def remove(self) -> None:
        """Take the panels off the page: nobody is there to command."""
        self._asked.clear()
        for panel in self._panels.values():
            panel.remove()
        self._panels.clear()

    def _ask(self, client: viser.ClientHandle) -> None:
        # A name that nobody can guess, nor use again: his answer comes by another connection.
        visitor = secrets.token_urlsafe(16)
        self._asked[visitor] = client
        ask = f'window.phalanxVisitor = "{visitor}"; dispatchEvent(new Event("phalanx-visitor"));'
        self._server.run_script("visitor", ask, client)

    def _forget(self, client: viser.ClientHandle) -> None:
        self._asked = {name: who for name, who in self._asked.items() if who is not client}
        self._panels.pop(client.client_id, None)


class CommandPanel:
    """One visitor's."""

    def __init__(self, gui: viser.GuiApi, live: Live, selected: Callable[[], str]) -> None:
        self._live, self._selected = live, selected
        self._folder = gui.add_folder("Command", order=10)
        with self._folder:
            self._pause = gui.add_button_group("Run", ("Pause", "Resume", "Step"))
            self._step = gui.add_number("Step [s]", 0.01, min=0.001, max=10.0, step=0.001)
            self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS))
            self._loss = gui.add_slider("Loss [%]", min=0, max=100, step=1, initial_value=0)
            self._delay = gui.add_slider("Delay [ms]", min=0, max=500, step=1, initial_value=0)
            self._agent = gui.add_button_group("Agent", _ON_AGENT)
        self._shown: tuple[float | None, float | None] = None, None
        """Loss and delay as the plant last told them."""
        self._pause.on_click(in_loop(lambda _: self._command_pace()))
        self._agent.on_click(in_loop(lambda _: self._command_agent()))
        self._speed.on_update(_by_visitors(self._command_speed))
        self._loss.on_update(_by_visitors(self._command_loss))
        self._delay.on_update(_by_visitors(self._command_delay))

    def remove(self) -> None:
        """Take it off the page."""
        self._folder.remove()

    def show(self, frame: Frame) -> None:
        """Let the sliders say what the plant does."""
        # Only what changed: else a slider that a visitor has just moved would be put back before
        # his command is on its way, and the command would carry the old value.
        loss, delay = self._shown
        if frame.loss is not None and frame.loss != loss:
            self._loss.value = round(100.0 * frame.loss)  # type: ignore[misc]
        if frame.delay is not None and frame.delay != delay:
            self._delay.value = round(1000.0 * frame.delay)  # type: ignore[misc]
        self._shown = frame.loss, frame.delay

    def _command_pace(self) -> None:
        kind = CommandKind(self._pause.value.lower())
        self._live.command(kind, value=self._step.value if kind == CommandKind.STEP else 0.0)

    def _command_agent(self) -> None:
        self._live.command(CommandKind(self._agent.value.lower()), agent=self._selected())

    def _command_speed(self) -> None:
        self._live.command(CommandKind.SPEED, value=_SPEEDS[self._speed.value])

    def _command_loss(self) -> None:
        self._live.command(CommandKind.LOSS, value=self._loss.value / 100.0)

    def _command_delay(self) -> None:
        self._live.command(CommandKind.DELAY, value=self._delay.value / 1000.0)


def _by_visitors(act: Callable[[], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
    """Act on what visitors do alone: viser also calls back when show() sets a value."""
    return in_loop(lambda event: act() if event.client is not None else None)

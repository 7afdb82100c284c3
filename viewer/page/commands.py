"""The command panel: pause and pace, the network, and what becomes of the selected agent."""

from collections.abc import Callable, Coroutine
from typing import Any

import viser

from phalanx.faults.commands import CommandKind
from phalanx.viewer.feeds.live import Live
from phalanx.viewer.scene.server import in_loop
from phalanx.wire.frames import Frame

_SPEEDS = {"as fast as possible": 0.0, **{f"{s:g} ×": s for s in (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)}}

_ON_AGENT = ("Kill", "Restart", "Freeze", "Thaw", "Turn")


class CommandPanel:
    """Commands to a live run; only on pages of a viewer that the plant obeys."""

    def __init__(self, server: viser.ViserServer, live: Live, selected: Callable[[], str]) -> None:
        """selected tells the name of the agent that commands to an agent are meant for."""
        gui = server.gui
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
        """Take the panel off the page: nobody is there to command."""
        self._folder.remove()

    def show(self, frame: Frame) -> None:
        """Let the sliders say what the plant does, whoever asked for it."""
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

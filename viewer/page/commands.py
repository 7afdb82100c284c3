"""Commands to a live run: pause and pace, the network, and what befalls the chosen agent."""

from collections.abc import Callable
from typing import Any

import viser

from phalanx.faults.commands import CommandKind
from phalanx.viewer.feeds.live import Live
from phalanx.wire.frames import Frame

_SPEEDS = {"as fast as possible": 0.0, **{f"{s:g} ×": s for s in (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)}}


class Controls:
    """Only there for a viewer with the control secret; the plant refuses all others anyway."""

    def __init__(self, server: viser.ViserServer, live: Live, chosen: Callable[[], str]) -> None:
        """chosen tells the name of the agent that kill, freeze, thaw and turn are meant for."""
        gui = server.gui
        self._live, self._chosen = live, chosen
        with gui.add_folder("Command", order=10):
            self._pause = gui.add_button_group("Run", ("Pause", "Resume", "Step"))
            self._step = gui.add_number("Step [s]", 0.01, min=0.001, max=10.0, step=0.001)
            self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS))
            self._loss = gui.add_slider("Loss [%]", min=0, max=100, step=1, initial_value=0)
            self._delay = gui.add_slider("Delay [ms]", min=0, max=500, step=1, initial_value=0)
            self._fate = gui.add_button_group("Agent", ("Kill", "Freeze", "Thaw", "Turn"))
        self._pause.on_click(lambda _: self._on_pause())
        self._fate.on_click(lambda _: self._on_fate())
        self._speed.on_update(self._by_hand(self._on_speed))
        self._loss.on_update(self._by_hand(self._on_loss))
        self._delay.on_update(self._by_hand(self._on_delay))

    def show(self, frame: Frame) -> None:
        """Let the sliders say what the plant does, whoever asked for it."""
        if frame.loss is not None:
            self._loss.value = round(100.0 * frame.loss)  # type: ignore[misc]
        if frame.delay is not None:
            self._delay.value = round(1000.0 * frame.delay)  # type: ignore[misc]

    def _by_hand(self, act: Callable[[], None]) -> Callable[[viser.GuiEvent[Any]], None]:
        def on_update(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # not our own show()
                act()

        return on_update

    def _on_pause(self) -> None:
        kind = {
            "Pause": CommandKind.PAUSE,
            "Resume": CommandKind.RESUME,
            "Step": CommandKind.STEP,
        }[self._pause.value]
        self._live.command(kind, value=self._step.value if kind == CommandKind.STEP else 0.0)

    def _on_fate(self) -> None:
        self._live.command(CommandKind(self._fate.value.lower()), agent=self._chosen())

    def _on_speed(self) -> None:
        self._live.command(CommandKind.SPEED, value=_SPEEDS[self._speed.value])

    def _on_loss(self) -> None:
        self._live.command(CommandKind.LOSS, value=self._loss.value / 100.0)

    def _on_delay(self) -> None:
        self._live.command(CommandKind.DELAY, value=self._delay.value / 1000.0)

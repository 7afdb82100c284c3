"""The timeline of a replay: scrub, play, pace, step, and jump to what matters."""

import viser

from phalanx.viewer.feeds.replay import Replay

_SPEEDS = {f"{s:g} ×": s for s in (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)}


class Timeline:
    """Moves a replay's cursor, and shows where it is."""

    def __init__(self, server: viser.ViserServer, replay: Replay) -> None:
        gui = server.gui
        self._replay = replay
        marks = {f"{mark.t:.3f} s: {mark.text}": mark.t for mark in replay.marks}
        begin = float(replay.times[0])
        self._shown = begin
        with gui.add_folder("Timeline", order=5):
            self._cursor = gui.add_slider(
                "t [s]", min=begin, max=max(replay.end, begin + 1e-3), step=0.001,
                initial_value=begin,
            )  # fmt: skip
            self._play = gui.add_button_group("Play", ("Play", "Pause"))
            self._step = gui.add_button_group("Step", ("-10", "-1", "+1", "+10"))
            self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1 ×")
            self._mark = gui.add_dropdown("Jump to", tuple(marks))
            jump = gui.add_button("Jump")
        self._cursor.on_update(self._on_scrub)
        self._play.on_click(lambda _: replay.play(self._play.value == "Play"))
        self._step.on_click(lambda _: replay.step(int(self._step.value)))
        self._speed.on_update(lambda _: setattr(replay, "speed", _SPEEDS[self._speed.value]))
        jump.on_click(lambda _: replay.seek(marks[self._mark.value]))

    def show(self) -> None:
        """Put the slider where the cursor is."""
        # A slider elsewhere than it was put was moved by a visitor, and _on_scrub, in a thread of
        # viser's, has yet to read it.
        if self._cursor.value == self._shown:
            self._cursor.value = self._replay.t  # type: ignore[misc]
            self._shown = self._cursor.value

    def _on_scrub(self, event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
        if event.client is not None:  # viser also calls back when show() sets the value
            self._shown = self._cursor.value
            self._replay.seek(self._shown)

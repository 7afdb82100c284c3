"""The explanation of the chosen agent's input at the time shown, made by a program of its own."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import NamedTuple

import msgspec
import viser

from phalanx_viewer.scene.server import SceneServer, in_loop
from phalanx_viewer.scene.texts import Markup, Panel, element, markup

_MOST_SECONDS = 600.0
"""Wall time for a run to be repeated [s]."""


class Moment(NamedTuple):
    """An agent and a time of a recorded run."""

    recording: Path
    agent: str
    t: float
    """[s]"""


class ExplanationPanel:
    """A button and its text, on one visitor's page of a recording."""

    def __init__(
        self, server: SceneServer, gui: viser.GuiApi, moment: Callable[[], Moment]
    ) -> None:
        """`moment` tells what the page shows when the button is pressed."""
        self._server, self._moment, self._asked = server, moment, 0
        self._answering: Thread | None = None
        with gui.add_folder("Explanation", order=80, expand_by_default=False):
            button = gui.add_button("Explain the agent's input")
            self._text = Panel(gui, _texts(["The run is repeated up to the time shown."]))
        button.on_click(in_loop(lambda _: self._ask()))

    def _ask(self) -> None:
        if self._answering and self._answering.is_alive():
            return  # one program at a time
        self._asked += 1
        moment = self._moment()
        self._text.show(_texts([f"Explaining agent {moment.agent} at {moment.t:.3f} s ..."]))
        # Not in the server's thread: it takes as long as the run up to then.
        self._answering = Thread(target=self._answer, args=(moment, self._asked), daemon=True)
        self._answering.start()

    def _answer(self, moment: Moment, number: int) -> None:
        sentences = explained(moment)
        if number == self._asked:  # no newer question
            self._server.run(lambda: self._text.show(_texts(sentences)))


def explained(moment: Moment) -> list[str]:
    """Return the sentences of `phalanx explain`, or those of its error."""
    which = ["--agent", moment.agent, "--at", f"{moment.t!r}", "--json", "--trust"]
    command = [sys.executable, "-m", "phalanx", "explain", str(moment.recording), *which]
    try:
        program = subprocess.run(command, capture_output=True, timeout=_MOST_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return [f"no explanation within {_MOST_SECONDS:g} s"]
    if program.returncode:
        return program.stderr.decode("utf-8", "replace").strip().splitlines()[-3:]
    sentences: list[str] = msgspec.json.decode(program.stdout)["sentences"]
    return sentences


def _texts(sentences: list[str]) -> Markup:
    return markup(*(element("p", text, kind="phalanx-text") for text in sentences))

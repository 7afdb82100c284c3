"""The explanation of the chosen agent's input at the time shown, made by a program of its own."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from subprocess import PIPE
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
        self, server: SceneServer, gui: viser.GuiApi, moment: Callable[[], tuple[Path, str, float]]
    ) -> None:
        """`moment` tells what the page shows when the button is pressed, as Moment has it."""
        self._server, self._moment, self._left = server, moment, False
        self._answering: Thread | None = None
        self.program: subprocess.Popen[bytes] | None = None
        """The program that explains, if one ever did."""
        with gui.add_folder("Explanation", order=80, expand_by_default=False):
            button = gui.add_button("Explain the agent's input")
            self._text = Panel(gui, _texts(["The run is repeated up to the time shown."]))
        button.on_click(in_loop(lambda _: self._ask()))

    def _ask(self) -> None:
        if self._answering and self._answering.is_alive():
            return  # one program at a time
        moment = Moment(*self._moment())
        self._text.show(_texts([f"Explaining agent {moment.agent} at {moment.t:.3f} s ..."]))
        # Not in the server's thread: it takes as long as the run up to then.
        self.program = subprocess.Popen(_command(moment), stdout=PIPE, stderr=PIPE)
        self._answering = Thread(target=self._answer, args=(self.program,), daemon=True)
        self._answering.start()

    def _answer(self, program: subprocess.Popen[bytes]) -> None:
        sentences = _sentences(program)
        if not self._left:
            self._server.run(lambda: self._text.show(_texts(sentences)))

    def leave(self) -> None:
        """Stop the program: its visitor has left."""
        self._left = True
        if self.program is not None:
            self.program.kill()


def _command(moment: Moment) -> list[str]:
    which = ["--agent", moment.agent, "--at", f"{moment.t!r}", "--json", "--trust"]
    return [sys.executable, "-m", "phalanx", "explain", str(moment.recording), *which]


def _sentences(program: subprocess.Popen[bytes]) -> list[str]:
    """Return the sentences of `phalanx explain`, or those of its error."""
    try:
        out, failure = program.communicate(timeout=_MOST_SECONDS)
    except subprocess.TimeoutExpired:
        program.kill()
        return [f"no explanation within {_MOST_SECONDS:g} s"]
    if program.returncode:
        return failure.decode("utf-8", "replace").strip().splitlines()[-3:]
    sentences: list[str] = msgspec.json.decode(out)["sentences"]
    return sentences


def _texts(sentences: list[str]) -> Markup:
    return markup(*(element("p", text, kind="phalanx-text") for text in sentences))

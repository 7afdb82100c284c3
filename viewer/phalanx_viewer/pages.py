"""A run on a page, served by a process of its own for as long as one likes."""

import contextlib
import multiprocessing
import os
import shlex
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from html import escape
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Self

from phalanx.compat.forkserver import without_main
from phalanx.launcher.live import find_live
from phalanx.launcher.programs import (
    configure_logging,
    end_with_launcher,
    redirect_output,
    show_as,
)
from phalanx.launcher.streams import printable
from phalanx.wire.session import HubError

_ANNOUNCED = "viewer: "
_LOG = "viewer.log"
_STARTS = 4
"""So often a page is started at most."""
_TIMEOUT = 5.0
"""For the hub of a run to answer, before it is looked whether that is over [s]."""
_GRACE = 2.5
"""How long a page may outlive who opened it [s]."""


class ViewerPage:
    """The page of one replay; close it, or leave its `with` block, to end the server."""

    def __init__(self, recording: Path, port: int | None = None) -> None:
        """Start to serve; port None takes 8080 or the next free one.

        Raises RuntimeError if the page cannot be served.
        """
        self._recording = recording
        # Who has a Run has read its scenario: what that names was trusted then.
        command = [sys.executable, "-m", "phalanx", "view", str(recording), "--trust"]
        if port is not None:
            command += ["--port", str(port)]
        self._server = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self._server.stdout
        # The command's first line says where the page is; without one it has failed.
        announced = self._server.stdout.readline()
        if not announced.startswith(_ANNOUNCED):
            raise RuntimeError(self._server.communicate()[1].strip() or "the page is not served")
        self.url = announced.removeprefix(_ANNOUNCED).strip()
        """The page's address."""

    def close(self) -> None:
        """End the server."""
        self._server.terminate()
        self._server.communicate()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"ViewerPage({self.url!r})"

    def _repr_html_(self) -> str:
        """The page itself, in a frame, as a notebook shows it; in a saved one there are words."""
        frame = f'<iframe src="{self.url}" width="100%" height="600" style="border:0"></iframe>'
        told = f"served at {self.url} while this program runs"
        again = f"phalanx view {shlex.quote(str(self._recording))}"
        return f"{frame}<p>{escape(told)}; afterwards: <code>{escape(again)}</code></p>"


class LivePage:
    """The page of a run while it goes on, then of its recording; started again if it dies."""

    def __init__(
        self, port: int | None = None, command_secret: bytes = b"", token: str = ""
    ) -> None:
        """Choose where, and serve nothing yet.

        Args:
            port: of the page; None takes 8080 or the next free one.
            command_secret: that of the run, if the page may command it.
            token: what its visitors must show to do so.

        Raises PortTakenError.
        """
        # A Run with a page of its own has no use for viser, which takes a second to import.
        from phalanx_viewer.scene.server import choose_port

        port = choose_port("127.0.0.1", port)
        self.url = f"http://127.0.0.1:{port}{token and f'/?token={token}'}"
        """The page's address, once it is served."""
        self._options = port, command_secret, token
        self._process: BaseProcess | None = None
        self._watch: threading.Thread | None = None
        self._closed = threading.Event()

    def serve(self, folder: Path) -> None:
        """Start to show the run of a folder, where it can be met. Its log is in the run's."""
        self._process = self._start(folder)
        self._watch = threading.Thread(target=self._keep_up, args=(folder,), daemon=True)
        self._watch.start()

    @property
    def served(self) -> bool:
        """Whether the page is there."""
        return self._watch is not None and self._watch.is_alive()

    def wait(self) -> None:
        """Return when the page has ended."""
        while self.served:
            assert self._watch
            self._watch.join(1.0)

    def close(self) -> None:
        """End the page."""
        self._closed.set()
        if self._process is not None:
            self._process.terminate()
        self.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _keep_up(self, folder: Path) -> None:
        """Start the page again when it dies, and say so, but not for ever."""
        for left in reversed(range(_STARTS)):
            assert self._process
            self._process.join()
            if self._closed.is_set() or self._process.exitcode == 0:
                return
            after = "it is started again" if left else f"phalanx view {folder} shows the run"
            died = f"the page died ({_why(self._process, folder)}): {after}"
            print(printable(died), file=sys.stderr)
            if left:
                self._process = self._start(folder)
                if self._closed.is_set():  # meanwhile: nobody else knows of this one
                    self._process.terminate()

    def _start(self, folder: Path) -> BaseProcess:
        context = multiprocessing.get_context("forkserver")
        # A daemon: it ends with this process, however that ends.
        process = context.Process(target=_serve, args=(folder, *self._options), daemon=True)
        with without_main():
            process.start()
        return process


def _why(process: BaseProcess, folder: Path) -> str:
    """How a page ended: the last line of its log is that of a traceback."""
    if process.exitcode is not None and process.exitcode < 0:
        return f"killed by signal {-process.exitcode}"
    log = folder / "logs" / _LOG
    said = log.read_text("utf-8", "replace").split("\n") if log.exists() else []
    return next(filter(None, map(str.strip, reversed(said))), f"exit status {process.exitcode}")


def _serve(folder: Path, port: int, command_secret: bytes, token: str) -> None:
    os.setsid()  # a Ctrl-C in the terminal ends the run; what became of it is still to be seen
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})  # blocked as of all programs
    show_as("phx-viewer")
    redirect_output(folder / "logs" / _LOG)
    end_with_launcher(_GRACE)
    configure_logging()
    from phalanx_viewer.main import run_live, run_replay

    # Who runs a scenario trusts what it names.
    while (found := find_live(folder)) is not None:
        membership = replace(found.membership, timeout=_TIMEOUT)
        with contextlib.suppress(HubError):  # it may be over meanwhile
            sys.exit(
                run_live(
                    membership,
                    recording=folder,
                    command_secret=command_secret,
                    token=token,
                    port=port,
                    trust=True,
                )
            )
    sys.exit(run_replay(folder, port=port, trust=True))

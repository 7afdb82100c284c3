"""A run's page, served by a process of its own."""

import multiprocessing
import os
import shlex
import signal
import sys
import threading
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from html import escape
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from phalanx.launcher.engine import silent
from phalanx.launcher.libraries import start_process
from phalanx.launcher.live import find_live
from phalanx.launcher.programs import configure_logging, redirect_output, show_as
from phalanx.launcher.streams import printable
from phalanx.wire.session import HubError

_LOG = "viewer.log"
_TIMEOUT = 5.0
"""Time for the hub of a run to answer, before checking whether the run is over [s]."""


class ViewerPage(AbstractContextManager["ViewerPage"]):
    """The page of one replay; close it, or leave its `with` block, to end the server."""

    def __init__(self, recording: Path, port: int | None = None) -> None:
        """Start to serve; port None takes 8080 or the next free one.

        Raises RuntimeError if the page cannot be served.
        """
        self._recording = recording
        opened, announce = multiprocessing.Pipe(duplex=False)
        self._server = start_process(_replay, recording, port, announce, daemon=True)
        announce.close()  # or a server that dies would leave recv() waiting
        try:
            url, problem = opened.recv()
        except EOFError:
            url, problem = "", "the page is not served"
        if problem:
            raise RuntimeError(problem)
        self.url: str = url
        """The page's address."""

    def close(self) -> None:
        """End the server."""
        self._server.terminate()
        self._server.join()

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"ViewerPage({self.url!r})"

    def _repr_html_(self) -> str:
        """The page itself in a frame, and its address as text for a saved notebook."""
        frame = f'<iframe src="{self.url}" width="100%" height="600" style="border:0"></iframe>'
        served = escape(f"served at {self.url} while this program runs")
        again = escape(f"phalanx view {shlex.quote(str(self._recording))}")
        return f"{frame}<p>{served}; afterwards: <code>{again}</code></p>"


class LivePage(AbstractContextManager["LivePage"]):
    """The page of a run while it goes on, then of its recording."""

    def __init__(
        self, port: int | None = None, command_secret: bytes = b"", token: str = ""
    ) -> None:
        """Choose the address; serve() opens the page there. Raises PortTakenError.

        port: None takes 8080 or the next free one. command_secret: seals commands, if the page may
        command the run. token: secret in the address of visitors that may do so.
        """
        # Here, because viser takes a second to import, which a ViewerPage does not need.
        from phalanx_viewer.scene.server import choose_port

        port = choose_port("127.0.0.1", port)
        self.url = f"http://127.0.0.1:{port}{token and f'/?token={token}'}"
        """The page's address, once it is served."""
        self._options = port, command_secret, token
        self._process: BaseProcess | None = None
        self._watch: threading.Thread | None = None
        self._closed = threading.Event()

    def serve(self, folder: Path) -> None:
        """Show the run of a folder. The page's log is among the run's logs."""
        self._process = start_process(_serve, folder, *self._options, daemon=True)
        self._watch = threading.Thread(target=self._say_if_it_dies, args=(folder,), daemon=True)
        self._watch.start()

    @property
    def served(self) -> bool:
        """True while the page is served."""
        return self._watch is not None and self._watch.is_alive()

    def wait(self) -> None:
        """Wait until the page has ended."""
        while self.served:
            assert self._watch
            self._watch.join(1.0)

    def close(self) -> None:
        """End the page."""
        self._closed.set()
        if self._process is not None:
            self._process.terminate()
        self.wait()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _say_if_it_dies(self, folder: Path) -> None:
        """Wait until the page has ended; if it died, print why."""
        assert self._process
        self._process.join()
        if not self._closed.is_set() and self._process.exitcode:
            cause = _cause_of_death(self._process, folder)
            words = f"the page died ({cause}): phalanx view {folder} shows the run"
            print(printable(words), file=sys.stderr)


def _cause_of_death(process: BaseProcess, folder: Path) -> str:
    """Reason why a page died; after an exception the last line of its log has it."""
    if process.exitcode is not None and process.exitcode < 0:
        return f"killed by signal {-process.exitcode}"
    log = folder / "logs" / _LOG
    lines = log.read_text("utf-8", "replace").split("\n") if log.exists() else []
    return next(filter(None, map(str.strip, reversed(lines))), f"exit status {process.exitcode}")


def _begin() -> None:
    os.setsid()  # Ctrl-C in the terminal ends the run, whose page still shows the outcome
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})  # blocked in all programs
    show_as("phx-viewer")
    threading.Thread(target=_end_with_opener, daemon=True).start()


def _end_with_opener() -> None:
    # No signal of the kernel: this process is a child of the one that loads the libraries, which
    # lives as long as any that it has started.
    opener = multiprocessing.parent_process()
    assert opener
    opener.join()
    os._exit(3)


def _replay(recording: Path, port: int | None, opened: Connection) -> None:
    """Serve a recording; send the page's address, and why there is none: one of them is empty."""
    _begin()
    from phalanx_viewer.main import run

    try:
        # The caller holds a Run, so it has already trusted the code that its scenario names.
        run(None, recording, port=port, trust=True, announce=lambda url: opened.send((url, "")))
    except (RuntimeError, ValueError, OSError) as error:
        opened.send(("", str(error)))


def _serve(folder: Path, port: int, command_secret: bytes, token: str) -> None:
    _begin()
    redirect_output(folder / "logs" / _LOG)
    configure_logging()
    from phalanx_viewer.main import run

    # A user who runs a scenario trusts the code that it names. Nothing is announced: output goes to
    # the log, which is no place for the token. The launcher prints the address on the terminal.
    while (live := find_live(folder)) is not None:
        membership = replace(live, timeout=_TIMEOUT)
        with suppress(HubError):  # it may be over meanwhile
            sys.exit(
                run(
                    membership, folder, command_secret=command_secret, token=token, port=port,
                    trust=True, announce=silent,
                )
            )  # fmt: skip
    sys.exit(run(None, folder, port=port, trust=True, announce=silent))

"""A run on a page, served by a process of its own for as long as one likes."""

import multiprocessing
import os
import pkgutil
import subprocess
import sys
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import TracebackType
from typing import Self

from phalanx.launcher.libraries import without_main
from phalanx.launcher.live import find_live
from phalanx.launcher.programs import (
    configure_logging,
    end_with_launcher,
    redirect_output,
    show_as,
)

_ANNOUNCED = "viewer: "
_GRACE = 2.5
"""How long a page may outlive who opened it [s]."""


class ViewerPage:
    """The page of one replay; close it, or leave its `with` block, to end the server."""

    def __init__(self, recording: Path, port: int | None = None) -> None:
        """Start to serve; port None takes 8080 or the next free one.

        Raises RuntimeError if the page cannot be served.
        """
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
        """Where the page is."""

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
        """The page itself, in a frame, as a notebook shows it."""
        return f'<iframe src="{self.url}" width="100%" height="600" style="border:0"></iframe>'


def serve_live(folder: Path, port: int | None = None, command_secret: bytes = b"") -> BaseProcess:
    """Start a page that shows the run of a folder while it goes on, then its recording.

    Args:
        folder: of a run that can be met there.
        port: of the page; by default 8080 or the next free one.
        command_secret: that of the run, if the page may command it.

    Returns:
        The process, which ends when it is terminated, or with this one. Its log is in the run's.
    """
    context = multiprocessing.get_context("forkserver")
    # A daemon: it ends with this process, however that ends.
    process = context.Process(target=_serve, args=(folder, port, command_secret), daemon=True)
    with without_main():
        process.start()
    return process


def _serve(folder: Path, port: int | None, command_secret: bytes) -> None:
    os.setsid()  # a Ctrl-C in the terminal ends the run; what became of it is still to be seen
    show_as("phx-viewer")
    redirect_output(folder / "logs" / "viewer.log")
    end_with_launcher(_GRACE)
    configure_logging()
    found = find_live(folder)
    program = "run_replay" if found is None else "run_live"
    show = pkgutil.resolve_name(f"phalanx.viewer.main:{program}")
    if found is None:
        sys.exit(show(folder, port=port, trust=True))
    # Who runs a scenario trusts what it names.
    options = {"recording": folder, "command_secret": command_secret, "trust": True}
    sys.exit(show(None, found.membership, port=port, **options))

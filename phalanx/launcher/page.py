"""A recorded run on a page, served by a process of its own for as long as one likes."""

import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

_ANNOUNCED = "viewer: "


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

"""Output of commands, with control characters escaped."""

import sys
from typing import TYPE_CHECKING

from phalanx.launcher.streams import printable

if TYPE_CHECKING:
    from phalanx.recording.read import Recording


def echo(*lines: object) -> None:
    """Print each line."""
    print("\n".join(map(printable, lines)), flush=True)


def echo_error(error: object) -> None:
    """Print an error, which may have several lines, to standard error."""
    print("\n".join(map(printable, str(error).split("\n"))), file=sys.stderr)


def warn_of_damage(recording: "Recording") -> None:
    """Print to standard error where a damaged recording ends."""
    if recording.damage:
        echo_error(f"{recording.path}: {recording.damage}; no verdict")

"""Output of commands, every text of it printable."""

import sys
from typing import TYPE_CHECKING

from phalanx.launcher.streams import printable

if TYPE_CHECKING:
    from phalanx.recording.read import Recording


def say(*lines: object) -> None:
    """Print each line."""
    print("\n".join(map(printable, lines)), flush=True)


def complain(error: object) -> None:
    """Print an error, which may have several lines, to standard error."""
    print("\n".join(map(printable, str(error).split("\n"))), file=sys.stderr)


def warn_of_damage(recording: "Recording") -> None:
    """Say on standard error where the recording ends, if it is before its end."""
    if recording.damage:
        complain(f"{recording.path}: {recording.damage}; no verdict")

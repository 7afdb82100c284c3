"""What a command says of a recording that is not whole."""

from phalanx.cli.terminal import complain
from phalanx.recording.read import Recording


def warn_of_damage(recording: Recording) -> None:
    """Say on standard error where the recording ends, if it is before its end."""
    if recording.damage:
        complain(f"{recording.path}: {recording.damage}; no verdict")

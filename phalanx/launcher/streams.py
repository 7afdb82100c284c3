"""Standard streams: reopen closed ones, survive closed pipes, and print text with escapes."""

import io
import logging
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing_extensions import Buffer

    from phalanx.recording.read import Recording


def open_closed_streams() -> None:
    """Open closed standard streams on /dev/null: else another file gets their numbers."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # open takes the lowest free number, which is this one.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def ignore_closed_pipes() -> None:
    """Drop output to a pipe once its reader has closed it, in place of a BrokenPipeError."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or stream is not getattr(sys, f"__{name}__"):
            continue  # closed or replaced
        pipe = _Pipe(stream.fileno(), "w", closefd=False)
        text = io.TextIOWrapper(
            # As Python does under PYTHONUNBUFFERED.
            pipe if stream.write_through else io.BufferedWriter(pipe),
            stream.encoding,
            stream.errors,
            line_buffering=stream.line_buffering,
            write_through=stream.write_through,
        )
        setattr(sys, name, text)


class _Pipe(io.FileIO):
    def write(self, data: "Buffer", /) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, self.fileno())
            os.close(null)
            return super().write(data)


def printable(text: object) -> str:
    """Return a text on one line, with control characters and the like as escapes.

    Escaped are control characters, line breaks and marks of the reading direction: a text from a
    run or a recording cannot control the terminal.
    """
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(text))


def echo(*lines: object) -> None:
    """Print each line.

    >>> echo("3 runs")
    3 runs
    """
    print("\n".join(map(printable, lines)), flush=True)


def echo_error(error: object) -> None:
    """Print an error, which may have several lines, to standard error.

    >>> echo_error("disk full")
    """
    print("\n".join(map(printable, str(error).split("\n"))), file=sys.stderr)


def warn_of_damage(recording: "Recording") -> None:
    """Print to standard error where a damaged recording ends."""
    if recording.damage:
        echo_error(f"{recording.path}: {recording.damage}; no verdict")


class PrintableFormatter(logging.Formatter):
    """Escapes messages by `printable`; tracebacks keep their lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """Format the line without its traceback."""
        return printable(super().formatMessage(record))

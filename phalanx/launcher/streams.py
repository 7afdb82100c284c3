"""Standard input, output and error: open where they were closed, and fit for a terminal."""

import io
import logging
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing_extensions import Buffer


def open_closed_streams() -> None:
    """Open what is closed of the three: else a pipe or a file takes its number, and its prints."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            # The lowest number that is free, which is this one.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def outlive_readers() -> None:
    """From now on drop what is printed to a pipe that nobody reads any more."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or stream is not getattr(sys, f"__{name}__"):
            continue  # closed, or somebody else's
        pipe = _Pipe(stream.fileno(), "w", closefd=False)
        text = io.TextIOWrapper(
            # As Python does where PYTHONUNBUFFERED asks for it.
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
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return super().write(data)


def printable(text: object) -> str:
    """A text on one line, with characters that a terminal obeys or does not show as escapes.

    Those are control characters, line breaks and marks of the reading direction: what a run or a
    recording says stays text, whatever it holds.
    """
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(text))


class PrintableFormatter(logging.Formatter):
    """Writes messages as printable; tracebacks keep their lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """The line without its traceback."""
        return printable(super().formatMessage(record))

"""Text of a run or a recording as a terminal may show it: it stays text, whatever it holds."""

import logging


def printable(text: object) -> str:
    """A text on one line, with characters that a terminal obeys or does not show as escapes.

    Those are control characters, line breaks and marks of the reading direction.
    """
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in str(text))


class PrintableFormatter(logging.Formatter):
    """Writes messages as printable; tracebacks keep their lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """The line without its traceback."""
        return printable(super().formatMessage(record))

"""What commands print, every text of it printable."""

import sys

from phalanx.launcher.printable import printable


def say(*lines: object) -> None:
    """Print each line."""
    print("\n".join(map(printable, lines)), flush=True)


def complain(error: object) -> None:
    """Print an error, which may have several lines, to standard error."""
    print("\n".join(map(printable, str(error).split("\n"))), file=sys.stderr)

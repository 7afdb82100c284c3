"""The command `phalanx`, which is also `python -m phalanx`."""

import os
import sys

from phalanx.launcher import interrupt
from phalanx.launcher.streams import open_closed_streams


def main() -> None:
    """Run the command and exit with its status."""
    open_closed_streams()
    interrupt.install()
    # Matrices here are small. More threads only take memory; with too little of it OpenBLAS hangs
    # while it is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        # A Ctrl-C during the import would end in a traceback.
        from phalanx.cli.app import status
    except KeyboardInterrupt:
        sys.exit(130)
    except (MemoryError, ImportError) as error:
        # Under a tight limit of memory often a library's file cannot be mapped.
        print(f"too little memory, or a broken installation: {error}", file=sys.stderr)
        sys.exit(3)
    sys.exit(status(sys.argv[1:]))


if __name__ == "__main__":
    main()

"""The command `phalanx`, which is also `python -m phalanx`."""

import sys


def main() -> None:
    """Run the command and exit with its status."""
    try:
        # Loading takes a part of a second, in which a Ctrl-C would end in a traceback.
        from phalanx.cli.app import status
    except KeyboardInterrupt:
        sys.exit(130)
    sys.exit(status(sys.argv[1:]))


if __name__ == "__main__":
    main()

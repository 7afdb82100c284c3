"""Extensions, found by the entry points of installed packages.

A package registers commands of `phalanx` in the group `phalanx.commands`, each a function that is
given the typer app; and in `phalanx.extensions`, under the name that the core asks for, what the
core can do without: the report, the page, identities. The core imports none of them.
"""

from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from typing import Any

COMMANDS, EXTENSIONS = "phalanx.commands", "phalanx.extensions"
AGAIN = "install phalanx-swarm again, in place too: python -m pip install --no-deps --editable ."
"""Advice where an installation is older than the code."""


class MissingExtensionError(ImportError):
    """No installed package offers what was asked for; the message names it."""


def extension(name: str) -> Any:
    """Load what is registered under a name. Raises MissingExtensionError, or as its import does."""
    for found in entry_points(group=EXTENSIONS, name=name):
        return found.load()
    raise MissingExtensionError(f"no installed package offers {name!r}: {AGAIN}")


def commands() -> Iterator[tuple[str, Callable[[Any], None] | Exception]]:
    """Functions that add commands to the app, in the order of their names, or why there is none.

    Each comes with what it is registered as, and by which package.
    """
    for found in sorted(entry_points(group=COMMANDS), key=lambda found: found.name):
        package = found.dist.name if found.dist else "unknown"
        try:
            register = found.load()
        except Exception as error:  # another package's code
            register = error
        yield f"{found.name} of {package}", register

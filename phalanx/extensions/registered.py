"""Extensions, found by the entry points of installed packages.

A package registers commands of `phalanx` in the group `phalanx.commands`, each a function that is
given the typer app; and in `phalanx.extensions`, under the name that the core asks for, what the
core can do without: the report, the page, identities. The core imports none of them.
"""

from collections.abc import Callable
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple

COMMANDS, EXTENSIONS = "phalanx.commands", "phalanx.extensions"
PACKAGE = "phalanx-swarm"
AGAIN = "install phalanx-swarm again, in place too: python -m pip install --no-deps --editable ."
"""Advice where an installation is older than the code."""


class MissingExtensionError(ImportError):
    """No installed package offers what was asked for; the message names it."""


def extension(name: str) -> Any:
    """Load what is registered under a name. Raises MissingExtensionError, or as its import does."""
    for found in entry_points(group=EXTENSIONS, name=name):
        return found.load()
    raise MissingExtensionError(f"no installed package offers {name!r}: {AGAIN}")


class Registered(NamedTuple):
    """An entry of the group `phalanx.commands`."""

    name: str
    package: str
    register: Callable[[Any], None] | BaseException
    """Adds commands to the app; or why it cannot be imported."""

    @property
    def ours(self) -> bool:
        """Whether Phalanx itself brings it."""
        return self.package == PACKAGE


def commands() -> list[Registered]:
    """What is registered, in the order of names; other packages' after ours."""
    found = [_loaded(entry) for entry in entry_points(group=COMMANDS)]
    return sorted(found, key=lambda entry: (not entry.ours, entry.name))


def _loaded(entry: EntryPoint) -> Registered:
    package = entry.dist.name if entry.dist else "unknown"
    try:
        return Registered(entry.name, package, entry.load())
    except (Exception, SystemExit) as error:  # another package's code
        return Registered(entry.name, package, error)

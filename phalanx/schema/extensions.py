"""Extensions, found by the entry points of installed packages.

A package registers commands of `phalanx` in the group `phalanx.commands`, each a function that
takes the typer app. In `phalanx.extensions` it registers optional functions by the names that the
core uses: the report, the page. The core imports none of them.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple

COMMANDS, EXTENSIONS = "phalanx.commands", "phalanx.extensions"
PACKAGE = "phalanx-swarm"
HERE = "."
"""This repository's folder, from which pip installs as long as no index has it."""
REINSTALL = (
    "install phalanx-swarm again, in place too: python -m pip install --no-deps --editable ."
)
"""Advice where an installation is older than the code."""

EXTRAS: Mapping[str, str] = {
    "matplotlib": "view",
    "PIL": "view",
    "trimesh": "view",
    "viser": "view",
    "websockets": "view",
    "polars": "lab",
}
"""The extra of Phalanx that brings a library, by the library's module."""
PACKAGES: Mapping[str, str] = {
    "attack": "phalanx-attacks",
    "certify": "phalanx-certify",
    "explain": "phalanx-explain",
    "fit": "phalanx-worlds",
    "keys": "phalanx-hosts",
    "mcap": "phalanx-mcap",
    "open_study": "phalanx-studies",
    "replay": "phalanx-attacks",
    "reproduce": "phalanx-paper",
    "ros2": "phalanx-ros2",
    "router": "phalanx-hosts",
    "shrink": "phalanx-attacks",
    "study": "phalanx-studies",
    "test-agent": "phalanx-testing",
}
"""The package of this repository that brings a command or an extension, by its name."""
STUDIES, ON_STUDIES = "phalanx-studies", ("phalanx-attacks", "phalanx-testing")
"""A package that others need, and those; no index has it either."""


class MissingExtensionError(ImportError):
    """A library, package or extension that the message names is not installed."""


@contextmanager
def extras_named() -> Iterator[None]:
    """Say which extra brings a library that an import in the block lacks.

    Raises MissingExtensionError.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if extra := EXTRAS.get(str(error.name).partition(".")[0]):
            words = f"needs {error.name}: pip install '{HERE}[{extra}]'"
            raise MissingExtensionError(words) from error
        raise


def extension(name: str) -> Any:
    """Load the extension of this name. Raises MissingExtensionError, or as its import does."""
    for entry in entry_points(group=EXTENSIONS, name=name):
        with extras_named():
            return entry.load()
    raise missing(name)


def installing(package: str) -> str:
    """Return the command that installs a package of this repository."""
    studies = f"{installing(STUDIES)} " if package in ON_STUDIES else "pip install "
    return f"{studies}{HERE}/packages/{package}"


def missing(name: str) -> MissingExtensionError:
    """Return the error that says what to install for a command or an extension."""
    if package := PACKAGES.get(name):
        return MissingExtensionError(f"needs {package}: {installing(package)}")
    return MissingExtensionError(f"no installed package offers {name!r}: {REINSTALL}")


class Registered(NamedTuple):
    """An entry of the group `phalanx.commands`."""

    name: str
    package: str
    register: Callable[[Any], None] | BaseException
    """The function that adds commands to the app, or the error of its import."""

    @property
    def ours(self) -> bool:
        """True for an entry of Phalanx itself."""
        return self.package == PACKAGE


def commands() -> list[Registered]:
    """Return all entries in the order of names, other packages' after ours."""
    entries = [_loaded(entry) for entry in entry_points(group=COMMANDS)]
    return sorted(entries, key=lambda entry: (not entry.ours, entry.name))


def _loaded(entry: EntryPoint) -> Registered:
    package = entry.dist.name if entry.dist else "unknown"
    try:
        return Registered(entry.name, package, entry.load())
    except (Exception, SystemExit) as error:  # another package's code
        return Registered(entry.name, package, error)
